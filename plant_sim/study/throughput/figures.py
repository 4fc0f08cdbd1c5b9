"""Figures of the throughput study: gaps over all planting frequencies; success, gaps and air at those of the tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from plant_sim.common.figure_style import COLOURS, QUIET, SERIES, draw_proportions, drawing
from plant_sim.common.proportion import Proportion
from plant_sim.study.estimates import Estimate, estimate
from plant_sim.study.throughput.driving import FrequencyResult, ThroughputResult
from plant_sim.study.throughput.pace import CyclePace


def scan_figure(result: ThroughputResult) -> Figure:
    """Plot the share of trials with a gap at every planting frequency, with exact 95 % intervals, and the limit."""
    frequencies = list(result.results)
    gaps = [Proportion(each.gaps, len(each.trials)) for each in result.results.values()]
    with drawing():
        figure = Figure(figsize=(7.0, 2.8), layout="constrained")
        axes = figure.add_subplot()
        draw_proportions(axes, frequencies, gaps, fmt="o", color=COLOURS["alarms"], markersize=3, capsize=1.5)
        limit = result.limits.without_gap.limit
        if limit is not None:
            axes.axvline(limit, color=QUIET, linewidth=0.8, linestyle="--", zorder=3)
            above = axes.get_xaxis_transform()
            axes.text(limit, 1.01, f"limit {limit}/min", color=QUIET, fontsize=7, ha="center", transform=above)
        axes.set(xlabel="planting frequency, 1/min per row", ylabel="trials with a gap, %", ylim=(-3, 103))
        axes.grid()
    return figure


def curves(points: Sequence[FrequencyResult], paces: Mapping[int, CyclePace], *, is_binomial: bool) -> Figure:
    """Plot success, gaps and air against the planting frequency, with 95 % intervals where there are several trials."""
    frequencies = [point.frequency_per_min for point in points]
    with drawing():
        figure = Figure(figsize=(11.0, 3.2), layout="constrained")
        success, gaps, air = figure.subplots(1, 3)
        rates = [estimate("S", each.trials, is_binomial=is_binomial) for each in points]
        _with_bars(success, frequencies, rates, SERIES[0])
        success.set_ylabel("success rate S, %")
        missed = [estimate("missed_cups", each.trials) for each in points]
        _with_bars(gaps, frequencies, missed, COLOURS["alarms"], label="trial of two trays")
        settled = [paces[each].settled_missed_cups for each in frequencies]
        gaps.plot(frequencies, settled, "s--", color=COLOURS["faults"], markersize=3, label="settled tray")
        gaps.set_ylabel("missed cups, mean number")
        gaps.legend()
        _with_bars(air, frequencies, [estimate("air_l_min", each.trials) for each in points], SERIES[5])
        air.set_ylabel("air consumption, L/min (ANR)")
        for axes in (success, gaps, air):
            axes.set_xlabel("planting frequency, 1/min per row")
            axes.grid()
    return figure


def _with_bars(
    axes: Axes, x: Sequence[float], estimates: Sequence[Estimate], colour: str, *, label: str | None = None
) -> None:
    """Draw means with their 95 % intervals; a mean without an interval has no bar."""
    means = np.array([math.nan if each.mean is None else each.mean for each in estimates])
    lows = np.array([mean if each.low is None else each.low for mean, each in zip(means, estimates, strict=True)])
    highs = np.array([mean if each.high is None else each.high for mean, each in zip(means, estimates, strict=True)])
    axes.errorbar(x, means, [means - lows, highs - means], fmt="o-", color=colour, capsize=2, markersize=3, label=label)
