"""Data of a figure: the numbers that its lines, points, bars and contours are drawn from, as a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection, PolyCollection, QuadMesh
from matplotlib.container import ErrorbarContainer
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

COLORBAR: Final = "<colorbar>"
"""Label that Matplotlib gives to the axes of a colour bar, which show no data of their own."""


class DrawnMark(NamedTuple):
    """Row of the table.

    Attributes:
        panel: Number of the panel, from 1.
        x_axis: Label of the horizontal axis.
        y_axis: Label of the vertical axis.
        kind: ``line``, ``points``, ``bar``, ``contour``, ``cell``, ``vertical line`` or ``horizontal line``.
        series: Number of the line or group of points in the panel, from 1.
        label: Its label in the legend; empty without one.
        x: Horizontal position; None for a horizontal line.
        y: Vertical position; None for a vertical line.
        x_low: Lower end of the error bar, or of the bar, in the horizontal direction.
        x_high: Upper end.
        y_low: Lower end of the error bar, or of the bar, in the vertical direction.
        y_high: Upper end.
        value: Level of the contour line, or value of the cell.
    """

    panel: int
    x_axis: str
    y_axis: str
    kind: str
    series: int
    label: str
    x: float | None = None
    y: float | None = None
    x_low: float | None = None
    x_high: float | None = None
    y_low: float | None = None
    y_high: float | None = None
    value: float | None = None


class _Series(NamedTuple):
    """Line or group of points, with the columns of its rows from `DrawnMark.x` on."""

    kind: str
    label: str
    rows: Sequence[tuple[float | None, ...]]


def drawn_marks(figure: Figure) -> list[DrawnMark]:
    """Return the data of a figure: panel by panel, in the order of drawing."""
    panels = [axes for axes in figure.axes if axes.get_label() != COLORBAR]
    return [
        DrawnMark(number, _words(axes.get_xlabel()), _words(axes.get_ylabel()), each.kind, index, each.label, *row)
        for number, axes in enumerate(panels, 1)
        for index, each in enumerate(_series(axes), 1)
        for row in each.rows
    ]


def _series(axes: Axes) -> Iterator[_Series]:
    """Yield the lines and groups of points of a panel; those without data are omitted."""
    of_bars: set[Artist] = set()
    for container in axes.containers:
        if isinstance(container, ErrorbarContainer):
            data, caps, bars = container.lines
            of_bars.update((*(() if data is None else (data,)), *caps, *bars))
            if data is not None:
                yield _Series("points" if _is_bare(data) else "line", _label(container), _with_bars(data, bars))
    for line in axes.lines:
        if line not in of_bars:
            yield from _line(axes, line)
    for collection in axes.collections:
        if collection not in of_bars:
            yield from _collection(collection)
    boxes = [
        _box(patch.get_bbox().get_points())
        for patch in axes.patches
        if isinstance(patch, Rectangle) and patch.get_transform().contains_branch(axes.transData)
    ]
    if boxes:
        yield _Series("bar", "", boxes)


def _line(axes: Axes, line: Line2D) -> Iterator[_Series]:
    x, y = (np.asarray(each, dtype=np.float64) for each in line.get_data(orig=False))
    along_x, along_y = line.get_transform().contains_branch_seperately(axes.transData)
    if along_x and along_y:
        kind = "points" if _is_bare(line) else "line"
        yield _Series(kind, _label(line), [(float(a), float(b)) for a, b in zip(x, y, strict=True)])
    elif along_x:
        yield _Series("vertical line", _label(line), [(float(x[0]), None)])
    elif along_y:
        yield _Series("horizontal line", _label(line), [(None, float(y[0]))])


def _collection(collection: Artist) -> Iterator[_Series]:
    if isinstance(collection, QuadContourSet):
        if not collection.filled:
            rows: list[tuple[float | None, ...]] = [
                (float(x), float(y), None, None, None, None, float(level))
                for level, segments in zip(collection.levels, collection.allsegs, strict=True)
                for segment in segments
                for x, y in segment
            ]
            yield _Series("contour", _label(collection), rows)
    elif isinstance(collection, QuadMesh):
        corners = np.asarray(collection.get_coordinates(), dtype=np.float64)
        low, high, values = corners[:-1, :-1], corners[1:, 1:], np.asarray(collection.get_array(), dtype=np.float64)
        middle = (low + high) / 2
        parts = (middle.reshape(-1, 2), low.reshape(-1, 2), high.reshape(-1, 2), values.reshape(-1, 1))
        yield _Series(
            "cell",
            _label(collection),
            [(x, y, x0, x1, y0, y1, value) for x, y, x0, y0, x1, y1, value in np.hstack(parts).tolist()],
        )
    elif isinstance(collection, PathCollection):
        offsets = np.asarray(collection.get_offsets(), dtype=np.float64)
        yield _Series("points", _label(collection), [(x, y) for x, y in offsets.tolist()])
    elif isinstance(collection, LineCollection):
        segments = (np.asarray(each, dtype=np.float64) for each in collection.get_segments())
        yield _Series("bar", _label(collection), [_box(each) for each in segments if len(each)])
    elif isinstance(collection, PolyCollection):
        outlines = (np.asarray(path.vertices, dtype=np.float64) for path in collection.get_paths())
        yield _Series("bar", _label(collection), [_box(each) for each in outlines if len(each)])


def _with_bars(data: Line2D, bars: tuple[LineCollection, ...]) -> list[tuple[float | None, ...]]:
    """Return the points of an error-bar plot with the ends of their bars."""
    x, y = (np.asarray(each, dtype=np.float64).tolist() for each in data.get_data(orig=False))
    ends: list[list[float | None]] = [[None] * 4 for _ in x]
    for bar in bars:
        for four, path in zip(ends, bar.get_paths(), strict=True):
            if np.isfinite(path.vertices).all():
                box = _box(np.asarray(path.vertices))
                for column in (0, 2):  # a bar has a length in one direction; without a length there is no bar
                    if box[2 + column] < box[3 + column]:
                        four[column : column + 2] = box[2 + column : 4 + column]
    return [(a, b, *four) for a, b, four in zip(x, y, ends, strict=True)]


def _box(corners: np.ndarray) -> tuple[float, ...]:
    """Return the middle of some corners, and their lowest and highest x and y."""
    (x0, y0), (x1, y1) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    return (x0 + x1) / 2, (y0 + y1) / 2, x0, x1, y0, y1


def _is_bare(line: Line2D) -> bool:
    return line.get_linestyle() in {"None", "none", " ", ""}


def _label(artist: object) -> str:
    label = str(getattr(artist, "get_label")() or "")  # noqa: B009 - containers and artists have it in common
    return "" if label.startswith("_") else label


def _words(text: str) -> str:
    return " ".join(text.split())
