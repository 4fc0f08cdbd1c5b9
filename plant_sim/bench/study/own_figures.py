"""Pictures of a study of one's own: what every factor does by itself."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from plant_sim.bench.study.design import to_natural
from plant_sim.bench.study.own_file import OwnStudy
from plant_sim.bench.study.regression import Fit
from plant_sim.bench.study.report import drawing
from plant_sim.scope.style import COLOURS, QUIET

_PANEL_IN = 2.8
_PANELS_A_ROW = 4
_CURVE_POINTS = 61


def main_effects(own: OwnStudy, means: NDArray[np.float64], label: str, model: Fit | None) -> Figure:
    """Draw a response over every factor: the runs as points, and as a line what the factor does.

    Only in a factorial does every level meet the same levels of the others, so that its mean is the factor's own
    doing; elsewhere the line is that of the model, the other factors at their coded 0.

    Args:
        own: The study.
        means: Mean of the response in every run; not a number where there is none.
        label: The response and its unit.
        model: What was fitted; None for nothing.
    """
    count = len(own.knobs)
    columns, rows = min(count, _PANELS_A_ROW), math.ceil(count / _PANELS_A_ROW)
    with drawing():
        figure = Figure(figsize=(_PANEL_IN * columns + 0.4, _PANEL_IN * rows), layout="constrained")
        first: Axes | None = None
        for place, (each, levels) in enumerate(zip(own.knobs, own.points.T, strict=True)):
            axes = figure.add_subplot(rows, columns, place + 1, sharey=first)
            first = first or axes
            axes.plot(levels, means, "o", color=QUIET, markersize=3, alpha=0.7, linewidth=0, zorder=3)
            if own.design == "factorial":
                axes.plot(*_level_means(levels, means), "o-", color=COLOURS["left"], markersize=5)
            elif model is not None:
                axes.plot(*_curve(own, place, model), color=COLOURS["left"])
            axes.grid(visible=True, axis="y")
            axes.set_xlabel(each.label)
            if place % columns == 0:
                axes.set_ylabel(label)
    return figure


def _level_means(
    levels: NDArray[np.float64], means: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The levels of a factor, and the mean of the runs at each that have a response."""
    distinct = np.unique(levels[np.isfinite(means)])
    return distinct, np.array([np.nanmean(means[levels == level]) for level in distinct])


def _curve(own: OwnStudy, place: int, model: Fit) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A factor from its lowest to its highest level, and the model there."""
    points = np.zeros((_CURVE_POINTS, len(own.factors)))
    points[:, place] = np.linspace(own.coded[:, place].min(), own.coded[:, place].max(), _CURVE_POINTS)
    return to_natural(own.factors, points)[:, place], model.predict(points)
