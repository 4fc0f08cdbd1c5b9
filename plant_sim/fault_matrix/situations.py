"""Rest situations: what the program knows of an arm that has come to rest, and what it will decide from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from controller.core.expr import Expr
from controller.program.tags import SIDES, ArmTags, Side
from plant_sim.fault_matrix.run import MatrixSetup, undisturbed
from plant_sim.fault_matrix.stops import STOPS, Stop
from plant_sim.twin.lock_step import SCAN_MS, Twin

ARM_SWITCHES: Final = (
    "lift_down",
    "lift_up",
    "slide_at_feed",
    "slide_at_pick_1",
    "slide_at_pick_2",
    "slide_at_pick_3",
    "claws_spread",
    "claws_converged",
)
"""Switches of an arm; the cup sensors are not among them, because they do not report a place."""
TRAY_SWITCH: Final = "tray_front_edge"


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


def remembered(arm: ArmTags) -> dict[str, Expr]:
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
        **{f"{name} distrusted": bit for name, bit in arm.distrusted.items()},
        **{f"was {name}": bit for name, bit in last.items()},
    }


def situation_of(twin: Twin, stop: Stop, side: Side) -> Situation:
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


def come_to_rest(twin: Twin, stop: Stop) -> list[Situation]:
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


def spells_between(from_ms: int, to_ms: int, setting: MatrixSetup, stops: Sequence[Stop] = STOPS) -> list[Spell]:
    """Return the spells of the stops in every scan of a period of the undisturbed trial.

    Args:
        from_ms: First moment, ms.
        to_ms: Exclusive last moment, ms.
        setting: Machine and trial.
        stops: Kinds of stop.
    """
    twin = twin_at(from_ms, setting)
    spells: list[Spell] = []
    current: dict[tuple[str, Side], Spell] = {}
    for at_ms in range(from_ms, to_ms, SCAN_MS):
        running = twin.snapshot()
        for stop in stops:
            for situation in come_to_rest(twin, stop):
                place = situation.stop, situation.side
                before = current.get(place)
                if before is not None and before.situation == situation:
                    current[place] = before._replace(last_ms=at_ms)
                    continue
                if before is not None:
                    spells.append(before)
                current[place] = Spell(situation, at_ms, at_ms)
            twin.restore(running)
        twin.scan()
    return [*spells, *current.values()]


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
