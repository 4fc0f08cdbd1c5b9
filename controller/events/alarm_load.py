"""Alarm load after EEMUA 191: alarms in ten minutes, chattering and standing alarms.

The limits are stated with their sources in docs/sources/ecosystem.md 3.
"""

from __future__ import annotations

from collections import Counter
from typing import Final

from controller.events.alarm_states import AlarmState

WINDOW_MS: Final = 600_000
"""Interval in which alarms are counted, ms."""
MOST_IN_WINDOW: Final = 10
"""Largest number of alarms that an operator can handle in `WINDOW_MS` after an upset."""
CHATTER_MS: Final = 60_000
"""Interval in which repetitions of one alarm are counted, ms."""
CHATTER_COUNT: Final = 3
"""Number of activations within `CHATTER_MS` from which an alarm is chattering."""
STANDING_MS: Final = 24 * 3_600_000
"""Time for which an alarm is active until it is a standing alarm, ms."""

_CLEARED: Final = (AlarmState.NORMAL, AlarmState.RETURNED_UNACKNOWLEDGED)
_LATCHED: Final = (AlarmState.LATCHED_UNACKNOWLEDGED, AlarmState.LATCHED_ACKNOWLEDGED)
NEW: Final = (AlarmState.UNACKNOWLEDGED, AlarmState.LATCHED_UNACKNOWLEDGED)
"""States of an alarm that has been announced and not acknowledged."""
ACTIVE: Final = (*NEW, AlarmState.ACKNOWLEDGED, AlarmState.LATCHED_ACKNOWLEDGED)
"""States of an alarm whose annunciator is set."""


def is_activation(before: AlarmState, after: AlarmState) -> bool:
    """Return True if a change is a new activation; the end of shelving is not one."""
    return after in NEW and (before in _CLEARED or (before in _LATCHED and after is AlarmState.UNACKNOWLEDGED))


def is_chattering(activations: int, came_ms: int, now_ms: int) -> bool:
    """Return True if an alarm with this number of activations within `CHATTER_MS` up to `came_ms` is chattering."""
    return activations >= CHATTER_COUNT and now_ms - came_ms < CHATTER_MS


def is_standing(state: AlarmState, came_ms: int, now_ms: int) -> bool:
    """Return True if an alarm in this state, active since `came_ms`, is a standing alarm."""
    return state in ACTIVE and now_ms - came_ms >= STANDING_MS


class AlarmLoad:
    """Counter of the activations of all alarms in one run of the controller.

    Attributes:
        peak: Largest number of activations within `WINDOW_MS`.
        chattered: Number of times at which each alarm has begun to chatter, by annunciator number.
    """

    def __init__(self) -> None:
        self.peak = 0
        self.chattered: Counter[int] = Counter()
        self._times: tuple[int, ...] = ()  # replaced as a whole, so that another thread may read it
        self._of_alarm: dict[int, tuple[int, ...]] = {}

    def announce(self, number: int, at_ms: int) -> int:
        """Count an activation; times must not decrease.

        Args:
            number: Number of the annunciator.
            at_ms: Time of the activation, ms.

        Returns:
            Number of activations of this alarm within `CHATTER_MS`, including this one.
        """
        self._times = (*_since(self._times, at_ms - WINDOW_MS), at_ms)
        self.peak = max(self.peak, len(self._times))
        before = self._of_alarm.get(number, ())
        self._of_alarm[number] = (*_since(before, at_ms - CHATTER_MS), at_ms)
        count = len(self._of_alarm[number])
        self.chattered[number] += count >= CHATTER_COUNT > len(before)
        return count

    def recent(self, now_ms: int) -> int:
        """Return the number of activations within the last `WINDOW_MS`."""
        return len(_since(self._times, now_ms - WINDOW_MS))


def _since(times: tuple[int, ...], start_ms: int) -> tuple[int, ...]:
    """Return the times after `start_ms`."""
    return tuple(at_ms for at_ms in times if at_ms > start_ms)
