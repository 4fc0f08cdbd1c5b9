"""I/O map: the wires of a machine, each with its terminal at the PLC and its address in a Modbus I/O module."""

from __future__ import annotations

import enum
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from controller.common.declarations import DeclarationError


class Polarity(enum.StrEnum):
    """Relation between the logical state of a point and its terminal level."""

    NORMALLY_OPEN = "normally_open"
    NORMALLY_CLOSED = "normally_closed"
    ACTIVE_HIGH = "active_high"
    ACTIVE_LOW = "active_low"


class ModbusTable(enum.StrEnum):
    """Modbus table of the I/O module that contains a point."""

    DISCRETE_INPUT = "discrete_input"
    COIL = "coil"
    HOLDING_REGISTER = "holding_register"
    INPUT_REGISTER = "input_register"


@dataclass(frozen=True, slots=True)
class Point:
    """I/O point: one wire of the machine.

    Attributes:
        tag: Name in the program, e.g. ``left.lift_down``.
        address: Terminal as written in the file, octal, e.g. ``X10``.
        device: ``X`` for an input, ``Y`` for an output.
        number: Value of the octal address (8 for X10), used as the index into an image.
        meaning: Meaning of the active state.
        polarity: Relation between logical state and terminal level.
        safe: Safe logical state, which is assumed for an input while the field link is lost and written to an output
            if a fault occurs.
        table: Modbus table of the I/O module.
        offset: Modbus offset in that table.
        optional: True if the machine can run without this point.
        wired: True if the wire exists; always true unless `optional` is true.
        moves: True for an output that moves something; it is off in an emergency stop.
        line: Line of the entry in the file, from 1.
    """

    tag: str
    address: str
    device: str
    number: int
    meaning: str
    polarity: Polarity
    safe: bool
    table: ModbusTable
    offset: int
    optional: bool
    wired: bool
    moves: bool
    line: int

    @property
    def inverted(self) -> bool:
        """True if the terminal is off while the point is active."""
        return self.polarity in (Polarity.NORMALLY_CLOSED, Polarity.ACTIVE_LOW)

    def level(self, active: bool) -> bool:
        """Return the raw terminal level of a logical state."""
        return active != self.inverted

    def active(self, level: bool) -> bool:
        """Return the logical state of a raw terminal level."""
        return level != self.inverted


@dataclass(frozen=True, slots=True)
class OutputRegister:
    """Data register that is written to the field I/O together with the outputs.

    Attributes:
        tag: Name in the program.
        address: Register as written in the file, for example ``D0``.
        number: Number of the data register.
        meaning: Meaning of the value, with its unit.
        safe: Value that is written if a fault occurs and on exit.
        table: Modbus table of the I/O module.
        offset: Modbus offset in that table.
        wired: True if the device exists.
        line: Line of the entry in the file, from 1.
    """

    tag: str
    address: str
    number: int
    meaning: str
    safe: int
    table: ModbusTable
    offset: int
    wired: bool
    line: int

    @property
    def device(self) -> str:
        """Letter of the address."""
        return "D"


