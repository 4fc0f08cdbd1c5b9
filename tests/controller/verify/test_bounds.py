"""Upper bound of the duration of a sequence: sums along the longest path, loops, and steps without a limit."""

from __future__ import annotations

import pytest

from controller.core.expr import Timer, Word
from controller.core.sequence import Dwell, Sequence, Step, Timeout, To
from controller.verify.bounds import LongestPath, UnboundedError, longest_path
from tests.controller.core.core_rig import s, x, y

PRESET = Word("D", 0, "dwell x10 ms")
T200 = Timer(200, "dwell")


def watched(title: str, ms: int, *to: str) -> Step:
    timer = ms // 100
    return Step(title, [To(step, x(0)) for step in to], hold=[y(0)], watch=Timeout(ms, s(900 + timer), Timer(timer)))


def dwelling(title: str, preset: int | Word, *to: str) -> Step:
    return Step(title, [To(step, T200.done) for step in to], dwell=Dwell(T200, preset))


def longest(*steps: Step, ends: tuple[str, ...] = ("end",), skipped: tuple[tuple[str, str], ...] = ()) -> LongestPath:
    sequence = Sequence("test", 20, [*steps, Step("end", [], waits_for="nothing")])
    return longest_path(sequence, steps[0].title, ends=ends, except_transfers=skipped, set_points={PRESET: 30})


def test_the_limits_and_dwell_times_of_the_longest_path_are_added() -> None:
    """Of two paths the longer one counts; a dwell time in a register counts with its set-point."""
    path = longest(
        watched("fork", 500, "long", "end"), watched("long", 2_500, "dwell"), dwelling("dwell", PRESET, "end")
    )
    assert path == LongestPath(500 + 2_500 + 300, ("fork", "long", "dwell", "end"))
    assert path.within_ms(10) == 3_300 + 4 * 10


def test_a_repeated_step_has_no_limit_unless_its_repetition_is_excluded() -> None:
    """A path that returns to one of its steps is reported by name."""
    steps = (watched("there", 500, "back"), watched("back", 600, "there", "end"))
    with pytest.raises(UnboundedError, match="test: step 'there' can be repeated without a limit"):
        longest(*steps)
    assert longest(*steps, skipped=(("back", "there"),)).ms == 1_100


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (Step("wait", [To("end", x(0))], waits_for="a person"), "neither a time limit nor a dwell time"),
        (
            Step("wait", [To("end", x(0) & T200.done)], dwell=Dwell(T200, 500)),
            "neither a time limit nor a dwell time",
        ),
        (Step("wait", [], waits_for="a person"), "has no transfer"),
    ],
)
def test_a_wait_without_a_limit_is_reported(step: Step, message: str) -> None:
    """A step must have a time limit, or a transfer that requires only the end of its dwell time."""
    with pytest.raises(UnboundedError, match=message):
        longest(step)
