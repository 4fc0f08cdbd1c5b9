"""Operands of applied instructions as closures over CPU memory: words, bit groups, bits, index registers.

Words are signed, as in an FX: 16 bits, or 32 bits in two consecutive registers, low word first. An instruction resolves
all devices of an operand before it writes anything, so an out-of-range operand leaves the memory unchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from controller.core.devices import EXTENSION, SIZES
from controller.fx.engine.cpu import Cpu, OperationError, index_register
from controller.fx.language.instruction import Constant, DeviceOperand, Digits, Operand, WordBit

Action = Callable[[], None]
"""Operation executed in each scan in which the instruction is driven."""
Level = Callable[[bool], None]
"""Operation executed in every scan; the argument is True if the instruction is driven."""
ActionFactory = Callable[[Cpu, tuple[Operand, ...], bool], Action]
"""Function that returns the action of an instruction with these operands; the last argument selects the 32-bit form."""
LevelFactory = Callable[[Cpu, tuple[Operand, ...], bool], Level]

Reader = Callable[[], int]
Writer = Callable[[int], None]
BitReader = Callable[[], bool]
BitWriter = Callable[[bool], None]

_Spans = tuple[range, ...]
_COUNTERS: Final = (range(200), range(200, 256))


def _spans(cpu: Cpu, kind: str) -> _Spans:
    """Return the ranges of consecutive devices; an operand, even an indexed one, is within one range (from memory)."""
    return _COUNTERS if kind == "C" else cpu.model.ranges[kind]


def signed(value: int, width: int) -> int:
    """Return the low bits of a value as a signed number.

    Args:
        value: Any number.
        width: Number of bits.

    Examples:
        >>> signed(32768, 16), signed(-32769, 16), signed(0xFFFF_FFFF, 32)
        (-32768, 32767, -1)
    """
    half = 1 << (width - 1)
    return (value + half) % (2 * half) - half


def width_of(wide: bool) -> int:
    """Return the number of bits of a word in the 16-bit or 32-bit form."""
    return 32 if wide else 16


def within(value: int, low: int, high: int) -> int:
    """Return the value if it is in range.

    Raises:
        OperationError: The value is not between `low` and `high`.
    """
    if not low <= value <= high:
        raise OperationError
    return value


def _offset(cpu: Cpu, index: str) -> Reader:
    """Return a reader of an index register: 16 bits, even in 32-bit forms.

    An FX2N, in contrast, uses the pair V, Z in 32-bit forms (from memory).
    """
    if not index:
        return lambda: 0
    return partial(cpu.memory.D.__getitem__, index_register(index))


def _finder(cpu: Cpu, number: int, index: str, spans: _Spans) -> Callable[[int], int]:
    """Return a function that takes a device count and returns the first device; all devices must be in one span."""
    offset = _offset(cpu, index)

    def find(count: int) -> int:
        first = number + offset()
        if not any(first in span and first + count - 1 in span for span in spans):
            raise OperationError
        return first

    return find


@dataclass(frozen=True, slots=True)
class Words:
    """Consecutive words of one operand.

    Attributes:
        find: Function that takes a device count and returns the first device.
        step: Devices per word: 1 for a register, 2 for a pair of registers, 4 times the number of digits for a bit
            group.
        get: Reader of the word that starts at a device.
        put: Writer of the word that starts at a device.
    """

    find: Callable[[int], int]
    step: int
    get: Callable[[int], int]
    put: Callable[[int, int], None]

    def places(self, count: int = 1) -> range:
        """Return the first device of each of `count` consecutive words.

        Raises:
            OperationError: A word is out of range.
        """
        first = self.find(within(count, 1, SIZES["D"]) * self.step)
        return range(first, first + count * self.step, self.step)

    def read(self, count: int) -> list[int]:
        """Return `count` consecutive words."""
        return [self.get(place) for place in self.places(count)]

    def write(self, values: list[int]) -> None:
        """Write consecutive words, all or none."""
        for place, value in zip(self.places(len(values)), values, strict=True):
            self.put(place, value)


def words(cpu: Cpu, operand: Operand, wide: bool) -> Words:
    """Return the words that start at an operand.

    Args:
        cpu: CPU with the memory.
        operand: T, C (current values), D, R, V, Z, a bit group, or a constant (read only).
        wide: Whether words have 32 bits. T, D, R and C0-C199 then occupy two registers, low word first; V and Z of the
            same number form one register, with Z as the low word; C200 and up have 32 bits and are valid only in this
            form.
    """
    match operand:
        case Constant(value, _, index):
            return _constant(cpu, value, index, wide)
        case Digits(digits, device):
            return _group(cpu, digits, device, wide)
        case DeviceOperand("V" | "Z" as letter, number):
            low, high = index_register(f"Z{number}"), index_register(f"V{number}")
            first = low if wide else index_register(f"{letter}{number}")
            return _registers(cpu, DeviceOperand("D", first), (range(low, high + 1),), wide)
        case DeviceOperand("C", number):
            long = number >= 200
            spans = (_COUNTERS[long],) if wide or not long else ()
            return _long_counters(cpu, operand, spans) if long else _registers(cpu, operand, spans, wide)
        case DeviceOperand("R", number, index):
            registers = range(EXTENSION, cpu.model.sizes["D"])
            return _registers(cpu, DeviceOperand("D", EXTENSION + number, index), (registers,), wide)
        case DeviceOperand("T" | "D" as kind):
            return _registers(cpu, operand, _spans(cpu, kind), wide)
    raise TypeError(f"not a word: {operand}")


def _constant(cpu: Cpu, value: int, index: str, wide: bool) -> Words:
    offset, width = _offset(cpu, index), width_of(wide)

    def put(_place: int, _value: int) -> None:
        raise TypeError("a constant cannot be written")

    return Words(lambda _count: 0, 1, lambda _place: signed(value + offset(), width), put)


def _registers(cpu: Cpu, device: DeviceOperand, spans: _Spans, wide: bool) -> Words:
    cells = {"D": cpu.memory.D, "T": cpu.memory.TV, "C": cpu.memory.CV}[device.kind]
    put = cpu.set_timer if device.kind == "T" else cells.__setitem__
    find = _finder(cpu, device.number, device.index, spans)

    def get_pair(place: int) -> int:
        return signed((cells[place] & 0xFFFF) | cells[place + 1] << 16, 32)

    def put_pair(place: int, value: int) -> None:
        put(place, signed(value, 16))
        put(place + 1, signed(value >> 16, 16))

    if wide:
        return Words(find, 2, get_pair, put_pair)
    return Words(find, 1, lambda place: signed(cells[place], 16), lambda place, value: put(place, signed(value, 16)))


def _long_counters(cpu: Cpu, device: DeviceOperand, spans: _Spans) -> Words:
    cells = cpu.memory.CV
    find = _finder(cpu, device.number, device.index, spans)
    return Words(
        find,
        1,
        lambda place: signed(cells[place], 32),
        lambda place, value: cells.__setitem__(place, signed(value, 32)),
    )


def _group(cpu: Cpu, digits: int, device: DeviceOperand, wide: bool) -> Words:
    """Return the words of a bit group, low bit first; a word is signed only if the group fills it."""
    cells, size = cpu.memory.bits(device.kind), 4 * digits
    spans = _spans(cpu, device.kind) if size <= width_of(wide) else ()

    def get(place: int) -> int:
        value = sum(bit << n for n, bit in enumerate(cells[place : place + size]))
        return signed(value, size) if size == width_of(wide) else value

    def put(place: int, value: int) -> None:
        cells[place : place + size] = [bool(value >> n & 1) for n in range(size)]

    return Words(_finder(cpu, device.number, device.index, spans), size, get, put)


def reader(cpu: Cpu, operand: Operand, wide: bool) -> Reader:
    """Return a function that reads an operand as a signed number.

    Args:
        cpu: CPU with the memory.
        operand: Any operand accepted by `words`.
        wide: Whether the number has 32 bits.

    Returns:
        A function that raises OperationError if the operand is out of range.
    """
    if not wide and isinstance(operand, DeviceOperand) and operand.kind == "D" and not operand.index:
        # by far the most frequent operand; its range is checked by the parser
        return partial(cpu.memory.D.__getitem__, operand.number)
    row = words(cpu, operand, wide)
    return lambda: row.get(row.find(row.step))


def writer(cpu: Cpu, operand: Operand, wide: bool) -> Writer:
    """Return a function that writes the low 16 or 32 bits of a number to an operand, or fewer to a short bit group.

    Args:
        cpu: CPU with the memory.
        operand: Any operand accepted by `words`, except constants.
        wide: Whether the number has 32 bits.

    Returns:
        A function that raises OperationError before writing anything if the operand is out of range.
    """
    row = words(cpu, operand, wide)
    return lambda value: row.put(row.find(row.step), value)


def bits(cpu: Cpu, operand: Operand) -> tuple[list[bool], Callable[[int], slice]]:
    """Return the cells of a bit device, and a function that converts a count to the slice that starts at the device.

    Args:
        cpu: CPU with the memory.
        operand: X, Y, M, S, or the contact of T or C.

    Returns:
        Cells, and a function that raises OperationError if the slice is out of range.
    """
    if not isinstance(operand, DeviceOperand):
        raise TypeError(f"not a bit: {operand}")
    find = _finder(cpu, operand.number, operand.index, _spans(cpu, operand.kind))

    def row(count: int) -> slice:
        first = find(within(count, 1, SIZES["M"]))
        return slice(first, first + count)

    return cpu.memory.bits(operand.kind), row


def bit_reader(cpu: Cpu, operand: Operand) -> BitReader:
    """Return a function that reads a bit device or a bit of a register."""
    if isinstance(operand, WordBit):
        data, number, bit = cpu.memory.D, operand.number, operand.bit
        return lambda: bool(data[number] >> bit & 1)
    cells, row = bits(cpu, operand)
    return lambda: cells[row(1).start]


def bit_writer(cpu: Cpu, operand: Operand) -> BitWriter:
    """Return a function that writes a bit device or a bit of a register."""
    if isinstance(operand, WordBit):
        data, number, mask = cpu.memory.D, operand.number, 1 << operand.bit

        def write_word_bit(on: bool) -> None:
            data[number] = signed(data[number] | mask if on else data[number] & ~mask, 16)

        return write_word_bit
    cells, row = bits(cpu, operand)

    def write(on: bool) -> None:
        cells[row(1).start] = on

    return write


def is_bit(operand: Operand) -> bool:
    """Return whether an operand names single bits X, Y, M or S rather than words."""
    return isinstance(operand, DeviceOperand) and operand.kind in "XYMS"
