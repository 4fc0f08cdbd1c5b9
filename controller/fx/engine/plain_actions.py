"""Frequent applied instructions as statements, for operands without index.

The result is that of the Python function of the instruction (package `applied`), which is executed for all other
operands.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, Literal

from controller.core.devices import EXTENSION, WORD_MAX, WORD_MIN
from controller.fx.engine.access import width_of
from controller.fx.engine.code import (
    Arithmetic,
    ClearBits,
    Comparison,
    Condition,
    Conjunction,
    Let,
    LocalVariable,
    RowElement,
    Selection,
    Statement,
    Store,
    Value,
)
from controller.fx.engine.coils import plain_word
from controller.fx.engine.cpu import BORROW, CARRY, ZERO
from controller.fx.language.instruction import DeviceOperand, Digits, Operand
from controller.fx.language.instruction_set import Form

_EXACT: Final = LocalVariable("exact")
_RESULT: Final = LocalVariable("v")
_BITWISE: Final[dict[str, Literal["&", "|", "^"]]] = {"WAND": "&", "WOR": "|", "WXOR": "^"}
_SPECIAL: Final = 8000
_AFTER_LAST: Final = 8256


def plain_action(form: Form, operands: tuple[Operand, ...]) -> tuple[Statement, ...] | None:
    """Return the statements for an applied instruction, or None if only its Python function can execute it."""
    match form.kind.name:
        case "ZRST":
            return _zone_reset(operands)
        case "CMP":
            return _compare(form, operands)
        case "ZCP":
            return _compare_zone(form, operands)
        case "INC" | "DEC" if not form.wide:
            return _next_number(form.kind.name, operands[0])
        case "MOV":
            return _assigned(plain_word(operands[0], wide=form.wide), operands[1], form.wide)
        case "INC" | "DEC":
            value, one = plain_word(operands[0], wide=True), 1 if form.kind.name == "INC" else -1
            changed = None if value is None else _wrapped(Arithmetic("+", value, one), 32)
            return _assigned(changed, operands[0], wide=True)
        case "ADD" | "SUB":
            return _flagged("+" if form.kind.name == "ADD" else "-", operands, form.wide)
        case "MUL" if not form.wide:
            return _product(operands)
        case name if name in _BITWISE:
            left, right = (plain_word(operand, wide=form.wide) for operand in operands[:2])
            if left is not None and right is not None:
                return _assigned(Arithmetic(_BITWISE[name], left, right), operands[2], form.wide)
    return None


def _zone_reset(operands: tuple[Operand, ...]) -> tuple[Statement, ...] | None:
    match operands:
        case (DeviceOperand("Y" | "M" | "S" as kind, first, ""), DeviceOperand(_, last, "")) if first <= last:
            return (ClearBits(kind, first, last),)
    return None


def _compare(form: Form, operands: tuple[Operand, ...]) -> tuple[Statement, ...] | None:
    """Return the statements for CMP: three bits for the first value above, equal to and below the second."""
    left, right = (plain_word(operand, wide=form.wide) for operand in operands[:2])
    target = operands[2]
    if left is None or right is None or not isinstance(target, DeviceOperand) or target.index:
        return None
    one, other = LocalVariable("one"), LocalVariable("other")
    bits = (Comparison(">", one, other), Comparison("==", one, other), Comparison("<", one, other))
    return Let(one, left), Let(other, right), *_three_bits(target, bits)


def _compare_zone(form: Form, operands: tuple[Operand, ...]) -> tuple[Statement, ...] | None:
    """Return the statements for ZCP: three bits for the value below, within and above the limits."""
    low, high, value = (plain_word(operand, wide=form.wide) for operand in operands[:3])
    target = operands[3]
    if low is None or high is None or value is None or not isinstance(target, DeviceOperand) or target.index:
        return None
    first, last = LocalVariable("first"), LocalVariable("last")
    highest = Selection(Comparison("<", last, first), first, last)
    bits = (
        Comparison("<", _RESULT, first),
        Conjunction(Comparison("<=", first, _RESULT), Comparison("<=", _RESULT, last)),
        Comparison(">", _RESULT, last),
    )
    return Let(first, low), Let(last, high), Let(_RESULT, value), Let(last, highest), *_three_bits(target, bits)


def _three_bits(target: DeviceOperand, conditions: Iterable[Condition]) -> Iterator[Store]:
    for number, condition in enumerate(conditions, target.number):
        yield Store(RowElement(target.kind, number), condition)


def _next_number(name: str, operand: Operand) -> tuple[Statement, ...] | None:
    """Return the statement for INC or DEC of a register."""
    count = plain_word(operand)
    if not isinstance(count, RowElement) or count.row != "D":
        return None
    if name == "INC":
        return (Store(count, Selection(Comparison("<", count, WORD_MAX), Arithmetic("+", count, 1), WORD_MIN)),)
    return (Store(count, Selection(Comparison(">", count, WORD_MIN), Arithmetic("-", count, 1), WORD_MAX)),)


def _flagged(operator: Literal["+", "-"], operands: tuple[Operand, ...], wide: bool) -> tuple[Statement, ...] | None:
    """Return the statements for ADD and SUB with their flags."""
    left, right = (plain_word(operand, wide=wide) for operand in operands[:2])
    if left is None or right is None:
        return None
    stores = _stores(operands[2], wide)
    if stores is None:
        return None
    return (
        Let(_EXACT, Arithmetic(operator, left, right)),
        Let(_RESULT, _wrapped(_EXACT, width_of(wide))),
        *stores,
        Store(RowElement("M", ZERO), Comparison("==", _RESULT, 0)),
        Store(RowElement("M", BORROW), Comparison("<", _EXACT, _RESULT)),
        Store(RowElement("M", CARRY), Comparison(">", _EXACT, _RESULT)),
    )


def _product(operands: tuple[Operand, ...]) -> tuple[Statement, ...] | None:
    """Return the statements for a 16-bit MUL into two registers."""
    left, right = (plain_word(operand) for operand in operands[:2])
    match operands[2]:
        case DeviceOperand("D", number, "") as target if number + 1 not in (_SPECIAL, _AFTER_LAST, EXTENSION):
            if left is not None and right is not None:
                return _assigned(Arithmetic("*", left, right), target, wide=True)
    return None


def _assigned(value: Value | None, target: Operand, wide: bool) -> tuple[Statement, ...] | None:
    """Return the assignment of a value to a word; None if it is not supported."""
    stores = _stores(target, wide)
    if value is None or stores is None:
        return None
    match stores:
        case (Store(element, LocalVariable()),):
            return (Store(element, value),)
    return Let(_RESULT, value), *stores


def _stores(target: Operand, wide: bool) -> tuple[Statement, ...] | None:
    """Return the statements that write the variable `_RESULT` to a word; None if it is not supported."""
    match target:
        case DeviceOperand("R", number, ""):
            return _stores(DeviceOperand("D", EXTENSION + number), wide)
        case DeviceOperand("D", number, "") if wide:
            high = Store(RowElement("D", number + 1), Arithmetic(">>", _RESULT, 16))
            return Store(RowElement("D", number), _wrapped(_RESULT, 16)), high
        case Digits(digits, DeviceOperand(kind, number, "")):
            return tuple(Store(RowElement(kind, number + n), _bit(_RESULT, n)) for n in range(4 * digits))
        case DeviceOperand("D" | "C" | "V" | "Z"):
            element = plain_word(target, wide=wide)
            return (Store(element, _RESULT),) if isinstance(element, RowElement) else None
    return None


def _bit(value: Value, n: int) -> Comparison:
    return Comparison("==", Arithmetic("&", Arithmetic(">>", value, n), 1), 1)


def _wrapped(value: Value, width: int) -> Value:
    """Return the low bits of a value as a signed number."""
    half = 1 << (width - 1)
    return Arithmetic("-", Arithmetic("&", Arithmetic("+", value, half), 2 * half - 1), half)
