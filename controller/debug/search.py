"""Search of a recorded run, forwards and backwards: changes of devices and of conditions.

All scans that are searched are executed again, so that a pulse of one scan is found too. Spans that grow with the
distance keep both the search for a near change and that through the complete run short.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from controller.debug.condition import Condition, SignalInverse
from controller.debug.machine import DebugSignal
from controller.debug.timeline import RunTimeline

_LONGEST: Final = 3_200
"""Longest span that is searched at once, scans: a search backwards executes at most this number in vain."""

Find = Callable[[int, int], Sequence[int]]
"""Function that returns the scans after one and up to another in which something happens, in order."""


def device_changes(line: RunTimeline, signals: Sequence[DebugSignal]) -> Find:
    """Return a search for the scans in which one of some devices changes."""
    return lambda since, to: line.changes(since, to, signals)


def condition_changes(line: RunTimeline, condition: Condition) -> Find:
    """Return a search for the scans in which a condition begins or ceases to be met."""

    def find(since: int, to: int) -> list[int]:
        line.seek(since)
        found: list[int] = []
        while line.run(to, SignalInverse(condition) if condition.holds() else condition):
            found.append(line.scan)
        return found

    return find


def condition_begins(line: RunTimeline, condition: Condition) -> Find:
    """Return a search for the scans in which a condition begins to be met."""

    def find(since: int, to: int) -> list[int]:
        line.seek(since)
        met = condition.holds()
        found: list[int] = []
        while line.run(to, SignalInverse(condition) if met else condition):
            met = not met
            if met:
                found.append(line.scan)
        return found

    return find


def last(line: RunTimeline, find: Find, before: int) -> int | None:
    """Return the last scan before another one in which something happens; None if there is none in the recorded run."""
    to, span = before - 1, line.interval
    while to > line.first:
        since = max(line.first, (to - 1) // line.interval * line.interval - span + line.interval)
        found = find(since, to)
        if found:
            return found[-1]
        to, span = since, min(2 * span, _LONGEST)
    return None


def following(line: RunTimeline, find: Find, after: int) -> int | None:
    """Return the first scan after another one in which something happens; None if there is none."""
    since, span = after, line.interval
    while since < line.last:
        to = min(since + span, line.last)
        found = find(since, to)
        if found:
            return found[0]
        since, span = to, min(2 * span, _LONGEST)
    return None


def first_met(line: RunTimeline, condition: Condition, after: int) -> int | None:
    """Return the first scan after another one at whose end a condition is met; None if there is none."""
    line.seek(after)
    return line.scan if line.run(line.last, condition) else None
