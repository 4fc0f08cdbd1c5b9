"""Names of the devices and values of a twin: devices of the PLC, tags, and the columns of the oscilloscope."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Final

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from controller.core.devices import SIZES, DeviceError, Memory, device_name
from controller.core.expr import Bit, Word
from controller.debug.machine import DebugSignal, Value
from plant_sim.scope.columns import Column, columns_of
from plant_sim.twin.conditions import Quantity
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recording import controller_tags

_DEVICE: Final = re.compile(r"(TN|CN|[XYMSTCD])(\d+)", re.IGNORECASE)
_ROWS: Final = {"TN": "TV", "CN": "CV"}
_KINDS: Final = ("X", "Y", "M", "S", "T", "TN", "C", "CN", "D")


class Signals:
    """Names of the devices and values of a twin.

    Attributes:
        steps: States of all steps of all sequences.
    """

    def __init__(self, twin: Twin) -> None:
        """Collect the names of a twin."""
        self._twin = twin
        self._columns: dict[str, Column] = {column.name: column for column in columns_of()}
        self._texts: Mapping[str, Callable[[], Value]] = controller_tags(twin)
        self._tags: dict[str, Bit | Word] = {}
        self._names: dict[tuple[str, str], str] = {}
        for device in twin.machine.program.devices():
            if device.name:
                self._tags.setdefault(_key(device.name), device)
                self._names.setdefault((_kind(device), str(device)), device.name)
        for point in (*twin.io_map.inputs, *twin.io_map.outputs):
            bit = Bit("X" if point in twin.io_map.inputs else "Y", point.number, point.tag)
            self._tags[_key(point.tag)] = bit
            self._names[bit.kind, str(bit)] = point.tag
        for name, word in vars(twin.machine.tags.sp).items():
            if isinstance(word, Word):
                self._tags.setdefault(name, word)
        self.steps = [self._of(bit) for each in twin.machine.program.sequences() for bit, _ in each]

    def find(self, name: str) -> DebugSignal:
        """Return a device or value by name.

        Raises:
            InputError: There is none.
        """
        match = _DEVICE.fullmatch(name)
        if match is not None:
            return self._of(_device(match[1].upper(), match[2], name))
        if name in self._columns:
            return self._of_column(self._columns[name])
        if name in self._texts:
            return DebugSignal(name, self._texts[name])
        tag = self._tags.get(_key(name))
        if tag is not None:
            return self._of(tag)
        raise InputError(f"{name}: no such device, tag or value; {self._remedy(name)}")

    def devices(self) -> Mapping[str, Value]:
        """Return the values of all devices by name."""
        return {name: value for kind in _KINDS for name, value in self._row(kind)}

    def values(self) -> Mapping[str, Value]:
        """Return the values of the plant by name."""
        return {name: self._of_column(column).read() for name, column in self._columns.items()}

    def _row(self, kind: str) -> Iterator[tuple[str, Value]]:
        row = getattr(self._twin.plc.memory, _ROWS.get(kind, kind))
        for number, value in enumerate(row):
            yield device_name(kind, number), int(value)

    def _of(self, device: Bit | Word) -> DebugSignal:
        kind, number = _kind(device), device.number
        row, twin = _ROWS.get(kind, kind), self._twin
        name = device_name(kind, number)

        def read() -> Value:
            memory: Memory = twin.plc.memory
            return int(getattr(memory, row)[number])

        return DebugSignal(name, read, tag=self._names.get((kind, str(device)), ""), source=device)

    def _of_column(self, column: Column) -> DebugSignal:
        plant = self._twin.plant
        is_number = column.unit and all(isinstance(step, int | str) for step in column.path)
        source = Quantity(".".join(map(str, column.path))) if is_number else None

        def read() -> Value:
            value: Value = column.of(plant.state)[0].item()
            return value

        return DebugSignal(column.name, read, unit=column.unit, source=source)

    def _remedy(self, name: str) -> str:
        known = (*self._columns, *self._tags, *self._texts)
        return suggestion(name, known, "write a device (X1, M135, TN5), a tag or a value such as left.lift.position_m")


def _device(kind: str, digits: str, name: str) -> Bit | Word:
    base = 8 if kind in "XY" else 10
    try:
        number = int(digits, base)
        return Word(kind[0], number) if kind in _ROWS or kind == "D" else Bit(kind, number)
    except (ValueError, DeviceError):
        last = device_name(kind, SIZES[kind[0]] - 1)
        octal = ", in octal numbers" if base == 8 else ""
        raise InputError(f"{name}: no such device; choose one from {kind}0 to {last}{octal}") from None


def _kind(device: Bit | Word) -> str:
    """Return the kind of a device as in its name: TN and CN for current values."""
    return f"{device.kind}N" if isinstance(device, Word) and device.kind in "TC" else device.kind


def _key(name: str) -> str:
    """Return a tag in the form in which it is written in a condition."""
    return name.replace(" ", "_")
