"""How the plots look: colours that also the colour-blind tell apart, sizes for a page, files without a date."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from plant_sim.scope.store import RecordingError

#: Okabe and Ito's palette: blue and vermilion stay apart in every kind of colour blindness.
COLOURS: Final[Mapping[str, str]] = {
    "left": "#0072B2",
    "right": "#D55E00",
    "machine": "#444444",
    "supply": "#009E73",
    "alarms": "#AA0044",
    "faults": "#7A5195",
}
#: For traces that belong to no arm, in this order.
SERIES: Final = ("#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#444444", "#0072B2", "#D55E00", "#999933")
QUIET: Final = "#666666"

#: Everything is drawn and saved in this style.
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


class Mark(NamedTuple):
    """A time in which something was wrong.

    Attributes:
        kind: ``alarms`` or ``faults``.
        from_s: Since when, s.
        to_s: Until when, s.
        text: What.
    """

    kind: str
    from_s: float
    to_s: float
    text: str


def spans_of(time_s: np.ndarray, values: np.ndarray) -> list[tuple[float, float, object]]:
    """Return every run of equal values: since when, until when, s, and the value; a sample holds until the next."""
    starts = np.concatenate(([0], np.flatnonzero(values[1:] != values[:-1]) + 1))
    ends = np.concatenate((starts[1:], [len(values) - 1]))
    return [(float(time_s[start]), float(time_s[end]), values[start]) for start, end in zip(starts, ends, strict=True)]


def marks_of(time_s: np.ndarray, data: Mapping[str, np.ndarray]) -> list[Mark]:
    """Return every fault and alarm of a part of a recording, so far as it has these columns, by its beginning."""
    marks: list[Mark] = []
    for kind in ("faults", "alarms"):
        texts = data.get(kind, np.array([], dtype=object))
        for item in dict.fromkeys(item for text in dict.fromkeys(texts) for item in text.split("; ") if item):
            holds = np.array([item in text.split("; ") for text in texts])
            marks += [Mark(kind, from_s, to_s, item) for from_s, to_s, on in spans_of(time_s, holds) if on]
    return sorted(marks, key=lambda mark: mark.from_s)


def seconds() -> MaxNLocator:
    """Return ticks at round seconds."""
    return MaxNLocator(nbins=14, steps=[1, 2, 5, 10])


def shade(axes: Axes, marks: list[Mark]) -> None:
    """Shade the times of alarms and faults, and draw a line where each begins."""
    for mark in marks:
        colour = COLOURS[mark.kind]
        axes.axvspan(mark.from_s, mark.to_s, color=colour, alpha=0.05, linewidth=0, zorder=0)
        axes.axvline(mark.from_s, color=colour, linewidth=0.9, linestyle=(0, (4, 2)), zorder=1)


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write a figure as PNG and as SVG; the same figure gives the same bytes.

    Args:
        figure: What to write.
        stem: Path without an ending.

    Returns:
        The two files.

    Raises:
        RecordingError: they cannot be written.
    """
    paths = []
    for ending, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
        path = stem.with_name(f"{stem.name}.{ending}")
        part = stem.with_name(f"{stem.name}.part.{ending}")
        try:
            figure.savefig(part, dpi=150, metadata=metadata)
            os.replace(part, path)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written ({error.strerror}); give another --out") from None
        paths.append(path)
    return paths
