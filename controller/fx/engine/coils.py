"""Devices in statements: contacts, words, and the effect of a coil with and without power."""

from __future__ import annotations

from typing import Final

from controller.core.devices import EXTENSION, WORD_MAX, is_32_bit_counter
from controller.fx.engine.access import signed, width_of
from controller.fx.engine.code import (
    Arithmetic,
    Branch,
    Comparison,
    Condition,
    Conjunction,
    Inverse,
    Let,
    LocalVariable,
    RowElement,
    Selection,
    Statement,
    Store,
    Tick,
    Value,
)
from controller.fx.engine.cpu import RETENTIVE_TIMER_NUMBERS, index_register, time_base_ms
from controller.fx.language.instruction import Constant, DeviceOperand, Digits, Operand, WordBit

NOW: Final = LocalVariable("now")
"""Power of the coil under translation."""
_ELAPSED: Final = LocalVariable("v")
_SIGN_BIT: Final = 15


def contact(operand: Operand) -> Condition:
    """Return a contact: a bit device or a bit of a register."""
    if isinstance(operand, WordBit):
        bit = Arithmetic("&", Arithmetic(">>", RowElement("D", operand.number), operand.bit), 1)
        return Comparison("==", bit, 1)
    return _cell(operand)


def _cell(operand: Operand) -> RowElement:
    assert isinstance(operand, DeviceOperand)  # noqa: S101 - operands are checked by the parser
    return RowElement(operand.kind, operand.number)


def plain_word(operand: Operand, *, wide: bool = False) -> Value | None:
    """Return a word of 16 or 32 bits, or None if it is indexed or not supported in statements.

    Examples:
        >>> device = DeviceOperand("D", 5)
        >>> plain_word(device), plain_word(Constant(0xFFFF, "H")), plain_word(DeviceOperand("D", 5, "Z0"))
        (RowElement(row='D', number=5), -1, None)
    """
    match operand:
        case Constant(value, _, ""):
            return signed(value, width_of(wide))
        case Digits(digits, DeviceOperand(kind, number, "")):
            return _group(kind, number, 4 * digits, wide)
        case DeviceOperand("D", number, "") if wide:
            low = Arithmetic("&", RowElement("D", number), 0xFFFF)
            return Arithmetic("|", Arithmetic("<<", RowElement("D", number + 1), 16), low)
        case DeviceOperand("R", number, ""):
            return plain_word(DeviceOperand("D", EXTENSION + number), wide=wide)
        case DeviceOperand("C", number, "") if wide == is_32_bit_counter(number):
            return RowElement("CV", number)
        case DeviceOperand("D", number, ""):
            return RowElement("D", number)
        case DeviceOperand("T", number, "") if not wide:
            return RowElement("TV", number)
        case DeviceOperand("V" | "Z" as kind, number, "") if not wide:
            return RowElement("D", index_register(f"{kind}{number}"))
    return None


def _group(kind: str, first: int, size: int, wide: bool) -> Value:
    """Return the word of a bit group, low bit first; the highest bit is the sign only if the group fills the word."""
    group: Value = Selection(RowElement(kind, first), 1, 0)
    for n in range(1, size):
        weight = signed(1 << n, width_of(wide))
        group = Arithmetic("|", group, Selection(RowElement(kind, first + n), weight, 0))
    return group


def drive(operand: Operand, power: Condition) -> Statement:
    """Return the statement that sets a bit to the power of its coil."""
    if isinstance(operand, WordBit):
        register = RowElement("D", operand.number)
        mask = -1 << operand.bit if operand.bit == _SIGN_BIT else 1 << operand.bit
        return Store(register, Selection(power, Arithmetic("|", register, mask), Arithmetic("&", register, ~mask)))
    return Store(_cell(operand), power)


def set_to(operand: Operand, *, on: bool) -> tuple[Statement, ...]:
    """Return the statements for SET or RST; RST also clears the value of a timer or counter, and sets a word to 0."""
    match operand:
        case DeviceOperand("T", n):
            return _stopped(n)
        case DeviceOperand("C", n):
            return Store(RowElement("CV", n), 0), Store(RowElement("C", n), value=False)
        case DeviceOperand("D" | "R" | "V" | "Z"):
            register = plain_word(operand)
            assert isinstance(register, RowElement)  # noqa: S101 - RST of an indexed register is rejected by the parser
            return (Store(register, 0),)
    return (drive(operand, on),)


