"""Figures of fitted responses: contours over pairs of factors, observed against predicted values, Pareto fronts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from plant_sim.common.figure_style import COLOURS, QUIET, SERIES, drawing
from plant_sim.study.doe.design import Factor, to_natural
from plant_sim.study.doe.optimum import Front, Surface
from plant_sim.study.errors import StudyError
from plant_sim.study.report.axis_labels import axis_label

_PANEL_IN: Final = (3.1, 2.9)
_COLUMNS = 3
_SIGNS = "oXs^D"
_GRID = 81
_SHADES = 4
"""Number of colour steps between two contour lines."""
_OUTSIDE: Final = "#BBBBBB"
_LABEL_EDGE = 0.08
"""Minimum distance of a label from the frame, as a fraction of the panel; a closer label would be clipped."""
_LABELS_APART = 0.12
"""Minimum distance between two labels, as a fraction of the panel."""
_ON_SLICE = 1e-6

Panel = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
Marks = Mapping[str, NDArray[np.float64]]


def contours(
    surface: Surface,
    factors: Sequence[Factor],
    *,
    response: str,
    held: Sequence[float],
    reach: Sequence[float],
    marks: Marks | None = None,
    box: float | None = None,
    limits: tuple[float, float] | None = None,
) -> Figure:
    """Draw a response over every pair of factors, with the others fixed.

    Args:
        surface: Response surface.
        factors: Factors, at least two.
        response: Name and unit for the colour bar.
        held: Coded levels of the factors not shown in a panel.
        reach: Half-width of the panels, coded, one per factor.
        marks: Points to mark, coded, by their name in the legend.
        box: Half the edge length of the search box, coded, drawn as a frame; None for no frame.
        limits: Limits of the response; areas outside the limits are grey; None for no limits.

    Raises:
        StudyError: There are fewer than two factors.
    """
    pairs = list(itertools.combinations(range(len(factors)), 2))
    if not pairs:
        raise StudyError(f"contours of {response}: two or more factors are required; draw a line instead")
    columns = min(len(pairs), _COLUMNS)
    rows = math.ceil(len(pairs) / columns)
    grids = [_grid(surface, pair, held, reach) for pair in pairs]
    lines, fills = _levels(grids, limits)
    with drawing():
        figure = Figure(figsize=(_PANEL_IN[0] * columns + 0.6, _PANEL_IN[1] * rows), layout="constrained")
        panels = [figure.add_subplot(rows, columns, index + 1) for index in range(len(pairs))]
        for axes, pair, (x, y, values) in zip(panels, pairs, grids, strict=True):
            x_axis, y_axis = factors[pair[0]], factors[pair[1]]
            natural = x_axis.centre + x_axis.step * x, y_axis.centre + y_axis.step * y
            filled = axes.contourf(*natural, values, levels=fills, cmap="viridis")
            drawn = axes.contour(*natural, values, levels=lines, colors="white", linewidths=0.5)
            axes.set_facecolor(_OUTSIDE)
            _label(axes, drawn)
            axes.set_xlabel(axis_label(x_axis.label))
            axes.set_ylabel(axis_label(y_axis.label))
            axes.set_title(_held_text(factors, pair, held), fontsize=7, color=QUIET)
            _mark(axes, factors, pair, marks or {}, held)
            _frame(axes, factors, pair, box)
        figure.colorbar(filled, ax=panels, label=axis_label(response), ticks=lines)
        if marks:
            values_at_marks = {name: float(surface.predict(point)[0]) for name, point in marks.items()}
            figure.legend(handles=_meanings(values_at_marks), loc="outside lower center", ncols=len(marks))
    return figure


def _grid(surface: Surface, pair: tuple[int, int], held: Sequence[float], reach: Sequence[float]) -> Panel:
    """Return the coded coordinates of a panel and the response at each point."""
    x, y = np.meshgrid(*(np.linspace(-reach[index], reach[index], _GRID) for index in pair))
    points = np.tile(np.asarray(held, dtype=np.float64), (x.size, 1))
    points[:, pair[0]], points[:, pair[1]] = x.ravel(), y.ravel()
    return x, y, surface.predict(points).reshape(x.shape)


def lowest_and_highest(
    surface: Surface, factors: Sequence[Factor], *, held: Sequence[float], reach: Sequence[float]
) -> tuple[tuple[float, NDArray[np.float64]], tuple[float, NDArray[np.float64]]]:
    """Return the minimum and maximum response in the panels of `contours`, each with its coded point.

    Args:
        surface: Response surface.
        factors: Factors, at least two.
        held: Coded levels of the factors not shown in a panel.
        reach: Half-width of the panels, coded, one per factor.
    """
    extremes: list[tuple[float, NDArray[np.float64]]] = []
    for pair in itertools.combinations(range(len(factors)), 2):
        x, y, values = _grid(surface, pair, held, reach)
        for index in (int(values.argmin()), int(values.argmax())):
            point = np.asarray(held, dtype=np.float64).copy()
            point[pair[0]], point[pair[1]] = x.flat[index], y.flat[index]
            extremes.append((float(values.flat[index]), point))
    return min(extremes, key=lambda each: each[0]), max(extremes, key=lambda each: each[0])


def _levels(
    grids: Sequence[Panel], limits: tuple[float, float] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rounded levels for the contour lines and finer levels for the colours, common to all panels."""
    values = np.concatenate([each.ravel() for _, _, each in grids])
    if limits is not None:
        values = np.clip(values, *limits)
    lines = np.asarray(MaxNLocator(nbins=10, steps=[1, 2, 5, 10]).tick_values(values.min(), values.max()))
    return lines, np.linspace(lines[0], lines[-1], _SHADES * (len(lines) - 1) + 1)


