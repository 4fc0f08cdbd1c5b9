"""Fault matrix with the yield inputs wired: their alarms are expected, and lead back to work; the page states it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from controller.common.document.rendering import markdown
from plant_sim.cli.faults import run_matrix
from plant_sim.cli.main import main
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.fault_matrix.cases import Subject, subjects
from plant_sim.fault_matrix.first_signal import Signal
from plant_sim.fault_matrix.judge import complaints
from plant_sim.fault_matrix.report import MatrixRow
from plant_sim.fault_matrix.run import MatrixSetup, Outcome, run_case
from plant_sim.fault_matrix.yield_inputs.fitted import YIELD_INPUTS, YieldResult, fitted_with, rows_to_run
from plant_sim.fault_matrix.yield_inputs.yield_report import parts, silent_harm
from plant_sim.faults import FAULTS, Fault, FaultError, parse_fault
from plant_sim.stories.drawn.draw import menu_of
from plant_sim.twin.lock_step import Twin
from tests.paths import DOCS
from tests.sampling import first_of
from tests.wiring import YIELD, wired

IN_MS = 30_000
"""Time of the faults, during the second row of each arm."""
FITTED = fitted_with(MatrixSetup(), YIELD_INPUTS)
ROWS, OWN = rows_to_run(MatrixSetup(), [])
SECTION = (DOCS / "fault-matrix.md").read_text(encoding="utf-8").partition("## With the yield inputs\n")[2]
SECTION = SECTION.partition("\n## ")[0]
COMPLETE = SECTION.partition("### Complete matrix with the yield inputs\n")[2]
"""Table of all rows with all yield inputs."""


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("kind", "target", "size", "signals"),
    first_of(
        [
            ("leak", "right.claws.minus", 2e-8, {"claw pressure", "close claws"}),
            ("skewed_tray", "magazine", 0.008, {"row short"}),
            ("stuck_on", "right.claw_pressure", None, {"open claws"}),
            ("jammed", "left.claws", None, {"row short"}),
            ("slow_valve", "left.claws", 0.5, {"row short"}),
            ("stuck_valve", "right.claws", None, {"open claws", "close claws"}),
            ("stuck_on", "left.cup_filled", None, {"row short"}),
            ("stuck_off", "right.seedling_beam", None, {"row short"}),
        ]
    ),
)
def test_a_fault_that_was_silent_is_told_as_expected(
    kind: str, target: str, size: float | None, signals: set[str]
) -> None:
    fault = Fault(kind, target, IN_MS, size=size)
    outcome = run_case(fault, FITTED)
    part = target.partition(".")[2] if "." in target else target
    assert outcome.signal is not None
    assert outcome.signal.name in signals
    assert complaints(Subject(kind, part, size, (target,)), outcome) == []


def test_wrong_readings_are_drawn_only_with_a_wired_input() -> None:
    delivered, fitted = Twin(), Twin(io_map=wired(*YIELD))
    menus = [menu_of(twin.machine, twin.plant).faults for twin in (delivered, fitted)]
    assert {*FAULTS} - {*menus[0]} == {"wrong_readings"}
    assert {*menus[1]["wrong_readings"]} == {*YIELD}
    assert [str(row) for row in subjects(fitted.plant, ["wrong_readings:cup_filled"])] == [
        "wrong_readings:cup_filled=0.05"
    ]
    with pytest.raises(FaultError, match="not a wired yield sensor"):
        subjects(delivered.plant, ["wrong_readings:left.cup_filled"])


# --- rows, report, command and page -------------------------------------------------------------


def test_every_row_is_run_without_and_with_the_inputs_which_have_rows_of_their_own() -> None:
    assert subjects(MatrixSetup().twin().plant) == ROWS
    sizes = {"stuck_on": "", "stuck_off": "", "broken_wire": "", "late_sensor": "=0.2", "wrong_readings": "=0.05"}
    assert {str(row) for row in OWN} == {f"{kind}:{name}{sizes[kind]}" for kind in sizes for name in YIELD_INPUTS}
    assert {*FITTED.wires} == {*YIELD}
    rows, own = rows_to_run(MatrixSetup(), ["jammed:claws", "stuck_on:left.cup_filled", "stuck_on:lift_up"])
    assert ([str(each) for each in rows], [str(each) for each in own]) == (
        ["jammed:claws", "stuck_on:lift_up"],
        ["stuck_on:cup_filled"],
    )


def test_a_map_with_a_yield_input_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "io_map.yaml"
    text = MatrixSetup().io_map.read_text(encoding="utf-8")
    path.write_text(re.sub(r"(left.cup_filled.*?)wired: false", r"\1wired: true", text), encoding="utf-8")
    with pytest.raises(FaultError, match=r"wires left\.cup_filled already"):
        rows_to_run(MatrixSetup(io_map=path), [])


def outcome_of(text: str, *, signal: str = "", trips: str = "", lost: int = 0) -> Outcome:
    """Return an outcome with a first signal, a violation and losses."""
    counts = SeedlingCounts(0, 0, 144 - lost, 0, 0, lost, 144)
    told = Signal(signal, "left", 25_000) if signal else None
    return Outcome(parse_fault(text), counts, lost, signal=told, trips={trips: "at 1"} if trips else {})


def test_the_report_counts_silent_harm_and_names_the_input_that_tells_it() -> None:
    (quiet,), (loud,) = ([row for row in ROWS if str(row) == name] for name in ("jammed:claws", "stuck_on:lift_up"))
    silent = outcome_of("jammed:left.claws@20s..", trips="dropped", lost=12)
    told = outcome_of("jammed:left.claws@20s..", signal="row short", trips="dropped", lost=3)
    sound = outcome_of("stuck_on:left.lift_up@20s..", signal="lift switches")
    result = YieldResult(
        without=[MatrixRow(quiet, [silent, silent]), MatrixRow(loud, [sound])],
        fitted=[MatrixRow(quiet, [told, silent]), MatrixRow(loud, [sound])],
        own=[MatrixRow(OWN[0], [outcome_of("stuck_on:left.claw_pressure@20s..", signal="open claws")])],
        single={name: [MatrixRow(quiet, [silent, told if name == "cup_filled" else silent])] for name in YIELD_INPUTS},
    )
    assert silent_harm(result.without) == "1 faults in 2 trials, with 24 seedlings lost in them (`jammed:claws`)"
    assert silent_harm(result.fitted) == "1 faults in 1 trials, with 12 seedlings lost in them (`jammed:claws`)"
    table = cells_of(markdown("Matrix", parts(result), is_literal=False).partition("### Faults")[0])
    assert table["jammed:claws"] == [*"22100011", "row short 1", "24", "12"]
    own_table = cells_of(markdown("Matrix", parts(result), is_literal=False).partition("### Faults")[2])
    assert own_table["stuck_on:claw_pressure"] == ["1", "1", "open claws 1", "0", "-", "-"]


def command(*arguments: str) -> int:
    return main(["faults", "--yield-inputs", "--trays", "1", "--moments", "1", "--jobs", "1", *arguments])


@pytest.mark.parametrize("fault", first_of(["stuck_on:cup_filled", "jammed:claws"]))
def test_the_command_writes_the_comparison(fault: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command("--fault", fault, "--out", str(tmp_path)) == 0
    printed = capsys.readouterr().out
    assert "findings: none" in printed
    assert "silent harm with them: 0 faults in 0 trials, with 0 seedlings lost in them (none)" in printed
    assert f"| `{fault}` | 1 |" in (tmp_path / "fault-matrix-yield.md").read_text(encoding="utf-8")
    assert len((tmp_path / "fault-matrix-yield.csv").read_text(encoding="utf-8").splitlines()) == 2


@pytest.mark.parametrize("other", [["--at-rest"], ["--times", "2"]])
def test_the_comparison_is_one_of_faults_in_motion(other: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert command("--all", *other) == 2
    assert capsys.readouterr().err.startswith("--yield-inputs: compares faults in motion; omit")


def cells_of(table: str) -> dict[str, list[str]]:
    """Return the cells of the rows of a table by fault."""
    lines = [
        [cell.strip() for cell in line.strip("| ").split(" | ")]
        for line in table.splitlines()
        if line.startswith("| `")
    ]
    return {name.strip("`"): cells for name, *cells in lines}


def test_the_headline_of_the_page_is_that_of_its_complete_matrix() -> None:
    table = cells_of(COMPLETE)
    assert list(table) == [str(row) for row in ROWS]
    assert list(cells_of(SECTION.partition("### Faults of the yield inputs")[2].partition("###")[0])) == [
        str(row) for row in OWN
    ]
    silent = {name: int(cells[11]) for name, cells in table.items() if cells[11] != "-"}
    harm = [int(cells[10]) for cells in table.values() if cells[10] != "-"]
    stated = re.search(r"With all of them: (\d+) faults, (\d+) trials: .*? Harm by (\d+) faults in (\d+) ", SECTION)
    assert stated is not None
    trials = sum(int(cells[0]) for cells in table.values())
    assert [int(number) for number in stated.groups()] == [len(table), trials, len(harm), sum(harm)]
    told = re.search(
        r"With all of them: (\d+) faults in (\d+) trials, with \d+ seedlings lost in them \((.*?)\)", SECTION
    )
    assert told is not None
    assert (int(told[1]), int(told[2])) == (len(silent), sum(silent.values()))
    assert told[3] == (", ".join(f"`{name}`" for name in silent) or "none")
    assert all(cells[-1] == "-" for cells in table.values())


@pytest.mark.parametrize("kind", first_of([*FAULTS], 0))
def test_the_complete_matrix_is_that_of_the_program(kind: str) -> None:
    moments = re.search(r"--yield-inputs --moments (\d+)", SECTION)
    assert moments is not None
    chosen = [row for row in ROWS if row.kind == kind]
    rows = run_matrix(chosen, FITTED, moments=int(moments[1]), jobs=1)
    table = cells_of(COMPLETE)
    assert {str(row.subject): list(row.cells()[1:]) for row in rows} == {str(row): table[str(row)] for row in chosen}
