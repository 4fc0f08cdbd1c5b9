"""Samples of parametrised tests: part of the values by default, all of them with ``--nightly``."""

from collections.abc import Iterable

import pytest
from _pytest.mark import ParameterSet


def first_of(values: Iterable[object], count: int = 1) -> list[ParameterSet]:
    """Return parameters of which the first ones run by default and the others with ``--nightly`` only.

    Args:
        values: Parameters; a tuple holds the values of several arguments.
        count: Number of parameters that run by default.
    """
    return [
        pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=() if n < count else pytest.mark.nightly)
        for n, value in enumerate(values)
    ]
