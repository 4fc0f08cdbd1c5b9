"""Command ``ladder``, and programs from ladder files run against the plant."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import pytest

from controller.cli.main import main as controller
from controller.export.instruction_list import acting, export
from controller.export.packages import fx2n
from controller.fx.language.check import MOST_STEPS, check
from controller.fx.language.instruction_set import steps
from controller.fx.language.reading import load_ladder
from controller.fx.timing.scan_time import scan_time_bounds
from controller.program.machine import build
from controller.program.memory import lose
from controller.program.states import State
from plant_sim.cli.main import main as plant_sim
from plant_sim.machine.plant import Plant
from plant_sim.twin.ladder import trial as ladder_trial
from plant_sim.twin.lock_step import Twin
from tests.controller.export.fx_equality import EXPORTED
from tests.controller.program.interlock_scene import MACHINE
from tests.paths import ROOT
from tests.sampling import one_in
from tests.wiring import unwired

STEPS = sum(steps(each) for each in EXPORTED.instructions)
"""Program steps of the exported program."""
SEAL_IN = "LD X0\nOR M0\nANI X1\nOUT M0\nLD M0\nOUT T0 K5\nLD T0\nOUT Y0\nEND\n"
STIMULUS = """
scan_ms: 100
scans: 8
inputs:
  - {at_ms: 100, set: {X0: 1}}
  - {at_ms: 200, set: {X0: 0}}
watch: [M0, T0, TN0, Y0]
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "seal-in.il"
    path.write_text(SEAL_IN, encoding="utf-8")
    return path


