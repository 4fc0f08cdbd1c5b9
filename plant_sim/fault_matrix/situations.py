"""Rest situations: what the program knows of an arm that has come to rest, and what it will decide from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final, NamedTuple

from controller.core.expr import Bit
from controller.program.tags import SIDES, ArmTags, Side
from plant_sim.fault_matrix.run import MatrixSetup, undisturbed
from plant_sim.fault_matrix.stops import STOPS, StopKind
from plant_sim.machine.arm import ARM_SWITCHES
from plant_sim.twin.lock_step import SCAN_MS, Twin, TwinSnapshot

TRAY_SWITCH: Final = "tray_front_edge"
SEARCH_MS: Final = 40
"""Distance of the moments at which situations are searched, ms. For the default machine, a search in every scan finds
no other situation (660 in 2 x 10,560 scans; at 80 ms, two are missing)."""
NEIGHBOURS: Final = 2
"""Number of scans before and after a change of the situation that are searched as well: some situations last for one
scan between two others, the first of which comes back."""


class Situation(NamedTuple):
    """Rest situation of an arm.

    Attributes:
        stop: Name of the kind of stop.
        side: The arm.
        switches: Switches of the arm and of the tray that are on.
        memory: Relays of the arm that are on, and its registers and the tray's that are not 0.
    """

    stop: str
    side: Side
    switches: tuple[str, ...]
    memory: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.side}, {self.stop}: {', '.join(self.switches) or 'no switch'} | {', '.join(self.memory)}"


class Spell(NamedTuple):
    """Consecutive moments of the stop that lead to the same rest situation.

    Attributes:
        situation: The situation.
        first_ms: First moment, ms.
        last_ms: Last moment, ms.
    """

    situation: Situation
    first_ms: int
    last_ms: int

    @property
    def middle_ms(self) -> int:
        """Moment in the middle, ms, a multiple of the scan period after the first."""
        return self.first_ms + (self.last_ms - self.first_ms) // 2 // SCAN_MS * SCAN_MS


def remembered(arm: ArmTags) -> dict[str, Bit]:
    """Return the relays of an arm that affect its next motions: its retentive relays, its last places and passages."""
    last = {"down": arm.was_down, "up": arm.was_up, "feed": arm.was_at_feed}
    last |= {f"pick {row}": bit for row, bit in arm.was_at_pick.items()}
    last |= {"spread": arm.was_spread, "converged": arm.was_converged}
    return {
        "loaded": arm.loaded,
        "closed": arm.claws_closed,
        "clamped": arm.clamped,
        "claws known": arm.claws_known,
        "on row": arm.on_row,
        "discard": arm.discard,
        **{f"reached {place}": bit for place, bit in arm.reached.items()},
        **{f"was {name}": bit for name, bit in last.items()},
    }


def situation_of(twin: Twin, stop: StopKind, side: Side) -> Situation:
    """Return the rest situation of an arm.

    Args:
        twin: The machine at rest. After a loss of power, the controller has executed its first scan.
        stop: Kind of stop.
        side: The arm.
    """
    tags = twin.machine.tags
    arm, levels, io_map = tags.arms[side], twin.plant.x, twin.io_map
    points = {name: io_map[f"{side}.{name}"] for name in ARM_SWITCHES} | {TRAY_SWITCH: io_map[TRAY_SWITCH]}
    on = tuple(name for name, point in points.items() if point.active(levels[point.number]))
    words = {f"row {row}": word for row, word in arm.rows.items()} | {"tray": tags.tray.phase}
    values = {name: twin.plc.read(word) for name, word in words.items()}
    bits = tuple(name for name, bit in remembered(arm).items() if twin.plc.read(bit))
    return Situation(stop.name, side, on, (*bits, *(f"{name} = {value}" for name, value in values.items() if value)))


def come_to_rest(twin: Twin, stop: StopKind) -> list[Situation]:
    """Stop a twin, run it until it is at rest, and return the situations of both arms; none if all work is complete.

    After a loss of power, they are those at the next power-up; the twin is then left without power.
    """
    stop.begin(twin)
    if twin.plc.read(twin.machine.tags.machine.batch_complete):
        return []
    if not stop.is_blind:
        return [situation_of(twin, stop, side) for side in SIDES]
    resting = twin.snapshot()
    stop.end(twin)
    found = [situation_of(twin, stop, side) for side in SIDES]
    twin.restore(resting)
    return found


def spells_between(
    from_ms: int, to_ms: int, setting: MatrixSetup, *, every_ms: int = SEARCH_MS, stops: Sequence[StopKind] = STOPS
) -> list[Spell]:
    """Return the spells of the stops in a period of the undisturbed trial.

    The situations are determined at regular moments. If they differ at two neighbouring moments, they are determined
    between these as well, by bisection down to single scans, and in the scans before and after each change.

    Args:
        from_ms: First moment, ms.
        to_ms: Exclusive last moment, ms.
        setting: Machine and trial.
        every_ms: Distance of the regular moments, ms; `SCAN_MS` = every scan.
        stops: Kinds of stop; if several begin in the same way, only the first is tried.
    """
    twin = twin_at(from_ms, setting)
    running: list[TwinSnapshot] = []
    while twin.now_ms < to_ms:
        running.append(twin.snapshot())
        twin.scan()
    spells: list[Spell] = []
    for stop in {stop.begin: stop for stop in reversed(stops)}.values():
        found = _search(twin, stop, running, every_ms // SCAN_MS)
        for side in SIDES:
            spells += [
                spell._replace(situation=spell.situation._replace(stop=other.name))
                for spell in _spells(found, side, from_ms, len(running))
                for other in stops
                if other.begin is stop.begin
            ]
    return spells


def _search(
    twin: Twin, stop: StopKind, running: Sequence[TwinSnapshot], every: int
) -> dict[int, dict[Side, Situation]]:
    """Return the situations by the number of the snapshot from which the machine was stopped."""
    found: dict[int, dict[Side, Situation]] = {}

    def at(number: int) -> dict[Side, Situation]:
        if number not in found:
            twin.restore(running[number])
            found[number] = {situation.side: situation for situation in come_to_rest(twin, stop)}
        return found[number]

    def bisect(first: int, last: int) -> None:
        if at(first) == at(last):
            return
        if last - first > 1:
            middle = (first + last) // 2
            bisect(first, middle)
            bisect(middle, last)
            return
        for number in range(max(0, first - NEIGHBOURS), min(last + NEIGHBOURS + 1, len(running))):
            at(number)

    at(0)
    for first in range(0, len(running) - 1, every):
        last = min(first + every, len(running) - 1)
        at(last)
        bisect(first, last)
    return found


def _spells(found: Mapping[int, Mapping[Side, Situation]], side: Side, from_ms: int, moments: int) -> list[Spell]:
    """Return the spells of one arm from the situations at some of the moments."""
    spells: list[Spell] = []
    numbers = sorted(found)
    for number, following in zip(numbers, [*numbers[1:], moments], strict=True):
        situation = found[number].get(side)
        if situation is None:
            continue
        first_ms, last_ms = from_ms + number * SCAN_MS, from_ms + (following - 1) * SCAN_MS
        if spells and spells[-1].situation == situation and spells[-1].last_ms + SCAN_MS == first_ms:
            spells[-1] = spells[-1]._replace(last_ms=last_ms)
        else:
            spells.append(Spell(situation, first_ms, last_ms))
    return spells


def longest_spells(spells: Iterable[Spell]) -> list[Spell]:
    """Return the longest spell of every situation, the first of several; in the order of their moments.

    Args:
        spells: Spells in any order; those that continue each other count as one.
    """
    joined: dict[Situation, list[Spell]] = {}
    for spell in sorted(spells, key=lambda spell: spell.first_ms):
        known = joined.setdefault(spell.situation, [])
        if known and known[-1].last_ms + SCAN_MS == spell.first_ms:
            known[-1] = known[-1]._replace(last_ms=spell.last_ms)
        else:
            known.append(spell)
    chosen = [max(known, key=lambda spell: spell.last_ms - spell.first_ms) for known in joined.values()]
    return sorted(chosen, key=lambda spell: (spell.middle_ms, spell.situation))


def twin_at(at_ms: int, setting: MatrixSetup) -> Twin:
    """Return the twin of the undisturbed trial at a moment, without monitors.

    Args:
        at_ms: Moment in Execute, ms.
        setting: Machine and trial.
    """
    reference = undisturbed(setting)
    start = next(start for start in reversed(reference.starts) if start.at_ms <= at_ms)
    twin = reference.twin
    twin.restore(start.snapshot)
    twin.unwatch()
    twin.run_for(at_ms - start.at_ms)
    return twin
