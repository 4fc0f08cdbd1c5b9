"""Paths of the planter relative to the soil, after Fig. 4 and Fig. 7 to 9 of the cabbage paper."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from plant_sim.common.figure_style import COLOURS, QUIET
from plant_sim.planter.chain import ChainSpec
from plant_sim.planter.drawing.shapes import (
    MARK,
    POINTS,
    draw_soil,
    label_axes,
    note,
    offsets_of,
    place_planter,
    planter_lines,
)
from plant_sim.planter.motion import Model, Motion, Segment
from plant_sim.planter.ratio import regime_of, zero_speed_points

FIG_4_RATIOS: Final = {"k1": 1.17, "k2": 1.0, "k3": 0.87}
"""Ratios of the paths in Fig. 4; the paper gives only > 1, = 1 and < 1. The values are those of Fig. 7 to 9."""

_BEYOND_M = 0.16
"""Height of the straight segments shown on either side of the bottom arc."""
_GHOSTS = 7


def window_s(motion: Motion) -> tuple[float, float]:
    """Return the interval shown: the bottom arc of planter 0, and the straight segments near it, s."""
    beyond_s = min(_BEYOND_M, motion.chain.centre_distance_m) / motion.chain_m_s
    return motion.starts_s[Segment.BOTTOM] - beyond_s, motion.starts_s[Segment.RISE] + beyond_s


def regimes_figure(chain: ChainSpec, *, frequency_per_min: float, model: Model = Model.RIGID) -> Figure:
    """Return the three paths of the tip of Fig. 4, with the points c (lowest), e and d (zero horizontal speed).

    Args:
        chain: Parameters of the chain.
        frequency_per_min: Planting frequency, 1/min.
        model: Model of the motion.
    """
    figure = Figure(figsize=(7.2, 4.2), layout="constrained")
    chain_m_s = Motion(chain, speed_m_s=0.0, frequency_per_min=frequency_per_min).chain_m_s
    rows = figure.subplots(1, len(FIG_4_RATIOS), sharey=True)
    for index, (axes, (name, ratio)) in enumerate(zip(rows, FIG_4_RATIOS.items(), strict=True), start=1):
        motion = Motion(chain, speed_m_s=chain_m_s / ratio, frequency_per_min=frequency_per_min, model=model)
        times_s = np.linspace(*window_s(motion), 401)
        path_m = motion.position_m(times_s, chain.tip)[0]
        origin_m = float(motion.position_m(motion.time_at_s(90.0), chain.tip)[0, 0, 0])
        axes.plot(path_m[:, 0] - origin_m, path_m[:, 1], color=POINTS["tip"])
        _mark_points(axes, motion, index, origin_m)
        draw_soil(axes, chain)
        label_axes(axes)
        axes.set_title(f"{name}: λ = {ratio:g}, {regime_of(motion.ratio)}")
    for axes in rows[1:]:
        axes.set_ylabel("")
    figure.suptitle(f"Path of the tip, after Fig. 4, model {model}", fontsize=9)
    note(rows[0])
    return figure


def _mark_points(axes: Axes, motion: Motion, index: int, origin_m: float) -> None:
    """Mark the lowest point, and the points of zero horizontal speed: e in the descent, d in the ascent."""
    named = [(f"c{index}", motion.time_at_s(90.0), (0, -12))]
    points = zero_speed_points(motion)
    if len(points) == 2:
        named += [(name, point.time_s, (at, 2)) for name, point, at in zip("ed", points, (8, -13), strict=True)]
    for name, time_s, shift in named:
        x_m, y_m = motion.position_m(time_s, motion.chain.tip)[0, 0]
        axes.plot(x_m - origin_m, y_m, "o", **MARK)
        axes.annotate(name, (x_m - origin_m, y_m), xytext=shift, textcoords="offset points")


def motion_figure(motion: Motion, *, title: str) -> Figure:
    """Return the paths of hinge, tip and guide plate past the bottom arc, and the speed of the tip.

    Args:
        motion: Motion of the planters; the machine moves.
        title: Title of the figure.
    """
    figure = Figure(figsize=(7.2, 6.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=(3, 2))
    draw_paths(upper, motion)
    first_s, last_s = window_s(motion)
    for time_s in np.linspace(first_s, last_s, _GHOSTS):
        hinge_m, tip_m = (motion.position_m(time_s, offset)[0, 0] for offset in ((0.0, 0.0), motion.chain.tip))
        place_planter(planter_lines(upper, alpha=0.35), motion.chain, (hinge_m[0], hinge_m[1]), (tip_m[0], tip_m[1]))
    _draw_speeds(lower, motion)
    figure.suptitle(title, fontsize=9)
    figure.legend(*upper.get_legend_handles_labels(), loc="outside right upper", fontsize=7)
    note(upper)
    return figure


def draw_paths(axes: Axes, motion: Motion) -> None:
    """Draw the paths of hinge, tip and guide plate of planter 0, their points of zero speed, and the soil surface."""
    times_s = np.linspace(*window_s(motion), 401)
    marked = "zero horizontal speed"
    for name, offset in offsets_of(motion.chain).items():
        path_m = motion.position_m(times_s, offset)[0]
        axes.plot(path_m[:, 0], path_m[:, 1], color=POINTS[name], label=name)
        for point in zero_speed_points(motion, offset):
            axes.plot(*motion.position_m(point.time_s, offset)[0, 0], "o", label=marked, **MARK)
            marked = "_once"
    draw_soil(axes, motion.chain)
    label_axes(axes)


def _draw_speeds(axes: Axes, motion: Motion) -> None:
    """Draw the speed of the tip over the phase of the bottom arc."""
    first_s, last_s = window_s(motion)
    times_s = np.linspace(first_s, last_s, 801)
    phases_deg = np.degrees((times_s - motion.starts_s[Segment.BOTTOM]) * motion.omega_rad_s)
    velocity_m_s = motion.velocity_m_s(times_s, motion.chain.tip)[0]
    axes.axhline(0.0, color=QUIET, linewidth=0.6)
    axes.plot(phases_deg, velocity_m_s[:, 0], color=COLOURS["left"], label="tip, horizontal")
    axes.plot(phases_deg, velocity_m_s[:, 1], color=COLOURS["right"], linestyle=(0, (4, 2)), label="tip, vertical")
    for point in zero_speed_points(motion):
        axes.plot(point.phase_deg, 0.0, "o", **MARK)
    for phase_deg in (0.0, 180.0):
        axes.axvline(phase_deg, color=QUIET, linewidth=0.6, linestyle=(0, (1, 2)))
    axes.set_xlabel("phase from joint D (0°) to joint A (180°), as angle of the sprocket, °")
    axes.set_ylabel("speed, m/s")
    axes.legend(loc="upper left", fontsize=7)
