"""Which part of a recording is looked at."""

from __future__ import annotations

import numpy as np

from plant_sim.quantity import QuantityError, parse_ms
from plant_sim.scope.store import Recording, RecordingError, Window

_LEAVES_M = 0.02  # an arm has left the feed for good
_MARGIN_MS = 200


def chosen_window(recording: Recording, start: str | None, end: str | None, *, side: str) -> Window:
    """Return the part of a recording that is asked for.

    Args:
        recording: The recording.
        start: From when, as ``12s``; None: the default's start, or that of the recording if there is an end.
        end: Until when; None: the default's end, or that of the recording if there is a start.
        side: The arm whose second full cycle is the default.

    Raises:
        RecordingError: a time cannot be read, or there is nothing between the two.
    """
    if start is None and end is None:
        return cycle_window(recording, side, 2) or cycle_window(recording, side, 1) or recording.whole
    whole = recording.whole
    from_ms = whole.from_ms if start is None else _time_ms("--from", start)
    to_ms = whole.to_ms if end is None else _time_ms("--to", end)
    if from_ms >= to_ms:
        raise RecordingError(
            f"--from {from_ms} ms --to {to_ms} ms: leaves no time between; let it begin before it ends"
        )
    inside = np.count_nonzero((recording.time_ms >= from_ms) & (recording.time_ms <= to_ms))
    if inside < 2:
        held = f"{recording.path} holds {whole.from_ms} to {whole.to_ms} ms"
        raise RecordingError(f"--from {from_ms} ms --to {to_ms} ms: nothing was recorded there; {held}")
    return Window(max(from_ms, whole.from_ms), min(to_ms, whole.to_ms))


def cycle_window(recording: Recording, side: str, number: int) -> Window | None:
    """Return when an arm makes a full cycle, from one start inward to the next; None if it makes fewer.

    Args:
        recording: The recording.
        side: ``left`` or ``right``.
        number: Which, from 1.
    """
    place, coil = f"{side}.slide.position_m", f"y.{side}.slide_inward"
    data = recording.read([place, coil])
    time_ms, place_m, driven = recording.time_ms, data[place], data[coil]
    away = np.flatnonzero((place_m[1:] > _LEAVES_M) & (place_m[:-1] <= _LEAVES_M)) + 1
    if len(away) <= number:
        return None
    starts = [int(time_ms[_first_driven(driven, int(index))]) for index in away[number - 1 : number + 1]]
    whole = recording.whole
    return Window(max(starts[0] - _MARGIN_MS, whole.from_ms), min(starts[1] + _MARGIN_MS, whole.to_ms))


def _first_driven(driven: np.ndarray, index: int) -> int:
    """Where the coil that is on at an index came on; the index itself if it is off."""
    off = np.flatnonzero(~driven[: index + 1])
    return min(int(off[-1]) + 1, index) if len(off) else 0


def _time_ms(option: str, text: str) -> int:
    try:
        return parse_ms(text)
    except QuantityError as error:
        raise RecordingError(f"{option} {error}") from None
