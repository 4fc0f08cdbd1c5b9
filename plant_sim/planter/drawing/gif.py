"""Animated GIF of a figure; equal figures give identical bytes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from plant_sim.common.figure_style import FigureError
from plant_sim.common.whole_file import write_whole

FRAMES_PER_S = 12
DPI: Final = 90
_BLOCK: Final = 255
"""Longest block of a comment, bytes."""


def frame_count(duration_s: float, *, slowed: float) -> int:
    """Return the number of frames of a motion.

    Args:
        duration_s: Duration of the motion, s.
        slowed: Factor by which the animation is slower than the motion.
    """
    return max(2, round(duration_s * slowed * FRAMES_PER_S))


def write_comment(path: Path, text: str) -> None:
    """Add a comment to a GIF file.

    Raises:
        FigureError: The file cannot be written.
    """
    content, comment = path.read_bytes(), text.encode()
    blocks = [comment[start : start + _BLOCK] for start in range(0, len(comment), _BLOCK)]
    extension = b"".join(bytes([len(block)]) + block for block in blocks)
    whole = content[:-1] + b"\x21\xfe" + extension + b"\x00" + content[-1:]
    write_whole(path, lambda part: part.write_bytes(whole), FigureError)


def write_gif(figure: Figure, show: Callable[[int], list[Artist]], frames: int, path: Path) -> None:
    """Write an animation of a figure.

    Args:
        figure: Figure with a layout engine; the layout of the figure as given is used for all frames.
        show: Function that moves the artists of a frame to their places and returns them.
        frames: Number of frames.
        path: File to write.

    Raises:
        FigureError: The file cannot be written.
    """
    figure.set_dpi(DPI)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    animation = FuncAnimation(figure, show, frames=frames, blit=False)
    write_whole(path, lambda part: animation.save(part, writer=PillowWriter(fps=FRAMES_PER_S), dpi=DPI), FigureError)
