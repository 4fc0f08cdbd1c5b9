"""Trend plot: positions and pressures over time, in panels above a common time axis."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from plant_sim.common.figure_style import COLOURS, QUIET, SERIES
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.scope.columns import SIDES, bands_of
from plant_sim.scope.store import TIME, Recording
from plant_sim.scope.style import Mark, marks_of, seconds, shade

_WIDTH_IN, _LEFT_IN, _BOTTOM_IN = 11.0, 0.85, 0.5
_TITLE_IN, _LEGEND_IN, _MARKS_IN = 0.4, 0.15, 0.35
_CHARACTER_IN = 0.052
"""Width of a character of a name next to a panel, inches."""

_PANEL_IN, _GAP_IN = 1.22, 0.14

_SUPPLY = {
    "air.network.receiver.pressure_pa": ("receiver", SERIES[4]),
    "air.network.manifold.pressure_pa": ("manifold", SERIES[0]),
    "air.network.claw_manifold.pressure_pa": ("claw manifold", SERIES[1]),
}


class Curve(NamedTuple):
    """One curve in a panel.

    Attributes:
        column: Column to draw.
        colour: Colour.
        dashed: True for the opposing chamber.
        label: Label at the end of the curve; empty if colour and line style identify it.
    """

    column: str
    colour: str
    dashed: bool = False
    label: str = ""


class ReferenceLevel(NamedTuple):
    """Reference in a panel, in the unit of the column: a band, or a line if both ends are equal."""

    low: float
    high: float
    label: str


@dataclass(frozen=True, slots=True)
class TrendPanel:
    """One panel.

    Attributes:
        title: Label of the axis, without the unit.
        unit: Unit of the columns.
        traces: Curves.
        levels: Bands and thresholds.
        upside_down: True if the axis points down, as for the lift.
    """

    title: str
    unit: str
    traces: list[Curve]
    levels: list[ReferenceLevel] = field(default_factory=list)
    upside_down: bool = False


_DISPLAY_UNITS = {
    "m": ("mm", 1e3, 0.0),
    "Pa": ("MPa gauge", 1e-6, ATMOSPHERE_PA),
    "kg": ("g", 1e3, 0.0),
    "K": ("°C", 1.0, 273.15),
}
"""Display of the recorded units: unit on the axis, factor, and the offset that is subtracted first."""


def default_panels(recording: Recording) -> list[TrendPanel]:
    """Return positions and chamber pressures of slide, lift and claws of both arms, and the supply."""
    params = recording.about["make"]
    bands: dict[str, list[ReferenceLevel]] = {}
    for band in bands_of(params):
        if band.sensor.startswith("left."):
            words = band.sensor.removeprefix("left.").removeprefix("slide_at_").removeprefix("lift_")
            label = words.replace("_", " ").replace("claws ", "")
            bands.setdefault(band.column, []).append(ReferenceLevel(band.low_m, band.high_m, label))
    grip = [
        ReferenceLevel(params["left.grips_below_m"], params["left.grips_below_m"], "grips below"),
        ReferenceLevel(params["left.frees_above_m"], params["left.frees_above_m"], "frees above"),
    ]
    supply = [
        ReferenceLevel(
            params["air.network.starts_below_pa"] + ATMOSPHERE_PA,
            params["air.network.stops_above_pa"] + ATMOSPHERE_PA,
            "compressor",
        ),
        ReferenceLevel(
            params["air.ok_above_pa"] - params["air.ok_gap_pa"] + ATMOSPHERE_PA,
            params["air.ok_above_pa"] + ATMOSPHERE_PA,
            "pressure switch",
        ),
    ]
    return [
        TrendPanel("slide position", "m", _both("slide.position_m"), bands["left.slide.position_m"]),
        TrendPanel("slide chambers", "Pa", _chambers("slide")),
        TrendPanel("lift extension", "m", _both("lift.position_m"), bands["left.lift.position_m"], upside_down=True),
        TrendPanel("lift chambers", "Pa", _chambers("lift")),
        TrendPanel("claw opening", "m", _both("claws.position_m"), grip),
        TrendPanel("claw chambers", "Pa", _chambers("claws")),
        TrendPanel("belt travel", "m", _both("spreader.travel_m"), bands["left.spreader.travel_m"]),
        TrendPanel(
            "supply", "Pa", [Curve(name, colour, label=label) for name, (label, colour) in _SUPPLY.items()], supply
        ),
    ]


def panels_of(recording: Recording, names: Iterable[str]) -> list[TrendPanel]:
    """Return one panel for each unit among the given numeric columns."""
    panels: dict[str, TrendPanel] = {}
    for name in names:
        unit = recording.units.get(name, "-")
        panel = panels.setdefault(unit, TrendPanel("", unit, []))
        panel.traces.append(Curve(name, SERIES[len(panel.traces) % len(SERIES)], label=name))
    return list(panels.values())


def trend_plot(panels: list[TrendPanel], data: Mapping[str, np.ndarray], title: str) -> Figure:
    """Draw the panels.

    Args:
        panels: Panels from the top.
        data: Columns of the panels in a window, with `TIME`, and alarms and faults if recorded.
        title: Title of the figure.
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
        _label_marks(first, marks)
    figure.axes[-1].set_xlabel("plant time (s)")
    figure.text(_LEFT_IN / _WIDTH_IN, 1 - 0.2 / height_in, title, fontsize=10, fontweight="bold", va="center")
    if by_arm:
        _draw_legend(figure, height_in)
    return figure


def _both(what: str) -> list[Curve]:
    return [Curve(f"{side}.{what}", COLOURS[side]) for side in reversed(SIDES)]


def _chambers(drive: str) -> list[Curve]:
    return [
        Curve(f"{side}.{drive}.{port}.chamber.pressure_pa", COLOURS[side], dashed=port == "minus")
        for side in reversed(SIDES)
        for port in ("plus", "minus")
    ]


def _display_unit(unit: str) -> tuple[str, float, float]:
    return _DISPLAY_UNITS.get(unit, (unit, 1.0, 0.0))


def _draw_panel(axes: Axes, panel: TrendPanel, time_s: np.ndarray, data: Mapping[str, np.ndarray]) -> None:
    unit, factor, zero = _display_unit(panel.unit)
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
    _label_heights(axes, names)


def _label_heights(axes: Axes, names: list[tuple[float, str, str]]) -> None:
    """Write labels next to a panel at their heights, with a minimum distance."""
    low, high = axes.get_ylim()
    apart = 0.095 / _PANEL_IN
    floor = -apart
    for height, label, colour in sorted(((y - low) / (high - low), label, colour) for y, label, colour in names):
        floor = max(floor + apart, height)
        axes.text(1.006, floor, label, transform=axes.transAxes, va="center", fontsize=6.5, color=colour)


def _label_marks(axes: Axes, marks: list[Mark]) -> None:
    """Label alarms and faults at their start above the first panel."""
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


def _draw_legend(figure: Figure, height_in: float) -> None:
    """Draw the legend of the colours and lines of both arms."""
    handles = [Line2D([], [], color=COLOURS[side], label=f"{side} arm") for side in SIDES]
    handles += [
        Line2D([], [], color="black", label="chamber that drives inward, down, open"),
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