def test_an_export_can_be_read_back_and_its_size_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert controller(["ladder", "export", "--target", "fx2n", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert f"{STEPS} of 8000 steps" in printed
    assert printed.endswith("fits\n")
    steps_of, facts = printed.splitlines()[2:-6], printed.splitlines()[-6:]
    budget = {title: int(used) for used, title in (line.split(maxsplit=1) for line in steps_of)}
    assert sum(budget.values()) == MOST_STEPS
    assert budget["free"] == MOST_STEPS - STEPS
    assert {"power-up", "scan supervision", "modes", "interlocks and outputs"} <= set(budget)
    assert "the largest with 24 lines, 0 too large for GX Works2" in facts[0]
    assert facts[1].startswith("device comments: ")
    assert facts[2] == "option: a memory cassette has 16000 steps (general knowledge)"
    assert re.match(r"estimated scan time of an FX2N: \d\.\d ms with no step active", facts[3])
    assert facts[4] == "scan supervision: mean of one second at most 12 ms, one scan at most 60 ms"
    read_me = (tmp_path / "README.txt").read_text(encoding="utf-8")
    assert "alarm S902 if the mean scan time in one second exceeds 12 ms" in read_me
    assert f"Memory: {STEPS} steps" in read_me
    assert max(len(text) for text in read_me.splitlines() if not is_of_a_table(text)) <= 120
    assert load_ladder(tmp_path / "transplanter.il") == EXPORTED
    assert load_ladder(tmp_path / "transplanter.csv") == EXPORTED


@pytest.mark.nightly
def test_export_with_pulses_for_the_stepper(tmp_path: Path) -> None:
    assert controller(["ladder", "export", "--target", "fx2n", "--stepper", "plsy", "--out", str(tmp_path)]) == 0
    names = [str(each) for each in load_ladder(tmp_path / "transplanter.il").instructions]
    assert names.count("PLSY K955 K0 Y0") == 1
    assert "OUT Y0" not in names


def test_structured_text_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert controller(["ladder", "export", "--target", "plain", "--out", str(tmp_path)]) == 0
    text = (tmp_path / "transplanter.st").read_text(encoding="utf-8")
    assert text.count("END_PROGRAM") == 1
    lines = capsys.readouterr().out.splitlines()
    assert "fits" not in lines, "Structured Text is for other PLCs"


@pytest.mark.nightly
def test_an_export_with_more_steps_than_an_fx2n_has_names_the_memory_cassette(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fx2n, "MOST_STEPS", STEPS - 1)
    assert controller(["ladder", "export", "--target", "fx2n", "--out", str(tmp_path)]) == 1
    *_, verdict = capsys.readouterr().out.splitlines()
    assert verdict == (
        f"does not fit: more than {STEPS - 1} steps; shorten it, or fit a memory cassette of 16000 steps "
        "(general knowledge)"
    )


def test_check_prints_the_estimated_scan_time_of_a_cpu(program: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert controller(["ladder", "check", str(program), "--cpu", "fx3u"]) == 0
    assert "scan time" not in capsys.readouterr().out
    assert controller(["ladder", "check", str(program)]) == 0
    *_, estimate = capsys.readouterr().out.splitlines()
    assert estimate.startswith("estimated scan time of an FX2N: 0.5 ms with no step active")


def test_the_guide_states_the_estimated_scan_time_of_the_exported_program() -> None:
    bounds = scan_time_bounds(EXPORTED)
    guide = (ROOT / "docs" / "ladder.md").read_text(encoding="utf-8")
    assert f"| shortest | {bounds.shortest_ms:.1f} ms |" in guide
    assert f"| longest | {bounds.longest_ms:.1f} ms |" in guide
    assert f"uses {STEPS:,} of the 8,000 steps" in guide


def test_check_tells_what_was_assumed_about_the_file(program: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program.write_bytes(f"; 启动按钮\n{SEAL_IN}".encode("gbk"))
    assert controller(["ladder", "check", str(program)]) == 0
    first, *_ = capsys.readouterr().out.splitlines()
    assert first == f"{program}:1: note: read as GBK; if a text is wrong, save it as UTF-8"


def test_check_reports_doubts_in_line_order_with_the_findings(
    program: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program.write_text(SEAL_IN.replace("END", "SUB D0 K1 D0\nLD X2\nOUT Y0\nEND"), encoding="utf-8")
    assert controller(["ladder", "check", str(program)]) == 0
    doubt, warning, total, _ = capsys.readouterr().out.splitlines()
    assert doubt.startswith(f"{program}:9: doubt: SUB D0 K1 D0 (step 10): the result can leave -32768 to 32767: ")
    assert warning.startswith(f"{program}:11: warning: OUT Y0 is on lines")
    assert total.endswith("; 0 errors, 1 warnings, 1 doubts")


def test_check_reports_findings_and_size(program: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program.write_text(SEAL_IN.replace("END", "LD X2\nOUT Y0\nEND"), encoding="utf-8")
    assert controller(["ladder", "check", str(program)]) == 0
    printed = capsys.readouterr().out
    assert f"{program}:10: warning: OUT Y0 is on lines 8 and 10" in printed
    assert "of 8000 steps" in printed


@pytest.mark.nightly
def test_the_only_finding_in_the_exported_program_concerns_commands_set_by_an_hmi(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert controller(["ladder", "export", "--target", "fx2n", "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    assert controller(["ladder", "check", str(tmp_path / "transplanter.il")]) == 0
    orders, *rest = capsys.readouterr().out.splitlines()
    assert ": warning:" not in "".join(rest)
    assert re.search(r": warning: M0, M3 to M6, M400 to .*: read but never driven; valid if a screen", orders)
    assert str(MACHINE.tags.system.panel_shown) == "M8", "not read, because the amber lamp shows the questions"
    (orders_without,) = check(export(acting(build(unwired("lamp_amber")).program)))
    assert "M0, M3 to M6, M8, M400 to " in orders_without.text, "without the lamp, the panel sets it"


def test_run_traces_devices_scan_by_scan(program: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stimulus = tmp_path / "stimulus.yaml"
    stimulus.write_text(STIMULUS, encoding="utf-8")
    assert controller(["ladder", "run", str(program), "--stimulus", str(stimulus), "--json"]) == 0
    scans = json.loads(capsys.readouterr().out)["scans"]
    assert [scan["ms"] for scan in scans] == list(range(0, 800, 100))
    assert [scan["M0"] for scan in scans] == [0, 1, 1, 1, 1, 1, 1, 1]
    assert [scan["TN0"] for scan in scans] == [0, 0, 1, 2, 3, 4, 5, 5]
    assert [scan["Y0"] for scan in scans] == [0, 0, 0, 0, 0, 0, 1, 1]
    assert controller(["ladder", "run", str(program), "--stimulus", str(stimulus)]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 9


def test_draw_writes_pictures(program: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "pictures"
    assert controller(["ladder", "draw", str(program), "--out", str(out)]) == 0
    named = capsys.readouterr().out.split("\n")[:-1]
    assert sorted(named) == sorted(map(str, out.iterdir()))
    words = "".join("".join(Xml.parse(path).getroot().itertext()) for path in out.iterdir())  # noqa: S314 - written by this test
    assert {"X0", "X1", "M0", "T0", "Y0"} <= {device for device in ("X0", "X1", "M0", "T0", "Y0") if device in words}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    one_in(
        3,
        [
            (["check", "{0}/none.il"], "cannot be read"),
            (["check", "{0}/wrong.il"], "wrong.il:1:1: LAD X0:"),
            (["run", "{0}/seal-in.il", "--stimulus", "{0}/none.yaml"], "none.yaml"),
            (["draw", "{0}/seal-in.il", "--out", "{0}/seal-in.il"], "seal-in.il"),
            (["export", "--target", "fx2n", "--out", "{0}/no/such/folder"], "no/such/folder"),
            (["export", "--target", "fx2n", "--out", "{0}/seal-in.il"], "seal-in.il"),
        ],
    ),
)
def test_invalid_input_is_reported_in_one_line(
    arguments: list[str], expected: str, program: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "wrong.il").write_text("LAD X0\nOUT Y0\nEND\n", encoding="utf-8")
    assert controller(["ladder", *(argument.format(tmp_path) for argument in arguments)]) == 2
    printed = capsys.readouterr()
    assert expected in printed.err
    assert printed.err.count("\n") == 1
    assert printed.out == ""
    assert program.read_text(encoding="utf-8") == SEAL_IN


@pytest.mark.nightly
def test_the_exported_program_transplants_144_seedlings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the same button presses, the export puts each seedling where the original program does, without incidents.

    The memory of both is lost, and the operator answers the question about the tray. The times of the presses determine
    where the cups are when an arm reaches them, and thus how long the arm holds its row.
    """
    plants: list[Watched] = []

    class Watched(Plant):
        """Plant that records the times at which its buttons are pressed."""

        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            self.pressed: set[tuple[str, int]] = set()
            plants.append(self)

        def step(self, for_ms: int, y: Sequence[bool]) -> None:
            self.pressed |= {(button, self.time_ms) for button in ("start", "stop") if getattr(self.box, button)}
            super().step(for_ms, y)

    assert controller(["ladder", "export", "--target", "fx2n", "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    monkeypatch.setattr(ladder_trial, "Plant", Watched)
    assert plant_sim(["trial", "--ladder", str(tmp_path / "transplanter.csv"), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    (theirs,) = plants
    ours = Twin(seed=1, trays=2, set_points={"trays_target": 2})
    lose(ours.machine.tags, ours.plc)
    while ours.now_ms < 1_000 * report["simulated_s"]:
        ours.plant.box.start, ours.plant.box.stop = (
            (button, ours.now_ms) in theirs.pressed for button in ("start", "stop")
        )
        ours.scan()
    assert ours.state is State.COMPLETE
    assert report["total"] == 144
    assert report["incidents"] == []
    assert report["in_cups"] == ours.plant.counts().in_cups > 120
    assert [seedling.location for seedling in theirs.seedlings] == [
        seedling.location for seedling in ours.plant.seedlings
    ]


@pytest.mark.nightly
def test_the_operator_of_a_trial_confirms_constants_that_differ(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first press of X0 moves nothing; after X25 (alarm S900) and X24, the second asks, the third homes."""
    assert controller(["ladder", "export", "--target", "fx2n", "--set", "clamp=21", "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    assert plant_sim(["trial", "--ladder", str(tmp_path / "transplanter.csv"), "--trays", "1", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["completed"]
    assert (report["presses"], [alarm.split()[0] for alarm in report["alarms"]]) == (4, ["S900"])
    assert report["in_cups"] > 60


def test_a_program_without_outputs_transplants_nothing(program: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program.write_text("LD X0\nOUT M0\nEND\n", encoding="utf-8")
    assert plant_sim(["trial", "--ladder", str(program), "--trays", "1"]) == 1
    printed = capsys.readouterr().out
    assert "in trays untouched 72" in printed
    assert "start pressed 10 times" in printed


def test_a_program_that_never_ends_a_scan_is_stopped_by_its_watchdog(
    program: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program.write_text("P0\nLD M8000\nCJ P0\nEND\n", encoding="utf-8")
    assert plant_sim(["trial", "--ladder", str(program), "--trays", "1"]) == 1
    assert "CPU error 6105, M8061" in capsys.readouterr().out


def is_of_a_table(text: str) -> bool:
    """Return whether a line belongs to a table, whose columns are not divided."""
    return " | " in text or "-+-" in text


def test_find_lists_the_places_of_a_device_and_the_rungs_behind_it(
    program: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert controller(["ladder", "find", str(program), "t0", "--behind", "2"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "T0",
        "  step     5  rung    1  written  OUT T0 K5",
        "  step     8  rung    2  read     LD T0",
        "  behind: rung    1  step     4  LD M0 OUT T0 K5",
        "  behind: rung    0  step     0  LD X0 OR M0 ANI X1 OUT M0",
    ]
    assert controller(["ladder", "find", str(program), "Y7"]) == 1
    assert capsys.readouterr().out == "Y7: not found\n"


def test_find_searches_the_machine_in_both_languages(capsys: pytest.CaptureFixture[str]) -> None:
    alarm = next(iter(MACHINE.alarms))
    for text in (alarm.text.message.zh, alarm.text.message.en.upper()):
        assert controller(["ladder", "find", "--machine", text]) == 0
        assert capsys.readouterr().out.startswith(f"{alarm.bit}  ")


@pytest.mark.parametrize("arguments", [["X1"], ["program.il", "X1", "--machine"]])
def test_find_takes_a_file_or_the_machine(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert controller(["ladder", "find", *arguments]) == 2
    assert "either the file of a program or --machine" in capsys.readouterr().err
