"""Timing diagram of the wires around one instant, SVG."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from controller.common.modbus.io_map import IoMap, Point
from controller.fx.drawing.svg import SvgPicture
from plant_sim.hil.trace import Levels, WireTrace

BEFORE_MS, AFTER_MS = 3_000, 5_000
"""Time before and after the instant that the diagram shows, ms."""
_LEFT, _WIDTH, _LANE, _TOP = 190.0, 760.0, 18.0, 44.0


class _Lane(NamedTuple):
    label: str
    steps: list[tuple[int, bool]]
    """Times of the changes with the state from then on, ms; the first one is at the left edge."""


def timing_picture(trace: WireTrace, io_map: IoMap, at_ms: int, *, title: str, to_ms: int) -> str:
    """Return the diagram of all wires that change around an instant.

    Args:
        trace: Record of the wires.
        io_map: I/O map.
        at_ms: Plant time of the instant, ms; marked by a line.
        title: Title.
        to_ms: Plant time at which the case ended, ms; the diagram does not go beyond it by more than 1 s.
    """
    from_ms = max(0, at_ms - BEFORE_MS)
    end_ms = max(min(at_ms + AFTER_MS, to_ms + 1_000), from_ms + 1_000)
    lanes = list(_lanes(trace.window(from_ms, end_ms), io_map, from_ms))
    scale = _WIDTH / (end_ms - from_ms)

    def x_of(time_ms: int) -> float:
        return round(_LEFT + scale * (min(max(time_ms, from_ms), end_ms) - from_ms), 1)

    picture = SvgPicture()
    bottom = _TOP + _LANE * max(1, len(lanes))
    picture.text(8, 16, title, "title")
    for time_ms in range(-(-from_ms // 1_000) * 1_000, end_ms + 1, 1_000):
        picture.line(x_of(time_ms), bottom, x_of(time_ms), bottom + 4)
        picture.text(x_of(time_ms), bottom + 16, f"{time_ms // 1_000} s", "note", middle=True)
    for number, lane in enumerate(lanes):
        low = _TOP + _LANE * (number + 1) - 4
        picture.text(8, low, lane.label)
        points: list[tuple[float, float]] = []
        for time_ms, on in lane.steps:
            level = low - (_LANE - 7 if on else 0)
            if points:
                points.append((x_of(time_ms), points[-1][1]))
            points.append((x_of(time_ms), level))
        picture.path([*points, (x_of(end_ms), points[-1][1])])
    if not lanes:
        picture.text(_LEFT, _TOP + _LANE - 4, "no wire changes", "note")
    picture.line(x_of(at_ms), _TOP - 8, x_of(at_ms), bottom)
    picture.text(x_of(at_ms), _TOP - 12, f"{at_ms / 1000:.3f} s", "note", middle=True)
    return picture.svg(_LEFT + _WIDTH + 24, bottom + 26, title)


def _lanes(window: list[Levels], io_map: IoMap, from_ms: int) -> Iterator[_Lane]:
    """Return the wires that change in the window, outputs first."""
    for points, letter in ((io_map.outputs, "y"), (io_map.inputs, "x")):
        for point in points:
            steps = _steps(window, point, letter, from_ms)
            if len(steps) > 1:
                yield _Lane(f"{letter.upper()}{point.number:o} {point.tag}", steps)


def _steps(window: list[Levels], point: Point, letter: str, from_ms: int) -> list[tuple[int, bool]]:
    steps: list[tuple[int, bool]] = []
    for entry in window:
        on = point.active(getattr(entry, letter)[point.number])
        if not steps or on != steps[-1][1]:
            steps.append((max(entry.time_ms, from_ms), on))
    return steps