def _held_text(factors: Sequence[Factor], pair: tuple[int, int], held: Sequence[float]) -> str:
    rest = [(factor, held[index]) for index, factor in enumerate(factors) if index not in pair]
    values = ((factor, f"{factor.name} {factor.natural(level):.4g}") for factor, level in rest)
    return "; ".join(text if factor.unit == "-" else f"{text} {factor.unit}" for factor, text in values)


def _label(axes: Axes, drawn: ContourSet) -> None:
    """Label each contour line once, at its point farthest from the frame and from the other labels.

    A line without a point that is far enough from both has no label.
    """
    to_axes = axes.transData + axes.transAxes.inverted()
    places: list[NDArray[np.float64]] = []
    points: list[tuple[float, float]] = []
    for segments in drawn.allsegs:
        line = np.concatenate([each for each in segments if len(each)] or [np.empty((0, 2))])
        shown = to_axes.transform(line) if len(line) else line
        from_frame = np.minimum(shown, 1 - shown).min(axis=1) if len(line) else np.empty(0)
        inside = from_frame > _LABEL_EDGE
        if not inside.any():
            continue
        line, shown, apart = line[inside], shown[inside], from_frame[inside]
        if places:
            from_labels = np.linalg.norm(shown[:, None] - np.array(places)[None], axis=2).min(axis=1)
            apart = np.where(from_labels > _LABELS_APART, np.minimum(apart, from_labels), 0.0)
        best = int(apart.argmax())
        if apart[best] > 0:
            places.append(shown[best])
            points.append((float(line[best, 0]), float(line[best, 1])))
    if points:
        axes.clabel(drawn, fmt="%g", fontsize=6, manual=points)


def _frame(axes: Axes, factors: Sequence[Factor], pair: tuple[int, int], box: float | None) -> None:
    """Draw the frame of the search box."""
    if box is not None:
        corners = np.array([(-box, -box), (box, -box), (box, box), (-box, box), (-box, -box)])
        frame = to_natural([factors[index] for index in pair], corners)
        axes.plot(frame[:, 0], frame[:, 1], color="white", linewidth=0.8, linestyle=(0, (4, 2)))


