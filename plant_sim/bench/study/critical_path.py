"""The critical path of a round: what each moment of it waited for, from a throw back to the one before."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, TypeVar

from controller.program.tags import CUPS as CUPS_A_ROW
from controller.program.tags import SIDES, Side
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.timeline import ARM, CUP_WAIT, CUPS, FEEDER, Motion, Stretch, Throw, Timeline, motion_of

TWELVE_CUPS: Final = Motion("twelve cups pass", "carousel", "moves")
"""The arm is there before its twelve cups: the carousel sets the pace."""
NEXT_CUP: Final = Motion("next cup", "carousel", "moves")
"""The twelfth cup has gone by: the arm waits for the next to come under the claws."""

IN_CENTRE: Final = 3
"""Row inward of pick 2: one arm at a time takes it."""

CUP_WAITS: Final = ("wait to lower", CUP_WAIT)
"""Steps in which an arm waits for cups."""

Key = TypeVar("Key")


@dataclass(frozen=True, slots=True)
class Segment:
    """A part of the critical path.

    Attributes:
        who: Sequence or carousel that was on its way.
        motion: What it did.
        from_ms: Since when, ms.
        to_ms: Until when, ms.
    """

    who: str
    motion: Motion
    from_ms: int
    to_ms: int

    @property
    def length_ms(self) -> int:
        """How long, ms."""
        return self.to_ms - self.from_ms


@dataclass(frozen=True, slots=True)
class Round:
    """From one throw of an arm to its next.

    Attributes:
        since: The throw before.
        throw: The throw that ends it.
        path: Its critical path, in order, without gap or overlap.
        margin_ms: By how much the arm was over its cups before the twelfth; negative where it came late.
        missed_cups: Cups that passed empty after the twelfth.
    """

    since: Throw
    throw: Throw
    path: tuple[Segment, ...]
    margin_ms: int
    missed_cups: int

    @property
    def changes_tray(self) -> bool:
        """Whether a tray was changed in it."""
        return self.throw.row <= self.since.row


def critical_path(timeline: Timeline, side: Side, since_ms: int, until_ms: int) -> tuple[Segment, ...]:
    """Return what a throw waited for, back to an earlier time.

    A step that moves or dwells is on the path. A step that waits hands over to whatever ended the wait: the carousel,
    the other arm as it leaves the centre, the tray feeder, and for the feeder the arm that came to feed last. What is
    left of the wait then, a scan, and a wait that nothing here has ended, are on the path as the wait they are.

    Args:
        timeline: The run.
        side: Arm that throws.
        since_ms: Where the path begins, ms.
        until_ms: Time of the throw, ms.

    Raises:
        StudyError: the run does not reach so far back.
    """
    path: list[Segment] = []
    who, at_ms = ARM[side], until_ms
    while at_ms > since_ms:
        stretch = timeline.before(who, at_ms)
        if stretch is None:
            raise StudyError(f"{who}: nothing is recorded before {at_ms} ms; begin the path at a later throw")
        segment, who = _step_back(timeline, stretch, at_ms)
        at_ms = segment.from_ms
        if segment.length_ms:
            path.append(replace(segment, from_ms=max(at_ms, since_ms)))
    return tuple(reversed(path))


def rounds(timeline: Timeline, side: Side) -> tuple[Round, ...]:
    """Return every round of an arm between two throws of a run, with its critical path."""
    return tuple(_round(timeline, since, throw) for since, throw in pairwise(timeline.throws[side]))


def by_motion(path: Iterable[Segment]) -> dict[Motion, int]:
    """Return how long each motion is on a path, ms, the longest first."""
    return _summed((segment.motion, segment.length_ms) for segment in path)


def by_device(path: Iterable[Segment]) -> dict[str, int]:
    """Return how long each device is on a path, ms, the longest first."""
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
    # an arm that comes as its cup does is in no step that waits
    there_ms = before.from_ms if before is not None and before.step == CUP_WAIT else throw.at_ms
    if len(cups_ms) < CUPS_A_ROW:
        raise StudyError(f"{ARM[throw.side]}: the throw at {throw.at_ms} ms had no twelve cups; take a later round")
    return Round(since, throw, path, cups_ms[CUPS_A_ROW - 1] - there_ms, len(cups_ms) - CUPS_A_ROW)


def _cups_between(timeline: Timeline, side: Side, after_ms: int, until_ms: int) -> list[int]:
    return [at_ms for at_ms in timeline.cups_ms[side] if after_ms < at_ms <= until_ms]


def _step_back(timeline: Timeline, stretch: Stretch, at_ms: int) -> tuple[Segment, str]:
    """Return the part of the path that ended at a time, and whose step comes before it."""
    motion = motion_of(stretch.who, stretch.step)
    own = Segment(stretch.who, motion, stretch.from_ms, at_ms)
    if motion.kind != "waits":
        return own, stretch.who
    if stretch.step in CUP_WAITS:
        return _before_cup(timeline, own)
    events = [(ended_ms, who) for ended_ms, who in _may_end(timeline, stretch) if stretch.from_ms < ended_ms <= at_ms]
    if not events:
        return own, stretch.who
    ended_ms, who = max(events)
    return replace(own, from_ms=ended_ms), who


def _before_cup(timeline: Timeline, wait: Segment) -> tuple[Segment, str]:
    """Hand a wait over the cups to the carousel, if a cup ended it."""
    side = _side_of(wait.who)
    if wait.to_ms not in timeline.cups_ms[side]:
        return wait, wait.who
    thrown_ms = timeline.release_before(side, wait.to_ms)
    if len(_cups_between(timeline, side, thrown_ms, wait.to_ms)) <= CUPS_A_ROW:
        return Segment(CUPS[side], TWELVE_CUPS, thrown_ms, wait.to_ms), wait.who
    return Segment(CUPS[side], NEXT_CUP, wait.from_ms, wait.to_ms), wait.who


def _may_end(timeline: Timeline, wait: Stretch) -> list[tuple[int, str]]:
    """Return when something happened that may end a wait, and who did it."""
    if wait.who == FEEDER:
        return _ends(timeline, ARM.values(), "slide to feed")
    side = _side_of(wait.who)
    events = _ends(timeline, [FEEDER], "settle")
    if timeline.approaches[side].get(wait.to_ms) == IN_CENTRE:
        other: Side = "right" if side == "left" else "left"
        events += [(left_ms, ARM[other]) for _, left_ms in timeline.centre[other]]
    return events


def _ends(timeline: Timeline, sequences: Iterable[str], step: str) -> list[tuple[int, str]]:
    return [(each.to_ms, who) for who in sequences for each in timeline.stretches[who] if each.step == step]


def _side_of(who: str) -> Side:
    return next(side for side in SIDES if ARM[side] == who)
