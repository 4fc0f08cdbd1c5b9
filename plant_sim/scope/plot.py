"""Pictures of a recording: a timing diagram, and positions and pressures over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from plant_sim.common.figure_style import drawing, save
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.scope.errors import RecordingError
from plant_sim.scope.store import Recording, RecordingWindow
from plant_sim.scope.timing import default_tags, timing_diagram
from plant_sim.scope.trends import TrendPanel, default_panels, panels_of, trend_plot

_EVENT_COLUMNS = ("alarms", "faults")


def plot(
    recording: Recording,
    out: Path,
    window: RecordingWindow,
    *,
    side: str,
    tags: Sequence[str] | None,
    provenance: Provenance | None = None,
) -> list[Path]:
    """Write the pictures of a window of a recording.

    Args:
        recording: Recording to plot.
        out: Output folder; it is created if missing.
        window: Window to plot.
        side: Arm whose steps and wires the timing diagram shows.
        tags: Names or patterns of the columns to plot; None for the default columns.
        provenance: Provenance that the pictures carry.

    Returns:
        Written files: the timing diagram of boolean and text columns, and the trends of numeric columns, each as PNG
        and SVG.

    Raises:
        RecordingError: A tag does not exist, or the folder cannot be created.
        FigureError: A picture cannot be written.
    """
    lanes, panels = _selected(recording, side, tags)
    event_columns = [name for name in _EVENT_COLUMNS if name in recording.names]
    _make_folder(out)
    name = recording.path.stem
    span = f"{window.from_ms / 1000:g} to {window.to_ms / 1000:g} s, seed {recording.about['seed']}"
    written: list[Path] = []
    with drawing():
        if lanes:
            data = recording.read(list(dict.fromkeys([*lanes, *event_columns])), window)
            requested = () if tags is None else lanes
            figure = timing_diagram(data, recording.labels, f"{name}: timing, {span}", requested=requested)
            written += save(figure, out / f"{name}-timing", provenance)
        if panels:
            columns = [trace.column for panel in panels for trace in panel.traces]
            data = recording.read(list(dict.fromkeys([*columns, *event_columns])), window)
            shown = "positions and pressures" if tags is None else "selected tags"
            figure = trend_plot(panels, data, f"{name}: {shown}, {span}")
            written += save(figure, out / f"{name}-trends", provenance)
    return written


def _selected(recording: Recording, side: str, tags: Sequence[str] | None) -> tuple[list[str], list[TrendPanel]]:
    """Split the selected columns into lanes and panels."""
    if tags is None:
        return default_tags(recording, side), default_panels(recording)
    names = [name for name in recording.matching(tags) if name != "seedlings"]
    if not names:
        raise RecordingError(f"{recording.path}: seedlings cannot be plotted; specify other tags")
    sample = recording.read(names, RecordingWindow(recording.full_window.from_ms, recording.full_window.from_ms))
    lanes = [name for name in names if sample[name].dtype in (np.bool_, np.object_)]
    return lanes, panels_of(recording, [name for name in names if name not in lanes])


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{out}: is not a writable folder ({error.strerror}); use another --out") from None
