"""Figures of a custom study: main effects."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from plant_sim.common.figure_style import COLOURS, QUIET, drawing
from plant_sim.study.custom.file import CustomStudy
from plant_sim.study.doe.design import to_natural
from plant_sim.study.doe.weighted import Model
from plant_sim.study.estimates import Estimate
from plant_sim.study.report.axis_labels import axis_label

_PANEL_IN = 2.8
_PANELS_A_ROW = 4
_CURVE_POINTS = 61


def main_effects(custom: CustomStudy, estimates: Sequence[Estimate], label: str, model: Model | None) -> Figure:
    """Plot a response against every factor: runs as points with intervals, the effect of the factor as a line.

    In a factorial design every level is combined with the same levels of the other factors, so the line joins the means
    at the levels. For other designs the line is the model with the other factors at coded 0.

    Args:
        custom: The study.
        estimates: Mean of the response in every run, with its interval.
        label: The response and its unit.
        model: Fitted model, if any.
    """
    means = np.array([np.nan if each.mean is None else each.mean for each in estimates])
    bars = _bars(means, estimates)
    count = len(custom.parameters)
    columns, rows = min(count, _PANELS_A_ROW), math.ceil(count / _PANELS_A_ROW)
    with drawing():
        figure = Figure(figsize=(_PANEL_IN * columns + 0.4, _PANEL_IN * rows), layout="constrained")
        first: Axes | None = None
        for index, (each, levels) in enumerate(zip(custom.parameters, custom.points.T, strict=True)):
            axes = figure.add_subplot(rows, columns, index + 1, sharey=first)
            first = first or axes
            axes.errorbar(
                levels,
                means,
                bars,
                fmt="o",
                color=QUIET,
                markersize=3,
                alpha=0.7,
                elinewidth=0.6,
                zorder=3,
            )
            if custom.design == "factorial":
                axes.plot(*_level_means(levels, means), "o-", color=COLOURS["left"], markersize=5)
            elif model is not None:
                axes.plot(*_curve(custom, index, model), color=COLOURS["left"])
            axes.grid(visible=True, axis="y")
            axes.set_xlabel(axis_label(each.label))
            if index % columns == 0:
                axes.set_ylabel(axis_label(label))
    return figure


def _bars(means: NDArray[np.float64], estimates: Sequence[Estimate]) -> NDArray[np.float64]:
    """Return the distances from each mean to the ends of its interval, in two rows; 0 without an interval."""
    ends = [(each.low, each.high) for each in estimates]
    bars = [
        (0.0, 0.0) if low is None or high is None else (mean - low, high - mean)
        for mean, (low, high) in zip(means.tolist(), ends, strict=True)
    ]
    return np.array(bars).T


def _level_means(
    levels: NDArray[np.float64], means: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the levels of a factor and the mean response of the runs at each level."""
    distinct = np.unique(levels[np.isfinite(means)])
    return distinct, np.array([np.nanmean(means[levels == level]) for level in distinct])


def _curve(custom: CustomStudy, index: int, model: Model) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return values of a factor from its lowest to its highest level, and the model's predictions at these values."""
    points = np.zeros((_CURVE_POINTS, len(custom.factors)))
    points[:, index] = np.linspace(custom.coded[:, index].min(), custom.coded[:, index].max(), _CURVE_POINTS)
    return to_natural(custom.factors, points)[:, index], model.predict(points)
