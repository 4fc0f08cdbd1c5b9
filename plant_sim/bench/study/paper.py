"""The tables of the two papers as data files, and the only reader of them.

[P] is the pepper paper, [K] the cabbage paper; [X] marks what was computed and is not printed. Every file in
``data`` begins with lines that say paper, table and section.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.bench.study.design import Factor
from plant_sim.bench.study.errors import StudyError

DATA: Final = Path(__file__).with_name("data")

CabbageData = Literal["printed", "reconciled"]

#: Coding of the pepper trial: foam thickness, age of the seedlings, claw pressure. Source: [P] Table 3.
PEPPER_FACTORS: Final = (
    Factor("foam thickness", "mm", 12.0, 3.6),
    Factor("seedling age", "d", 50.0, 5.0),
    Factor("claw pressure", "MPa", 0.45, 0.13),
)
#: Coding of the cabbage trial: machine speed, planting frequency, force of the inner plates. Source: [K] Table 1.
CABBAGE_FACTORS: Final = (
    Factor("speed", "km/h", 1.75, 0.15),
    Factor("frequency", "1/min", 58.0, 1.0),
    Factor("plate force", "N", 104.62, 8.79),
)


@dataclass(frozen=True)
class Sheet:
    """One data file.

    Attributes:
        path: Where it was read.
        notes: Its leading lines: paper, table, section, remarks.
        heading: Names of the columns.
        rows: Cells as written, row by row.
        lines: Line of the file each row stands in.
    """

    path: Path
    notes: tuple[str, ...]
    heading: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]

    def texts(self, column: str) -> tuple[str, ...]:
        """Return a column as written.

        Raises:
            StudyError: there is no such column.
        """
        if column not in self.heading:
            raise StudyError(f"{self.path}: has no column {column!r}; it has {', '.join(self.heading)}")
        place = self.heading.index(column)
        return tuple(row[place] for row in self.rows)

    def numbers(self, column: str) -> NDArray[np.float64]:
        """Return a column of numbers.

        Raises:
            StudyError: there is no such column, or a cell is no number.
        """
        return np.array([self._number(place, column, text) for place, text in enumerate(self.texts(column))])

    def optional_numbers(self, column: str) -> tuple[float | None, ...]:
        """Return a column of numbers in which cells may be empty.

        Raises:
            StudyError: there is no such column, or a cell is neither empty nor a number.
        """
        texts = enumerate(self.texts(column))
        return tuple(self._number(place, column, text) if text else None for place, text in texts)

    def points(self, *columns: str) -> NDArray[np.float64]:
        """Return some columns of numbers side by side, one row a point."""
        return np.column_stack([self.numbers(column) for column in columns])

    def _number(self, place: int, column: str, text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            where = f"{self.path}, line {self.lines[place]}"
            raise StudyError(f"{where}: {column} is {text!r}, which is no number; write one as in the paper")
        return value


def read_sheet(path: Path) -> Sheet:
    """Read a data file: lines of notes beginning with ``#``, a heading, rows of as many cells.

    Raises:
        StudyError: it cannot be read, has no notes or heading, or a row is too short or too long.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError(f"{path}: cannot be read ({error}); install the package again") from None
    notes = tuple(line.removeprefix("#").strip() for line in lines if line.startswith("#"))
    cells = [
        (number, tuple(cell.strip() for cell in next(csv.reader([line]))))
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.startswith("#")
    ]
    if not notes or len(cells) < 2:
        raise StudyError(f"{path}: needs a line '# paper, table', a heading and rows")
    (_, heading), *rows = cells
    for number, row in rows:
        if len(row) != len(heading):
            raise StudyError(
                f"{path}, line {number}: {len(row)} cells where the heading has {len(heading)}; complete it"
            )
    return Sheet(path, notes, heading, tuple(row for _, row in rows), tuple(number for number, _ in rows))


def sheet(name: str) -> Sheet:
    """Return the data file of this name, such as ``pepper-table-4``."""
    return read_sheet(DATA / f"{name}.csv")


