"""Scheme of the chain planter, after Fig. 3 of the cabbage paper."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from plant_sim.common.figure_style import COLOURS, QUIET
from plant_sim.planter.chain import ChainSpec
from plant_sim.planter.drawing.shapes import (
    POINTS,
    draw_soil,
    note_origin,
    offsets_of,
    place_planter,
    planter_lines,
)
from plant_sim.planter.motion import Motion
from plant_sim.planter.motion_model import MotionModel

_FREQUENCY_PER_MIN = 60.0
"""Planting frequency, which does not affect the scheme."""


class Scheme:
    """Scheme in machine coordinates: chain path, sprockets, planters, joints A to D and dimensions.

    Attributes:
        motion: Motion of the planters relative to the machine.
        figure: The figure; half a spacing after time 0, no planter covers a joint.
    """

    def __init__(self, chain: ChainSpec, model: MotionModel = MotionModel.RIGID) -> None:
        """Draw the scheme.

        Args:
            chain: Parameters of the chain.
            model: Model of the motion.
        """
        self.motion = Motion(chain, speed_m_s=0.0, frequency_per_min=_FREQUENCY_PER_MIN, model=model)
        self.figure = Figure(figsize=(5.8, 8.2), layout="constrained")
        axes = self.figure.add_subplot()
        _draw_machine(axes, self.motion)
        self._planters = [planter_lines(axes) for _ in range(chain.planters)]
        (self._hinges,) = axes.plot([], [], "o", color=COLOURS["machine"], markersize=3, zorder=4)
        self.place(self.motion.period_s / chain.planters / 2)
        _mark_joints(axes, self.motion)
        _dimension(axes, chain)
        draw_soil(axes, chain)
        axes.legend(loc="center right", fontsize=7)
        axes.set_aspect("equal", adjustable="box")
        axes.set_xlim(-chain.sprocket_radius_m - 0.32, chain.sprocket_radius_m + chain.offset_m + 0.49)
        axes.set_xlabel("x, direction of travel, m")
        axes.set_ylabel("y, m")
        axes.set_title(f"Chain planter, scheme after Fig. 3, model {model}")
        note_origin(self.figure)

    def place(self, time_s: float) -> list[Artist]:
        """Move the planters to their positions at a time, s; return everything that has moved."""
        chain = self.motion.chain
        hinges_m, tips_m = (self.motion.position_m(time_s, offset)[:, 0] for offset in ((0.0, 0.0), chain.tip))
        for lines, hinge_m, tip_m in zip(self._planters, hinges_m, tips_m, strict=True):
            place_planter(lines, chain, (hinge_m[0], hinge_m[1]), (tip_m[0], tip_m[1]))
        self._hinges.set_data(hinges_m[:, 0], hinges_m[:, 1])
        return [self._hinges, *(line for lines in self._planters for line in lines)]


def _draw_machine(axes: Axes, motion: Motion) -> None:
    """Draw the paths of the points of a planter and the sprockets."""
    chain = motion.chain
    times_s = np.linspace(0.0, motion.period_s, 721)
    for name, offset in offsets_of(chain).items():
        path_m = motion.position_m(times_s, offset)[0]
        axes.plot(path_m[:, 0], path_m[:, 1], color=POINTS[name], linewidth=0.9, label=f"path of the {name}", zorder=2)
    for centre_m in (0.0, chain.centre_distance_m):
        axes.add_patch(Circle((0.0, centre_m), chain.sprocket_radius_m, fill=False, color=QUIET, linewidth=0.6))
        axes.plot(0.0, centre_m, "+", color=QUIET, markersize=5)


def _mark_joints(axes: Axes, motion: Motion) -> None:
    for joint in motion.joints():
        x_m, y_m = motion.position_m(joint.time_s)[0, 0]
        axes.plot(x_m, y_m, "s", color=COLOURS["alarms"], markersize=3.5, zorder=5)
        axes.annotate(
            joint.name,
            (x_m, y_m),
            xytext=(-9 if x_m < 0 else 5, 3),
            textcoords="offset points",
            color=COLOURS["alarms"],
            fontweight="bold",
        )


def _dimension(axes: Axes, chain: ChainSpec) -> None:
    """Draw the dimensions R, H, l and h."""
    radius_m, high_m, (ahead_m, down_m) = chain.sprocket_radius_m, chain.centre_distance_m, chain.tip
    left_m = -radius_m - 0.17
    arrow = {"arrowstyle": "<->", "color": QUIET, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0}
    for start, end, text, place in (
        ((left_m, 0.0), (left_m, high_m), f"H = {high_m:.4g} m", (left_m - 0.05, high_m / 2)),
        ((0.0, high_m), (0.0, high_m + radius_m), f"R = {1000 * radius_m:.3g} mm", (0.0, high_m + radius_m + 0.03)),
        ((left_m, down_m), (left_m, 0.0), f"h = {1000 * chain.tip_height_m:.3g} mm", (left_m - 0.05, down_m / 2)),
        (
            (radius_m, high_m / 3),
            (radius_m + ahead_m, high_m / 3),
            f"l = {1000 * ahead_m:.3g} mm",
            (radius_m + ahead_m + 0.12, high_m / 3),
        ),
    ):
        axes.annotate("", start, end, arrowprops=arrow)
        is_upright = start[0] == end[0] == left_m
        axes.text(*place, text, ha="center", va="center", rotation=90 if is_upright else 0, fontsize=7)