def _mark(axes: Axes, factors: Sequence[Factor], pair: tuple[int, int], marks: Marks, held: Sequence[float]) -> None:
    """Draw the marked points projected onto this pair of factors; a point is hollow if it is not in the plane shown."""
    rest = [index for index in range(len(factors)) if index not in pair]
    for (name, point), sign in zip(marks.items(), itertools.cycle(_SIGNS)):
        natural = to_natural(factors, point)
        on_slice = all(abs(point[index] - held[index]) < _ON_SLICE for index in rest)
        colours = (COLOURS["right"], "white") if on_slice else ("none", COLOURS["right"])
        axes.plot(
            natural[pair[0]],
            natural[pair[1]],
            sign,
            markerfacecolor=colours[0],
            markeredgecolor=colours[1],
            markersize=7 if on_slice else 10,
            linestyle="none",
            label=name,
        )


def _meanings(values: Mapping[str, float]) -> list[Line2D]:
    """Return the legend entries of the marked points, with the response at each."""
    return [
        Line2D(
            [], [], marker=sign, color=COLOURS["right"], markersize=6, linestyle="none", label=f"{name}: {value:.2f}"
        )
        for (name, value), sign in zip(values.items(), itertools.cycle(_SIGNS))
    ]


def observed_against_predicted(
    observed: NDArray[np.float64], predicted: NDArray[np.float64], *, response: str, r2: float
) -> Figure:
    """Plot observed against predicted responses, with the line of equality.

    Args:
        observed: Observed responses, one per run.
        predicted: Predicted responses of the same runs.
        response: Name and unit for both axes.
        r2: Coefficient of determination, 0 to 1.
    """
    ends = [float(min(observed.min(), predicted.min())), float(max(observed.max(), predicted.max()))]
    with drawing():
        figure = Figure(figsize=(3.6, 3.4), layout="constrained")
        axes = figure.add_subplot()
        axes.plot(ends, ends, color=QUIET, linewidth=0.8, label="observed = predicted")
        axes.plot(predicted, observed, "o", color=COLOURS["left"], markersize=4, markeredgewidth=0)
        axes.set_xlabel(f"predicted {axis_label(response)}")
        axes.set_ylabel(f"observed {axis_label(response)}")
        axes.set_aspect("equal", adjustable="datalim")
        axes.legend(fontsize=7)
        axes.set_title(f"R² = {r2:.4f}, {len(observed)} runs", fontsize=8)
    return figure


def pareto_front(
    front: Front,
    *,
    a: str,
    b: str,
    marks: Mapping[str, tuple[float, float]],
    cloud: NDArray[np.float64],
    beside: Mapping[str, Front] | None = None,
) -> Figure:
    """Draw a Pareto front in the plane of its two responses.

    Args:
        front: Pareto front.
        a: Name and unit of the first response.
        b: Name and unit of the second response.
        marks: Pairs of responses to mark, by their name in the legend.
        cloud: Pairs of responses on a grid of the box, one per row, drawn in the background.
        beside: Further fronts to compare, dashed, by their name in the legend; the first one is then "as printed".
    """
    with drawing():
        figure = Figure(figsize=(4.8, 3.6), layout="constrained")
        axes = figure.add_subplot()
        axes.plot(
            cloud[:, 0], cloud[:, 1], ".", color="#CCCCCC", markersize=2, markeredgewidth=0, label="settings in the box"
        )
        label = "Pareto front, as printed" if beside else "Pareto front"
        axes.plot(front.a, front.b, color=COLOURS["left"], label=label)
        for name, other in (beside or {}).items():
            axes.plot(other.a, other.b, "--", color=COLOURS["right"], label=name)
        for (name, point), colour, sign in zip(marks.items(), itertools.cycle(SERIES), itertools.cycle(_SIGNS)):
            axes.plot(*point, sign, color=colour, markeredgecolor="white", markersize=7, linestyle="none", label=name)
        axes.set_xlabel(axis_label(a))
        axes.set_ylabel(axis_label(b))
        axes.legend(fontsize=7)
    return figure
