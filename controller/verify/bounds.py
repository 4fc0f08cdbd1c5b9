"""Upper bound of the duration of a sequence, from the time limits and dwell times of its steps."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from controller.core.expr import Word
from controller.core.sequence import Sequence, Step


class UnboundedError(ValueError):
    """Raised if a sequence may run without a limit; the message is one line."""


@dataclass(frozen=True, slots=True)
class LongestPath:
    """Longest path through the steps of a sequence.

    Attributes:
        ms: Sum of the time limits and dwell times of its steps, ms. The sequence has ended, or an alarm of a time limit
            is set, after this time and one scan per step.
        steps: Titles of its steps.
    """

    ms: int
    steps: tuple[str, ...]

    def within_ms(self, scan_ms: int) -> int:
        """Return the longest duration with a given scan time, ms; each transfer takes up to one scan."""
        return self.ms + scan_ms * len(self.steps)


def longest_path(
    sequence: Sequence,
    start: str,
    *,
    ends: Collection[str],
    at_once: Collection[str] = (),
    except_transfers: Collection[tuple[str, str]] = (),
    set_points: Mapping[Word, int],
) -> LongestPath:
    """Return the longest path from a step to any end.

    Args:
        sequence: Sequence; its transfers must not depend on an enable condition while it is examined.
        start: Title of the first step.
        ends: Titles of the steps at which the sequence has ended.
        at_once: Titles of the steps that are left in the scan in which they begin.
        except_transfers: Pairs of titles of the transfers that are assumed not to occur.
        set_points: Values of the words that contain dwell times.

    Raises:
        UnboundedError: A path returns to one of its steps, or a step has neither a time limit nor a dwell time at the
            end of which it is left.
    """
    by_title = {step.title: step for step in sequence.steps}

    def longest(title: str, before: tuple[str, ...]) -> LongestPath:
        if title in ends:
            return LongestPath(0, (title,))
        if title in before:
            raise UnboundedError(f"{sequence.name}: step {title!r} can be repeated without a limit")
        step = by_title[title]
        bound_ms = 0 if title in at_once else _bound_ms(sequence, step, set_points)
        following = dict.fromkeys(to.step for to in step.go if (title, to.step) not in except_transfers)
        rest = max((longest(to, (*before, title)) for to in following), key=lambda path: path.ms)
        return LongestPath(bound_ms + rest.ms, (title, *rest.steps))

    return longest(start, ())


def _bound_ms(sequence: Sequence, step: Step, set_points: Mapping[Word, int]) -> int:
    """Return the longest duration of a step, ms."""
    if not step.go:
        raise UnboundedError(f"{sequence.name}: step {step.title!r} has no transfer")
    if step.watch is not None:
        return step.watch.ms
    dwell = step.dwell
    if dwell is None or all(to.when != dwell.timer.done for to in step.go):
        raise UnboundedError(f"{sequence.name}: step {step.title!r} has neither a time limit nor a dwell time")
    return dwell.preset if isinstance(dwell.preset, int) else set_points[dwell.preset] * dwell.timer.base_ms
