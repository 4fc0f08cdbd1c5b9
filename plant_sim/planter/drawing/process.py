"""Figures of the simulated fall of a block, as in Fig. 7 to 9 of the cabbage paper."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from plant_sim.common.figure_style import QUIET
from plant_sim.planter.contact import FallFrame
from plant_sim.planter.drawing.gif import frame_count, write_gif
from plant_sim.planter.drawing.shapes import POINTS, SOIL, note_origin
from plant_sim.planter.parameters import Planter

SLOWED: Final = 8
"""Ratio of the duration of the animation to that of the real motion."""

_PANELS: Final = 6
_SUBSTRATE, _STEM = "#8C6D46", "#4C8C3B"
_PLATE_M: Final = 0.09
_AHEAD_M, _BEHIND_M, _HIGH_M = 0.12, 0.08, 0.16
_LEFT_M: Final = 0.06
"""Height of the hinge above its lowest point from which the guide plate is clear of the block, m."""


def process_figure(frames: Sequence[FallFrame], planter: Planter, *, title: str) -> Figure:
    """Return a figure of six stages of a fall, from the start of the opening until the block is at rest.

    Args:
        frames: Frames of one fall.
        planter: Parameters of the planter.
        title: Title of the figure.
    """
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    panels = figure.subplots(2, _PANELS // 2, sharex=True, sharey=True).flat
    for axes, index in zip(panels, _stages(frames), strict=True):
        drawing = _Drawing(axes, planter)
        drawing.show(frames[index])
        axes.plot([f.block_x_m for f in frames[: index + 1]], [f.block_y_m for f in frames[: index + 1]], **_TRACE)
        axes.set_title(f"{1000 * frames[index].time_s:+.0f} ms, stem at {_degrees(frames[index])}")
    figure.supylabel("height above the bottom of the furrow, m", fontsize=8)
    figure.suptitle(f"{title}\nTimes from the lowest point of the planter; positions along the row, m", fontsize=9)
    note_origin(figure)
    return figure


def write_process(frames: Sequence[FallFrame], planter: Planter, path: Path, *, title: str) -> None:
    """Write an animated GIF of a fall; equal frames give identical bytes.

    Args:
        frames: Frames of one fall.
        planter: Parameters of the planter.
        path: File to write.
        title: Title of the figure.

    Raises:
        FigureError: The file cannot be written.
    """
    figure = Figure(figsize=(5.0, 4.2), layout="constrained")
    axes = figure.add_subplot()
    drawing = _Drawing(axes, planter)
    axes.set_xlabel("position along the row from the lowest point of the planter, m")
    axes.set_ylabel("height above the bottom of the furrow, m")
    figure.suptitle(f"{title}\n{SLOWED} times slower than the machine", fontsize=7.5)
    note_origin(figure)
    duration_s = frames[-1].time_s - frames[0].time_s
    shown = np.linspace(0, len(frames) - 1, frame_count(duration_s, slowed=SLOWED)).round().astype(int).tolist()
    write_gif(figure, lambda index: drawing.show(frames[shown[index]]), len(shown), path)


class _Drawing:
    """Block, plates, guide plate and ground in one set of axes."""

    def __init__(self, axes: Axes, planter: Planter) -> None:
        self._planter = planter
        axes.axhline(0.0, color=SOIL, linewidth=1.4, zorder=1)
        axes.set_xlim(-_BEHIND_M, _AHEAD_M)
        axes.set_ylim(-0.01, _HIGH_M)
        axes.set_aspect("equal", adjustable="box")
        self._cube = Polygon(np.zeros((4, 2)), facecolor=_SUBSTRATE, alpha=0.85, zorder=3)
        self._stem = Polygon(np.zeros((4, 2)), facecolor=_STEM, zorder=3)
        self._guide = Line2D([], [], color=POINTS["guide plate"], linewidth=2.0, zorder=4)
        self._plates = Polygon(np.zeros((4, 2)), facecolor="none", edgecolor=POINTS["tip"], linewidth=0.8, zorder=2)
        for artist in (self._cube, self._stem, self._plates):
            axes.add_patch(artist)
        axes.add_line(self._guide)

    def show(self, frame: FallFrame) -> list[Artist]:
        """Move all parts to their positions in a frame."""
        chain, block = self._planter.chain, self._planter.block
        half_m, stem_m = block.edge_m / 2, block.stem_diameter_m / 2
        self._cube.set_xy(
            _turned(frame, [(-half_m, 0.0), (half_m, 0.0), (half_m, block.edge_m), (-half_m, block.edge_m)])
        )
        top_m, height_m = block.edge_m, block.height_m
        self._stem.set_xy(_turned(frame, [(-stem_m, top_m), (stem_m, top_m), (stem_m, height_m), (-stem_m, height_m)]))
        tip_x_m, tip_y_m = frame.hinge_x_m, frame.hinge_y_m
        guide_m, low_m = tip_x_m - chain.guide_behind_m, tip_y_m + chain.guide_above_m
        self._guide.set_data([guide_m, guide_m], [low_m, low_m + _PLATE_M])
        wide_m, high_m = 1.1 * half_m, tip_y_m + _PLATE_M
        corners = [(-wide_m, high_m), (-0.3 * wide_m, tip_y_m), (0.3 * wide_m, tip_y_m), (wide_m, high_m)]
        self._plates.set_xy([(tip_x_m + x_m, y_m) for x_m, y_m in corners])
        return [self._cube, self._stem, self._guide, self._plates]


_TRACE: Final = {"color": QUIET, "linewidth": 0.6, "linestyle": (0, (1, 2)), "zorder": 1}


def _turned(frame: FallFrame, corners: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return points given relative to the middle of the base, transformed to the position of the block."""
    cos, sin = math.cos(frame.tilt_rad), math.sin(frame.tilt_rad)
    return [(frame.block_x_m + x * cos + y * sin, frame.block_y_m - x * sin + y * cos) for x, y in corners]


def _stages(frames: Sequence[FallFrame]) -> list[int]:
    """Return the indices of the stages: equally spaced until the guide plate is clear of the block, and the last."""
    last = next(
        (i for i, frame in enumerate(frames) if frame.hinge_y_m > _LEFT_M and frame.time_s > 0), len(frames) - 1
    )
    stages = [round(part * last / (_PANELS - 2)) for part in range(_PANELS - 1)]
    return [*stages, len(frames) - 1]


def _degrees(frame: FallFrame) -> str:
    return f"{abs(round(math.degrees(frame.tilt_rad)))}°"
