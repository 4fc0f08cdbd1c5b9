"""Remote I/O of the machine: images of Y and X, output registers, and a watchdog that trips when writes stop.

The behaviour is that of industrial couplers (armed by the first write, safe levels on timeout, latched),
except that this watchdog cannot be disabled. Source: docs/sources/ecosystem.md 6.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence

from controller.common.modbus.io_map import IoMap
from controller.common.modbus.output_owner import OwnerReport
from controller.common.saved import Saved
from plant_sim.links.output_lease import OutputLease
from plant_sim.links.write_timing import LinkTiming
from plant_sim.machine.plant import Plant


class ModuleFault(Exception):  # noqa: N818 - the Modbus term (device failure)
    """Refusal to set an output because the watchdog of the module has tripped; the message is one line."""


class WatchdogState(enum.IntEnum):
    """State of the output watchdog in the telemetry."""

    UNARMED = 0
    ARMED = 1
    TRIPPED = 2


class IoModule(Saved):
    """Remote I/O of the plant with an output watchdog in plant time.

    The first write arms the watchdog. If no output is written for more than `watchdog_ms` of plant time, every
    output is set to its safe level and the module is tripped: it refuses any write that would set an output to an
    unsafe level. Writing safe levels to all outputs, in one write or several, resets the trip, so nothing restarts
    automatically. Writes to the operator box do not restart the watchdog timer.

    Attributes:
        plant: The plant.
        io_map: I/O map.
        tripped: True if the watchdog has tripped and has not been reset.
        last_write_ms: Plant time of the last accepted write, ms; None before the first.
        tripped_at_ms: Plant time of the last trip, ms, retained after a reset; None before the first.
        trips: Number of trips.
        block_writes: Number of times all outputs that move something have been written, each time in one write or
            several: a controller without a lamp need not write it.
        observers: Functions called after every advance of plant time.
        write_observers: Functions called with the client and the levels by Y number after every accepted write of a
            client.
        lease: Lease of the outputs; only the clients of a server need it.
        timing: Measured timing of the links.
    """

    SAVED = ("_outputs", "_registers", "_written", "block_writes", "last_write_ms", "tripped", "tripped_at_ms", "trips")

    def __init__(self, plant: Plant, io_map: IoMap, *, watchdog_ms: int = 100) -> None:
        """Connect a module to a plant with safe outputs and an unarmed watchdog.

        Args:
            plant: The plant; `advance` must be the only caller that advances its time.
            io_map: I/O map.
            watchdog_ms: Maximum plant time between writes, ms.

        Raises:
            ValueError: The watchdog time is not positive.
        """
        if watchdog_ms <= 0:
            raise ValueError(
                f"watchdog_ms is {watchdog_ms}: the output watchdog cannot be disabled; must be 1 ms or more"
            )
        self.plant = plant
        self.io_map = io_map
        self.tripped = False
        self.last_write_ms: int | None = None
        self.tripped_at_ms: int | None = None
        self.trips = 0
        self.block_writes = 0
        self.observers: list[Callable[[], None]] = []
        self.write_observers: list[Callable[[str, Mapping[int, bool]], None]] = []
        self.lease = OutputLease()
        self.timing = LinkTiming()
        self._watchdog_ms = watchdog_ms
        self._safe = io_map.safe_outputs()
        self._outputs = list(self._safe)
        self._wired = frozenset(point.number for point in io_map.outputs)
        self._block = frozenset(point.number for point in io_map.outputs if point.moves)
        self._safe_registers = {register.number: register.safe for register in io_map.registers}
        self._registers = dict(self._safe_registers)
        self._planter = io_map.register("planter_speed")
        self._written: set[int] = set()  # outputs of the block written since it was last complete

    @property
    def watchdog_ms(self) -> int:
        """Maximum plant time between two writes before the watchdog trips, ms."""
        return self._watchdog_ms

    @property
    def watchdog_state(self) -> WatchdogState:
        """State of the watchdog: unarmed before the first write, then armed or tripped."""
        if self.tripped:
            return WatchdogState.TRIPPED
        return WatchdogState.UNARMED if self.last_write_ms is None else WatchdogState.ARMED

    @property
    def owner_report(self) -> OwnerReport:
        """Report for the clients: owner of the outputs and output watchdog."""
        lease = self.lease
        return OwnerReport(lease.owner, lease.refused, lease.last_refused, self.trips, self._watchdog_ms)

    @property
    def outputs(self) -> list[bool]:
        """Current raw Y image."""
        return list(self._outputs)

    def inputs(self) -> list[bool]:
        """Return the current raw X image."""
        return self.plant.x

    def write_outputs(self, first: int, levels: Sequence[bool]) -> None:
        """Write consecutive outputs.

        Args:
            first: Y number of the first level.
            levels: Raw levels, starting at Y `first`.

        Raises:
            ModuleFault: The module is tripped, and a level is not safe.
            ValueError: An output is beyond the Y image.
        """
        if first == 0 and not self.tripped and list(levels) == self._outputs:
            self.last_write_ms = self.plant.time_ms
            self._note_written(self._block)
        else:
            self.write({first + index: level for index, level in enumerate(levels)})

    def write(self, levels: Mapping[int, bool]) -> None:
        """Write several outputs, either all or none of them.

        Args:
            levels: Raw level by Y number; numbers without a terminal are ignored.

        Raises:
            ModuleFault: The module is tripped, and a level is not safe.
            ValueError: An output is beyond the Y image.
        """
        if levels and not 0 <= min(levels) <= max(levels) < len(self._outputs):
            raise ValueError(f"outputs {sorted(levels)} exceed the {len(self._outputs)} outputs of the I/O map")
        wired = self._wired & levels.keys()
        if self.tripped and any(levels[number] != self._safe[number] for number in wired):
            self._written.clear()
            raise ModuleFault(
                f"output watchdog tripped at {self.tripped_at_ms} ms: write every output to its safe level first"
            )
        for number in wired:
            self._outputs[number] = bool(levels[number])
        if wired:
            self.last_write_ms = self.plant.time_ms
            self._note_written(wired)

    def write_as(self, client: str, levels: Mapping[int, bool]) -> None:
        """Write several outputs for a client, which then has the lease of the outputs; see `write`.

        Args:
            client: Address of the client.
            levels: Raw level by Y number; at least one.

        Raises:
            LeaseError: The outputs belong to another client.
            ModuleFault: The module is tripped, and a level is not safe.
            ValueError: An output is beyond the Y image.
        """
        self.lease.check(client)
        self.write(levels)
        self.lease.take(client)
        for observe in self.write_observers:
            observe(client, levels)

    @property
    def registers(self) -> dict[int, int]:
        """Current values of the output registers by number of the data register."""
        return dict(self._registers)

    def write_registers(self, values: Mapping[int, int]) -> None:
        """Write several output registers, either all or none of them; this does not restart the watchdog.

        Args:
            values: Value by number of the data register.

        Raises:
            ModuleFault: The module is tripped, and a value is not safe.
            ValueError: The I/O map has no such register.
        """
        if not values.keys() <= self._registers.keys():
            raise ValueError(f"registers {sorted(values)}: the I/O map has {sorted(self._registers)}")
        if self.tripped and any(value != self._safe_registers[number] for number, value in values.items()):
            raise ModuleFault(f"output watchdog tripped at {self.tripped_at_ms} ms: write every register safe first")
        self._registers.update(values)
        self._drive_planter()

    def make_safe(self) -> None:
        """Set every output and output register to its safe state; watchdog and write times are unchanged."""
        self._outputs = list(self._safe)
        self._registers = dict(self._safe_registers)
        self._drive_planter()

    def _drive_planter(self) -> None:
        if self._planter is not None:
            self.plant.planter_speed_m_s = self._registers[self._planter.number] / 1_000

    def adopt(self, outputs: Sequence[bool], *, writes: int, last_ms: int) -> None:
        """Adopt block writes that were executed elsewhere on an armed module.

        Args:
            outputs: Raw levels of the last write.
            writes: Number of writes.
            last_ms: Plant time of the last write, ms.
        """
        self._outputs = list(outputs)
        self.block_writes += writes
        self.last_write_ms = last_ms

    def advance(self, for_ms: int) -> None:
        """Advance plant time; a trip occurs at its exact millisecond.

        Args:
            for_ms: Duration, ms.
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
        self.trips += 1
        self._written.clear()
        self.lease.end()

    def _note_written(self, wired: frozenset[int]) -> None:
        self._written |= wired & self._block
        if self._written == self._block:
            self._written.clear()
            self.block_writes += 1
            self.tripped = False  # while tripped, only safe levels are accepted
