"""Polynomials in the coded factors of an experiment, such as the equations of the papers.

Terms are named as in the papers: ``1`` for the constant, ``X1``, ``X1 X2``, ``X1^2``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.common.errors import InputError

CONSTANT: Final = "1"

_PART = re.compile(r"X([1-9]\d*)(\^2)?")


@dataclass(frozen=True)
class Polynomial:
    """Polynomial in the coded factors, such as a printed equation.

    Attributes:
        coefficients: Coefficients by term; ``1`` is the constant.
    """

    coefficients: Mapping[str, float]

    def predict(self, coded: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the value at coded points, one per row; a single point gives an array with one element."""
        points = np.atleast_2d(np.asarray(coded, dtype=np.float64))
        value: NDArray[np.float64] = model_matrix(points, list(self.coefficients)) @ list(self.coefficients.values())
        return value


def model_matrix(coded: NDArray[np.float64], names: Sequence[str]) -> NDArray[np.float64]:
    """Return the model matrix of the given terms at coded points.

    Args:
        coded: Points, one per row.
        names: Names of the terms, including the constant if required.

    Raises:
        InputError: A term is malformed, or its factor does not exist.
    """
    return np.column_stack([_column(coded, name) for name in names])


def _column(coded: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    column = np.ones(len(coded))
    for factor, power in _powers(name, coded.shape[1]):
        column = column * (coded[:, factor] if power == 1 else coded[:, factor] ** power)
    return column


@cache
def _powers(name: str, factors: int) -> tuple[tuple[int, int], ...]:
    """Return the factors of a term, numbered from 0, with their powers; empty for the constant."""
    if name == CONSTANT:
        return ()
    powers = []
    for part in name.split(" "):
        match = _PART.fullmatch(part)
        if match is None or int(match[1]) > factors:
            available = f"the design has X1 to X{factors}"
            raise InputError(f"term {name!r}: {available}; write a term such as X1, 'X1 X2' or X1^2")
        powers.append((int(match[1]) - 1, 2 if match[2] else 1))
    return tuple(powers)
