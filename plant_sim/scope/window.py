"""Selection of the window of a recording."""

from __future__ import annotations

import numpy as np

from plant_sim.common.units import QuantityError, parse_ms
from plant_sim.scope.errors import RecordingError
from plant_sim.scope.store import Recording, RecordingWindow

_LEAVES_M = 0.02
"""Slide position beyond which an arm has left the feed, m."""

_MARGIN_MS = 200


def selected_window(recording: Recording, start: str | None, end: str | None, *, side: str) -> RecordingWindow:
    """Return the requested window of a recording.

    Args:
        recording: The recording.
        start: Start, such as ``12s``; None for the default, or for the start of the recording if `end` is given.
        end: End; None for the default, or for the end of the recording if `start` is given.
        side: Arm whose second full cycle is the default window.

    Raises:
        RecordingError: A time is invalid, or the window contains fewer than two samples.
    """
    if start is None and end is None:
        return cycle_window(recording, side, 2) or cycle_window(recording, side, 1) or recording.full_window
    full_window = recording.full_window
    from_ms = full_window.from_ms if start is None else _time_ms("--from", start)
    to_ms = full_window.to_ms if end is None else _time_ms("--to", end)
    if from_ms >= to_ms:
        raise RecordingError(f"--from {from_ms} ms --to {to_ms} ms: the window is empty; --from must be less than --to")
    inside = np.count_nonzero((recording.time_ms >= from_ms) & (recording.time_ms <= to_ms))
    if inside < 2:
        held = f"{recording.path} contains {full_window.from_ms} to {full_window.to_ms} ms"
        raise RecordingError(f"--from {from_ms} ms --to {to_ms} ms: contains fewer than two samples; {held}")
    return RecordingWindow(max(from_ms, full_window.from_ms), min(to_ms, full_window.to_ms))


def cycle_window(recording: Recording, side: str, number: int) -> RecordingWindow | None:
    """Return the window of a full cycle of an arm, from one inward motion to the next; None if it does not exist.

    Args:
        recording: The recording.
        side: ``left`` or ``right``.
        number: Number of the cycle, from 1.
    """
    place, coil = f"{side}.slide.position_m", f"y.{side}.slide_inward"
    data = recording.read([place, coil])
    time_ms, place_m, driven = recording.time_ms, data[place], data[coil]
    away = np.flatnonzero((place_m[1:] > _LEAVES_M) & (place_m[:-1] <= _LEAVES_M)) + 1
    if len(away) <= number:
        return None
    starts = [int(time_ms[_first_driven(driven, int(index))]) for index in away[number - 1 : number + 1]]
    full_window = recording.full_window
    return RecordingWindow(
        max(starts[0] - _MARGIN_MS, full_window.from_ms), min(starts[1] + _MARGIN_MS, full_window.to_ms)
    )


def _first_driven(driven: np.ndarray, index: int) -> int:
    """Return the index at which the coil turned on, if it is on at `index`; otherwise return `index`."""
    off = np.flatnonzero(~driven[: index + 1])
    return min(int(off[-1]) + 1, index) if len(off) else 0


def _time_ms(option: str, text: str) -> int:
    try:
        return parse_ms(text)
    except QuantityError as error:
        raise RecordingError(f"{option} {error}") from None