@dataclass(frozen=True)
class IoMap:
    """I/O points of one machine.

    An image is a list of raw terminal levels indexed by the value of the octal address.

    Attributes:
        path: Path of the file.
        inputs: Wired inputs, by number.
        outputs: Wired outputs, by number.
        unwired: Optional points without a wire, in the order of the file.
        registers: Wired output registers, by number.
        unwired_registers: Output registers without a device, in the order of the file.
    """

    path: Path
    inputs: tuple[Point, ...]
    outputs: tuple[Point, ...]
    unwired: tuple[Point, ...]
    registers: tuple[OutputRegister, ...] = ()
    unwired_registers: tuple[OutputRegister, ...] = ()

    @cached_property
    def _by_tag(self) -> Mapping[str, Point]:
        return {point.tag: point for point in (*self.inputs, *self.outputs)}

    def __getitem__(self, tag: str) -> Point:
        __tracebackhide__ = True
        if tag not in self._by_tag:
            line = next((f":{point.line}" for point in self.unwired if point.tag == tag), "")
            remedy = "set wired: true" if line else "add it, and declare its tag in controller/iomap/schema.py"
            raise DeclarationError(f"{self.path}{line}: no wired point {tag}; {remedy}")
        return self._by_tag[tag]

    def __contains__(self, tag: object) -> bool:
        return tag in self._by_tag

    def all_wired(self) -> IoMap:
        """Return the map with all optional points and output registers wired."""
        points = sorted((*self.inputs, *self.outputs, *self.unwired), key=lambda point: point.number)
        return replace(
            self,
            inputs=tuple(replace(point, wired=True) for point in points if point.device == "X"),
            outputs=tuple(replace(point, wired=True) for point in points if point.device == "Y"),
            unwired=(),
            registers=tuple(replace(each, wired=True) for each in (*self.registers, *self.unwired_registers)),
            unwired_registers=(),
        )

    def with_wired(self, tags: Collection[str]) -> IoMap:
        """Return the map with the given optional points and output registers wired as well.

        Args:
            tags: Their tags; those that are wired already are left as they are.

        Raises:
            DeclarationError: The map has no point or output register with one of the tags.
        """
        everything = self.all_wired()
        for tag in tags:
            if everything.get(tag) is None and everything.register(tag) is None:
                raise DeclarationError(f"{self.path}: no point or output register {tag}")
        named = {tag for tag in tags if tag not in self}
        return replace(
            self,
            inputs=tuple(each for each in everything.inputs if each.tag in self or each.tag in named),
            outputs=tuple(each for each in everything.outputs if each.tag in self or each.tag in named),
            unwired=tuple(each for each in self.unwired if each.tag not in named),
            registers=tuple(each for each in everything.registers if self.register(each.tag) or each.tag in named),
            unwired_registers=tuple(each for each in self.unwired_registers if each.tag not in named),
        )

    def with_unwired(self, tags: Collection[str]) -> IoMap:
        """Return the map with the given wired points not wired."""
        points = [replace(self[tag], wired=False) for tag in tags]
        return replace(
            self,
            inputs=tuple(each for each in self.inputs if each.tag not in tags),
            outputs=tuple(each for each in self.outputs if each.tag not in tags),
            unwired=(*self.unwired, *points),
        )

    def get(self, tag: str) -> Point | None:
        """Return the wired point with this tag, or None."""
        return self._by_tag.get(tag)

    @property
    def input_count(self) -> int:
        """Length of an X image: the highest wired X number + 1."""
        return self.inputs[-1].number + 1

    @property
    def output_count(self) -> int:
        """Length of a Y image: the highest wired Y number + 1."""
        return self.outputs[-1].number + 1

    def register(self, tag: str) -> OutputRegister | None:
        """Return the wired output register with this tag, or None."""
        return next((register for register in self.registers if register.tag == tag), None)

    def safe_registers(self) -> list[int]:
        """Return the safe value of each wired output register."""
        return [register.safe for register in self.registers]

    def safe_inputs(self) -> list[bool]:
        """Return the X image to assume while the field link is lost."""
        return [*self._safe_inputs]

    def safe_outputs(self) -> list[bool]:
        """Return the Y image with all outputs in their safe state."""
        return [*self._safe_outputs]

    @cached_property
    def _safe_inputs(self) -> tuple[bool, ...]:
        return _safe_image(self.inputs, self.input_count)

    @cached_property
    def _safe_outputs(self) -> tuple[bool, ...]:
        return _safe_image(self.outputs, self.output_count)


def _safe_image(points: Iterable[Point], count: int) -> tuple[bool, ...]:
    image = [False] * count  # terminals without a wire are off
    for point in points:
        image[point.number] = point.level(point.safe)
    return tuple(image)
