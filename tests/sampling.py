"""Samples of tests: some of the values or Hypothesis examples by default, more every night, all of them every week."""

from collections.abc import Callable, Iterable
from typing import Any, Final, TypeVar

import pytest
from _pytest.mark import ParameterSet
from hypothesis import settings

NIGHTLY: Final = "nightly"
"""Mark of the tests of a night, and name of the Hypothesis profile with which they are selected."""
WEEKLY: Final = "weekly"
"""Mark of the tests of a week."""
MORE_EXAMPLES: Final = "more_examples"
"""Mark of the tests by default that are repeated every night with more Hypothesis examples."""
DEFAULT: Final = "by default"
"""Name of the Hypothesis profile of the tests by default."""
for profile in (DEFAULT, NIGHTLY):
    settings.register_profile(profile, deadline=None)  # an example takes longer on a busy computer

Function = TypeVar("Function", bound=Callable[..., Any])


def first_of(values: Iterable[object], count: int = 1, *, nightly: int | None = None) -> list[ParameterSet]:
    """Return parameters, of which only the first `count` run by default.

    Args:
        values: Parameters; a tuple contains the values of several arguments.
        count: Number of parameters that run by default.
        nightly: Number of further parameters that run every night; the rest runs every week. None means all.
    """
    return [_parameter(value, max(0, n - count + 1), nightly) for n, value in enumerate(values)]


def one_in(every: int, values: Iterable[object]) -> list[ParameterSet]:
    """Return parameters, of which one in `every`, starting with the first, runs by default, the others every night."""
    return [_parameter(value, n % every, None) for n, value in enumerate(values)]


def examples(count: int, nightly: int, **others: Any) -> Callable[[Function], Function]:
    """Return a decorator that sets the number of Hypothesis examples of a test.

    Args:
        count: Number of examples by default.
        nightly: Number of examples every night.
        others: Further settings of Hypothesis.
    """
    by_night = settings.get_current_profile_name() == NIGHTLY
    chosen = settings(max_examples=nightly if by_night else count, **others)

    def set_up(function: Function) -> Function:
        return getattr(pytest.mark, MORE_EXAMPLES)(chosen(function))  # type: ignore[no-any-return]

    return set_up


def _parameter(value: object, number: int, nightly: int | None) -> ParameterSet:
    values = value if isinstance(value, tuple) else (value,)
    each = value if isinstance(value, ParameterSet) else pytest.param(*values)
    if number == 0:
        return each
    mark = pytest.mark.nightly if nightly is None or number <= nightly else pytest.mark.weekly
    return each._replace(marks=(*each.marks, mark))
