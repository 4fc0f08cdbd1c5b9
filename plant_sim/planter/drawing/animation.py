"""Animations of the planters: on the chain, on the three paths of Fig. 4, and past the bottom arc."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from plant_sim.planter.chain import ChainSpec
from plant_sim.planter.drawing.gif import frame_count, write_gif
from plant_sim.planter.drawing.paths import draw_paths, regime_motions, regimes_figure, shown_m, window_s
from plant_sim.planter.drawing.scheme import Scheme
from plant_sim.planter.drawing.shapes import POINTS, note_origin, place_planter, planter_lines
from plant_sim.planter.motion import Motion, PathSegment
from plant_sim.planter.motion_model import MotionModel

SLOWED: Final = 4
"""Ratio of the duration of the animation to that of the real motion."""


def write_animation(motion: Motion, path: Path, *, title: str) -> None:
    """Write an animated GIF of planter 0; equal motions give identical bytes.

    Args:
        motion: Motion of the planters, with a machine speed above 0.
        path: File to write.
        title: Title of the figure.

    Raises:
        FigureError: The file cannot be written.
    """
    figure = Figure(figsize=(6.0, 4.8), layout="constrained")
    axes = figure.add_subplot()
    draw_paths(axes, motion)
    figure.suptitle(f"{title}\n{SLOWED} times slower than the machine", fontsize=7.5)
    note_origin(figure)
    lines = planter_lines(axes)
    axes.autoscale(enable=False)
    first_s, last_s = window_s(motion)
    times_s = np.linspace(first_s, last_s, frame_count(last_s - first_s, slowed=SLOWED))
    hinges_m, tips_m = (shown_m(motion, times_s, offset) for offset in ((0.0, 0.0), motion.chain.tip))

    def show(frame: int) -> list[Artist]:
        hinge_m, tip_m = hinges_m[frame], tips_m[frame]
        place_planter(lines, motion.chain, (hinge_m[0], hinge_m[1]), (tip_m[0], tip_m[1]))
        return list(lines)

    write_gif(figure, show, len(times_s), path)


def write_regimes_animation(chain: ChainSpec, path: Path, *, frequency_per_min: float, model: MotionModel) -> None:
    """Write an animated GIF of Fig. 4: the three paths, each with the tip that describes it.

    Args:
        chain: Parameters of the chain.
        path: File to write.
        frequency_per_min: Planting frequency, 1/min.
        model: Model of the motion.

    Raises:
        FigureError: The file cannot be written.
    """
    figure = regimes_figure(chain, frequency_per_min=frequency_per_min, model=model)
    motions = regime_motions(chain, frequency_per_min=frequency_per_min, model=model)
    arc_s = motions[0].starts_s[PathSegment.RISE] - motions[0].starts_s[PathSegment.BOTTOM]
    share = np.linspace(0.0, 1.0, frame_count(arc_s, slowed=SLOWED), endpoint=False)
    paths_m = [shown_m(each, each.starts_s[PathSegment.BOTTOM] + share * arc_s, chain.tip) for each in motions]
    tips = [axes.plot([], [], "o", color=POINTS["tip"], markersize=7, zorder=6)[0] for axes in figure.axes]

    def show(frame: int) -> list[Artist]:
        for tip, path_m in zip(tips, paths_m, strict=True):
            tip.set_data([path_m[frame, 0]], [path_m[frame, 1]])
        return list(tips)

    write_gif(figure, show, len(share), path)


def write_scheme_animation(chain: ChainSpec, path: Path, *, model: MotionModel) -> None:
    """Write an animated GIF of Fig. 3: the planters move on by one planter, after which the animation repeats.

    Args:
        chain: Parameters of the chain.
        path: File to write.
        model: Model of the motion.

    Raises:
        FigureError: The file cannot be written.
    """
    drawing = Scheme(chain, model)
    spacing_s = drawing.motion.period_s / chain.planters
    times_s = np.linspace(0.0, spacing_s, frame_count(spacing_s, slowed=1.0), endpoint=False)

    def show(frame: int) -> list[Artist]:
        return drawing.place(float(times_s[frame]))

    write_gif(drawing.figure, show, len(times_s), path)
