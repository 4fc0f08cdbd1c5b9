"""Samples of parametrised tests: some of the values by default, all of them with ``--nightly``."""

from collections.abc import Iterable

import pytest
from _pytest.mark import ParameterSet


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


def _parameter(value: object, *, by_default: bool) -> ParameterSet:
    return pytest.param(
        *(value if isinstance(value, tuple) else (value,)), marks=() if by_default else pytest.mark.nightly
    )
