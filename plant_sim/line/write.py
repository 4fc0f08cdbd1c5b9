"""Files of a result: the plants as CSV and Parquet, and a picture of the rows."""

from __future__ import annotations

import os
from errno import EACCES, ENOENT, ENOTDIR
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from plant_sim.common.figure_style import QUIET, drawing
from plant_sim.common.picture_form import PictureForm
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.common.provenance.result_files import ResultFiles
from plant_sim.line.errors import LineError
from plant_sim.line.result import LineResult
from plant_sim.line.row import NO_PLANT, Missing, PlantRow
from plant_sim.planter.verdict import Stand

COLUMNS: Final = (
    "row",
    "cup",
    "time_s",
    "travel_m",
    "speed_m_s",
    "lambda",
    "plants",
    "missing",
    "position_m",
    "spacing_m",
    "depth_m",
    "tilt_deg",
    "stand",
    "scraped",
    "injured",
)
"""Columns of the table of plants; a missing value is an empty cell in CSV and null in Parquet."""

_SHOWN_M = 25.0
"""Length of row in the upper part of the picture, m."""
_WIDTH_IN = 7.0
_STANDS = {Stand.UPRIGHT: ("upright", "#009E73", "^"), Stand.TILTED: ("tilted", "#E69F00", ">")}
_LODGED = ("lodged", "#D55E00", "_")
_MISSING = ("missing", "#444444", "x")


def check_folder(out: Path) -> None:
    """Check before a run that the folder for its files exists or can be created in its parent; nothing is created.

    Raises:
        LineError: The folder cannot be created or written.
    """
    nearest = out if out.exists() else out.parent
    number = ENOENT if not nearest.exists() else ENOTDIR if not nearest.is_dir() else EACCES
    if number != EACCES or not os.access(nearest, os.W_OK):
        raise LineError(f"{out}: cannot be created ({os.strerror(number)}); specify another --out")


def write_result(
    result: LineResult, out: Path, provenance: Provenance | None = None, form: PictureForm | None = None
) -> list[Path]:
    """Write ``plants.csv``, ``plants.parquet``, the picture ``rows`` with its data, and ``result.json``.

    Args:
        result: The result.
        out: Folder, which is created if it does not exist.
        provenance: Provenance, which is also a file if there is one.
        form: Form of the picture; None = PNG and SVG.

    Returns:
        The paths of the files.

    Raises:
        InputError: A file cannot be written.
    """
    plants = plant_table(result)
    try:
        out.mkdir(exist_ok=True)
    except OSError as error:
        raise LineError(f"{out}: cannot be created ({error.strerror}); specify another --out") from None
    files = ResultFiles(out, provenance, form=form)
    files.csv("plants.csv", COLUMNS, zip(*(plants.column(name).to_pylist() for name in COLUMNS), strict=True))
    files.parquet("plants.parquet", plants)
    with drawing():
        files.picture("rows", row_picture(result))
    files.json("result.json", result.record())
    return files.finish()


def plant_table(result: LineResult) -> pa.Table:
    """Return a table of the positions of all rows with the columns `COLUMNS`."""
    return pa.concat_tables(
        pa.table(dict(zip(COLUMNS, _columns(number, row), strict=True)))
        for number, row in enumerate(result.rows, start=1)
    )


def _columns(number: int, row: PlantRow) -> list[pa.Array]:
    causes = [None if code == Missing.NONE else Missing(code).label for code in row.missing.tolist()]
    stands = [None if code == NO_PLANT else Stand(code).name.lower() for code in row.stand.tolist()]
    numbers = (row.time_s, row.travel_m, row.speed_m_s, row.ratio)
    return [
        pa.array(np.full(row.released, number)),
        pa.array(row.cup),
        *(pa.array(values, from_pandas=True) for values in numbers),
        pa.array(row.seedlings),
        pa.array(causes, type=pa.string()),
        pa.array(row.position_m, from_pandas=True),
        pa.array(_spacing_m(row), from_pandas=True),
        pa.array(row.depth_m, from_pandas=True),
        pa.array(row.tilt_deg, from_pandas=True),
        pa.array(stands, type=pa.string()),
        pa.array(row.scraped),
        pa.nulls(row.released, pa.bool_()) if row.injured is None else pa.array(row.injured),
    ]


