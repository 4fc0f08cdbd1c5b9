"""Fault matrix with the yield inputs wired: their alarms are expected, and lead back to work."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.iomap.loader import DEFAULT_IO_MAP
from plant_sim.fault_matrix.cases import Subject, subjects
from plant_sim.fault_matrix.judge import complaints
from plant_sim.fault_matrix.run import MatrixSetup, run_case
from plant_sim.faults import FAULTS, Fault, FaultError
from plant_sim.stories.drawn.draw import menu_of
from plant_sim.twin.lock_step import Twin
from tests.sampling import first_of
from tests.wiring import YIELD, wired

IN_MS = 30_000
"""Time of the faults, during the second row of each arm."""


@pytest.fixture(scope="module")
def setting(tmp_path_factory: pytest.TempPathFactory) -> MatrixSetup:
    """Return a trial with the yield inputs wired."""
    path: Path = tmp_path_factory.mktemp("map") / "io_map.yaml"
    lines = DEFAULT_IO_MAP.read_text(encoding="utf-8").splitlines()
    with_wires = [
        line.replace("wired: false", "wired: true") if any(tag in line for tag in YIELD) else line for line in lines
    ]
    path.write_text("\n".join(with_wires), encoding="utf-8")
    return MatrixSetup(io_map=path)


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
    setting: MatrixSetup, kind: str, target: str, size: float | None, signals: set[str]
) -> None:
    fault = Fault(kind, target, IN_MS, size=size)
    outcome = run_case(fault, setting)
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
