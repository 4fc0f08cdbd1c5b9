"""I/O module of the bench: additional dead time, welded outputs and inputs that are shorted to each other."""

from __future__ import annotations

from collections import deque

from controller.common.modbus.io_map import IoMap
from plant_sim.links.io_module import IoModule
from plant_sim.machine.plant import Plant


class BenchModule(IoModule):
    """I/O module that shows inputs, and switches outputs, later by a dead time, and whose terminals can be faulty.

    A dead time of d ms in each direction has the effect of a controller whose scan, with its link, takes 2 d ms longer
    at most. The dead time may be changed at any time; it does not delay the output watchdog.

    Attributes:
        dead_time_ms: Dead time in each direction, ms.
        welded: Tag of the output whose coil is switched on whatever is written; empty = none. The safety relay is
            behind it, so that the emergency stop switches the coil off.
        shorted: Tags of inputs whose wires touch: each terminal is on if one of the contacts is closed.
    """

    def __init__(self, plant: Plant, io_map: IoMap, *, watchdog_ms: int = 100) -> None:
        """Create a module without dead time; see `IoModule`."""
        super().__init__(plant, io_map, watchdog_ms=watchdog_ms)
        self.dead_time_ms = 0
        self.welded = ""
        self.shorted: tuple[str, ...] = ()
        self._seen: deque[tuple[int, list[bool]]] = deque()
        """Past X images with the time from which they are shown, oldest first."""
        self._pending: deque[tuple[int, list[bool]]] = deque()
        """Written Y images with the time from which they act, oldest first."""
        self._acting = list(self._outputs)

    def inputs(self) -> list[bool]:
        """Return the raw X image of the dead time ago."""
        levels = self._delayed_inputs()
        if numbers := [self.io_map[tag].number for tag in self.shorted]:
            touching = any(levels[number] for number in numbers)
            for number in numbers:
                levels[number] = touching
        return levels

    def _delayed_inputs(self) -> list[bool]:
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
            if at_ms > self.plant.time_ms:
                self.plant.step(at_ms - self.plant.time_ms, self._driven(self._outputs))
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
            plant.step(end_ms - plant.time_ms, self._driven(self._acting))

    def _driven(self, image: list[bool]) -> list[bool]:
        """Return the levels at the coils."""
        if not self.welded:
            return image
        point, driven = self.io_map[self.welded], list(image)
        driven[point.number] = point.level(True)
        return driven