def _spacing_m(row: PlantRow) -> np.ndarray:
    """Return the distance from the previous planted position to each planted one, m; NaN elsewhere."""
    spacing_m = np.full(row.released, np.nan)
    planted = np.flatnonzero(row.planted)
    spacing_m[planted[1:]] = np.diff(row.position_m[planted])
    return spacing_m


def row_picture(result: LineResult) -> Figure:
    """Return a figure with the first metres of each row, and the distribution of all spacings.

    Call it within `figure_style.drawing`.
    """
    rows = result.rows
    figure = Figure(figsize=(_WIDTH_IN, 2.6 + 0.7 * len(rows)), layout="constrained")
    strip, histogram = figure.subplots(2, 1, height_ratios=(0.6 + 0.5 * len(rows), 1.6))
    _draw_strip(strip, result)
    _draw_histogram(histogram, result)
    return figure


def _draw_strip(axes: Axes, result: LineResult) -> None:
    for number, row in enumerate(result.rows, start=1):
        shown = row.travel_m <= _SHOWN_M
        for stand, (label, colour, marker) in {**_STANDS, Stand.LODGED: _LODGED}.items():
            chosen = shown & (row.stand == stand)
            axes.scatter(
                row.position_m[chosen],
                np.full(np.count_nonzero(chosen), number),
                s=14,
                color=colour,
                marker=marker,
                linewidths=1.2,
                label=label if number == 1 else None,
            )
        empty = shown & ~row.planted
        axes.scatter(
            row.travel_m[empty],
            np.full(np.count_nonzero(empty), number),
            s=14,
            color=_MISSING[1],
            marker=_MISSING[2],
            linewidths=1.0,
            label=_MISSING[0] if number == 1 else None,
        )
        for at_m, code in zip(row.travel_m[empty], row.missing[empty], strict=True):
            axes.annotate(
                _short(int(code)), (at_m, number), (0, 5), textcoords="offset points", ha="center", fontsize=6
            )
    axes.set_yticks(range(1, len(result.rows) + 1), [f"row {number}" for number in range(1, len(result.rows) + 1)])
    axes.set_ylim(0.4, len(result.rows) + 0.6)
    axes.set_xlim(-0.2, _SHOWN_M + 0.2)
    axes.set_xlabel("position along the row, m")
    axes.set_ylabel("planted row")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, handletextpad=0.2, columnspacing=1.2)


def _draw_histogram(axes: Axes, result: LineResult) -> None:
    spacings_cm = 100 * np.concatenate([np.diff(row.plants_m) for row in result.rows])
    set_cm, indices = 100 * result.spacing_m, result.spacing
    top_cm = max(float(spacings_cm.max(initial=0.0)), 2 * set_cm)
    axes.hist(spacings_cm, bins=np.arange(0.0, top_cm + 1.0, 1.0).tolist(), color=QUIET)
    if len(spacings_cm):
        axes.set_yscale("log")
    for factor, label in ((0.5, "0.5"), (1.5, "1.5")):
        axes.axvline(factor * set_cm, color="#AA0044", linestyle=(0, (4, 2)), linewidth=0.9)
        axes.annotate(
            f"{label} × set", (factor * set_cm, 1.0), (3, -8), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=6, color="#AA0044",
        )  # fmt: off
    axes.set_xlabel("plant spacing, cm")
    axes.set_ylabel("number of spacings")
    axes.set_title(
        f"mean {100 * indices.mean_m:.1f} cm, CV {100 * indices.cv:.1f} %, multiple {indices.multiple.percent:.1f} %, "
        f"quality {indices.quality.percent:.1f} %, miss {indices.miss.percent:.1f} %",
        fontsize=8,
    )


def _short(code: int) -> str:
    """Return the letter of a cause: the letter of the paper, or the first letter of its name in lower case."""
    return Missing(code).label[0]
