"""States of an alarm in the operator's alarm list."""

from __future__ import annotations

from enum import StrEnum

from controller.program.texts.alarms.handling import ALARM_STATES
from controller.program.texts.operator import Text


class AlarmState(StrEnum):
    """Alarm states of ISA-18.2 (docs/sources/fx2n.md 5).

    *Latched* means that the cause has cleared and the annunciator has not yet been reset. The states "suppressed by
    design" and "out of service" are not used: the alarm of an unwired point is never set and remains normal.
    """

    NORMAL = "normal"
    UNACKNOWLEDGED = "unacknowledged"
    ACKNOWLEDGED = "acknowledged"
    RETURNED_UNACKNOWLEDGED = "returned_unacknowledged"
    LATCHED_UNACKNOWLEDGED = "latched_unacknowledged"
    LATCHED_ACKNOWLEDGED = "latched_acknowledged"
    SHELVED = "shelved"

    @property
    def text(self) -> Text:
        """Name of the state for the operator."""
        return ALARM_STATES[self.value]
