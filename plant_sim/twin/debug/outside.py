"""State of a twin that can be changed from outside between two scans, and the entries that change it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from controller.core.devices import device_name
from controller.core.expr import Bit, Word
from controller.core.machine_code import MachineExecution
from controller.core.memory_layout import WORD_BYTES, MemoryLayout
from controller.io.forcing import Forcing
from controller.io.runtime import Runtime
from plant_sim.devices.operator_box import OperatorBox
from plant_sim.faults import Fault, FaultSchedule
from plant_sim.twin.lock_step import Twin

if TYPE_CHECKING:
    from plant_sim.twin.debug.machine import TwinMachine

_ORDERS: Final = Runtime.SAVED.index("_orders")
_LEVELS: Final = Forcing.SAVED.index("_levels")
_RUNTIME, _PLC, _FORCING, _PANEL = 0, 1, 2, 5
"""Positions of the parts in the saved state of a runtime."""


class OutsideState(NamedTuple):
    """State that can be changed from outside.

    Attributes:
        box: Buttons, in the order of `OperatorBox.SAVED`.
        releases: Times at which pressed buttons are released, ms.
        faults: Faults that are active or scheduled.
        memory: Devices of the program.
        state: State of the plant.
        params: Parameters of the plant.
        frequency_per_min: Set-point of the tractor speed.
        orders: Orders of an operator that the runtime has not taken yet, forced inputs, and messages of a panel.
        bridged: Levels applied to terminals.
        conveyor: Trays on the belt and in the magazine, in the order of `Conveyor.SAVED`.
        retained: Contents of the retentive store.
    """

    box: list[bool]
    releases: dict[str, int]
    faults: tuple[Fault, ...]
    memory: bytes
    state: bytes
    params: bytes
    frequency_per_min: float
    orders: tuple[Any, ...]
    bridged: dict[int, bool]
    conveyor: list[Any]
    retained: dict[str, int] | None


def outside_of(twin: Twin) -> OutsideState:
    """Return the state of a twin that can be changed from outside."""
    runtime, plant = twin.runtime.save(), twin.plant
    return OutsideState(
        box=plant.box.save(),
        releases=twin.releases.copy(),
        faults=plant.faults.listed,
        memory=runtime[_PLC][1],
        state=plant.state.tobytes(),
        params=plant.params.tobytes(),
        frequency_per_min=plant.planting_frequency_per_min,
        orders=(list(runtime[_RUNTIME][_ORDERS]), runtime[_FORCING], runtime[_PANEL]),
        bridged=plant.terminals.bridged.copy(),
        conveyor=plant.conveyor.save(),
        retained=twin.store.values,
    )


def ordered(twin: Twin) -> Iterator[tuple[Bit | Word, int]]:
    """Yield the devices and values that have been ordered for the next scan."""
    for order in twin.runtime.save()[_RUNTIME][_ORDERS]:
        yield from order


@dataclass(frozen=True, slots=True)
class BytePatch:
    """Bytes of an array that have been written.

    Attributes:
        at: Positions.
        values: New values.
    """

    at: np.ndarray
    values: np.ndarray

    @staticmethod
    def between(before: bytes, after: bytes) -> BytePatch | None:
        """Return the difference of two states; None if there is none."""
        if before == after:
            return None
        new = np.frombuffer(after, np.uint8)
        at = np.flatnonzero(np.frombuffer(before, np.uint8) != new)
        return BytePatch(at, new[at])

    def apply(self, target: np.ndarray) -> None:
        """Write the bytes."""
        target[self.at] = self.values


@dataclass(frozen=True, slots=True)
class OutsideAction:
    """Change of the state from outside before a scan.

    Attributes:
        text: The change, in words; empty if a client has only read.
        box: Levels of buttons.
        releases: Times of all releases, ms; None = unchanged.
        begun: Faults that have been added.
        ended: Names of the faults that have been cleared.
        memory: Written devices.
        state: Written state of the plant.
        params: Written parameters of the plant.
        frequency_per_min: Set-point of the tractor speed; None = unchanged.
        orders: Orders, forced inputs and messages; None = unchanged.
        conveyor: Changes of trays, by position in `Conveyor.SAVED`.
        retained: New contents of the retentive store; empty = unchanged.
    """

    text: str
    box: dict[str, bool] = field(default_factory=dict)
    releases: dict[str, int] | None = None
    begun: tuple[Fault, ...] = ()
    ended: tuple[str, ...] = ()
    memory: BytePatch | None = None
    state: BytePatch | None = None
    params: BytePatch | None = None
    frequency_per_min: float | None = None
    orders: tuple[Any, ...] | None = None
    conveyor: dict[int, Any] = field(default_factory=dict)
    retained: tuple[dict[str, int] | None, ...] = ()

    def __str__(self) -> str:
        return self.text

    @property
    def is_repeatable(self) -> bool:
        """True: a branch can repeat it."""
        return True

    def apply(self, machine: TwinMachine, /) -> None:
        """Let the change enter the machine."""
        twin = machine.twin
        plant = twin.plant
        self._change_faults(plant.faults)
        for button, level in self.box.items():
            setattr(plant.box, button, level)
        if self.releases is not None:
            twin.releases.clear()
            twin.releases.update(self.releases)
        if self.frequency_per_min is not None:
            plant.planting_frequency_per_min = self.frequency_per_min
        if self.conveyor:
            trays = plant.conveyor.save()
            plant.conveyor.restore([self.conveyor.get(number, value) for number, value in enumerate(trays)])
        for contents in self.retained:
            twin.store.values = contents
        for patch, target in (
            (self.memory, machine.region),
            (self.state, plant.state.view(np.uint8)),
            (self.params, plant.params.view(np.uint8)),
        ):
            if patch is not None:
                patch.apply(target)
        if self.orders is not None:
            self._order(twin.runtime)

    def _change_faults(self, faults: FaultSchedule) -> None:
        listed = {fault.name for fault in faults.listed}
        for name in self.ended:
            if name in listed:  # a branch may have ended it before
                faults.clear(name)
        for fault in self.begun:
            if fault.name not in listed:
                faults.add(fault)

    def _order(self, runtime: Runtime) -> None:
        orders, forcing, panel = self.orders or ()
        saved = list(runtime.save())
        saved[_RUNTIME] = list(saved[_RUNTIME])
        saved[_RUNTIME][_ORDERS] = type(saved[_RUNTIME][_ORDERS])(orders)
        saved[_FORCING], saved[_PANEL] = forcing, panel
        runtime.restore(saved)


def action_between(before: OutsideState, after: OutsideState, execution: MachineExecution) -> OutsideAction | None:
    """Return the action that has changed the state from outside; None if there is none."""
    if before == after:
        return None
    buttons = OperatorBox.SAVED
    box = {name: new for name, old, new in zip(buttons, before.box, after.box, strict=True) if old != new}
    begun = tuple(fault for fault in after.faults if fault not in before.faults)
    ended = tuple(fault.name for fault in before.faults if fault not in after.faults)
    memory = BytePatch.between(before.memory, after.memory)
    frequency = after.frequency_per_min if after.frequency_per_min != before.frequency_per_min else None
    trays = enumerate(zip(before.conveyor, after.conveyor, strict=True))
    conveyor = {number: new for number, (old, new) in trays if old != new}
    words = [
        *(f"{button}={'on' if level else 'off'}" for button, level in box.items()),
        *(f"end of fault {name}" for name in ended),
        *(f"fault {fault}" for fault in begun),
        *([] if memory is None else _devices_in(memory, after.memory, execution.layout)),
        *(["trays moved by hand"] if conveyor else []),
        *(["retained memory replaced"] if after.retained != before.retained else []),
        *([] if frequency is None else [f"planting_frequency={frequency:g}"]),
        *_orders_in(before.orders, after.orders),
    ]
    state, params = BytePatch.between(before.state, after.state), BytePatch.between(before.params, after.params)
    return OutsideAction(
        ", ".join(words) or ("" if state is None and params is None else "a change of the plant"),
        box=box,
        releases=after.releases if after.releases != before.releases else None,
        begun=begun,
        ended=ended,
        memory=memory,
        state=state,
        params=params,
        frequency_per_min=frequency,
        orders=after.orders if after.orders != before.orders else None,
        conveyor=conveyor,
        retained=() if after.retained == before.retained else (after.retained,),
    )


def _orders_in(before: tuple[Any, ...], after: tuple[Any, ...]) -> Iterator[str]:
    """Yield the devices that have been ordered, and a change of the forced inputs."""
    waiting, forced, _ = before
    orders, forces, _ = after
    for order in orders[len(waiting) :] if orders[: len(waiting)] == waiting else orders:
        yield from (f"{device}={value}" for device, value in order)
    levels = forces[_LEVELS]
    if levels != forced[_LEVELS]:
        yield "forced " + (
            " ".join(f"X{number:o}={int(level)}" for number, level in levels.items()) or "inputs released"
        )


def _devices_in(patch: BytePatch, memory: bytes, layout: MemoryLayout) -> Iterator[str]:
    """Yield the devices that a patch writes, with their values."""
    data = np.frombuffer(memory, np.uint8)
    rows = [(name, row, WORD_BYTES) for name, row in layout.words.items()]
    rows += [(name, row, 1) for name, row in layout.bits.items()]
    for name, row, size in rows:
        inside = patch.at[(patch.at >= row.offset) & (patch.at < row.offset + row.length * size)]
        for number, _ in groupby(((inside - row.offset) // size).tolist()):
            at = row.offset + number * size
            value = int.from_bytes(data[at : at + size].tobytes(), "little", signed=size > 1)
            yield f"{device_name(_NAMES.get(name, name), number)}={value}"


_NAMES: Final = {"TV": "TN", "CV": "CN"}


@dataclass(frozen=True, slots=True)
class PowerCycle:
    """Power cycle of the controller before a scan.

    Attributes:
        off_ms: Time without power, ms.
    """

    off_ms: int

    def __str__(self) -> str:
        return f"power off for {self.off_ms} ms"

    @property
    def is_repeatable(self) -> bool:
        """True: a branch can repeat it."""
        return True

    def apply(self, machine: TwinMachine, /) -> None:
        """Cycle the power."""
        with suppress(ValueError):  # retained values that no program can have stored, as when it was recorded
            machine.twin.power_cycle(self.off_ms)


@dataclass(frozen=True, slots=True)
class MovedByHand:
    """Time that passed for the plant between two scans, while somebody moved it.

    Attributes:
        saved: State of the machine after it.
    """

    saved: Any

    def __str__(self) -> str:
        return "the machine was moved by hand"

    @property
    def is_repeatable(self) -> bool:
        """False: a branch in which the machine has moved otherwise cannot repeat it."""
        return False

    def apply(self, machine: TwinMachine, /) -> None:
        """Put the machine in the state after it."""
        machine.restore(self.saved)
