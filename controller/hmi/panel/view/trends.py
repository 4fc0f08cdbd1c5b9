"""Trend buffer in memory, with the samples of the last few minutes."""

from __future__ import annotations

from collections import deque
from itertools import dropwhile
from typing import Final

from controller.core.clock import Clock
from controller.hmi.access import status_registers as status
from controller.hmi.panel.modbus.mirror import Mirror
from controller.hmi.panel.modbus.telemetry import Telemetry
from controller.hmi.panel.view.state import Json
from controller.program.tags import SIDES

PERIOD_MS: Final = 200
BUFFER_MS: Final = 600_000
TREND_UNITS: Final = ("mm", "°", "N", "kPa", "%")
"""Units of the telemetry tags that are recorded."""


class Trends:
    """Ring buffer of samples: telemetry positions, pressures, forces and percentages, and the last cycle times."""

    def __init__(self, mirror: Mirror, telemetry: Telemetry | None, clock: Clock) -> None:
        """Initialise an empty buffer."""
        self._mirror = mirror
        self._telemetry = telemetry
        self._clock = clock
        tags = () if telemetry is None else telemetry.tags
        self._recorded = [tag.name for tag in tags if tag.unit in TREND_UNITS]
        self._rows: deque[list[float | None]] = deque(maxlen=BUFFER_MS // PERIOD_MS)

    def sample(self) -> None:
        """Record one sample."""
        values = {} if self._telemetry is None else self._telemetry.values
        cycles = [self._cycle_ms(index) for index in range(len(SIDES))]
        self._rows.append([self._clock.now_ms(), *(values.get(name) for name in self._recorded), *cycles])

    def since(self, at_ms: int) -> Json:
        """Return the samples recorded after `at_ms` on the panel clock, ms, oldest first."""
        return {
            "now_ms": self._clock.now_ms(),
            "period_ms": PERIOD_MS,
            "names": [*self._recorded, *(f"{side}.cycle_ms" for side in SIDES)],
            "rows": list(dropwhile(lambda row: (row[0] or 0) <= at_ms, self._rows)),
        }

    def _cycle_ms(self, index: int) -> int | None:
        first = status.R_CYCLES + status.CYCLE_WORDS * index
        return self._mirror.long(first + 2) or None if self._mirror.fresh else None
