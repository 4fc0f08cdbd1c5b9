"""Travel times that the twin derives from its machine, against those measured in a trial without faults."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import pytest

from controller.common.modbus.io_map import Point
from controller.program.states import State
from controller.program.tags import ROWS, SIDES, Side
from plant_sim.machine.parameters import Machine
from plant_sim.twin.commissioning import travel_times_of
from plant_sim.twin.lock_step import SCAN_MS, Twin
from tests.plant_sim.twin.twin_rig import MACHINE, TRAY_MS
from tests.sampling import first_of

MARGIN_MS = 65
"""Margin of the derived times beyond the measured ones, ms; the measurement has steps of one scan."""
SWITCHES = {
    "lift": ("lift_down", "lift_up"),
    "belt": ("claws_converged", "claws_spread"),
    "slide": ("slide_at_feed", *(f"slide_at_pick_{row}" for row in ROWS)),
}
COILS = {
    "lift": ("lift_extend", "lift_retract"),
    "belt": ("converge", "spread"),
    "slide": ("slide_outward", "slide_inward"),
}


@dataclass
class Travels:
    """Recorder of the travels of one arm, called after every scan.

    Attributes:
        from_coil: Times from the coil to the switch of another place, ms, by both places.
        between: Times from leaving a switch to the next one, ms, by both places.
        claws: Times from the coil to gripped or free stems, ms, by coil.
    """

    side: Side
    from_coil: dict[tuple[str, str], list[int]] = field(default_factory=lambda: defaultdict(list))
    between: dict[tuple[str, str], list[int]] = field(default_factory=lambda: defaultdict(list))
    claws: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    _driven: dict[str, tuple[str, int]] = field(default_factory=dict)
    _left: dict[str, tuple[str, int]] = field(default_factory=dict)
    _at: dict[str, str | None] = field(default_factory=dict)
    _swinging: dict[str, int] = field(default_factory=dict)
    _on: frozenset[str] = frozenset()

    def __call__(self, twin: Twin) -> None:
        """Record the edges of one scan."""
        on = frozenset(tag.removeprefix(f"{self.side}.") for tag in twin.outputs() if tag.startswith(self.side))
        for device, switches in SWITCHES.items():
            self._follow(device, twin.now_ms, next((name for name in switches if self._is_on(twin, name)), None), on)
        claws = twin.plant.arms[self.side].claws
        for coil, done in (("claws_close", claws.gripping), ("claws_open", claws.free)):
            if coil in on - self._on and not done:
                self._swinging[coil] = twin.now_ms
            if done and (since := self._swinging.pop(coil, None)) is not None:
                self.claws[coil].append(twin.now_ms - since)
        self._on = on

    def _is_on(self, twin: Twin, name: str) -> bool:
        point: Point = twin.io_map[f"{self.side}.{name}"]
        return point.active(twin.plc.memory.X[point.number])

    def _follow(self, device: str, now_ms: int, at: str | None, on: frozenset[str]) -> None:
        before = self._at.get(device)
        started = any(coil in on - self._on for coil in COILS[device])
        if started and at is not None:
            self._driven[device] = (at, now_ms)
        if at != before and before is not None:
            self._left[device] = (before, now_ms)
        if at != before and at is not None:
            for table, begun in ((self.from_coil, self._driven), (self.between, self._left)):
                if device in begun and begun[device][0] != at:
                    table[begun[device][0], at].append(now_ms - begun[device][1])
        self._at[device] = at


def measured(machine: Machine) -> list[Travels]:
    """Return the travels of both arms in a trial of one tray."""
    twin = Twin(trays=1, parameters=machine, set_points={"trays_target": 1})
    twin.plant.seedlings.make_typical()
    twin.home()
    travels = [Travels(side) for side in SIDES]
    for each in travels:
        twin.watch(each)
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=2 * TRAY_MS)
    return travels


@pytest.mark.parametrize("row_spacing_m", first_of([0.35, 0.6, 0.8]))
def test_the_derived_times_are_those_of_the_machine(row_spacing_m: float) -> None:
    """Every measured time is within the derived ones, and the longest and shortest ones are close to them."""
    machine = MACHINE.with_values({"layout.row_spacing_m": row_spacing_m})
    times, travels = travel_times_of(machine), measured(machine)

    def longest(*ways: tuple[str, str]) -> int:
        return max(max(each.from_coil[way], default=0) for each in travels for way in ways)

    def shortest(*ways: tuple[str, str]) -> int:
        return min(min(each.between[way], default=10**6) for each in travels for way in ways)

    def both(one: str, other: str) -> tuple[tuple[str, str], tuple[str, str]]:
        return (one, other), (other, one)

    rows = [f"slide_at_pick_{row}" for row in ROWS]
    bounds = {
        "lift": (longest(*both(*SWITCHES["lift"])), times.lift_ms),
        "belt": (longest(*both(*SWITCHES["belt"])), times.belt_ms),
        "row 1": (longest(*both("slide_at_feed", rows[0])), times.row_1_ms),
        "belt, shortest": (-shortest(*both(*SWITCHES["belt"])), -times.belt_shortest_ms),
        "row 1, shortest": (-shortest(*both("slide_at_feed", rows[0])), -times.row_1_shortest_ms),
        "row to row, shortest": (-shortest(*both(*rows[:2]), *both(*rows[1:])), -times.row_shortest_ms),
        "claws": (max(max(ms) for each in travels for ms in each.claws.values()), times.claws_ms),
    }
    for name, (found, derived) in bounds.items():
        assert derived - MARGIN_MS - SCAN_MS <= found <= derived, f"{name}: measured {found}, derived {derived}"
    assert longest(*both("slide_at_feed", rows[1])) <= times.row_1_ms + times.row_ms
    assert longest(*both("slide_at_feed", rows[2])) <= times.slide_ms
    assert shortest(*both(*SWITCHES["lift"])) >= times.lift_shortest_ms
