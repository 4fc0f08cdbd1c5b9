"""Frequent applied instructions as statements, for operands without index.

The result is that of the Python function of the instruction (package `applied`), which is executed for all other
operands.
"""

from __future__ import annotations

from typing import Final, Literal

from controller.core.devices import WORD_MAX, WORD_MIN
from controller.fx.engine.access import width_of
from controller.fx.engine.code import (
    Arithmetic,
    ClearBits,
    Comparison,
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
        case "CMP" | "ZCP":
            return _compare(form, operands)
        case "INC" | "DEC" if not form.wide:
            return _step(form.kind.name, operands[0])
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
    """Return the statements for CMP and ZCP: three bits for below, within and above, or the reverse for CMP."""
    *limits, value = (plain_word(operand, wide=form.wide) for operand in operands[:-1])
    match operands[-1]:
        case DeviceOperand(kind, number, ""):
            bits = [RowElement(kind, number + n) for n in range(3)]
        case _:
            return None
    if value is None or None in limits:
        return None
    low, high = LocalVariable("low"), LocalVariable("high")
    lets: list[Statement] = [Let(_RESULT, value), Let(low, limits[0] or 0)]
    if form.kind.name == "CMP":
        relations = (Comparison(">", low, _RESULT), Comparison("==", low, _RESULT), Comparison("<", low, _RESULT))
        return (*lets, *(Store(bit, each) for bit, each in zip(bits, relations, strict=True)))
    lets += [Let(high, limits[1] or 0), Let(high, Selection(Comparison("<", high, low), low, high))]
    within = Conjunction(Comparison("<=", low, _RESULT), Comparison("<=", _RESULT, high))
    below, above = Comparison("<", _RESULT, low), Comparison(">", _RESULT, high)
    return *lets, Store(bits[0], below), Store(bits[1], within), Store(bits[2], above)


def _step(name: str, operand: Operand) -> tuple[Statement, ...] | None:
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
        case DeviceOperand("D", number, "") as target if number + 1 not in (_SPECIAL, _AFTER_LAST):
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
