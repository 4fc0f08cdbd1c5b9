"""The last minutes of what is worth a curve, in memory."""

from __future__ import annotations

from collections import deque
from itertools import dropwhile
from typing import Final

from controller.core.clock import Clock
from controller.hmi import own_registers as own
from controller.hmi.panel.source import Mirror
from controller.hmi.panel.telemetry import Telemetry
from controller.hmi.panel.view import Json
from controller.program.tags import SIDES

PERIOD_MS: Final = 200
KEPT_MS: Final = 600_000
DRAWN: Final = ("mm", "°", "N", "kPa", "%")
"""Units of telemetry that is worth a curve."""


class Trends:
    """A ring of samples: positions, pressures, forces and shares of telemetry, and the last cycle times."""

    def __init__(self, mirror: Mirror, telemetry: Telemetry | None, clock: Clock) -> None:
        """Begin empty."""
        self._mirror = mirror
        self._telemetry = telemetry
        self._clock = clock
        tags = () if telemetry is None else telemetry.tags
        self._drawn = [tag.name for tag in tags if tag.unit in DRAWN]
        self._rows: deque[list[float | None]] = deque(maxlen=KEPT_MS // PERIOD_MS)

    def sample(self) -> None:
        """Take a sample of now."""
        values = {} if self._telemetry is None else self._telemetry.values
        cycles = [self._cycle_ms(index) for index in range(len(SIDES))]
        self._rows.append([self._clock.now_ms(), *(values.get(name) for name in self._drawn), *cycles])

    def since(self, at_ms: int) -> Json:
        """Return the samples later than a time of the panel's clock, ms; the oldest first."""
        return {
            "now_ms": self._clock.now_ms(),
            "period_ms": PERIOD_MS,
            "names": [*self._drawn, *(f"{side}.cycle_ms" for side in SIDES)],
            "rows": list(dropwhile(lambda row: (row[0] or 0) <= at_ms, self._rows)),
        }

    def _cycle_ms(self, index: int) -> int | None:
        first = own.R_CYCLES + own.CYCLE_WORDS * index
        return self._mirror.long(first + 2) or None if self._mirror.fresh else None
