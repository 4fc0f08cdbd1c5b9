"""Categorical factors of a table of trials, such as variety, type of nozzle or operator."""

from __future__ import annotations

import itertools
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from plant_sim.study.analyse.table import TrialColumn, TrialTable
from plant_sim.study.doe.block_columns import block_columns

MOST_LABELS: Final = 10
"""Maximum number of levels of a categorical factor."""


@dataclass(frozen=True)
class KindFactor:
    """Categorical factor: its levels have names and no order.

    Its columns in the model are deviations from the mean of the levels, so a coefficient is the effect of one level
    relative to that mean. The effect of the last level is minus the sum of the others.

    Attributes:
        name: Name.
        cells: Level of each trial.
    """

    name: str
    cells: tuple[str, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """Levels in the order of the table."""
        return tuple(dict.fromkeys(self.cells))

    @property
    def columns(self) -> NDArray[np.float64]:
        """Columns for the model matrix, one less than there are levels."""
        return block_columns(self.cells)

    @property
    def codes(self) -> NDArray[np.float64]:
        """Number of the level of each trial, from 0 in the order of `labels`."""
        return np.array([self.labels.index(cell) for cell in self.cells], dtype=np.float64)


def combinations(kinds: Sequence[KindFactor]) -> list[tuple[str, ...]]:
    """Return every combination of the levels; one empty combination without categorical factors."""
    return list(itertools.product(*(each.labels for each in kinds)))


def combination_columns(kinds: Sequence[KindFactor], labels: Sequence[str]) -> NDArray[np.float64]:
    """Return the columns of the model matrix for one combination of levels."""
    parts = [block_columns(each.labels)[each.labels.index(label)] for each, label in zip(kinds, labels, strict=True)]
    return np.concatenate([np.empty(0), *parts])


def read_kind(table: TrialTable, column: TrialColumn, *, is_named: bool) -> KindFactor:
    """Return the categorical factor of a column.

    Args:
        table: The table.
        column: Its column.
        is_named: True if the user says that the column is categorical, so that numbers are names, too.

    Raises:
        StudyError: A level is missing, is probably a typing error, or there are too few or too many levels.
    """
    cells = table.texts(column)
    first: dict[str, tuple[str, int]] = {}
    for line, cell in zip(table.lines, cells, strict=True):
        if not is_named and table.is_number(cell):
            raise table.error(
                line,
                column,
                f"{cell} is a number among names; correct it, or name the column with --categorical",
            )
        plain = "".join(unicodedata.normalize("NFKC", cell).casefold().split())
        other, other_line = first.setdefault(plain, (cell, line))
        if other != cell:
            raise table.error(
                line, column, f"{cell!r} is probably {other!r}, as in line {other_line}; write one of them"
            )
    if len(first) == 1:
        raise table.error(
            table.lines[0],
            column,
            f"is {cells[0]!r} in every trial, so it is no factor; name the factors with --factors",
        )
    if len(first) > MOST_LABELS:
        line = next(line for line, cell in zip(table.lines, cells, strict=True) if cell == list(first.values())[-1][0])
        raise table.error(
            line, column, f"has more than {MOST_LABELS} levels here; combine levels, or name it with --blocks"
        )
    return KindFactor(column.name, tuple(cells))
