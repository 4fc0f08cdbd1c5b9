"""Parts common to the plots of recordings: intervals, marks of alarms and faults, time axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from plant_sim.common.figure_style import COLOURS


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
