"""The program as a ladder: an observed scan from the memory of the soft PLC gives the memory of the soft PLC."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, ClassVar

import pytest

from controller.core.devices import Memory
from controller.core.program import Program
from controller.core.scan import Execution, Plc
from controller.events.kinds import AlarmEvent
from controller.export.instruction_list import SCRATCH, program_ladder
from controller.fx.language.il import read_il, write_il
from controller.fx.language.instruction import DeviceOperand
from controller.fx.observation.observed_plc import ObservedPlc
from controller.program.states import State
from plant_sim.faults import parse_fault
from plant_sim.twin import lock_step as twin_module
from plant_sim.twin.lock_step import Twin
from tests.controller.export import fx_equality
from tests.controller.export.fx_equality import stories
from tests.controller.program.interlock_scene import MACHINE
from tests.sampling import first_of

LADDER = program_ladder(MACHINE.program)
ROWS = [field.name for field in fields(Memory)]
SPECIAL = 8000
"""First of the special relays and registers, which the simulated FX2N writes and the soft PLC mostly does not have."""


def rows_of(memory: Memory) -> dict[str, list[Any]]:
    """Return copies of all rows."""
    return {name: getattr(memory, name).copy() for name in ROWS}


def compared_rows(rows: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Return the rows without special devices and without the work registers of the arithmetic."""
    kept = rows | {kind: rows[kind][:SPECIAL] for kind in "MD"}
    kept["D"][SCRATCH.start : SCRATCH.stop] = [0] * len(SCRATCH)
    return kept


class ObservedScans(Plc):
    """PLC each of whose scans is observed from its memory before the scan.

    Attributes:
        found: Differences across all instances.
        compared: Number of compared scans across all instances.
        every: The number of scans of which one is observed.
    """

    found: ClassVar[list[str]] = []
    compared: ClassVar[int] = 0
    every: ClassVar[int] = 1
    observer: ClassVar[ObservedPlc]

    def __init__(self, program: Program, *, input_filter_ms: int = 10, execution: Execution | None = None) -> None:
        super().__init__(program, input_filter_ms=input_filter_ms, execution=execution)
        assert program is MACHINE.program

    def scan(self, now_ms: int, levels: Sequence[bool]) -> list[bool]:
        if self.scans % self.every:
            return super().scan(now_ms, levels)
        before, first = rows_of(self.memory), self.scans == 0
        outputs = super().scan(now_ms, list(levels))
        after = rows_of(self.memory)
        self.observer.load(Memory(**before), first=first)
        self.observer.scan(now_ms, after["X"])
        ObservedScans.compared += 1
        seen, expected = compared_rows(rows_of(self.observer.memory)), compared_rows(after)
        if seen != expected:
            different = [
                f"{name}{n}: {one} in the soft PLC, {other} observed"
                for name in ROWS
                for n, (one, other) in enumerate(zip(expected[name], seen[name], strict=True))
                if one != other
            ]
            self.found.append(f"{now_ms} ms: {different[:5]}")
        return outputs


@pytest.fixture(scope="module")
def observer() -> ObservedPlc:
    return ObservedPlc(LADDER, input_filter_ms=0)


@pytest.fixture
def observing(monkeypatch: pytest.MonkeyPatch, observer: ObservedPlc) -> type[ObservedScans]:
    """Observe the scans of every soft PLC."""
    monkeypatch.setattr(twin_module, "Plc", ObservedScans)
    monkeypatch.setattr(fx_equality, "Plc", ObservedScans)
    monkeypatch.setattr(ObservedScans, "observer", observer, raising=False)
    monkeypatch.setattr(ObservedScans, "found", [])
    monkeypatch.setattr(ObservedScans, "compared", 0)
    monkeypatch.setattr(ObservedScans, "every", 1)
    return ObservedScans


def test_the_ladder_has_the_devices_of_the_program_and_is_valid() -> None:
    own = {(device.kind, device.number) for device in MACHINE.program.devices()}
    own |= {("T", rung.timer.number) for rung in MACHINE.program.rungs() if hasattr(rung, "timer")}
    used = {
        (operand.kind, operand.number)
        for instruction in LADDER.instructions
        for operand in instruction.operands
        if isinstance(operand, DeviceOperand)
    }
    scratch = {("D", number) for number in SCRATCH}
    special = {("M", 8000), ("M", 8001)}
    assert used - own <= scratch | special
    assert read_il(write_il(LADDER)) == LADDER
    assert [each.title for each in MACHINE.program.blocks if each.title not in LADDER.titles.values()] == []


@pytest.mark.parametrize("scans", first_of([150, 300]))
def test_an_observed_scan_gives_the_memory_of_the_soft_plc_in_random_stories(
    scans: int, observing: type[ObservedScans]
) -> None:
    *_, (pair, _) = stories(11, scans)
    assert pair.scans == scans
    assert observing.found == []
    assert observing.compared >= scans


@pytest.mark.nightly
@pytest.mark.timeout(1_200)
def test_an_observed_scan_gives_the_memory_of_the_soft_plc_in_long_stories(observing: type[ObservedScans]) -> None:
    for seed in (11, 27, 30):
        *_, (pair, _) = stories(seed, 4_000)
        assert pair.scans == 4_000
    assert observing.found == []
    assert observing.compared >= 3 * 4_000


FAULTS = ("stuck_off:left.lift_down@14s..17s", "broken_wire:right.slide_at_feed@23s..24s", "jammed:right.lift@26s..30s")


@pytest.mark.parametrize(("every", "seconds"), first_of([(16, 30), (8, 30), (1, 120)]))
def test_an_observed_scan_gives_the_memory_of_the_soft_plc_in_a_run_with_faults(
    every: int, seconds: int, observing: type[ObservedScans], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(observing, "every", every)
    twin = Twin(seed=1, trays=1, machine=MACHINE, faults=map(parse_fault, FAULTS))
    twin.home()
    twin.start()
    for _ in range(seconds):
        twin.run_for(1_000)
        if twin.state == State.HELD:
            twin.press("start", 1_000)
    assert observing.found == []
    assert observing.compared > 100 * seconds // every // 2
    assert any(isinstance(event, AlarmEvent) for event in twin.events)
