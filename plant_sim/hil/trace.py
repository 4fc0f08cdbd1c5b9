"""Levels of all wires over time, kept at their changes."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

from plant_sim.links.io_module import IoModule


@dataclass(frozen=True, slots=True)
class Levels:
    """Raw levels from one instant to the next entry.

    Attributes:
        time_ms: Plant time, ms.
        x: X image.
        y: Y image.
    """

    time_ms: int
    x: tuple[bool, ...]
    y: tuple[bool, ...]


class WireTrace:
    """Record of the X and Y images of a module.

    Attributes:
        entries: Entries in order of time; consecutive ones differ.
        until_ms: Plant time of the last sample, ms.
    """

    def __init__(self, module: IoModule) -> None:
        """Create a trace that begins with the present levels."""
        self._module = module
        self.entries: list[Levels] = []
        self.until_ms = 0
        self.sample()

    def sample(self) -> None:
        """Add the present levels if they have changed."""
        self.until_ms = self._module.plant.time_ms
        x, y = tuple(self._module.inputs()), tuple(self._module.outputs)
        if not self.entries or (x, y) != (self.entries[-1].x, self.entries[-1].y):
            self.entries.append(Levels(self.until_ms, x, y))

    def window(self, from_ms: int, to_ms: int) -> list[Levels]:
        """Return the entries of a window; the first one holds the levels at its beginning."""
        first = bisect_right(self.entries, from_ms, key=_time_ms)
        return self.entries[max(0, first - 1) : bisect_right(self.entries, to_ms, key=_time_ms)]


def _time_ms(entry: Levels) -> int:
    return entry.time_ms
