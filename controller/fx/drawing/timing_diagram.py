"""Timing diagram of a run: one lane for each watched device, with the values after END of each scan."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby, pairwise
from typing import Final

from controller.fx.drawing.svg import CHARACTER_WIDTH, SvgPicture

LANE: Final = 30
"""Height of a lane, px."""
SWING: Final = 16
"""Height of a signal that is on, or of a word, px."""
WIDTH: Final = 900
"""Width of the time axis, px."""
MARGIN: Final = 16
_HEAD: Final = 46
_STEPS: Final = (1, 2, 5)
_MOST_TICKS: Final = 12
_BITS: Final = frozenset("XYMSTC")


def draw_timing(records: Sequence[Mapping[str, int]], title: str, *, time: str = "ms") -> str:
    """Return the timing diagram of a run as the text of an SVG file.

    A value is drawn from its scan until the next one; the last one for the period of the last two scans.

    Args:
        records: One record for each scan: its time in ms and the values of the devices by name.
        title: Title of the picture.
        time: Key of the time.

    Raises:
        ValueError: There is no scan, or the times do not increase.
    """
    times = [record[time] for record in records]
    if not times or any(after <= before for before, after in pairwise(times)):
        raise ValueError("a timing diagram needs at least one scan, with increasing times")
    period_ms = times[-1] - times[-2] if len(times) > 1 else 1
    ends = [*times[1:], times[-1] + period_ms]
    names = [name for name in records[0] if name != time]
    left = MARGIN + round(CHARACTER_WIDTH * max((len(name) for name in names), default=0)) + MARGIN
    scale = WIDTH / (ends[-1] - times[0])
    picture = SvgPicture()
    bottom = _HEAD + LANE * len(names)
    picture.text(MARGIN, MARGIN + 2, title, "title")
    for at_ms in _ticks(times[0], ends[-1]):
        x = left + scale * (at_ms - times[0])
        with picture.group("grid"):
            picture.line(x, _HEAD - 4, x, bottom)
        picture.text(x, _HEAD - 8, f"{at_ms} ms", "note", middle=True)
    for row, name in enumerate(names):
        base = _HEAD + LANE * (row + 1) - (LANE - SWING) / 2
        picture.text(MARGIN, base - 4, name)
        spans = [
            (left + scale * (from_ms - times[0]), left + scale * (to_ms - times[0]), value)
            for from_ms, to_ms, value in _spans([record[name] for record in records], times, ends)
        ]
        with picture.group("lane", **{"data-device": name}):
            if name.rstrip("0123456789") in _BITS:
                picture.path(point for x1, x2, value in spans for point in _level(x1, x2, base, value))
            else:
                for x1, x2, value in spans:
                    _word(picture, (x1, x2), base, str(value))
    return picture.svg(left + WIDTH + 2 * MARGIN, bottom + MARGIN, title)


def _spans(values: Sequence[int], times: Sequence[int], ends: Sequence[int]) -> Iterator[tuple[int, int, int]]:
    """Yield start, end and value of each span in which a device keeps its value."""
    scans = zip(values, times, ends, strict=True)
    for value, span in groupby(scans, key=lambda scan: scan[0]):
        _, starts, span_ends = zip(*span, strict=True)
        yield starts[0], span_ends[-1], value


def _level(x1: float, x2: float, base: float, value: int) -> tuple[tuple[float, float], tuple[float, float]]:
    y = base - SWING if value else base
    return (x1, y), (x2, y)


def _word(picture: SvgPicture, span: tuple[float, float], base: float, text: str) -> None:
    """Draw a word as a box with its value, which is omitted if the box is too narrow."""
    x1, x2 = span
    picture.box(x1, base - SWING, x2 - x1, SWING)
    if CHARACTER_WIDTH * len(text) < x2 - x1:
        picture.text((x1 + x2) / 2, base - 4, text, middle=True)


def _ticks(from_ms: int, to_ms: int) -> range:
    """Return round times, ms."""
    step = next(
        step * 10**power
        for power in range(10)
        for step in _STEPS
        if (to_ms - from_ms) / (step * 10**power) <= _MOST_TICKS
    )
    return range(-(-from_ms // step) * step, to_ms + 1, step)
