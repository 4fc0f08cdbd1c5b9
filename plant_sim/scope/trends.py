"""Places and pressures over time, one panel each above one time axis."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.scope.columns import SIDES, bands_of
from plant_sim.scope.store import TIME, Recording
from plant_sim.scope.style import COLOURS, QUIET, SERIES, Mark, marks_of, seconds, shade

_WIDTH_IN, _LEFT_IN, _BOTTOM_IN = 11.0, 0.85, 0.5
_TITLE_IN, _LEGEND_IN, _MARKS_IN = 0.4, 0.15, 0.35
_CHARACTER_IN = 0.052  # of a name beside a panel
_PANEL_IN, _GAP_IN = 1.22, 0.14

_SUPPLY = {
    "air.network.receiver.pressure_pa": ("receiver", SERIES[4]),
    "air.network.manifold.pressure_pa": ("manifold", SERIES[0]),
    "air.network.claw_manifold.pressure_pa": ("claw manifold", SERIES[1]),
}


class Trace(NamedTuple):
    """One line in a panel.

    Attributes:
        column: What it shows.
        colour: Its colour.
        dashed: Whether it is the chamber that drives back.
        label: What is written at its end; empty where colour and line say it.
    """

    column: str
    colour: str
    dashed: bool = False
    label: str = ""


class Level(NamedTuple):
    """A height in a panel that means something, in the unit of the column: a band, or a line if both ends are equal."""

    low: float
    high: float
    label: str


@dataclass(frozen=True, slots=True)
class Panel:
    """One panel.

    Attributes:
        title: What it shows, with the unit as it is drawn.
        unit: Unit of its columns.
        traces: Its lines.
        levels: Bands and thresholds.
        upside_down: Whether the axis points down, as the lift does.
    """

    title: str
    unit: str
    traces: list[Trace]
    levels: list[Level] = field(default_factory=list)
    upside_down: bool = False


#: How a recorded unit is drawn: unit on the axis, factor, what is taken off first.
_DRAWN = {
    "m": ("mm", 1e3, 0.0),
    "Pa": ("MPa gauge", 1e-6, ATMOSPHERE_PA),
    "kg": ("g", 1e3, 0.0),
    "K": ("°C", 1.0, 273.15),
}


def default_panels(recording: Recording) -> list[Panel]:
    """Return places and chamber pressures of slide, lift and claws of both arms, and the supply."""
    made = recording.about["make"]
    bands: dict[str, list[Level]] = {}
    for band in bands_of(made):
        if band.sensor.startswith("left."):
            words = band.sensor.removeprefix("left.").removeprefix("slide_at_").removeprefix("lift_")
            label = words.replace("_", " ").replace("claws ", "")
            bands.setdefault(band.column, []).append(Level(band.low_m, band.high_m, label))
    grip = [
        Level(made["left.grips_below_m"], made["left.grips_below_m"], "grips below"),
        Level(made["left.frees_above_m"], made["left.frees_above_m"], "frees above"),
    ]
    supply = [
        Level(made["air.network.starts_below_pa"] + ATMOSPHERE_PA, made["air.network.stops_above_pa"] + ATMOSPHERE_PA,
              "compressor"),
        Level(made["air.ok_above_pa"] - made["air.ok_gap_pa"] + ATMOSPHERE_PA, made["air.ok_above_pa"] + ATMOSPHERE_PA,
              "pressure switch"),
    ]  # fmt: skip
    return [
        Panel("slide place", "m", _both("slide.position_m"), bands["left.slide.position_m"]),
        Panel("slide chambers", "Pa", _chambers("slide")),
        Panel("lift extension", "m", _both("lift.position_m"), bands["left.lift.position_m"], upside_down=True),
        Panel("lift chambers", "Pa", _chambers("lift")),
        Panel("claw opening", "m", _both("claws.position_m"), grip),
        Panel("claw chambers", "Pa", _chambers("claws")),
        Panel("belt travel", "m", _both("spreader.travel_m"), bands["left.spreader.travel_m"]),
        Panel("supply", "Pa", [Trace(name, colour, label=label) for name, (label, colour) in _SUPPLY.items()], supply),
    ]


def panels_of(recording: Recording, names: Iterable[str]) -> list[Panel]:
    """Return one panel for each unit of some columns of numbers."""
    panels: dict[str, Panel] = {}
    for name in names:
        unit = recording.units.get(name, "-")
        panel = panels.setdefault(unit, Panel("", unit, []))
        panel.traces.append(Trace(name, SERIES[len(panel.traces) % len(SERIES)], label=name))
    return list(panels.values())


def trend_plot(panels: list[Panel], data: Mapping[str, np.ndarray], title: str) -> Figure:
    """Draw the panels.

    Args:
        panels: What to draw, from the top.
        data: Their columns of a part of a recording, with `TIME`; alarms and faults where they are known.
        title: What is shown.
    """
    time_s = data[TIME] / 1000
    marks = marks_of(time_s, data)
    by_arm = any(not trace.label for panel in panels for trace in panel.traces)
    top_in = _TITLE_IN + (_LEGEND_IN if by_arm else 0.0) + (_MARKS_IN if marks else 0.0)
    height_in = top_in + _BOTTOM_IN + len(panels) * (_PANEL_IN + _GAP_IN) - _GAP_IN
    names = [trace.label for panel in panels for trace in panel.traces]
    names += [level.label for panel in panels for level in panel.levels]
    wide_in = _WIDTH_IN - _LEFT_IN - 0.2 - _CHARACTER_IN * max(map(len, names))
    figure = Figure(figsize=(_WIDTH_IN, height_in))
    first: Axes | None = None
    for number, panel in enumerate(panels):
        low_in = _BOTTOM_IN + (len(panels) - 1 - number) * (_PANEL_IN + _GAP_IN)
        box = (_LEFT_IN / _WIDTH_IN, low_in / height_in, wide_in / _WIDTH_IN, _PANEL_IN / height_in)
        axes = figure.add_axes(box, sharex=first)
        first = first or axes
        _draw_panel(axes, panel, time_s, data)
        shade(axes, marks)
        axes.tick_params(axis="x", labelbottom=number == len(panels) - 1)
    if first is not None:
        first.set_xlim(time_s[0], time_s[-1])
        _note_marks(first, marks)
    figure.axes[-1].set_xlabel("plant time (s)")
    figure.text(_LEFT_IN / _WIDTH_IN, 1 - 0.2 / height_in, title, fontsize=10, fontweight="bold", va="center")
    if by_arm:
        _explain(figure, height_in)
    return figure


def _both(what: str) -> list[Trace]:
    return [Trace(f"{side}.{what}", COLOURS[side]) for side in reversed(SIDES)]


def _chambers(drive: str) -> list[Trace]:
    return [
        Trace(f"{side}.{drive}.{port}.chamber.pressure_pa", COLOURS[side], dashed=port == "minus")
        for side in reversed(SIDES)
        for port in ("plus", "minus")
    ]


def _drawn(unit: str) -> tuple[str, float, float]:
    return _DRAWN.get(unit, (unit, 1.0, 0.0))


def _draw_panel(axes: Axes, panel: Panel, time_s: np.ndarray, data: Mapping[str, np.ndarray]) -> None:
    unit, factor, zero = _drawn(panel.unit)
    names: list[tuple[float, str, str]] = []
    for level in panel.levels:
        low, high = factor * (level.low - zero), factor * (level.high - zero)
        if low == high:
            axes.axhline(low, color=QUIET, linewidth=0.6, linestyle=(0, (1, 2)))
        else:
            axes.axhspan(low, high, color=QUIET, alpha=0.13, linewidth=0)
        names.append(((low + high) / 2, level.label, QUIET))
    for trace in panel.traces:
        values = factor * (np.asarray(data[trace.column], dtype=float) - zero)
        style = (0, (3.5, 1.5)) if trace.dashed else "-"
        axes.plot(time_s, values, color=trace.colour, linestyle=style, linewidth=0.9 if trace.dashed else 1.2)
        if trace.label:
            names.append((float(values[-1]), trace.label, trace.colour))
    axes.set_ylabel(f"{panel.title}\n({unit})" if panel.title else f"({unit})")
    axes.margins(x=0.0, y=0.08)
    axes.grid(visible=True)
    axes.set_axisbelow(True)
    axes.yaxis.set_label_coords(-0.055, 0.5)
    axes.xaxis.set_major_locator(seconds())
    if panel.upside_down:
        axes.invert_yaxis()
    _name_heights(axes, names)


def _name_heights(axes: Axes, names: list[tuple[float, str, str]]) -> None:
    """Write names beside a panel at their heights, so far apart that each can be read."""
    low, high = axes.get_ylim()
    apart = 0.095 / _PANEL_IN
    floor = -apart
    for height, label, colour in sorted(((y - low) / (high - low), label, colour) for y, label, colour in names):
        floor = max(floor + apart, height)
        axes.text(1.006, floor, label, transform=axes.transAxes, va="center", fontsize=6.5, color=colour)


def _note_marks(axes: Axes, marks: list[Mark]) -> None:
    """Name alarms and faults above the first panel, where they begin."""
    for number, mark in enumerate(marks):
        axes.annotate(
            mark.text,
            (mark.from_s, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(2, 3 + 8 * (number % 3)),
            textcoords="offset points",
            fontsize=6.5,
            color=COLOURS[mark.kind],
        )


def _explain(figure: Figure, height_in: float) -> None:
    """Say what the colours and lines of both arms mean."""
    handles = [Line2D([], [], color=COLOURS[side], label=f"{side} arm") for side in SIDES]
    handles += [
        Line2D([], [], color="black", label="chamber that drives in, down, open"),
        Line2D([], [], color="black", linestyle=(0, (3.5, 1.5)), label="the opposite chamber"),
        Line2D([], [], color=QUIET, alpha=0.3, linewidth=6, label="switch on"),
    ]
    figure.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(_LEFT_IN / _WIDTH_IN - 0.005, 1 - 0.28 / height_in),
        ncols=len(handles),
        fontsize=7,
        handlelength=2.2,
        columnspacing=1.6,
    )
