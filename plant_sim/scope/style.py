"""Style of the plots: colour-blind-safe colours, page sizes, and files without timestamps."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from plant_sim.scope.errors import RecordingError

COLOURS: Final[Mapping[str, str]] = {
    "left": "#0072B2",
    "right": "#D55E00",
    "machine": "#444444",
    "supply": "#009E73",
    "alarms": "#AA0044",
    "faults": "#7A5195",
}
"""Palette of Okabe and Ito, whose colours can be distinguished with any type of colour blindness."""

SERIES: Final = ("#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#444444", "#0072B2", "#D55E00", "#999933")
"""Colours of traces that do not belong to an arm, in order of use."""

QUIET: Final = "#666666"

STYLE: Final[dict[Any, Any]] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "svg.hashsalt": "seedling transplanter",
}
"""Matplotlib settings for drawing and saving."""


class Mark(NamedTuple):
    """Interval of an alarm or a fault.

    Attributes:
        kind: ``alarms`` or ``faults``.
        from_s: Start, s.
        to_s: End, s.
        text: Text of the alarm or fault.
    """

    kind: str
    from_s: float
    to_s: float
    text: str


def spans_of(time_s: np.ndarray, values: np.ndarray) -> list[tuple[float, float, object]]:
    """Return the runs of equal values as (start, end, value), times in s; a sample lasts until the next one."""
    starts = np.concatenate(([0], np.flatnonzero(values[1:] != values[:-1]) + 1))
    ends = np.concatenate((starts[1:], [len(values) - 1]))
    return [(float(time_s[start]), float(time_s[end]), values[start]) for start, end in zip(starts, ends, strict=True)]


def marks_of(time_s: np.ndarray, data: Mapping[str, np.ndarray]) -> list[Mark]:
    """Return the alarms and faults of a window, sorted by start; missing columns are ignored."""
    marks: list[Mark] = []
    for kind in ("faults", "alarms"):
        texts = data.get(kind, np.array([], dtype=object))
        for item in dict.fromkeys(item for text in dict.fromkeys(texts) for item in text.split("; ") if item):
            holds = np.array([item in text.split("; ") for text in texts])
            marks += [Mark(kind, from_s, to_s, item) for from_s, to_s, on in spans_of(time_s, holds) if on]
    return sorted(marks, key=lambda mark: mark.from_s)


def seconds() -> MaxNLocator:
    """Return a tick locator for round seconds."""
    return MaxNLocator(nbins=14, steps=[1, 2, 5, 10])


def shade(axes: Axes, marks: list[Mark]) -> None:
    """Shade the intervals of alarms and faults, and draw a line at the start of each."""
    for mark in marks:
        colour = COLOURS[mark.kind]
        axes.axvspan(mark.from_s, mark.to_s, color=colour, alpha=0.05, linewidth=0, zorder=0)
        axes.axvline(mark.from_s, color=colour, linewidth=0.9, linestyle=(0, (4, 2)), zorder=1)


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write a figure as PNG and as SVG; equal figures give identical bytes.

    Args:
        figure: Figure to write.
        stem: Path without suffix.

    Returns:
        The two files.

    Raises:
        RecordingError: A file cannot be written.
    """
    paths = []
    for ending, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
        path = stem.with_name(f"{stem.name}.{ending}")
        part = stem.with_name(f"{stem.name}.part.{ending}")
        try:
            figure.savefig(part, dpi=150, metadata=metadata)
            os.replace(part, path)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written ({error.strerror}); use another --out") from None
        paths.append(path)
    return paths
