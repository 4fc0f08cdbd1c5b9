"""Timing diagram: coils, sensors and steps as lanes above a common time axis, as on a logic analyser."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from plant_sim.common.figure_style import COLOURS, QUIET
from plant_sim.scope.store import TIME, Recording
from plant_sim.scope.style import Mark, marks_of, seconds, shade, spans_of

_WIDTH_IN, _LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 11.0, 1.6, 0.25, 0.42, 0.62
_LANE_IN = 0.185
_HEADING, _APART = 1.3, 0.4
"""Height of a group heading, and gap between the kinds of lanes, in lanes."""

_CHARACTER_IN = 0.062
"""Width of a character of the small text in a lane, inches."""

_NOTE_CHARACTERS, _NOTE_LINE_IN = 170, 0.12
"""Line length, in characters, and line height, in inches, of the note below the diagram."""

_TITLES = {"machine": "Machine", "left": "Left arm", "right": "Right arm"}

Span = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Lane:
    """One lane of the diagram.

    Attributes:
        label: Label on the axis.
        colour: Colour.
        kind: ``coil``, ``sensor``, ``step`` (one step of a sequence), ``text`` or ``mark`` (an alarm or a fault).
        spans: Intervals in which the lane is on, or intervals of the texts, s.
        texts: Texts in the spans of a ``text`` or ``mark`` lane.
    """

    label: str
    colour: str
    kind: str
    spans: list[Span]
    texts: tuple[str, ...] = ()


def default_tags(recording: Recording, side: str) -> list[str]:
    """Return the columns of the diagram of one arm: machine, steps and wires of the arm, step of the other arm."""
    other = "right" if side == "left" else "left"
    wanted = ["state", "alarms", "faults", "step.tray_feeder", f"step.{other}_arm", f"step.{side}_arm"]
    wires = [name for name in recording.labels if name.partition(".")[2].partition(".")[0] != other]
    return [name for name in wanted if name in recording.names] + wires


def timing_diagram(
    data: Mapping[str, np.ndarray], labels: Mapping[str, str], title: str, *, requested: Sequence[str] = ()
) -> Figure:
    """Draw the diagram.

    Args:
        data: Boolean and text columns of a window, with `TIME`.
        labels: Terminals by column.
        title: Title of the figure.
        requested: Columns to draw even if constant; if empty, constant columns are listed below the diagram instead.
    """
    time_s = data[TIME] / 1000
    constant = [] if requested else [name for name in data if name not in (TIME, "state") and _constant(data[name])]
    groups = _groups(time_s, {name: data[name] for name in data if name not in constant}, labels, requested)
    quiet = [_display_name(name, labels) for name in constant if name not in ("alarms", "faults")]
    note = _note(quiet)
    bottom_in = _BOTTOM_IN + _NOTE_LINE_IN * note.count("\n")
    height_in = _TOP_IN + bottom_in + _LANE_IN * sum(_height(lanes) for lanes in groups.values())
    figure = Figure(figsize=(_WIDTH_IN, height_in))
    wide_in, high_in = _WIDTH_IN - _LEFT_IN - _RIGHT_IN, height_in - _TOP_IN - bottom_in
    axes = figure.add_axes((_LEFT_IN / _WIDTH_IN, bottom_in / height_in, wide_in / _WIDTH_IN, high_in / height_in))
    axes.set_xlim(time_s[0], time_s[-1])
    bottom = _draw_groups(axes, groups, (time_s[-1] - time_s[0]) / wide_in)
    axes.set_ylim(bottom, 0.0)
    _frame(axes, marks_of(time_s, data))
    figure.text(_LEFT_IN / _WIDTH_IN, 1 - 0.2 / height_in, title, fontsize=10, fontweight="bold", va="center")
    if note:
        place = (_LEFT_IN / _WIDTH_IN, 0.09 / height_in)
        figure.text(*place, note, fontsize=6.5, color=QUIET, va="bottom")
    return figure


def _note(quiet: Sequence[str]) -> str:
    """Return the wrapped list of constant columns, broken between names; empty if no column is constant."""
    names = ", ".join(name.replace(" ", "\u00a0") for name in quiet)
    return "\n".join(wrap(f"Unchanged: {names}", _NOTE_CHARACTERS)).replace("\u00a0", " ") if quiet else ""


def _constant(values: np.ndarray) -> bool:
    return bool(np.all(values == values[0]))


def _groups(
    time_s: np.ndarray, data: Mapping[str, np.ndarray], labels: Mapping[str, str], requested: Sequence[str]
) -> dict[str, list[Lane]]:
    """Group the columns by machine and arm, sorted by `_rank`."""
    # if there are several sequences, the last one is shown step by step
    staircase = next((name for name in reversed(list(data)) if name.startswith("step.")), None)
    groups: dict[str, list[Lane]] = {owner: [] for owner in _TITLES}
    for name in sorted(data, key=_rank):
        if name == TIME:
            continue
        owner = _owner(name)
        label, colour = _display_name(name, labels), COLOURS.get(name, COLOURS[owner])
        spans = spans_of(time_s, data[name])
        if name in ("faults", "alarms"):
            marks = [mark for mark in marks_of(time_s, data) if mark.kind == name]
            lanes = [Lane(name[:-1], colour, "mark", [(mark.from_s, mark.to_s)], (mark.text,)) for mark in marks]
        elif data[name].dtype == np.bool_:
            kind = "coil" if name.startswith("y.") else "sensor"
            lanes = [Lane(label, colour, kind, [(from_s, to_s) for from_s, to_s, on in spans if on])]
        elif name == staircase:
            lanes = _staircase(spans, colour)
        else:
            # the state is recorded as the name of its constant
            shown = [
                (from_s, to_s, str(text).capitalize() if name == "state" else str(text))
                for from_s, to_s, text in spans
                if text
            ]
            texts = tuple(text for _, _, text in shown)
            lanes = [Lane(label, colour, "text", [(from_s, to_s) for from_s, to_s, _ in shown], texts)]
        if not lanes and name in requested:
            lanes = [Lane(label, colour, "text", [])]
        groups[owner] += lanes
    return {owner: lanes for owner, lanes in groups.items() if lanes}


def _staircase(spans: list[tuple[float, float, object]], colour: str) -> list[Lane]:
    """Return one lane for each step in the order of occurrence."""
    steps: dict[str, list[Span]] = {}
    # a step at the start of the window that recurs belongs to the previous cycle: sort it by its recurrence
    comes_again = any(title == spans[0][2] for _, _, title in spans[1:])
    for from_s, to_s, title in [*spans[1:], spans[0]] if comes_again else spans:
        if title:
            steps.setdefault(str(title), []).append((from_s, to_s))
    return [Lane(title, colour, "step", times) for title, times in steps.items()]


def _rank(name: str) -> tuple[int, int]:
    """Return the sort key: faults, alarms, state, steps, coils, sensors, other columns; equal within each kind."""
    heads = ("faults", "alarms", "state", "step", "y", "x")
    head = name.partition(".")[0]
    return (heads.index(head) if head in heads else len(heads), 0)


def _owner(name: str) -> str:
    words = name.replace("_", ".").split(".")
    return next((side for side in ("left", "right") if side in words[:2]), "machine")


def _display_name(name: str, labels: Mapping[str, str]) -> str:
    """Return the display name of a tag with its terminal."""
    words = [word for word in name.split(".") if word not in ("x", "y", "left", "right")]
    text = " ".join(words).replace("_", " ").removeprefix("step ")
    if text in ("left arm", "right arm"):
        text = "step"
    return f"{text}  {labels[name]}" if name in labels else text


def _height(lanes: Sequence[Lane]) -> float:
    """Return the height of a group with its heading, in lanes."""
    kinds = [lane.kind for lane in lanes]
    return _HEADING + len(lanes) + _APART * sum(one != other for one, other in pairwise(kinds))


def _draw_groups(axes: Axes, groups: Mapping[str, Sequence[Lane]], inch_s: float) -> float:
    """Draw the groups from the top; return their total height in lanes."""
    places: list[tuple[float, str, dict[str, Any]]] = []
    top = 0.0
    for owner, lanes in groups.items():
        heading = {"color": COLOURS[owner], "fontweight": "bold", "fontsize": 8.5}
        places.append((top + _HEADING - 0.45, _TITLES[owner], heading))
        top += _HEADING
        before = lanes[0].kind
        for lane in lanes:
            top += _APART if lane.kind != before else 0.0
            before = lane.kind
            _draw_lane(axes, lane, top, inch_s)
            places.append((top + 0.52, lane.label, {"color": QUIET if lane.kind == "step" else "black", "fontsize": 7}))
            top += 1.0
    axes.set_yticks([place for place, _, _ in places], [label for _, label, _ in places])
    for text, (_, _, look) in zip(axes.get_yticklabels(), places, strict=True):
        text.update(look)
    return top


def _draw_lane(axes: Axes, lane: Lane, top: float, inch_s: float) -> None:
    low, high = top + 0.86, top + 0.16  # the axis points down
    widths = [(from_s, to_s - from_s) for from_s, to_s in lane.spans]
    if lane.kind == "step":
        axes.broken_barh(widths, (top + 0.22, 0.56), facecolors=lane.colour, alpha=0.45, linewidth=0)
    elif lane.kind in ("text", "mark"):
        axes.broken_barh(
            widths, (top + 0.12, 0.76), facecolors=lane.colour, alpha=0.16, edgecolors=lane.colour, linewidth=0.7
        )
        _write_texts(axes, lane, top + 0.52, inch_s)
    else:
        alpha = 0.55 if lane.kind == "coil" else 0.2
        axes.broken_barh(widths, (high, low - high), facecolors=lane.colour, alpha=alpha, linewidth=0)
        axes.plot(*_wave(lane.spans, *axes.get_xlim(), low, high), color=lane.colour, linewidth=0.8)


def _write_texts(axes: Axes, lane: Lane, middle: float, inch_s: float) -> None:
    """Write the texts into their spans: states and steps if they fit, alarms and faults from the start of the span."""
    for (from_s, to_s), text in zip(lane.spans, lane.texts, strict=True):
        if lane.kind == "mark":
            axes.text(from_s + 0.04 * inch_s, middle, text, va="center", fontsize=6, clip_on=True)
        elif len(text) * _CHARACTER_IN <= (to_s - from_s) / inch_s:
            axes.text((from_s + to_s) / 2, middle, text, ha="center", va="center", fontsize=6)


def _wave(spans: list[Span], start_s: float, end_s: float, low: float, high: float) -> tuple[list[float], list[float]]:
    """Return the corners of a square wave; a level at an end of the window extends to that end."""
    times, levels = [start_s], [high if spans and spans[0][0] <= start_s else low]
    for from_s, to_s in spans:
        if from_s > start_s:
            times += [from_s, from_s]
            levels += [low, high]
        if to_s < end_s:
            times += [to_s, to_s]
            levels += [high, low]
    return [*times, end_s], [*levels, levels[-1]]


def _frame(axes: Axes, marks: list[Mark]) -> None:
    shade(axes, marks)
    axes.set_xlabel("plant time (s)")
    axes.grid(axis="x")
    axes.set_axisbelow(True)
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.xaxis.set_major_locator(seconds())
