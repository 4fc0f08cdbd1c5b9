"""Transfer, conversion and comparison: MOV SMOV CML XCH BMOV FMOV BCD BIN CMP ZCP (FNC 10-19), SWAP (FNC 147).

Operand order: docs/sources/fx2n.md 1.2. Details are from memory unless a docstring states otherwise.
"""

from __future__ import annotations

from typing import Final

from controller.fx.engine.access import Action, ActionFactory, bits, reader, within, words, writer
from controller.fx.engine.cpu import Cpu, OperationError
from controller.fx.language.instruction import Operand

BMOV_REVERSED: Final = 8024
"""Special relay: BMOV copies from its second operand to its first."""
_LONGEST_BLOCK: Final = 512
WITHOUT_BCD: Final = 8168
"""Special relay: SMOV moves hexadecimal digits instead of decimal ones."""


def mov(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """MOV s d: d := s."""
    get, put = reader(cpu, operands[0], wide), writer(cpu, operands[1], wide)
    return lambda: put(get())


def smov(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """SMOV s m1 m2 d n: move m2 decimal digits of s, from digit m1 downwards, to d, from digit n downwards.

    Digit 1 is the lowest of four; the other digits of d are unchanged. A value outside 0 to 9999 is an error, and so is
    m2 above m1 or n. While M8168 is on, the digits are hexadecimal.
    """
    get, row = reader(cpu, operands[0], wide), words(cpu, operands[3], wide)
    first, number, target = (reader(cpu, operands[n], wide) for n in (1, 2, 4))
    special = cpu.memory.M

    def run() -> None:
        m1, n = within(first(), 1, 4), within(target(), 1, 4)
        m2 = within(number(), 1, min(m1, n))
        place = row.places().start
        base = 16 if special[WITHOUT_BCD] else 10
        source, old = (_digits(value, base) for value in (get(), row.get(place)))
        old[n - m2 : n] = source[m1 - m2 : m1]
        row.put(place, sum(digit * base**at for at, digit in enumerate(old)))

    return run


def _digits(value: int, base: int) -> list[int]:
    """Return the four digits of a number, the lowest first."""
    value = value & 0xFFFF if base == 16 else within(value, 0, 9999)
    return [value // base**n % base for n in range(4)]


def swap(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """SWAP d: exchange the low and the high byte of each word of d."""
    row = words(cpu, operands[0], wide)

    def run() -> None:
        place = row.places().start
        value = row.get(place)
        row.put(place, (value & 0xFF00FF) << 8 | value >> 8 & 0xFF00FF)

    return run


def cml(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """CML s d: d := s with every bit inverted; a short bit group s is extended with zeros before inversion."""
    get, put = reader(cpu, operands[0], wide), writer(cpu, operands[1], wide)
    return lambda: put(~get())


def xch(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """XCH d1 d2: exchange d1 and d2."""
    first, second = words(cpu, operands[0], wide), words(cpu, operands[1], wide)

    def run() -> None:
        a, b = first.places().start, second.places().start
        value = first.get(a)
        first.put(a, second.get(b))
        second.put(b, value)

    return run


def bmov(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """BMOV s d n: copy n words (1-512) from s to d, or from d to s while M8024 is on. The blocks may overlap."""
    source, target = words(cpu, operands[0], wide), words(cpu, operands[1], wide)
    count, special = reader(cpu, operands[2], wide), cpu.memory.M

    def run() -> None:
        n = within(count(), 1, _LONGEST_BLOCK)
        origin, destination = (target, source) if special[BMOV_REVERSED] else (source, target)
        destination.write(origin.read(n))

    return run


def fmov(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """FMOV s d n: copy s into n words (1-512) from d."""
    get, target, count = reader(cpu, operands[0], wide), words(cpu, operands[1], wide), reader(cpu, operands[2], wide)
    return lambda: target.write([get()] * within(count(), 1, _LONGEST_BLOCK))


def bcd(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """BCD s d: d := s with one decimal digit in every 4 bits; s is 0-9999, or 0-99999999 in the 32-bit form."""
    get, put, highest = reader(cpu, operands[0], wide), writer(cpu, operands[1], wide), 10 ** (8 if wide else 4) - 1
    return lambda: put(int(str(within(get(), 0, highest)), 16))


def bin_(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """BIN s d: d := s decoded from one decimal digit in every 4 bits; a digit above 9 is an error."""
    get, put, mask = reader(cpu, operands[0], wide), writer(cpu, operands[1], wide), 0xFFFF_FFFF if wide else 0xFFFF

    def run() -> None:
        digits = f"{get() & mask:x}"
        if not digits.isdecimal():
            raise OperationError
        put(int(digits))

    return run


def cmp(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """CMP s1 s2 d: compare s1 with s2; bit d is on if s1 > s2, d+1 if s1 = s2, and d+2 if s1 < s2.

    The bits do not change when the drive input turns off (docs/sources/fx2n.md 1.2).
    """
    left, right = reader(cpu, operands[0], wide), reader(cpu, operands[1], wide)
    cells, row = bits(cpu, operands[2])

    def run() -> None:
        a, b = left(), right()
        cells[row(3)] = (a > b, a == b, a < b)

    return run


def zcp(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """ZCP s1 s2 s d: compare s with the range s1 to s2; bit d is on if s is below it, d+1 if within, d+2 if above.

    If s2 is below s1, s1 is used instead of s2.
    """
    low, high, get = (reader(cpu, operand, wide) for operand in operands[:3])
    cells, row = bits(cpu, operands[3])

    def run() -> None:
        a, b, value = low(), high(), get()
        b = max(a, b)
        cells[row(3)] = (value < a, a <= value <= b, value > b)

    return run


ACTIONS: Final[dict[str, ActionFactory]] = {
    "MOV": mov,
    "SMOV": smov,
    "SWAP": swap,
    "CML": cml,
    "XCH": xch,
    "BMOV": bmov,
    "FMOV": fmov,
    "BCD": bcd,
    "BIN": bin_,
    "CMP": cmp,
    "ZCP": zcp,
}
