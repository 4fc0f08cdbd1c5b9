"""Animation of a planter passing the bottom arc."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from plant_sim.common.figure_style import write_whole
from plant_sim.planter.drawing.paths import draw_paths, shown_m, window_s
from plant_sim.planter.drawing.shapes import note_origin, place_planter, planter_lines
from plant_sim.planter.motion import Motion

SLOWED: Final = 4
"""Ratio of the duration of the animation to that of the real motion."""
FRAMES_PER_S: Final = 12

_DPI = 90


def write_animation(motion: Motion, path: Path, *, title: str) -> None:
    """Write an animated GIF of planter 0; equal motions give identical bytes.

    Args:
        motion: Motion of the planters, with a machine speed above 0.
        path: File to write.
        title: Title of the figure.

    Raises:
        FigureError: The file cannot be written.
    """
    figure = Figure(figsize=(6.0, 4.8), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    draw_paths(axes, motion)
    figure.suptitle(f"{title}\n{SLOWED} times slower than the machine", fontsize=7.5)
    note_origin(figure)
    lines = planter_lines(axes)
    figure.draw_without_rendering()
    axes.autoscale(enable=False)
    figure.set_layout_engine("none")  # all frames use the layout of the first
    first_s, last_s = window_s(motion)
    times_s = np.linspace(first_s, last_s, max(2, round((last_s - first_s) * SLOWED * FRAMES_PER_S)))
    hinges_m, tips_m = (shown_m(motion, times_s, offset) for offset in ((0.0, 0.0), motion.chain.tip))

    def show(frame: int) -> list[Artist]:
        hinge_m, tip_m = hinges_m[frame], tips_m[frame]
        place_planter(lines, motion.chain, (hinge_m[0], hinge_m[1]), (tip_m[0], tip_m[1]))
        return list(lines)

    animation = FuncAnimation(figure, show, frames=len(times_s), blit=False)
    write_whole(path, lambda part: animation.save(part, writer=PillowWriter(fps=FRAMES_PER_S), dpi=_DPI))
