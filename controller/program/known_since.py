"""Beliefs of the program about the machine that no input shows, what ends each, and how it is known again.

A belief holds since it was measured or answered. What a person, time or a fault could have changed since ends it: the
program then measures again, within a homing that a person has ordered, or asks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from controller.common.declarations import DeclarationError
from controller.core.expr import Expr, all_of, any_of
from controller.program.tags import FORGOTTEN, IN_DOUBT, IN_PLACE, IN_PROGRESS, Tags


class End(StrEnum):
    """Events after which a belief may be wrong."""

    ABORTED = "Aborted"
    MANUAL = "manual mode"
    POWER_UP = "power-up"
    MEMORY_LOST = "memory lost, or of another run or version"
    CUP_ALARM = "alarm of the cup pulses"
    CUPS_AT_REST = "implausible cup pulses at rest"
    GUARD = "guard opened"
    TRAY_LOST = "alarm of a lost tray"


@dataclass(frozen=True, slots=True)
class Belief:
    """One belief.

    Attributes:
        name: Name in the table.
        known: Condition that the belief holds.
        ends: How the belief is measured or asked again, by the event that ends it.
        kept: Reason why the belief holds, by each other event.

    Raises:
        DeclarationError: An event is missing, or both ends and keeps the belief.
    """

    name: str
    known: Expr
    ends: Mapping[End, str]
    kept: Mapping[End, str]

    def __post_init__(self) -> None:
        """Check that each event has one effect."""
        for end in End:
            if (end in self.ends) == (end in self.kept):
                raise DeclarationError(f"belief {self.name!r}: state whether {end.value!r} ends it or keeps it")


def beliefs(tags: Tags) -> tuple[Belief, ...]:
    """Return all beliefs of the program."""
    arms = tuple(tags.arms.values())
    rows = [row for arm in arms for row in arm.rows.values()]
    kept = dict.fromkeys(End, "not concerned")
    same_tray = "asked when the arms are at home: same tray, not moved?"
    twelve = "asked: are the cups empty? Or twelve cups pass"
    full_tray = "asked: treat the tray as full, or is there none?"
    return (
        _belief(
            "place of the tray at the pick position",
            all_of(tags.tray.phase.equals(IN_PLACE), tags.tray.place_known),
            {End.ABORTED: same_tray, End.MANUAL: same_tray, End.POWER_UP: same_tray, End.MEMORY_LOST: full_tray}
            | {End.GUARD: same_tray, End.TRAY_LOST: same_tray},
            kept,
        ),
        _belief(
            "rows that are full, and rows that are taken",
            all_of(tags.tray.phase.differs(FORGOTTEN), *(row.differs(IN_DOUBT) for row in rows)),
            {End.MEMORY_LOST: full_tray},
            kept
            | dict.fromkeys((End.ABORTED, End.MANUAL), "each coil that takes a row or puts it back is recorded")
            | {End.POWER_UP: "retentive", End.GUARD: "as in Aborted"},
        ),
        _belief(
            "row between clamping and lifting",
            any_of(*(row.equals(IN_PROGRESS) for row in rows)),
            {
                End.POWER_UP: "asked: is the arm holding seedlings?",
                End.MEMORY_LOST: "claws count as closed and loaded; the load is thrown over cups",
            },
            kept
            | dict.fromkeys((End.ABORTED, End.GUARD), "claws and lift keep their state")
            | {End.MANUAL: "its coils are recorded"},
        ),
        _belief(
            "claws open or closed, with or without a load",
            all_of(*(arm.claws_known for arm in arms)),
            {End.MEMORY_LOST: "claws count as closed and loaded; the load is thrown over cups"},
            kept
            | {
                End.ABORTED: "bistable valves and a reservoir of their own keep the claws",
                End.MANUAL: "the coils of the claws are recorded",
                End.POWER_UP: "retentive; as in Aborted",
                End.GUARD: "as in Aborted, and the air stays on",
            },
        ),
        _belief(
            "place of lift, slide and belt",
            all_of(*(bit for arm in arms for bit in arm.placed.values())),
            {End.MEMORY_LOST: "measured in homing: driven against the end stop for the time of a full stroke"},
            kept
            | {
                End.ABORTED: "while its switch stays on; else measured in homing as after a loss of memory",
                End.MANUAL: "a coil that drives the device away ends it",
                End.POWER_UP: "retentive, and as in Aborted",
                End.GUARD: "as in Aborted",
            },
        ),
        _belief(
            "cups under the claws",
            all_of(*(arm.count_valid for arm in arms)),
            dict.fromkeys((End.POWER_UP, End.MEMORY_LOST, End.CUP_ALARM, End.CUPS_AT_REST), twelve),
            kept | dict.fromkeys((End.ABORTED, End.MANUAL, End.GUARD), "the count runs on"),
        ),
        _belief(
            "machine constants that differ from their defaults",
            ~tags.machine.constants_open,
            dict.fromkeys((End.POWER_UP, End.MEMORY_LOST), "given at each start, and confirmed with X25"),
            kept,
        ),
    )


def _belief(name: str, known: Expr, ends: Mapping[End, str], kept: Mapping[End, str]) -> Belief:
    return Belief(name, known, ends, {end: reason for end, reason in kept.items() if end not in ends})
