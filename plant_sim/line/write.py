"""Files of a result: the plants as CSV and Parquet, and a picture of the rows."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
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
from plant_sim.line.row import CAUSES, NO_PLANT, Missing, PlantRow
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

_LINE_M: Final = 25.0
"""Length of row in one line of the picture, m, unless the row requires more than `_MOST_LINES` lines."""
_MOST_LINES: Final = 20
_LONGEST_LINE_M: Final = 100.0
"""Length of row in one line up to which each plant is shown, m."""
_SECTIONS: Final = 50
_ROUNDING: Final = 1e-9
_WIDTH_IN: Final = 7.0
_ROW_IN: Final = 0.12
_GAP_IN: Final = 0.12
_HISTOGRAM_IN: Final = 2.0
_DRAWN_PT: Final = 430.0
"""Width of the axes, points."""
_MARKER_PT: Final = 3.7
_FADED: Final = 0.45
_STANDS: Final = {
    Stand.UPRIGHT: ("upright", "#009E73", "^"),
    Stand.TILTED: ("tilted", "#E69F00", ">"),
    Stand.LODGED: ("lodged", "#D55E00", "s"),
}
_MISSING: Final = dict(zip(CAUSES, ("#111111", "#333333", "#555555", "#777777", "#999999", "#BBBBBB"), strict=True))
"""Colours of the causes where sections are shown; a single position has the letter of its cause."""


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
    """Return a figure with the complete rows, continued from line to line, and the distribution of all spacings.

    Rows that are too long to show each plant are divided into sections, whose shares are shown.

    Call it within `figure_style.drawing`.
    """
    rows, length_m = len(result.rows), max(_LINE_M, result.metres / _MOST_LINES)
    shows_plants = length_m <= _LONGEST_LINE_M
    lines = math.ceil(result.metres / length_m - _ROUNDING) if shows_plants else 1
    height_in = 0.7 + (_ROW_IN * rows + _GAP_IN) * lines if shows_plants else 1.0 + 1.1 * rows
    figure = Figure(figsize=(_WIDTH_IN, height_in + _HISTOGRAM_IN), layout="constrained")
    grid = figure.add_gridspec(2, 1, height_ratios=(height_in, _HISTOGRAM_IN))
    upper, lower = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
    if shows_plants:
        _draw_plants(upper.subplots(), result, length_m, lines)
    else:
        _draw_sections(upper.subplots(rows, 1, sharex=True, squeeze=False)[:, 0].tolist(), result)
    _draw_histogram(lower.subplots(), result)
    return figure


def _draw_plants(axes: Axes, result: LineResult, length_m: float, lines: int) -> None:
    """Draw each position; a line of the picture begins where the previous one ends."""
    rows = len(result.rows)
    step = rows + _GAP_IN / _ROW_IN
    size_pt = min(_MARKER_PT, 0.8 * _DRAWN_PT * result.spacing_m / length_m)
    at_m = [np.where(row.planted, row.position_m, row.travel_m) for row in result.rows]
    line_of = [np.clip((each // length_m).astype(np.int64), 0, lines - 1) for each in at_m]
    for label, colour, marker, is_hollow, chosen in _classes(result.rows):
        if not any(each.any() for each in chosen):
            continue
        axes.scatter(
            np.concatenate(
                [(at - length_m * line)[each] for at, line, each in zip(at_m, line_of, chosen, strict=True)]
            ),
            np.concatenate(
                [(step * line + number)[each] for number, (line, each) in enumerate(zip(line_of, chosen, strict=True))]
            ),
            s=size_pt**2,
            marker=marker,
            facecolors="none" if is_hollow else colour,
            edgecolors=colour,
            linewidths=0.2 * size_pt,
            label=label,
        )
    middles = step * np.arange(lines) + (rows - 1) / 2
    axes.set_yticks(middles, [f"{length_m * line:g} m" for line in range(lines)])
    axes.set_ylim(step * lines - 0.3, -1.0)
    axes.set_xlim(-0.01 * length_m, 1.01 * length_m)
    axes.set_xlabel("position from the start of the line, m")
    axes.set_ylabel("start of the line" if rows == 1 else f"start of the line; {rows} rows each, left first")
    _legend_above(axes)


def _draw_sections(panels: Sequence[Axes], result: LineResult) -> None:
    """Draw the share of each class in each of the sections of a row."""
    edges_m = np.linspace(0.0, result.metres, _SECTIONS + 1)
    for number, (axes, row) in enumerate(zip(panels, result.rows, strict=True), start=1):
        section = np.clip(np.searchsorted(edges_m, row.travel_m, side="right") - 1, 0, _SECTIONS - 1)
        total = np.maximum(np.bincount(section, minlength=_SECTIONS), 1)
        base = np.zeros(_SECTIONS)
        for label, colour, _, is_hollow, chosen in _classes([row]):
            share = 100 * np.bincount(section[chosen[0]], minlength=_SECTIONS) / total
            if share.any():
                axes.bar(
                    edges_m[:-1],
                    share,
                    np.diff(edges_m),
                    base,
                    align="edge",
                    color=colour,
                    alpha=_FADED if is_hollow else 1.0,
                    label=label,
                )
            base += share
        axes.set_ylabel(f"row {number}, %")
        axes.set_ylim(0.0, 100.0)
        axes.set_xlim(0.0, result.metres)
        _legend_above(axes)
    panels[-1].set_xlabel("position along the row, m")


def _classes(rows: Sequence[PlantRow]) -> Iterator[tuple[str, str, str, bool, list[np.ndarray]]]:
    """Yield label, colour, marker, whether it is hollow, and the positions of each row, for each class."""
    for stand, (name, colour, marker) in _STANDS.items():
        for is_scraped in (False, True):
            label = f"{name}, scraped" if is_scraped else name
            yield (
                label,
                colour,
                marker,
                is_scraped,
                [(row.stand == stand) & (row.scraped == is_scraped) for row in rows],
            )
    for cause in CAUSES:
        label = f"missing: {cause.label.replace('_', ' ')}"
        yield label, _MISSING[cause], f"${cause.label[0]}$", False, [row.missing == cause for row in rows]


def _legend_above(axes: Axes) -> None:
    axes.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=5, handletextpad=0.2, columnspacing=1.2, fontsize=7
    )


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
            f"{label} × set", (factor * set_cm, 1.0), (0, 2), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=6, color="#AA0044", ha="center", annotation_clip=False,
        )  # fmt: off
    axes.set_xlabel("plant spacing, cm")
    axes.set_ylabel("number of spacings")
    axes.set_title(
        f"mean {100 * indices.mean_m:.1f} cm, CV {100 * indices.cv:.1f} %, multiple {indices.multiple.percent:.1f} %, "
        f"quality {indices.quality.percent:.1f} %, miss {indices.miss.percent:.1f} %",
        fontsize=8,
        pad=12,
    )
