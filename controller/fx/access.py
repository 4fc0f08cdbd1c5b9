"""Operands of applied instructions as closures over a CPU's memory: words, groups of bits, bits, index registers.

Words are signed, as an FX counts: 16 bits, or 32 bits with the low word first in two registers in a row. All places
of an operand are found before anything is written, so an operand outside its range leaves everything as it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from controller.core.devices import SIZES
from controller.fx.cpu import Cpu, OperationError, index_register
from controller.fx.instruction import Constant, Device, Digits, Operand, WordBit

Action = Callable[[], None]
"""What an instruction does in a scan in which it is driven."""
Level = Callable[[bool], None]
"""What an instruction does in every scan, given whether it is driven."""
Maker = Callable[[Cpu, tuple[Operand, ...], bool], Action]
"""Makes the action of an instruction with these operands; the last argument is True for its 32-bit form."""
LevelMaker = Callable[[Cpu, tuple[Operand, ...], bool], Level]

Reader = Callable[[], int]
Writer = Callable[[int], None]
BitReader = Callable[[], bool]
BitWriter = Callable[[bool], None]

_Spans = tuple[range, ...]
_SPANS: Final[dict[str, _Spans]] = {
    **{kind: (range(SIZES[kind]),) for kind in "XYST"},
    "M": (range(3072), range(8000, 8256)),
    "D": (range(8000), range(8000, 8256)),
    "C": (range(200), range(200, 256)),
}
"""Devices in a row: an operand never runs from one range into the next, nor by its index (GK)."""


def signed(value: int, width: int) -> int:
    """Return the low bits of a value as a signed number.

    Args:
        value: Any number.
        width: How many bits.

    Examples:
        >>> signed(32768, 16), signed(-32769, 16), signed(0xFFFF_FFFF, 32)
        (-32768, 32767, -1)
    """
    half = 1 << (width - 1)
    return (value + half) % (2 * half) - half


def width_of(wide: bool) -> int:
    """Return the bits of a word in the 16-bit or 32-bit form."""
    return 32 if wide else 16


def within(value: int, low: int, high: int) -> int:
    """Return the value.

    Raises:
        OperationError: It is not from low to high.
    """
    if not low <= value <= high:
        raise OperationError
    return value


def _offset(cpu: Cpu, index: str) -> Reader:
    """Return what an index register adds; 16 bits in 32-bit forms too, where an FX2N takes the pair V, Z (GK)."""
    if not index:
        return lambda: 0
    return partial(cpu.memory.D.__getitem__, index_register(index))


def _finder(cpu: Cpu, number: int, index: str, spans: _Spans) -> Callable[[int], int]:
    """Return what finds the first of so many devices in a row, all inside one of the spans."""
    offset = _offset(cpu, index)

    def find(count: int) -> int:
        first = number + offset()
        if not any(first in span and first + count - 1 in span for span in spans):
            raise OperationError
        return first

    return find


@dataclass(frozen=True, slots=True)
class Words:
    """Places of words in a row, as one operand names them.

    Attributes:
        find: First device of so many in a row.
        step: Devices a word takes: 1, 2 for a pair of registers, 4 a digit for bits.
        get: Read the word that starts at a device.
        put: Write the word that starts at a device.
    """

    find: Callable[[int], int]
    step: int
    get: Callable[[int], int]
    put: Callable[[int, int], None]

    def places(self, count: int = 1) -> range:
        """Return the first devices of so many words in a row.

        Raises:
            OperationError: They are not all there.
        """
        first = self.find(within(count, 1, SIZES["D"]) * self.step)
        return range(first, first + count * self.step, self.step)

    def read(self, count: int) -> list[int]:
        """Return so many words in a row."""
        return [self.get(place) for place in self.places(count)]

    def write(self, values: list[int]) -> None:
        """Write words in a row, all or none."""
        for place, value in zip(self.places(len(values)), values, strict=True):
            self.put(place, value)


def words(cpu: Cpu, operand: Operand, wide: bool) -> Words:
    """Return the words from an operand on.

    Args:
        cpu: Whose memory.
        operand: T, C (current values), D, V, Z, a group of bits, or a constant (read only).
        wide: Whether words have 32 bits. T, D and C0-C199 are then two in a row, low word first; V and Z of one number
            are one register, Z low; C200 and up hold 32 bits and are there in this form only.
    """
    match operand:
        case Constant(value, _, index):
            return _constant(cpu, value, index, wide)
        case Digits(digits, device):
            return _group(cpu, digits, device, wide)
        case Device("V" | "Z" as letter, number):
            low, high = index_register(f"Z{number}"), index_register(f"V{number}")
            first = low if wide else index_register(f"{letter}{number}")
            return _registers(cpu, Device("D", first), (range(low, high + 1),), wide)
        case Device("C", number):
            long = number >= 200
            spans = (_SPANS["C"][long],) if wide or not long else ()
            return _long_counters(cpu, operand, spans) if long else _registers(cpu, operand, spans, wide)
        case Device("T" | "D" as kind):
            return _registers(cpu, operand, _SPANS[kind], wide)
    raise TypeError(f"not a word: {operand}")


def _constant(cpu: Cpu, value: int, index: str, wide: bool) -> Words:
    offset, width = _offset(cpu, index), width_of(wide)

    def put(_place: int, _value: int) -> None:
        raise TypeError("a constant is not written")

    return Words(lambda _count: 0, 1, lambda _place: signed(value + offset(), width), put)


def _registers(cpu: Cpu, device: Device, spans: _Spans, wide: bool) -> Words:
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


def _long_counters(cpu: Cpu, device: Device, spans: _Spans) -> Words:
    cells = cpu.memory.CV
    find = _finder(cpu, device.number, device.index, spans)
    return Words(
        find,
        1,
        lambda place: signed(cells[place], 32),
        lambda place, value: cells.__setitem__(place, signed(value, 32)),
    )


def _group(cpu: Cpu, digits: int, device: Device, wide: bool) -> Words:
    """A group of bits, low bit first; it has a sign only if it fills the word."""
    cells, size = cpu.memory.bits(device.kind), 4 * digits
    spans = _SPANS[device.kind] if size <= width_of(wide) else ()

    def get(place: int) -> int:
        value = sum(bit << n for n, bit in enumerate(cells[place : place + size]))
        return signed(value, size) if size == width_of(wide) else value

    def put(place: int, value: int) -> None:
        cells[place : place + size] = [bool(value >> n & 1) for n in range(size)]

    return Words(_finder(cpu, device.number, device.index, spans), size, get, put)


def reader(cpu: Cpu, operand: Operand, wide: bool) -> Reader:
    """Return what reads an operand as a signed number.

    Args:
        cpu: Whose memory.
        operand: Any that `words` takes.
        wide: Whether it has 32 bits.

    Returns:
        A function that raises OperationError when the operand is outside its range.
    """
    if not wide and isinstance(operand, Device) and operand.kind == "D" and not operand.index:
        # by far the most frequent operand; its range was checked when the program was read
        return partial(cpu.memory.D.__getitem__, operand.number)
    row = words(cpu, operand, wide)
    return lambda: row.get(row.find(row.step))


def writer(cpu: Cpu, operand: Operand, wide: bool) -> Writer:
    """Return what writes an operand: the low 16 or 32 bits of a number, fewer into a short group of bits.

    Args:
        cpu: Whose memory.
        operand: Any that `words` takes and that is no constant.
        wide: Whether it has 32 bits.

    Returns:
        A function that raises OperationError, having written nothing, when the operand is outside its range.
    """
    row = words(cpu, operand, wide)
    return lambda value: row.put(row.find(row.step), value)


def bits(cpu: Cpu, operand: Operand) -> tuple[list[bool], Callable[[int], slice]]:
    """Return the cells of a bit device, and what gives the slice of so many from it on.

    Args:
        cpu: Whose memory.
        operand: X, Y, M, S, or the contact of T or C.

    Returns:
        Cells and a function that raises OperationError unless all of them are there.
    """
    if not isinstance(operand, Device):
        raise TypeError(f"not a bit: {operand}")
    find = _finder(cpu, operand.number, operand.index, _SPANS[operand.kind])

    def row(count: int) -> slice:
        first = find(within(count, 1, SIZES["M"]))
        return slice(first, first + count)

    return cpu.memory.bits(operand.kind), row


def bit_reader(cpu: Cpu, operand: Operand) -> BitReader:
    """Return what reads one bit, a bit of a register among them."""
    if isinstance(operand, WordBit):
        data, number, bit = cpu.memory.D, operand.number, operand.bit
        return lambda: bool(data[number] >> bit & 1)
    cells, row = bits(cpu, operand)
    return lambda: cells[row(1).start]


def bit_writer(cpu: Cpu, operand: Operand) -> BitWriter:
    """Return what writes one bit, a bit of a register among them."""
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
    """Tell whether an operand names single bits X, Y, M or S rather than words."""
    return isinstance(operand, Device) and operand.kind in "XYMS"
