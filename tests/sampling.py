"""Samples of tests: some of the values or Hypothesis examples by default, all of them with ``--nightly``."""

from collections.abc import Iterable
from typing import Final

import pytest
from _pytest.mark import ParameterSet
from hypothesis import settings

NIGHTLY: Final = "nightly"
"""Mark of the long tests, and name of the Hypothesis profile with which they are selected."""
settings.register_profile(NIGHTLY)


def first_of(values: Iterable[object], count: int = 1) -> list[ParameterSet]:
    """Return parameters, of which only the first `count` run without ``--nightly``.

    Args:
        values: Parameters; a tuple contains the values of several arguments.
        count: Number of parameters that run by default.
    """
    return [_parameter(value, by_default=n < count) for n, value in enumerate(values)]


def one_in(every: int, values: Iterable[object]) -> list[ParameterSet]:
    """Return parameters, of which only one in `every`, starting with the first, runs without ``--nightly``."""
    return [_parameter(value, by_default=n % every == 0) for n, value in enumerate(values)]


def examples(count: int, nightly: int) -> settings:
    """Return Hypothesis settings without a deadline.

    Args:
        count: Number of examples by default.
        nightly: Number of examples with ``--nightly``.
    """
    return settings(deadline=None, max_examples=nightly if settings.get_current_profile_name() == NIGHTLY else count)


def _parameter(value: object, *, by_default: bool) -> ParameterSet:
    return pytest.param(
        *(value if isinstance(value, tuple) else (value,)), marks=() if by_default else pytest.mark.nightly
    )
