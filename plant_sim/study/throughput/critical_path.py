"""Critical path of a round: the motions and waits from a throw (release over the cups) back to the previous throw."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, TypeVar

from controller.program.set_points import CUPS as CUPS_A_ROW
from controller.program.tags import SIDES, Side
from plant_sim.study.errors import StudyError
from plant_sim.study.throughput.timeline import (
    ARM,
    CUP_WAIT,
    CUPS,
    FEEDER,
    StepInterval,
    StepMotion,
    Throw,
    Timeline,
    motion_of,
)

TWELVE_CUPS: Final = StepMotion("twelve cups pass", "carousel", "moves")
"""Wait of an arm that arrives before its twelfth cup: the carousel sets the pace."""
NEXT_CUP: Final = StepMotion("next cup", "carousel", "moves")
"""Wait of an arm that arrives after its twelfth cup, until the next cup."""

IN_CENTRE: Final = 3
"""Row inward of pick 2, which only one arm at a time may approach."""

CUP_WAITS: Final = ("wait to lower", CUP_WAIT)
"""Steps of an arm that wait for cups."""

Key = TypeVar("Key")


@dataclass(frozen=True, slots=True)
class Segment:
    """Segment of the critical path.

    Attributes:
        sequence: Sequence or carousel in motion.
        motion: Its motion.
        from_ms: Start, ms.
        to_ms: End, ms.
    """

    sequence: str
    motion: StepMotion
    from_ms: int
    to_ms: int

    @property
    def length_ms(self) -> int:
        """Duration, ms."""
        return self.to_ms - self.from_ms


@dataclass(frozen=True, slots=True)
class Round:
    """Round of an arm from one throw to the next.

    Attributes:
        since: Previous throw.
        throw: Throw at the end.
        path: Critical path in order, without gaps or overlaps.
        margin_ms: Time from the arrival of the arm to the twelfth cup, ms; negative if the arm was late.
        missed_cups: Number of cups that passed empty after the twelfth cup since the previous throw.
    """

    since: Throw
    throw: Throw
    path: tuple[Segment, ...]
    margin_ms: int
    missed_cups: int

    @property
    def changes_tray(self) -> bool:
        """True if the round includes a tray change."""
        return self.throw.row <= self.since.row


def critical_path(timeline: Timeline, side: Side, since_ms: int, until_ms: int) -> tuple[Segment, ...]:
    """Return the critical path from a throw back to an earlier time.

    A step that moves or dwells is on the path. From a step that waits, the path continues with the event that
    ended the wait: the carousel, the other arm leaving the centre, the tray feeder, or, if the feeder waits, the last
    arm to arrive at feed. The rest of the wait (one scan) and a wait without a known cause are parts of the path.

    Args:
        timeline: Timeline of the run.
        side: Arm of the throw.
        since_ms: Start of the path, ms.
        until_ms: Time of the throw, ms.

    Raises:
        StudyError: The timeline starts after `since_ms`.
    """
    path: list[Segment] = []
    sequence, at_ms = ARM[side], until_ms
    while at_ms > since_ms:
        interval = timeline.before(sequence, at_ms)
        if interval is None:
            raise StudyError(f"{sequence}: no record before {at_ms} ms; start the path at a later throw")
        segment, sequence = _step_back(timeline, interval, at_ms)
        at_ms = segment.from_ms
        if segment.length_ms:
            path.append(replace(segment, from_ms=max(at_ms, since_ms)))
    return tuple(reversed(path))


def rounds(timeline: Timeline, side: Side) -> tuple[Round, ...]:
    """Return the rounds of an arm in a run, each from one throw to the next."""
    return tuple(_round(timeline, since, throw) for since, throw in pairwise(timeline.throws[side]))


def by_motion(path: Iterable[Segment]) -> dict[StepMotion, int]:
    """Return the total duration of each motion on a path, ms, longest first."""
    return _summed((segment.motion, segment.length_ms) for segment in path)


def by_device(path: Iterable[Segment]) -> dict[str, int]:
    """Return the total time of each device on a path, ms, longest first."""
    return _summed((segment.motion.device, segment.length_ms) for segment in path)


def _summed(lengths: Iterable[tuple[Key, int]]) -> dict[Key, int]:
    sums: dict[Key, int] = defaultdict(int)
    for key, length_ms in lengths:
        sums[key] += length_ms
    return dict(sorted(sums.items(), key=lambda each: -each[1]))


def _round(timeline: Timeline, since: Throw, throw: Throw) -> Round:
    path = critical_path(timeline, throw.side, since.at_ms, throw.at_ms)
    cups_ms = _cups_between(timeline, throw.side, since.at_ms, throw.at_ms)
    before = timeline.before(ARM[throw.side], throw.at_ms)
    # an arm that arrives in the same scan as its cup has no waiting step
    arrived_ms = before.from_ms if before is not None and before.step == CUP_WAIT else throw.at_ms
    if len(cups_ms) < CUPS_A_ROW:
        raise StudyError(
            f"{ARM[throw.side]}: fewer than twelve cups before the throw at {throw.at_ms} ms; use a later round"
        )
    return Round(since, throw, path, cups_ms[CUPS_A_ROW - 1] - arrived_ms, len(cups_ms) - CUPS_A_ROW)


def _cups_between(timeline: Timeline, side: Side, after_ms: int, until_ms: int) -> list[int]:
    return [at_ms for at_ms in timeline.cups_ms[side] if after_ms < at_ms <= until_ms]


def _step_back(timeline: Timeline, interval: StepInterval, at_ms: int) -> tuple[Segment, str]:
    """Return the segment that ended at a time, and the sequence with which the path continues before that segment."""
    motion = motion_of(interval.sequence, interval.step)
    segment = Segment(interval.sequence, motion, interval.from_ms, at_ms)
    if motion.kind != "waits":
        return segment, interval.sequence
    if interval.step in CUP_WAITS:
        return _before_cup(timeline, segment)
    events = [
        (ended_ms, sequence)
        for ended_ms, sequence in _end_events(timeline, interval)
        if interval.from_ms < ended_ms <= at_ms
    ]
    if not events:
        return segment, interval.sequence
    ended_ms, sequence = max(events)
    return replace(segment, from_ms=ended_ms), sequence


def _before_cup(timeline: Timeline, wait: Segment) -> tuple[Segment, str]:
    """Return the segment of the carousel that replaces a wait ended by a cup."""
    side = _side_of(wait.sequence)
    if wait.to_ms not in timeline.cups_ms[side]:
        return wait, wait.sequence
    thrown_ms = timeline.release_before(side, wait.to_ms)
    if len(_cups_between(timeline, side, thrown_ms, wait.to_ms)) <= CUPS_A_ROW:
        return Segment(CUPS[side], TWELVE_CUPS, thrown_ms, wait.to_ms), wait.sequence
    return Segment(CUPS[side], NEXT_CUP, wait.from_ms, wait.to_ms), wait.sequence


def _end_events(timeline: Timeline, wait: StepInterval) -> list[tuple[int, str]]:
    """Return the events that may have ended a wait, with their time and sequence."""
    if wait.sequence == FEEDER:
        return _ends(timeline, ARM.values(), "slide to feed")
    side = _side_of(wait.sequence)
    events = _ends(timeline, [FEEDER], "settle")
    if timeline.approaches[side].get(wait.to_ms) == IN_CENTRE:
        other: Side = "right" if side == "left" else "left"
        events += [(left_ms, ARM[other]) for _, left_ms in timeline.centre[other]]
    return events


def _ends(timeline: Timeline, sequences: Iterable[str], step: str) -> list[tuple[int, str]]:
    return [
        (each.to_ms, sequence) for sequence in sequences for each in timeline.intervals[sequence] if each.step == step
    ]


def _side_of(sequence: str) -> Side:
    return next(side for side in SIDES if ARM[side] == sequence)
