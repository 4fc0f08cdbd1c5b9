"""Proof of the machine program by function calls and by commands; the monitors do not affect the program."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import pytest

from controller.cli.main import main
from controller.cli.prove import prove_command
from controller.core.expr import Bit, Word, evaluate
from controller.core.rungs import Out, written_devices
from controller.core.specification import ComputedProperty, Invariant, Limit, Requirement, WayOut
from controller.program.machine import build
from controller.program.requirements.proof import specification
from controller.program.states import State
from controller.verify.cells import ModelError
from controller.verify.report import CONSISTENT, Result, prove
from plant_sim.twin.lock_step import Twin
from tests.controller.core.core_rig import x, y
from tests.controller.verify.proof_rig import MACHINE, SOUND, seconds
from tests.controller.verify.verify_rig import specification_of
from tests.sampling import first_of, one_in
from tests.wiring import YIELD, wired

RULE, GOAL = "left: down at feed only", "left: down away from feed"
STEPS: list[Bit] = [bit for sequence in MACHINE.program.sequences() for bit, _ in sequence]
NOT_GOALS = {"remembered", "assumptions"}
"""Tables of a specification whose entries are no goals."""


def result_of(goal: object) -> Result:
    """Return the result that an entry of the specification has in a report without a finding.

    Raises:
        TypeError: The kind of the entry is unknown here.
    """
    match goal:
        case Invariant() | Requirement() | WayOut():
            return Result.PROVED
        case ComputedProperty(explores=explores):
            return Result.EXPLORED if explores else Result.PROVED
        case Limit():
            return Result.LISTED
    raise TypeError(f"state which result a {type(goal).__name__} of a specification must have")


TABLES = {
    each.name: {goal.name: result_of(goal) for goal in getattr(SOUND, each.name)}
    for each in fields(SOUND)
    if each.name not in NOT_GOALS and isinstance(getattr(SOUND, each.name), tuple)
}
"""Expected results by name, for every table of goals of the specification."""
ALWAYS = TABLES.pop("invariants") | TABLES.pop("requirements") | {CONSISTENT: Result.POSSIBLE}
SAMPLED = [{f"{bit} {bit.name}": Result.POSSIBLE for bit in STEPS}, *TABLES.values()]


# ---- complete program -------------------------------------------------------------------------------------------


PROGRESS = re.compile(
    r"\d+ s: (check|step or way out|limit) \d+ of \d+|\d+ s: requirements and invariants: \d+ together"
)


COMPLETE_PROOF_S = 1_800
"""End of a hang, s; the complete proof takes two to five minutes, according to what else the computer does."""


def expected_results(every: int) -> dict[str, Result]:
    """Return the results by name: all requirements and invariants, and one in `every` of each other kind of goal.

    A limit takes as long as everything else together, so that limits are omitted unless `every` is 1.
    """
    sampled = SAMPLED if every == 1 else [table for table in SAMPLED if Result.LISTED not in table.values()]
    return ALWAYS | {name: table[name] for table in sampled for name in [*table][::every]}


def test_every_goal_of_the_proof_is_expected() -> None:
    """The names that a proof knows are those of the specification and the steps, so no kind of goal is missing here."""
    with pytest.raises(ModelError) as error:
        prove(SOUND, clock=seconds, only=["no such goal"])
    known = str(error.value).removeprefix("unknown goal 'no such goal'; known: ")
    assert sorted(known.split(", ")) == sorted(", ".join(expected_results(every=1)).split(", "))


@pytest.mark.timeout(COMPLETE_PROOF_S + 100)
@pytest.mark.parametrize("every", first_of([40, 1]))
def test_the_proof_succeeds(every: int) -> None:
    """Every goal has the result that the specification demands: requirements are proved, limits are not provable.

    One step in forty, and one in forty of the ways out and checks are proved by default; all of them, the limits, and
    the exploration of homing every night. The limits of a small program are shown by default in test_limits.py.
    """
    expected = expected_results(every)
    goals = [] if every == 1 else [f"--goal={name}" for name in expected]
    command = [sys.executable, "-m", "controller", "prove", "--json", *goals]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=COMPLETE_PROOF_S)
    assert [line for line in done.stderr.splitlines() if not PROGRESS.fullmatch(line)] == []
    report = json.loads(done.stdout)
    assert len(report["rows"]) == len(expected)
    assert {row["name"]: row["result"] for row in report["rows"]} == expected
    assert (done.returncode, report["good"]) == (0, True)


@pytest.mark.nightly
def test_a_machine_with_a_reset_button_is_proved() -> None:
    """The optional button is one of the buttons that are off in a way out."""
    goals = {"a press that may reset is one of the reset button", "reset: from Stopped to Resetting"}
    report = prove(specification(build(wired("reset"))), clock=seconds, only=goals)
    assert {row.name for row in report.rows if row.result is Result.PROVED} >= goals


@pytest.mark.nightly
@pytest.mark.timeout(COMPLETE_PROOF_S + 100)
@pytest.mark.parametrize("points", [("guard",), ("horn",), ("guard", "horn"), YIELD], ids=" and ".join)
def test_a_machine_with_optional_points_is_proved(points: tuple[str, ...]) -> None:
    """Requirements and invariants hold with the optional points wired, and orders lead to homing and work."""
    demands = specification(build(wired(*points)))
    work = ("reset", "start", "unhold", "mode", "emergency stop")
    goals = {each.name for each in demands.requirements} | {each.name for each in demands.invariants}
    goals |= {way.name for way in demands.ways_out if way.name.startswith(work)}
    report = prove(demands, clock=seconds, only=goals)
    assert {row.name for row in report.rows if row.result is Result.PROVED} >= goals


# ---- commands ---------------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_a_violation_is_reported_saved_and_replayed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """If a rule is omitted, the violation is printed and its trace is saved; a replay with the rule shows none."""
    assert main(["prove", "--without", RULE, "--goal", GOAL, "--traces", str(tmp_path)]) == 1
    report = capsys.readouterr().out
    assert f"{GOAL}: violated" in report
    assert "left.lift_extend on" in report
    [trace] = tmp_path.iterdir()
    assert trace.name == "left-down-away-from-feed.json"
    assert main(["replay", str(trace), "--without", RULE]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "the requirement is violated"
    assert main(["replay", str(trace)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "the requirement holds"


def trace_file(folder: Path, **fields: object) -> Path:
    scan = {"at_ms": 0, "inputs": [], "written": {}}
    trace = {"goal": GOAL, "start": "the first power-up", "retained": {}, "forced": {}, "scans": [scan]}
    path = folder / "trace.json"
    path.write_text(json.dumps(trace | fields), encoding="utf-8")
    return path


def scan_of(**fields: object) -> list[dict[str, object]]:
    return [{"at_ms": 0, "inputs": [], "written": {}} | fields]


RETAINED = "power-up with retained values that the invariants allow"
TRACES: dict[str, tuple[dict[str, object], str]] = {
    "another goal": ({"goal": "no such goal"}, "the program has no goal 'no such goal'"),
    "another memory": ({"start": RETAINED, "retained": {"D200": 1}}, "specify the omitted rules"),
    "another edge": ({"forced": {"E999": 1}}, "specify the omitted rules"),
    "no scan": ({"scans": []}, "not a trace"),
    "no time": ({"scans": scan_of(at_ms="now")}, "not a trace"),
    "no number": ({"scans": scan_of(written={"M400": "on"})}, "not a trace"),
    "no terminal": ({"scans": scan_of(inputs=["X8"])}, "'X8': unknown device"),
    "no device": ({"scans": scan_of(written={"M9999": 1})}, "'M9999': out of range for an FX2N"),
}


@pytest.mark.parametrize(("fields", "expected"), one_in(4, TRACES.values()), ids=TRACES)
def test_a_trace_that_cannot_be_replayed_is_reported_in_one_line(
    fields: dict[str, object], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file that is not a trace, or is a trace of another program, is named in a one-line error."""
    path = trace_file(tmp_path, **fields)
    assert main(["replay", str(path)]) == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert str(path) in printed.err
    assert expected in printed.err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["prove", "--short", "--goal", "left: no such goal"], "unknown goal 'left: no such goal'"),
        (
            ["prove", "--without", "left: no such rule"],
            "unknown interlock rule 'left: no such rule'; known: left: not with",
        ),
        (["prove", "--traces", "pyproject.toml/traces"], "--traces pyproject.toml/traces: Not a directory; choose"),
        (["prove", "--report", "no_folder/report"], "--report no_folder/report: No such file or directory; choose"),
        (["prove", "--report", "tests"], "--report tests: Is a directory; choose a writable folder"),
        (["prove", "--report", "pyproject.toml", "--goal", "no goal"], "unknown goal 'no goal'"),
        (["replay", "no_such_trace.json"], "no_such_trace.json'; specify a trace written by 'prove --traces'"),
        (["replay", "tests"], "specify a trace written by 'prove --traces'"),
    ],
)
def test_invalid_input_is_reported_in_one_line_with_exit_code_2(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """An invalid name or path is reported in one line that states the remedy."""
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert expected in printed.err


def test_an_invalid_trace_folder_is_reported_before_the_proof(tmp_path: Path) -> None:
    """If the trace folder is a file, the error is raised before any goal is proved."""
    (tmp_path / "traces").touch()

    def never() -> float:
        raise AssertionError("a proof has begun")

    with pytest.raises(FileExistsError):
        prove_command(specification_of(Out(y(0))), clock=never, goals=None, short=True, traces=tmp_path / "traces")


def test_the_summary_is_printed_and_everything_is_in_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Standard error has the progress: each part of the proof when it begins."""
    limit = Limit("the limit", "X0 is believed", "a second switch", y(0) & x(0))
    bench = specification_of(Out(y(0), when=x(0) & ~x(1)), never=y(0) & x(1))
    bench = replace(bench, assumptions=("the motor stops at once",), limits=(limit,))
    file = tmp_path / "report"
    ticks = iter(range(1_000))
    summary, good = prove_command(bench, clock=lambda: next(ticks), goals=None, report_file=file)
    assert good
    head, _, tail = summary.partition("\n")
    assert re.fullmatch(r"bench: proved: 3 goals, \d+\.0 s", head)
    assert tail.startswith("assumption 1: the motor stops at once\nrequirement ")
    assert "\n\nthe limit: not provable, as listed\n  reason: X0 is believed\n  remedy: a second switch\n  in " in tail
    complete = file.read_text(encoding="utf-8")
    assert "\nthe limit  " in complete
    assert "is violated by" in complete
    assert "is violated by" not in summary
    progress = capsys.readouterr().err.splitlines()
    assert [line for line in progress if not PROGRESS.fullmatch(line)] == []
    assert [line.partition(": ")[2] for line in progress] == [
        "step or way out 1 of 1",
        "requirements and invariants: 1 together",
        "limit 1 of 1",
    ]


# ---- monitors ---------------------------------------------------------------------------------------------------


def test_monitors_write_no_device_of_the_program() -> None:
    """The program neither reads nor writes any device that the monitors write."""
    written = {device for rung in SOUND.monitors.rungs() for device in written_devices(rung)}
    assert {*SOUND.remembered} <= written
    assert written.isdisjoint(MACHINE.program.devices())
    assert all(isinstance(device, Bit | Word) and device.kind in "MTD" for device in written)


@pytest.mark.nightly
def test_monitors_report_nothing_and_change_no_output_in_a_trial() -> None:
    """While a tray is emptied, the outputs of every scan are the same with and without the monitors."""
    alone, watched = Twin(trays=1, set_points={"trays_target": 1}), Twin(trays=1, set_points={"trays_target": 1})
    watched.machine = replace(watched.machine, program=SOUND.watched)
    watched.power_on()
    outputs: dict[int, list[list[bool]]] = {id(alone): [], id(watched): []}
    broken: list[str] = []

    def note(twin: Twin) -> None:
        outputs[id(twin)].append(list(twin.plc.memory.Y))

    def look(twin: Twin) -> None:
        broken.extend(each.name for each in SOUND.requirements if evaluate(each.never, twin.plc.memory))

    watched.watch(look)
    for twin in (alone, watched):
        twin.watch(note)
        twin.home()
        twin.start()
        twin.run_for(90_000)
        assert twin.state is State.COMPLETE
    assert broken == []
    assert len(outputs[id(alone)]) > 3_000
    assert outputs[id(alone)] == outputs[id(watched)]
