"""The machine's remote I/O: Y image, X image, and the watchdog that makes silence safe.

Conventions follow industrial couplers (armed by the first write, safe levels on timeout, latched),
with one difference: this watchdog cannot be switched off. Source: DESIGN.md, links.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence

from controller.io_map import IoMap
from plant_sim.plant import Plant


class ModuleFault(Exception):  # noqa: N818 - the word Modbus uses (device failure)
    """The module refuses to set an output: its watchdog has tripped; `str()` is one line."""


class WatchdogState(enum.IntEnum):
    """The output watchdog as telemetry reports it."""

    UNARMED = 0
    ARMED = 1
    TRIPPED = 2


class IoModule:
    """Remote I/O of the plant with an output watchdog in plant time.

    The first write arms the watchdog. When no output has been written for more than
    `watchdog_ms` of plant time, every output takes its safe level and the module is tripped: it
    refuses any write that would set an output unsafe. Writing every output safe, in one write or
    several, ends that; so nothing starts again by itself. Only writes to outputs count, neither
    the operator box nor telemetry.

    Attributes:
        plant: The machine behind the terminals.
        io_map: Which terminals exist.
        tripped: Whether the watchdog has tripped and has not been re-armed.
        last_write_ms: Plant time of the last accepted write, ms; None before the first.
        tripped_at_ms: Plant time of the last trip, ms; kept after re-arming; None before the first.
        block_writes: How often the complete Y block has been written, in one write or several.
        observers: Called whenever plant time has passed.
    """

    def __init__(self, plant: Plant, io_map: IoMap, *, watchdog_ms: int = 100) -> None:
        """Connect a module to a plant, outputs safe, watchdog unarmed.

        Args:
            plant: The machine; its time is advanced by `advance` only.
            io_map: Which terminals exist.
            watchdog_ms: Longest plant time between writes, ms.

        Raises:
            ValueError: the watchdog time is not positive.
        """
        if watchdog_ms <= 0:
            raise ValueError(
                f"watchdog_ms is {watchdog_ms}: the output watchdog cannot be switched off; give a time of 1 ms or more"
            )
        self.plant = plant
        self.io_map = io_map
        self.tripped = False
        self.last_write_ms: int | None = None
        self.tripped_at_ms: int | None = None
        self.block_writes = 0
        self.observers: list[Callable[[], None]] = []
        self._watchdog_ms = watchdog_ms
        self._safe = io_map.safe_outputs()
        self._outputs = list(self._safe)
        self._block = frozenset(point.number for point in io_map.outputs)
        self._written: set[int] = set()  # the part of the block written since it was last complete

    @property
    def watchdog_ms(self) -> int:
        """Longest plant time between writes that does not trip, ms."""
        return self._watchdog_ms

    @property
    def watchdog_state(self) -> WatchdogState:
        """Unarmed before the first write, then armed or tripped."""
        if self.tripped:
            return WatchdogState.TRIPPED
        return WatchdogState.UNARMED if self.last_write_ms is None else WatchdogState.ARMED

    @property
    def outputs(self) -> list[bool]:
        """The raw Y image in force."""
        return list(self._outputs)

    def inputs(self) -> list[bool]:
        """The raw X image of this instant."""
        return self.plant.x

    def write_outputs(self, first: int, levels: Sequence[bool]) -> None:
        """Write neighbouring outputs.

        Args:
            first: Y number of the first level.
            levels: Raw levels of Y `first` and those after it.

        Raises:
            ModuleFault: tripped, and a level is not safe.
            ValueError: beyond the Y image.
        """
        if first == 0 and not self.tripped and list(levels) == self._outputs:
            self.last_write_ms = self.plant.time_ms
            self._note_written(self._block)
        else:
            self.write({first + index: level for index, level in enumerate(levels)})

    def write(self, levels: Mapping[int, bool]) -> None:
        """Write outputs, all or none of them.

        Args:
            levels: Raw level by Y number; numbers without a terminal go nowhere.

        Raises:
            ModuleFault: tripped, and a level is not safe.
            ValueError: beyond the Y image.
        """
        if levels and not 0 <= min(levels) <= max(levels) < len(self._outputs):
            raise ValueError(f"outputs {sorted(levels)} exceed the {len(self._outputs)} of the map")
        wired = self._block & levels.keys()
        if self.tripped and any(levels[number] != self._safe[number] for number in wired):
            self._written.clear()
            raise ModuleFault(
                f"output watchdog tripped at {self.tripped_at_ms} ms: write every output safe before setting one"
            )
        for number in wired:
            self._outputs[number] = bool(levels[number])
        if wired:
            self.last_write_ms = self.plant.time_ms
            self._note_written(wired)

    def make_safe(self) -> None:
        """Put every output at its safe level; watchdog and write times stay as they are."""
        self._outputs = list(self._safe)

    def advance(self, for_ms: int) -> None:
        """Let plant time pass; a trip within it happens at exactly its millisecond.

        Args:
            for_ms: How long, ms.
        """
        end_ms = self.plant.time_ms + for_ms
        if self.last_write_ms is not None and not self.tripped:
            due_ms = self.last_write_ms + self._watchdog_ms + 1
            if due_ms <= end_ms:
                self._step_to(due_ms)
                self._trip()
        self._step_to(end_ms)
        for observe in self.observers:
            observe()

    def _step_to(self, at_ms: int) -> None:
        for_ms = at_ms - self.plant.time_ms
        if for_ms > 0:
            self.plant.step(for_ms, self._outputs)

    def _trip(self) -> None:
        self.make_safe()
        self.tripped = True
        self.tripped_at_ms = self.plant.time_ms
        self._written.clear()

    def _note_written(self, wired: frozenset[int]) -> None:
        self._written |= wired
        if self._written == self._block:
            self._written.clear()
            self.block_writes += 1
            self.tripped = False  # while tripped only safe levels get this far
