"""I/O module with additional dead time, for the margin of the scan time."""

from __future__ import annotations

from collections import deque

from controller.common.modbus.io_map import IoMap
from plant_sim.links.io_module import IoModule
from plant_sim.machine.plant import Plant


class DelayingModule(IoModule):
    """I/O module that shows inputs, and switches outputs, later by a dead time.

    A dead time of d ms in each direction has the effect of a controller whose scan, with its link, takes 2 d ms longer
    at most. The dead time may be changed at any time; it does not delay the output watchdog.

    Attributes:
        dead_time_ms: Dead time in each direction, ms.
    """

    def __init__(self, plant: Plant, io_map: IoMap, *, watchdog_ms: int = 100) -> None:
        """Create a module without dead time; see `IoModule`."""
        super().__init__(plant, io_map, watchdog_ms=watchdog_ms)
        self.dead_time_ms = 0
        self._seen: deque[tuple[int, list[bool]]] = deque()
        """Past X images with the time from which they are shown, oldest first."""
        self._pending: deque[tuple[int, list[bool]]] = deque()
        """Written Y images with the time from which they act, oldest first."""
        self._acting = list(self._outputs)

    def inputs(self) -> list[bool]:
        """Return the raw X image of the dead time ago."""
        while len(self._seen) > 1 and self._seen[1][0] <= self.plant.time_ms:
            self._seen.popleft()
        shown = self._seen and self._seen[0][0] <= self.plant.time_ms
        return list(self._seen[0][1]) if shown and self.dead_time_ms else super().inputs()

    def _step_to(self, at_ms: int) -> None:
        """Advance the plant; every output image acts from its own time on."""
        if not self.dead_time_ms:
            self._seen.clear()
            self._pending.clear()
            self._acting = list(self._outputs)
            super()._step_to(at_ms)
            return
        plant = self.plant
        last = self._pending[-1][1] if self._pending else self._acting
        if last != self._outputs:
            self._pending.append((plant.time_ms + self.dead_time_ms, list(self._outputs)))
        while plant.time_ms < at_ms:
            if self._pending and self._pending[0][0] <= plant.time_ms:
                self._acting = self._pending.popleft()[1]
            end_ms = min(at_ms, self._pending[0][0]) if self._pending else at_ms
            end_ms = min(end_ms, plant.time_ms + 1)
            self._seen.append((plant.time_ms + self.dead_time_ms, plant.x))
            plant.step(end_ms - plant.time_ms, self._acting)
