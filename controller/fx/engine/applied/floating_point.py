"""Binary floating point: FLT (FNC 49), comparison, arithmetic, ESQR, INT, SIN and related functions (FNC 110-137).

A number is an IEEE 754 single in two data registers, low word first; a constant K or H is treated as an integer.
Angles are in radians. EMOV, ENEG, RAD, DEG and real constants E are those of an FX3U.
Registers that do not contain a finite number cause an operation error. The treatment of constants and the behaviour of
the flags have not been verified against the manual.
"""

from __future__ import annotations

import math
import operator
import struct
from collections.abc import Callable
from typing import Final

from controller.fx.engine.access import Action, ActionFactory, bits, reader, signed, width_of, writer
from controller.fx.engine.cpu import BORROW, CARRY, ZERO, Cpu, OperationError
from controller.fx.language.instruction import Constant, Operand, RealConstant
from controller.fx.language.parsing import LARGEST, SMALLEST


def to_registers(value: float) -> int:
    """Return the 32 bits of a number in single precision.

    Examples:
        >>> hex(to_registers(1.5))
        '0x3fc00000'
    """
    return int.from_bytes(struct.pack(">f", value), "big")


def from_registers(bits_32: int) -> float:
    """Return the number encoded in 32 bits.

    Raises:
        OperationError: The bits do not encode a finite number.
    """
    value: float = struct.unpack(">f", (bits_32 & 0xFFFF_FFFF).to_bytes(4, "big"))[0]
    if not math.isfinite(value):
        raise OperationError
    return value


def _float_reader(cpu: Cpu, operand: Operand) -> Callable[[], float]:
    if isinstance(operand, RealConstant):
        return lambda: operand.value
    get = reader(cpu, operand, wide=True)
    if isinstance(operand, Constant):
        return lambda: from_registers(to_registers(get()))
    return lambda: from_registers(get())


def _arithmetic(operation: Callable[[float, float], float]) -> ActionFactory:
    """EADD ESUB EMUL EDIV: d := s1 operation s2, rounded to single precision.

    M8020: the result is 0. M8021: underflow; d has the smallest magnitude. M8022: overflow; d has the largest
    magnitude.
    """

    def make(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Action:
        left, right = _float_reader(cpu, operands[0]), _float_reader(cpu, operands[1])
        put, special = writer(cpu, operands[2], wide=True), cpu.memory.M

        def run() -> None:
            exact = operation(left(), right())
            size = abs(exact)
            tiny, huge = 0 < size < SMALLEST, size > LARGEST
            value = math.copysign(SMALLEST if tiny else min(size, LARGEST), exact)
            put(to_registers(value))
            special[ZERO], special[BORROW], special[CARRY] = exact == 0, tiny, huge

        return run

    return make


def _divide(dividend: float, divisor: float) -> float:
    if divisor == 0:
        raise OperationError
    return dividend / divisor


def ecmp(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Action:
    """ECMP s1 s2 d: compare s1 with s2; bit d is on if s1 > s2, d+1 if s1 = s2, and d+2 if s1 < s2."""
    left, right = _float_reader(cpu, operands[0]), _float_reader(cpu, operands[1])
    cells, row = bits(cpu, operands[2])

    def run() -> None:
        a, b = left(), right()
        cells[row(3)] = (a > b, a == b, a < b)

    return run


def ezcp(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Action:
    """EZCP s1 s2 s d: compare s with the range s1 to s2; bit d is on if s is below it, d+1 if within, d+2 if above.

    If s2 is below s1, s1 is used instead of s2.
    """
    low, high, get = (_float_reader(cpu, operand) for operand in operands[:3])
    cells, row = bits(cpu, operands[3])

    def run() -> None:
        a, b, value = low(), high(), get()
        b = max(a, b)
        cells[row(3)] = (value < a, a <= value <= b, value > b)

    return run


def _function(operation: Callable[[float], float]) -> ActionFactory:
    """EMOV, ENEG, SIN, COS, TAN, RAD and DEG: d := operation(s), rounded to single precision; no flags change."""

    def make(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Action:
        get, put = _float_reader(cpu, operands[0]), writer(cpu, operands[-1], wide=True)

        def run() -> None:
            exact = operation(get())
            put(to_registers(math.copysign(min(abs(exact), LARGEST), exact)))

        return run

    return make


def esqr(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Action:
    """ESQR s d: d := square root of s. M8020: the result is 0. A negative s is an error."""
    get, put, special = _float_reader(cpu, operands[0]), writer(cpu, operands[1], wide=True), cpu.memory.M

    def run() -> None:
        value = get()
        if value < 0:
            raise OperationError
        root = math.sqrt(value)
        put(to_registers(root))
        special[ZERO] = root == 0

    return run


def flt(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """FLT s d: convert the integer in s (a pair in the 32-bit form) to a float in d, d+1."""
    get, put = reader(cpu, operands[0], wide), writer(cpu, operands[1], wide=True)
    return lambda: put(to_registers(get()))


def int_(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """INT s d: truncate the float in s, s+1 to an integer in d (a pair in the 32-bit form).

    M8020: the result is 0. M8021: a fraction was truncated. M8022: out of range; d is unchanged.
    """
    get, put = _float_reader(cpu, operands[0]), writer(cpu, operands[1], wide)
    width, special = width_of(wide), cpu.memory.M

    def run() -> None:
        exact = get()
        value = int(exact)
        fits = signed(value, width) == value
        if fits:
            put(value)
        special[ZERO], special[BORROW], special[CARRY] = value == 0, value != exact, not fits

    return run


ACTIONS: Final[dict[str, ActionFactory]] = {
    "ECMP": ecmp,
    "EZCP": ezcp,
    "EADD": _arithmetic(operator.add),
    "ESUB": _arithmetic(operator.sub),
    "EMUL": _arithmetic(operator.mul),
    "EDIV": _arithmetic(_divide),
    "EMOV": _function(lambda value: value),
    "ENEG": _function(operator.neg),
    "ESQR": esqr,
    "SIN": _function(math.sin),
    "COS": _function(math.cos),
    "TAN": _function(math.tan),
    "RAD": _function(math.radians),
    "DEG": _function(math.degrees),
    "FLT": flt,
    "INT": int_,
}
