"""Integer arithmetic: ADD SUB MUL DIV INC DEC NEG, WAND WOR WXOR (FNC 20-29), SUM MEAN SQR (FNC 43, 45, 48).

Details are from memory unless a docstring or docs/sources/fx2n.md 1.2 states otherwise; no page of a manual was found
for INC, DEC and MEAN.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from math import isqrt
from typing import Final

from controller.fx.engine.access import Action, ActionFactory, reader, signed, width_of, within, words, writer
from controller.fx.engine.cpu import BORROW, CARRY, ZERO, Cpu, OperationError
from controller.fx.language.instruction import Digits, Operand

_Binary = Callable[[int, int], int]


def _flagged(operation: _Binary) -> ActionFactory:
    """ADD and SUB: d := s1 operation s2, with the flags M8020 (zero), M8021 (borrow) and M8022 (carry).

    An overflow sets the carry flag, and an underflow sets the borrow flag (verified, docs/sources/fx2n.md 1.2). A
    result out of range wraps around in two's complement. Page 5-25 of the FX programming manual contradicts this: the
    number stored has the sign of the limit exceeded. It does not give the number; according to a widely copied diagram
    of the flags, the highest number is followed by 0.
    """

    def make(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
        left, right = reader(cpu, operands[0], wide), reader(cpu, operands[1], wide)
        put, width, special = writer(cpu, operands[2], wide), width_of(wide), cpu.memory.M

        def run() -> None:
            exact = operation(left(), right())
            value = signed(exact, width)
            put(value)
            special[ZERO], special[BORROW], special[CARRY] = value == 0, exact < value, exact > value

        return run

    return make


def _bitwise(operation: _Binary) -> ActionFactory:
    """WAND, WOR and WXOR: d := s1 operation s2, bit by bit."""

    def make(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
        left, right = reader(cpu, operands[0], wide), reader(cpu, operands[1], wide)
        put = writer(cpu, operands[2], wide)
        return lambda: put(operation(left(), right()))

    return make


def _in_place(operation: Callable[[int], int]) -> ActionFactory:
    """INC, DEC and NEG: d := operation(d), with wrap-around and without flags; NEG is verified (fx2n.md 1.2)."""

    def make(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
        get, put = reader(cpu, operands[0], wide), writer(cpu, operands[0], wide)
        return lambda: put(operation(get()))

    return make


def mul(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """MUL s1 s2 d: 16 x 16 bits into d, d+1 (docs/sources/fx2n.md 1.2); 32 x 32 bits into d to d+3.

    A bit group receives the low bits that it has places for, at most 32 (verified, docs/sources/fx2n.md 1.2). No flags
    change (from memory).
    """
    left, right = reader(cpu, operands[0], wide), reader(cpu, operands[1], wide)
    target = operands[2]
    if isinstance(target, Digits):
        put = writer(cpu, target, wide=True)
        return lambda: put(left() * right())
    row, width = words(cpu, target, wide), width_of(wide)

    def run() -> None:
        product = left() * right()
        row.write([product, product >> width])

    return run


def div(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """DIV s1 s2 d: quotient into d, remainder with the sign of s1 into the next word (docs/sources/fx2n.md 1.2).

    The quotient is truncated towards zero. A bit group receives only the quotient. Division by 0 is an error (all
    verified there). The lowest number divided by -1 is the lowest number (no page found).
    """
    left, right = reader(cpu, operands[0], wide), reader(cpu, operands[1], wide)
    row, only_quotient = words(cpu, operands[2], wide), isinstance(operands[2], Digits)

    def run() -> None:
        a, b = left(), right()
        quotient = _quotient(a, b)
        row.write([quotient] if only_quotient else [quotient, a - b * quotient])

    return run


def _quotient(dividend: int, divisor: int) -> int:
    """Return the quotient truncated towards zero."""
    if divisor == 0:
        raise OperationError
    size = abs(dividend) // abs(divisor)
    return size if (dividend < 0) == (divisor < 0) else -size


def sum_(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """SUM s d: d := number of bits that are 1 in s; M8020 is on if this number is 0 (verified, fx2n.md 1.2)."""
    get, put = reader(cpu, operands[0], wide), writer(cpu, operands[1], wide)
    mask, special = (1 << width_of(wide)) - 1, cpu.memory.M

    def run() -> None:
        count = (get() & mask).bit_count()
        put(count)
        special[ZERO] = count == 0

    return run


def mean(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """MEAN s d n: d := mean of n words (1-64) from s, truncated towards zero."""
    row, put, count = words(cpu, operands[0], wide), writer(cpu, operands[1], wide), reader(cpu, operands[2], wide)

    def run() -> None:
        n = within(count(), 1, 64)
        put(_quotient(sum(row.read(n)), n))

    return run


def sqr(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """SQR s d: d := integer square root of s.

    M8020: the result is 0. M8021: the result is not exact. A negative s is an error.
    """
    get, put, special = reader(cpu, operands[0], wide), writer(cpu, operands[1], wide), cpu.memory.M

    def run() -> None:
        value = within(get(), 0, 2**31 - 1)
        root = isqrt(value)
        put(root)
        special[ZERO], special[BORROW] = root == 0, root * root != value

    return run


ACTIONS: Final[dict[str, ActionFactory]] = {
    "ADD": _flagged(operator.add),
    "SUB": _flagged(operator.sub),
    "MUL": mul,
    "DIV": div,
    "INC": _in_place(lambda value: value + 1),
    "DEC": _in_place(lambda value: value - 1),
    "NEG": _in_place(operator.neg),
    "WAND": _bitwise(operator.and_),
    "WOR": _bitwise(operator.or_),
    "WXOR": _bitwise(operator.xor),
    "SUM": sum_,
    "MEAN": mean,
    "SQR": sqr,
}
