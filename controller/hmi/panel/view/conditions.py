"""Transition conditions of the step charts as text, in English and Chinese."""

from __future__ import annotations

from typing import Final

from controller.core.expr import And, Bit, Compare, Const, Expr, Not, Or, Word
from controller.hmi.panel.view.texts import TEXTS
from controller.program.tags import SIDES
from controller.program.texts.operator import Text

_AND: Final = Text(" and ", " 且 ")
_OR: Final = Text(" or ", " 或 ")
_NOT: Final = Text("not {text}", "非“{text}”")
_NOT_GROUP: Final = Text("not ({text})", "非（{text}）")
_GROUP: Final = Text("({text})", "（{text}）")
_CONSTANTS: Final = {True: Text("always", "始终"), False: Text("never", "从不")}
_RELATIONS: Final = {"==": "=", "!=": "≠", "<": "<", "<=": "≤", ">": ">", ">=": "≥"}
_VALUES: Final = {"tray.phase": "phase"}
"""Key prefix of the texts for the values of a word, by word name; values of other words are shown as numbers."""


def condition_text(condition: Expr) -> Text:
    """Return a condition as text.

    Examples:
        >>> condition_text(Bit("M", 100, "left.down") & ~Bit("M", 1024, "left.loaded"))
        Text(en='arm down and not arm loaded', zh='臂在下限位 且 非“臂带苗”')
    """
    match condition:
        case Bit():
            return _name(condition)
        case Not(operand):
            return _fill(_NOT if isinstance(operand, Bit) else _NOT_GROUP, condition_text(operand))
        case And(operands):
            return _join(_AND, [_grouped(each, Or) for each in operands])
        case Or(operands):
            return _join(_OR, [_grouped(each, And) for each in operands])
        case Compare(relation, left, right):
            value = _name(right) if isinstance(right, Word) else _value(left, right)
            return _join(Text(*2 * (f" {_RELATIONS[relation]} ",)), [_name(left), value])
        case Const(value):
            return _CONSTANTS[value]
    raise TypeError(f"not a condition: {condition!r}")


def _name(device: Bit | Word) -> Text:
    side, _, bare = device.name.partition(".")
    name = bare if side in SIDES else device.name
    return TEXTS.get(f"condition.{name}", Text(*2 * (name or str(device),)))


def _value(word: Word, value: int) -> Text:
    return TEXTS.get(f"{_VALUES.get(word.name)}.{value}", Text(*2 * (str(value),)))


def _grouped(condition: Expr, kind: type[And | Or]) -> Text:
    text = condition_text(condition)
    return _fill(_GROUP, text) if isinstance(condition, kind) else text


def _fill(form: Text, text: Text) -> Text:
    return Text(form.en.format(text=text.en), form.zh.format(text=text.zh))


def _join(separator: Text, texts: list[Text]) -> Text:
    return Text(separator.en.join(text.en for text in texts), separator.zh.join(text.zh for text in texts))
