"""Experiments, analyses and settings printed in the two papers.

[P] is the pepper paper, [K] the cabbage paper; [X] marks values that were computed and are not printed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.common.paper_sheet import cabbage_coding, sheet
from plant_sim.study.doe.design import Factor
from plant_sim.study.errors import StudyError

CabbageData = Literal["printed", "reconciled"]


PEPPER_FACTORS: Final = (
    Factor("foam thickness", "mm", 12.0, 3.6),
    Factor("seedling age", "d", 50.0, 5.0),
    Factor("claw pressure", "MPa", 0.45, 0.13),
)
"""Coding of the pepper trial: foam thickness, age of the seedlings, claw pressure. Source: [P] Table 3."""
CABBAGE_FACTORS: Final = tuple(
    Factor(name, unit, *coding)
    for name, unit, coding in zip(
        ("speed", "frequency", "plate force"), ("km/h", "1/min", "N"), cabbage_coding(), strict=True
    )
)
"""Coding of the cabbage trial: machine speed, planting frequency, force of the inner plates. Source: [K] Table 1."""


@dataclass(frozen=True)
class Experiment:
    """Response-surface experiment as printed in a paper.

    Attributes:
        source: Paper, table and section.
        factors: Coded factors X1, X2, ...
        coded: Coded runs, one per row.
        responses: Measured responses of every run by name, %.
    """

    source: str
    factors: tuple[Factor, ...]
    coded: NDArray[np.float64]
    responses: Mapping[str, NDArray[np.float64]]


class PrintedRow(NamedTuple):
    """Row of a printed analysis of variance.

    Attributes:
        source: Model, a term, residual, lack of fit, pure error or total.
        sum_of_squares: Sum of squares.
        degrees: Degrees of freedom.
        mean_square: Mean square; None if not printed.
        f: F value; None if not printed.
        p: P value as printed, such as ``<0.0001``; empty if not printed.
    """

    source: str
    sum_of_squares: float
    degrees: int
    mean_square: float | None
    f: float | None
    p: str


class Correction(NamedTuple):
    """Correction of one cell of cabbage Table 2 that reconciles this table with Table 3.

    Attributes:
        run: Run number.
        column: ``Y1``, ``Y2`` (%) or a coded factor.
        printed: Value in the paper.
        reconciled: Value that reproduces the analysis of the paper.
    """

    run: int
    column: str
    printed: float
    reconciled: float


class PaperSetting(NamedTuple):
    """Setting of the three factors in natural units, with predicted or measured responses.

    Attributes:
        source: Origin of the responses.
        natural: Values of the factors in their units.
        responses: Responses, %.
    """

    source: str
    natural: tuple[float, ...]
    responses: Mapping[str, float]


def printed_anova(name: str) -> tuple[PrintedRow, ...]:
    """Return a printed analysis of variance, such as ``pepper-table-5``."""
    printed = sheet(name)
    columns = zip(
        printed.texts("source"),
        map(float, printed.numbers("sum_of_squares")),
        map(int, printed.numbers("degrees")),
        printed.optional_numbers("mean_square"),
        printed.optional_numbers("f"),
        printed.texts("p"),
        strict=True,
    )
    return tuple(PrintedRow(*row) for row in columns)


def pepper_experiment() -> Experiment:
    """Return the pepper trial, [P] Table 4: success S, %."""
    printed = sheet("pepper-table-4")
    return Experiment(printed.notes[0], PEPPER_FACTORS, printed.points("X1", "X2", "X3"), {"S": printed.numbers("S")})


def pepper_optimum() -> PaperSetting:
    """Return the optimum stated in [P] and its predicted success."""
    printed = sheet("pepper-optimum")
    natural = printed.points("foam_mm", "age_d", "pressure_mpa")[0]
    return PaperSetting("predicted", tuple(map(float, natural)), {"S": float(printed.numbers("S")[0])})


def corrections() -> tuple[Correction, ...]:
    """Return the corrections of cabbage Table 2 [X]."""
    listed = sheet("cabbage-corrections")
    columns = (listed.numbers(name).tolist() for name in ("run", "printed", "reconciled"))
    cells = zip(*columns, listed.texts("column"), strict=True)
    return tuple(Correction(int(run), column, printed, reconciled) for run, printed, reconciled, column in cells)


def cabbage_experiment(data: CabbageData) -> Experiment:
    """Return the cabbage trial, [K] Table 2: lodging Y1 and injury Y2, %.

    Args:
        data: ``printed`` for the printed table, ``reconciled`` for the corrected one.

    Raises:
        StudyError: The data set is unknown, or a correction does not match the printed cell.
    """
    if data not in ("printed", "reconciled"):
        raise StudyError(f"data {data!r}: unknown data set of the cabbage trial; use printed or reconciled")
    printed = sheet("cabbage-table-2")
    names = ("X1", "X2", "X3", "Y1", "Y2")
    columns = {name: printed.numbers(name) for name in names}
    source = printed.notes[0]
    if data == "reconciled":
        correct(columns, printed.numbers("run"), corrections())
        source += " Reconciled with Table 3."
    coded = np.column_stack([columns[name] for name in names[:3]])
    return Experiment(source, CABBAGE_FACTORS, coded, {name: columns[name] for name in names[3:]})


def correct(
    columns: Mapping[str, NDArray[np.float64]], runs: NDArray[np.float64], changes: Sequence[Correction]
) -> None:
    """Apply corrections to columns.

    Raises:
        StudyError: A cell to be corrected does not exist or contains a different value.
    """
    for change in changes:
        where = f"correction of run {change.run}, {change.column}"
        indices = np.flatnonzero(runs == change.run)
        if change.column not in columns or len(indices) != 1:
            raise StudyError(f"{where}: the cell does not exist; specify a run and a column of the table")
        value = columns[change.column][indices[0]]
        if value != change.printed:
            raise StudyError(f"{where}: the table contains {value:g}, not {change.printed:g}; correct one of them")
        columns[change.column][indices[0]] = change.reconciled


def cabbage_settings() -> tuple[PaperSetting, ...]:
    """Return the optimum stated in [K] with its prediction and its verification on the bench and in the field."""
    printed = sheet("cabbage-optimum")
    natural = printed.points("speed_km_h", "frequency_per_min", "force_n")
    responses = printed.points("Y1", "Y2")
    return tuple(
        PaperSetting(source, tuple(map(float, point)), {"Y1": float(y1), "Y2": float(y2)})
        for source, point, (y1, y2) in zip(printed.texts("source"), natural, responses, strict=True)
    )