def driven_off(operand: Operand) -> tuple[Statement, ...]:
    """Return the statements for a coil that is executed without power."""
    match operand:
        case DeviceOperand("C", n):
            return (Store(RowElement("CE", n), value=False),)
        case DeviceOperand("T", n):
            return (Store(RowElement("TS", n), -1),) if n in RETENTIVE_TIMER_NUMBERS else _stopped(n)
    return (drive(operand, power=False),)


def _stopped(n: int) -> tuple[Statement, ...]:
    """Return the statements that stop a timer and clear its value."""
    return Store(RowElement("TS", n), -1), Store(RowElement("TV", n), 0), Store(RowElement("T", n), value=False)


def timer_off(n: int) -> Statement:
    """Return the statement for a timer that is not retentive and has no power."""
    return Branch(Comparison(">=", RowElement("TS", n), 0), _stopped(n))


def timer(n: int, preset: Operand, power: Condition) -> Statement:
    """Return the statement for OUT T: an on-delay timer, or a retentive timer for T246 to T255.

    How a retentive timer counts short pulses and beyond its preset is from memory (docs/sources/fx2n.md 1.4).
    """
    tick, counts = Tick(time_base_ms(n)), plain_word(preset)
    assert counts is not None  # noqa: S101 - a preset is a constant or a register without index
    start, value, done = RowElement("TS", n), RowElement("TV", n), RowElement("T", n)
    if n in RETENTIVE_TIMER_NUMBERS:
        total = Arithmetic("+", value, Arithmetic("-", tick, start))
        limited = Selection(Comparison("<", total, WORD_MAX), total, WORD_MAX)
        running = (
            Branch(Comparison(">=", start, 0), (Store(value, limited),)),
            Store(start, tick),
            Branch(Comparison(">=", value, counts), (Store(done, value=True),)),
        )
        return Branch(power, running, (Store(start, -1),))
    reached = Comparison(">=", _ELAPSED, counts)
    on = (
        Branch(Comparison("<", start, 0), (Store(start, tick),)),
        Let(_ELAPSED, Arithmetic("-", tick, start)),
        Store(done, reached),
        Store(value, Selection(reached, counts, _ELAPSED)),
    )
    return Branch(power, on, (timer_off(n),))


def annunciator(n: int, preset: Operand, state: Operand, power: Condition) -> tuple[Statement, ...]:
    """Return the statements for ANS with a constant preset: a timer that sets an annunciator."""
    set_state = Branch(Conjunction(NOW, RowElement("T", n)), (drive(state, power=True),))
    return Let(NOW, power), timer(n, preset, NOW), set_state


def counter(n: int, preset: Operand, power: Condition) -> tuple[Statement, ...]:
    """Return the statements for OUT C: count up to the preset or, from C200 on, up and down with 32-bit wrap-around.

    The wrap-around is verified (docs/sources/fx2n.md 1.5).
    """
    value, done, before = RowElement("CV", n), RowElement("C", n), RowElement("CE", n)
    if is_32_bit_counter(n):
        counts = plain_word(preset, wide=True)
        assert counts is not None  # noqa: S101 - a preset is a constant or a pair of registers without index
        count = _count_both_ways(n, counts)
    else:
        limit = plain_word(preset)
        assert limit is not None  # noqa: S101 - a preset is a constant or a register without index
        count = (
            Branch(Comparison("<", value, limit), (Store(value, Arithmetic("+", value, 1)),)),
            Branch(Comparison(">=", value, limit), (Store(done, value=True),)),
        )
    return Let(NOW, power), Branch(Conjunction(NOW, Inverse(before)), count), Store(before, NOW)


def _count_both_ways(n: int, counts: Value) -> tuple[Statement, ...]:
    """Return the statements for one pulse: the contact turns on or off when the value passes the preset."""
    value, done, down = RowElement("CV", n), RowElement("C", n), RowElement("M", 8000 + n)
    old, limit = LocalVariable("v"), LocalVariable("limit")
    # the sum of value, direction and 2**31 is reduced to 32 bits; subtracting 2**31 then gives a signed number
    shifted = Arithmetic("+", old, Selection(down, 2**31 - 1, 2**31 + 1))
    below = Arithmetic("-", limit, 1)
    reached = Conjunction(Comparison("==", old, below), Comparison("==", value, limit))
    left = Conjunction(Comparison("==", old, limit), Comparison("==", value, below))
    return (
        Let(old, value),
        Let(limit, counts),
        Store(value, Arithmetic("-", Arithmetic("&", shifted, 2**32 - 1), 2**31)),
        Branch(reached, (Store(done, value=True),), (Branch(left, (Store(done, value=False),)),)),
    )