@dataclass(frozen=True)
class Experiment:
    """A response-surface experiment as a paper prints it.

    Attributes:
        source: Paper, table and section.
        factors: Its coded factors X1, X2, ...
        coded: Its runs, one row each, coded.
        responses: What was measured in every run, by name, %.
    """

    source: str
    factors: tuple[Factor, ...]
    coded: NDArray[np.float64]
    responses: Mapping[str, NDArray[np.float64]]


class PrintedRow(NamedTuple):
    """A line of a printed analysis of variance.

    Attributes:
        source: Model, a term, residual, lack of fit, pure error or total.
        sum_of_squares: Its sum of squares.
        degrees: Its degrees of freedom.
        mean_square: Its mean square, where printed.
        f: Its F, where printed.
        p: Its P as printed, such as ``<0.0001``; empty where there is none.
    """

    source: str
    sum_of_squares: float
    degrees: int
    mean_square: float | None
    f: float | None
    p: str


class Correction(NamedTuple):
    """A cell of cabbage Table 2 that must read otherwise to give Table 3.

    Attributes:
        run: Number of the run.
        column: ``Y1``, ``Y2`` (%) or a coded factor.
        printed: What the paper prints.
        reconciled: What gives the paper's own analysis.
    """

    run: int
    column: str
    printed: float
    reconciled: float


class Setting(NamedTuple):
    """A setting of the three factors in natural units, and what was said or found there.

    Attributes:
        source: Who says so.
        natural: The factors, in their units.
        responses: The responses, %.
    """

    source: str
    natural: tuple[float, ...]
    responses: Mapping[str, float]


def equation(name: str, response: str) -> dict[str, float]:
    """Return the coefficients of a printed equation, such as ``pepper-equation-5``, by term."""
    printed = sheet(name)
    return dict(zip(printed.texts("term"), map(float, printed.numbers(response)), strict=True))


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


def pepper_optimum() -> Setting:
    """Return the setting [P] says to be the best, and the success it predicts there."""
    printed = sheet("pepper-optimum")
    natural = printed.points("foam_mm", "age_d", "pressure_mpa")[0]
    return Setting("predicted", tuple(map(float, natural)), {"S": float(printed.numbers("S")[0])})


def corrections() -> tuple[Correction, ...]:
    """Return the cells of cabbage Table 2 that must read otherwise [X]."""
    listed = sheet("cabbage-corrections")
    columns = (listed.numbers(name).tolist() for name in ("run", "printed", "reconciled"))
    cells = zip(*columns, listed.texts("column"), strict=True)
    return tuple(Correction(int(run), column, printed, reconciled) for run, printed, reconciled, column in cells)


def cabbage_experiment(data: CabbageData) -> Experiment:
    """Return the cabbage trial, [K] Table 2: lodging Y1 and injury Y2, %.

    Args:
        data: ``printed`` as it stands, ``reconciled`` with the corrected cells.

    Raises:
        StudyError: it is neither, or a correction names a cell that does not hold what it says is printed.
    """
    if data not in ("printed", "reconciled"):
        raise StudyError(f"data {data!r}: is no data set of the cabbage trial; take printed or reconciled")
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
    """Put corrections into columns.

    Raises:
        StudyError: a correction names a cell that does not exist, or that holds something else than it says.
    """
    for change in changes:
        where = f"correction of run {change.run}, {change.column}"
        places = np.flatnonzero(runs == change.run)
        if change.column not in columns or len(places) != 1:
            raise StudyError(f"{where}: there is no such cell; name a run and a column of the table")
        value = columns[change.column][places[0]]
        if value != change.printed:
            raise StudyError(f"{where}: the table says {value:g}, not {change.printed:g}; correct one of the two")
        columns[change.column][places[0]] = change.reconciled


def cabbage_settings() -> tuple[Setting, ...]:
    """Return the setting [K] says to be the best: what it predicts there, and its checks on bench and field."""
    printed = sheet("cabbage-optimum")
    natural = printed.points("speed_km_h", "frequency_per_min", "force_n")
    responses = printed.points("Y1", "Y2")
    return tuple(
        Setting(source, tuple(map(float, point)), {"Y1": float(y1), "Y2": float(y2)})
        for source, point, (y1, y2) in zip(printed.texts("source"), natural, responses, strict=True)
    )
