"""From a recording to pictures: a timing diagram, and places and pressures over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np

from plant_sim.scope.store import Recording, RecordingError, Window
from plant_sim.scope.style import STYLE, save
from plant_sim.scope.timing import default_tags, timing_diagram
from plant_sim.scope.trends import Panel, default_panels, panels_of, trend_plot

_TROUBLE = ("alarms", "faults")


def plot(recording: Recording, out: Path, window: Window, *, side: str, tags: Sequence[str] | None) -> list[Path]:
    """Write the pictures of a part of a recording.

    Args:
        recording: What was recorded.
        out: Folder for the pictures; it is made if need be.
        window: The part.
        side: The arm whose steps and wires the timing diagram shows.
        tags: Names or patterns of columns instead of the usual ones.

    Returns:
        The files: the timing diagram of tags that are on and off or texts, the trends of numbers, each as
        PNG and SVG.

    Raises:
        RecordingError: there is no such tag, or the pictures cannot be written.
    """
    lanes, panels = _chosen(recording, side, tags)
    trouble = [name for name in _TROUBLE if name in recording.names]
    _make_folder(out)
    name = recording.path.stem
    span = f"{window.from_ms / 1000:g} to {window.to_ms / 1000:g} s, seed {recording.about['seed']}"
    written: list[Path] = []
    with mpl.rc_context():
        mpl.rcdefaults()  # whatever the user has set up for other plots
        mpl.rcParams.update(STYLE)
        if lanes:
            data = recording.read(list(dict.fromkeys([*lanes, *trouble])), window)
            asked = () if tags is None else lanes
            figure = timing_diagram(data, recording.labels, f"{name}: timing, {span}", asked=asked)
            written += save(figure, out / f"{name}-timing")
        if panels:
            columns = [trace.column for panel in panels for trace in panel.traces]
            data = recording.read(list(dict.fromkeys([*columns, *trouble])), window)
            shown = "places and pressures" if tags is None else "chosen tags"
            figure = trend_plot(panels, data, f"{name}: {shown}, {span}")
            written += save(figure, out / f"{name}-trends")
    return written


def _chosen(recording: Recording, side: str, tags: Sequence[str] | None) -> tuple[list[str], list[Panel]]:
    """Sort what is to be shown into lanes and panels."""
    if tags is None:
        return default_tags(recording, side), default_panels(recording)
    names = [name for name in recording.matching(tags) if name != "seedlings"]
    if not names:
        raise RecordingError(f"{recording.path}: seedlings are no signal; name tags that can be drawn")
    sample = recording.read(names, Window(recording.whole.from_ms, recording.whole.from_ms))
    lanes = [name for name in names if sample[name].dtype in (np.bool_, np.object_)]
    return lanes, panels_of(recording, [name for name in names if name not in lanes])


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{out}: is no folder to write to ({error.strerror}); give another --out") from None
