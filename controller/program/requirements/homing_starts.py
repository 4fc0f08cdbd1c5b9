"""Situations from which homing is explored: every place of every device combined with every memory of an arm."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from controller.core.expr import Bit, Word
from controller.program.machine import Transplanter
from controller.program.requirements.homing_trial import HomingStart
from controller.program.requirements.travel_model import TRAY_AND_GAP_MS, TRAY_MS, Travel, TravelModel
from controller.program.states import Mode
from controller.program.tags import (
    COMING,
    FULL,
    IN_DOUBT,
    IN_PLACE,
    IN_PROGRESS,
    MOVING_OUT,
    NO_TRAY,
    ROWS,
    SIDES,
    TAKEN,
    ArmTags,
    Side,
)

AUTOMATIC: Final = tuple(mode for mode in Mode if mode is not Mode.MANUAL)
"""Modes in which the machine is homed."""
PARTNER: Final = 7_919
"""Distance in the list of starts between the two arms of a situation; a prime, so that every start meets others."""


@dataclass(frozen=True, slots=True)
class ArmStart:
    """One arm at rest.

    Attributes:
        positions: Position of each device, ms of travel.
        reached: Place that each device has reached by motion; None if its switch, if any, is not confirmed.
        claws: Relays of the claws that are on: loaded, claws_closed, clamped, discard, on_row.
        rows: State of each row.
        last: Last confirmed place of each device, at which it came to rest before it was moved by hand; None if
            unknown.
        travelled: True if the shortest travel times since the last places have elapsed.
    """

    positions: tuple[int, ...]
    reached: tuple[str | None, ...]
    claws: frozenset[str]
    rows: tuple[int, ...]
    last: tuple[str | None, ...] = ()
    travelled: bool = False

    def values(self, arm: ArmTags, devices: Mapping[str, Travel]) -> dict[Bit | Word, int]:
        """Return the values of the devices of an arm and of its model."""
        values: dict[Bit | Word, int] = {
            device.position: at for device, at in zip(devices.values(), self.positions, strict=True)
        }
        values |= {arm.reached[place]: 1 for place in self.reached if place is not None}
        values |= {getattr(arm, name): 1 for name in (*self.claws, "claws_known")}
        values |= dict(zip(arm.rows.values(), self.rows, strict=True))
        last = _last_places(arm)
        values |= {last[place]: 1 for place in self.last if place is not None}
        if self.last:
            values |= {bit: place in self.last for place, bit in _rests(arm).items()}
        if self.travelled:
            way = (arm.lift_travelled, arm.slide_travelled, arm.slide_hopped, arm.belt_travelled)
            values |= dict.fromkeys(way, 1)
        return values


def arm_starts(model: TravelModel, *, all_rows: bool) -> list[ArmStart]:
    """Return all starts of one arm: places x memory of claws and rows, then places x last places.

    Args:
        model: Travel model.
        all_rows: True for all states of the three rows; False for one of all states between which homing does not
            distinguish: it reads the next row, and whether any row is in progress or in doubt.
    """
    devices = model.devices["left"]
    places = [list(_places(device)) for device in devices.values()]
    rows = list(itertools.product((TAKEN, FULL, IN_PROGRESS, IN_DOUBT), repeat=len(ROWS)))
    if not all_rows:
        rows = list({_reads(states): states for states in rows}.values())
    claws = list(_claws())
    starts = [
        _start(at_places, memory, states)
        for at_places, memory, states in itertools.product(itertools.product(*places), claws, rows)
    ]
    last = [[None, *device.switches] for device in devices.values()]
    combinations = itertools.product(itertools.product(*places), itertools.product(*last), (False, True))
    for n, (at_places, last_places, travelled) in enumerate(combinations):
        memory, states = claws[n % len(claws)], rows[n % len(rows)]
        starts.append(_start(at_places, memory, states, last_places, travelled=travelled))
    return starts


def situations(
    machine: Transplanter, model: TravelModel, starts: list[ArmStart], *, thorough: bool
) -> Iterator[HomingStart]:
    """Yield the situations that combine the starts of both arms.

    Each situation combines two different starts, because the arms do not wait for each other in homing.

    Args:
        machine: Program of the machine.
        model: Travel model.
        starts: Starts of one arm.
        thorough: True if each start occurs on each arm, at rest and after a loss of power; False if it occurs on one
            arm, alternately at rest and after a loss of power.
    """
    count = len(starts)
    for n in range(count) if thorough else range(0, count, 2):
        partner = (n + PARTNER) % count if thorough else (n + 1) % count
        memory_only = not any((start.last or start.travelled) for start in (starts[n], starts[partner]))
        both = (False, True) if thorough else (n % 4 == 0,)
        for powered_up in both if memory_only else (False,):
            values: dict[Bit | Word, int] = {machine.tags.tray.phase: IN_PLACE}
            for side, index in zip(SIDES, (n, partner), strict=True):
                values |= starts[index].values(machine.tags.arms[side], model.devices[side])
                if index % 3 == 0:
                    values |= _disturbance(machine, side)
            yield HomingStart(values, powered_up, AUTOMATIC[n % len(AUTOMATIC)])


def tray_situations(machine: Transplanter, model: TravelModel) -> Iterator[HomingStart]:
    """Yield the situations that combine the memory of the tray with its way, for arms at feed and away from it."""
    tags = machine.tags
    ways = (0, TRAY_MS // 2, TRAY_MS - 1, TRAY_MS, (TRAY_MS + TRAY_AND_GAP_MS) // 2)
    phases = (NO_TRAY, IN_PLACE, MOVING_OUT, COMING)
    places = [next(_places(device)) for device in model.devices["left"].values()]
    away = [places[0], (model.devices["left"]["slide"].switches["pick 2"], None), places[2]]
    for phase, way, ask, rows, at, gripped, powered_up in itertools.product(
        phases, ways, (0, 1), ((TAKEN,) * 3, (TAKEN, FULL, FULL)), (places, away), (0, 1), (False, True)
    ):
        claws = frozenset({"loaded", "claws_closed", "clamped"} if gripped else ())
        start = _start(at, claws, rows)
        values: dict[Bit | Word, int] = {tags.tray.phase: phase, model.tray: way, tags.tray.ask: ask}
        for side in SIDES:
            values |= start.values(tags.arms[side], model.devices[side])
        yield HomingStart(values, powered_up)


def _start(
    places: Iterable[tuple[int, str | None]],
    claws: frozenset[str],
    rows: tuple[int, ...],
    last: tuple[str | None, ...] = (),
    *,
    travelled: bool = False,
) -> ArmStart:
    positions, reached = zip(*places, strict=True)
    return ArmStart(positions, reached, claws, rows, last, travelled)


def _places(device: Travel) -> Iterator[tuple[int, str | None]]:
    """Yield the positions of a device with the place it has reached: at each switch, confirmed or not, and between."""
    by_position = sorted((at, place) for place, at in device.switches.items())
    for at, place in by_position:
        yield at, place
        yield at, None
    for (one, _), (two, _) in itertools.pairwise(by_position):
        yield (one + two) // 2, None


def _claws() -> Iterator[frozenset[str]]:
    """Yield every memory of the claws that the invariants permit, with and without `on_row`."""
    names = ("loaded", "claws_closed", "clamped", "discard", "on_row")
    for bits in itertools.product((False, True), repeat=len(names)):
        on = frozenset(name for name, bit in zip(names, bits, strict=True) if bit)
        closed = "claws_closed" in on or not on & {"loaded", "clamped"}
        if closed and ("loaded" in on or "discard" not in on):
            yield on


def _reads(rows: tuple[int, ...]) -> tuple[int | None, bool, bool]:
    """Return what homing reads of the rows: the next row, and whether a row is in progress or in doubt."""
    following = next((n for n, state in enumerate(rows) if state != TAKEN), None)
    return following, IN_PROGRESS in rows, IN_DOUBT in rows


def _last_places(arm: ArmTags) -> dict[str, Bit]:
    rows = {f"pick {row}": bit for row, bit in arm.was_at_pick.items()}
    ends = {"down": arm.was_down, "up": arm.was_up, "feed": arm.was_at_feed}
    return {**ends, **rows, "spread": arm.was_spread, "converged": arm.was_converged}


def _rests(arm: ArmTags) -> dict[str, Bit]:
    """Return the relays of the places at which an arm came to rest, before it was moved by hand."""
    ends = {"down": arm.rests_down, "up": arm.rests_up, "feed": arm.rests_at_feed}
    return {**ends, "spread": arm.rests_spread, "converged": arm.rests_converged}


def _disturbance(machine: Transplanter, side: Side) -> dict[Bit | Word, int]:
    """Return relays of the work before homing, all alarms of an arm, and the longest release dwell."""
    arm = machine.tags.arms[side]
    relays = (arm.passed, arm.in_centre, arm.retried, arm.cycle_done, arm.count_valid, arm.row_running)
    longest_release = machine.tags.sp.limits[machine.tags.sp.release][1]
    return {
        **dict.fromkeys((*relays, *machine.alarms.of_side(side)), 1),
        machine.tags.sp.release: longest_release,
    }
