"""Paths of the planter relative to the soil, after Fig. 4 and Fig. 7 to 9 of the cabbage paper."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from plant_sim.common.figure_style import COLOURS, QUIET
from plant_sim.planter.chain import ChainSpec, Offset
from plant_sim.planter.drawing.shapes import (
    MARK,
    POINTS,
    draw_soil,
    note_origin,
    offsets_of,
    place_planter,
    planter_lines,
)
from plant_sim.planter.motion import Motion, PathSegment
from plant_sim.planter.motion_model import MotionModel
from plant_sim.planter.ratio import regime_of, zero_speed_points

FIG_4_RATIOS: Final = {"k1": 1.17, "k2": 1.0, "k3": 0.87}
"""Ratios of the paths in Fig. 4, where the paper states only > 1, = 1 and < 1; the values are those of Fig. 7 to 9."""

_BEYOND_M = 0.08
"""Height of the part of the straight segments that is shown on either side of the bottom arc, m."""
_OUTLINES = 7


def window_s(motion: Motion) -> tuple[float, float]:
    """Return the start and end of the interval shown, s: bottom arc of planter 0 and adjacent straight segments."""
    beyond_s = min(_BEYOND_M, motion.chain.centre_distance_m) / motion.chain_m_s
    return motion.starts_s[PathSegment.BOTTOM] - beyond_s, motion.starts_s[PathSegment.RISE] + beyond_s


def shown_m(motion: Motion, times_s: ArrayLike, offset: Offset) -> NDArray[np.float64]:
    """Return the positions of a point of planter 0, with x from the lowest position of the hinge, m."""
    positions_m: NDArray[np.float64] = motion.position_m(times_s, offset)[0]
    origin_m = motion.position_m(motion.time_at_s(90.0))[0, 0, 0]
    positions_m[:, 0] -= origin_m
    return positions_m


def regime_motions(chain: ChainSpec, *, frequency_per_min: float, model: MotionModel) -> list[Motion]:
    """Return the motions of Fig. 4, in the order of `FIG_4_RATIOS`.

    Args:
        chain: Parameters of the chain.
        frequency_per_min: Planting frequency, 1/min.
        model: Model of the motion.
    """
    chain_m_s = chain.pitch_m * frequency_per_min / 60
    return [
        Motion(chain, speed_m_s=chain_m_s / ratio, frequency_per_min=frequency_per_min, model=model)
        for ratio in FIG_4_RATIOS.values()
    ]


def regimes_figure(chain: ChainSpec, *, frequency_per_min: float, model: MotionModel = MotionModel.RIGID) -> Figure:
    """Return a figure of the three paths of the tip, after Fig. 4, with the points c, e and d.

    Point c is the lowest point; e and d are the points of zero horizontal speed.

    Args:
        chain: Parameters of the chain.
        frequency_per_min: Planting frequency, 1/min.
        model: Model of the motion.
    """
    figure = Figure(figsize=(7.2, 2.8), layout="constrained")
    motions = regime_motions(chain, frequency_per_min=frequency_per_min, model=model)
    panels = figure.subplots(1, len(FIG_4_RATIOS), sharex=True, sharey=True)
    for index, (axes, (name, ratio), motion) in enumerate(
        zip(panels, FIG_4_RATIOS.items(), motions, strict=True), start=1
    ):
        arc_s = np.linspace(motion.starts_s[PathSegment.BOTTOM], motion.starts_s[PathSegment.RISE], 401)
        path_m = shown_m(motion, arc_s[:-1], chain.tip)
        axes.plot(path_m[:, 0], path_m[:, 1], color=POINTS["tip"])
        _mark_points(axes, motion, index)
        draw_soil(axes, chain)
        axes.set_aspect("equal", adjustable="box")
        axes.set_xlabel("x, m")
        axes.set_title(f"{name}: λ = {ratio:g}, {regime_of(motion.ratio)}")
    panels[0].set_ylabel("y, m")
    figure.suptitle(f"Path of the tip on the bottom arc, after Fig. 4, model {model}", fontsize=9)
    note_origin(figure)
    return figure


def _mark_points(axes: Axes, motion: Motion, index: int) -> None:
    """Mark the lowest point c and the points of zero horizontal speed, e on the descent and d on the ascent."""
    named = [(f"c{index}", motion.time_at_s(90.0), (0, -12))]
    points = zero_speed_points(motion)
    if len(points) == 2:
        named += [(name, point.time_s, (at, 2)) for name, point, at in zip("ed", points, (6, -12), strict=True)]
    for name, time_s, shift in named:
        at_m = shown_m(motion, time_s, motion.chain.tip)[0]
        axes.plot(*at_m, "o", **MARK)
        axes.annotate(name, (at_m[0], at_m[1]), xytext=shift, textcoords="offset points")


def motion_figure(motion: Motion, *, title: str) -> Figure:
    """Return a figure of the paths of hinge, tip and guide plate at the bottom arc, and of the speed of the tip.

    Args:
        motion: Motion of the planters, with a machine speed above 0.
        title: Title of the figure.
    """
    figure = Figure(figsize=(7.2, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    draw_paths(left, motion)
    for time_s in np.linspace(*window_s(motion), _OUTLINES):
        hinge_m, tip_m = (shown_m(motion, time_s, offset)[0] for offset in ((0.0, 0.0), motion.chain.tip))
        place_planter(planter_lines(left, alpha=0.3), motion.chain, (hinge_m[0], hinge_m[1]), (tip_m[0], tip_m[1]))
    left.relim()
    left.autoscale_view()
    _draw_speeds(right, motion)
    figure.suptitle(title, fontsize=9)
    note_origin(figure)
    return figure


def draw_paths(axes: Axes, motion: Motion) -> None:
    """Draw the paths of hinge, tip and guide plate of planter 0, their points of zero speed, and the soil surface."""
    times_s = np.linspace(*window_s(motion), 401)
    zeros_m = []
    for name, offset in offsets_of(motion.chain).items():
        path_m = shown_m(motion, times_s, offset)
        axes.plot(path_m[:, 0], path_m[:, 1], color=POINTS[name], label=name)
        zeros_m += [shown_m(motion, point.time_s, offset)[0] for point in zero_speed_points(motion, offset)]
    if zeros_m:
        axes.plot(*np.transpose(zeros_m), "o", label="zero horizontal speed", **MARK)
    draw_soil(axes, motion.chain)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x from the lowest position of the hinge, m")
    axes.set_ylabel("y, m")
    axes.legend(loc="lower left", fontsize=7, frameon=True, framealpha=0.85, edgecolor="none")


def _draw_speeds(axes: Axes, motion: Motion) -> None:
    """Draw the speed of the tip over the phase of the bottom arc."""
    first_s, last_s = window_s(motion)
    times_s = np.linspace(first_s, last_s, 801)
    phases_deg = np.degrees((times_s - motion.starts_s[PathSegment.BOTTOM]) * motion.omega_rad_s)
    velocity_m_s = motion.velocity_m_s(times_s, motion.chain.tip)[0]
    axes.axhline(0.0, color=QUIET, linewidth=0.6)
    axes.plot(phases_deg, velocity_m_s[:, 0], color=COLOURS["left"], label="tip, horizontal")
    axes.plot(phases_deg, velocity_m_s[:, 1], color=COLOURS["right"], linestyle=(0, (4, 2)), label="tip, vertical")
    for point in zero_speed_points(motion):
        axes.plot(point.phase_deg, 0.0, "o", **MARK)
    for phase_deg in (0.0, 180.0):
        axes.axvline(phase_deg, color=QUIET, linewidth=0.6, linestyle=(0, (1, 2)))
    axes.set_xlabel("angle of the sprocket from joint D, °")
    axes.set_ylabel("speed, m/s")
    axes.legend(loc="lower right", fontsize=7)
