"""Conditions over devices of the program and values of the plant, as written by a user.

::

    X1 and not M240                     # contacts; also & | ~ !
    D100 >= 12 or C5 = 3                # words; the current values of timers and counters are TN12, CN5
    left.lift.position_m < 0.05         # values of the plant
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from controller.common.errors import InputError
from controller.core.expr import COMPARISONS

if TYPE_CHECKING:
    from controller.debug.machine import DebugSignal


@dataclass(frozen=True, slots=True)
class SignalContact:
    """Condition that a signal is on, or not 0."""

    signal: DebugSignal

    def holds(self) -> bool:
        """Return True if the condition is met now."""
        return bool(self.signal.read())


@dataclass(frozen=True, slots=True)
class SignalComparison:
    """Condition that compares a signal with a number or another signal.

    Attributes:
        relation: One of ``==``, ``!=``, ``<``, ``<=``, ``>``, ``>=``.
    """

    relation: str
    left: DebugSignal
    right: DebugSignal | float

    def holds(self) -> bool:
        """Return True if the condition is met now."""
        right = self.right if isinstance(self.right, int | float) else self.right.read()
        return bool(COMPARISONS[self.relation](self.left.read(), right))  # type: ignore[arg-type] # numbers


@dataclass(frozen=True, slots=True)
class SignalInverse:
    """Condition that another one is not met."""

    operand: Condition

    def holds(self) -> bool:
        """Return True if the condition is met now."""
        return not self.operand.holds()


@dataclass(frozen=True, slots=True)
class SignalJoined:
    """Conditions of which all, or any, must be met.

    Attributes:
        every: True for all, False for any.
    """

    every: bool
    operands: tuple[Condition, ...]

    def holds(self) -> bool:
        """Return True if the condition is met now."""
        met = (operand.holds() for operand in self.operands)
        return all(met) if self.every else any(met)


Condition = SignalContact | SignalComparison | SignalInverse | SignalJoined

_TOKEN: Final = re.compile(r"\s*(<=|>=|==|!=|<>|[()<>=&|~!]|[^\s()<>=&|~!]+)")
_RELATIONS: Final = {"=": "==", "<>": "!="} | {name: name for name in COMPARISONS}
_AND, _OR, _NOT = frozenset({"and", "&"}), frozenset({"or", "|"}), frozenset({"not", "~", "!"})
_DEEPEST: Final = 50
_SYNTAX: Final = "write for example: X1 and not M240, D100 >= 12, left.lift.position_m < 0.05"


def parse_condition(text: str, signal: Callable[[str], DebugSignal]) -> Condition:
    """Return the condition in a text.

    Args:
        text: The text.
        signal: Function that returns a signal by name, or raises InputError.

    Raises:
        InputError: The text is not a condition.
    """
    tokens = _TOKEN.findall(text)
    if not tokens:
        raise InputError(f"no condition; {_SYNTAX}")
    reader = _Reader(text, tokens, signal)
    condition = reader.either(0)
    if reader.next is not None:
        raise reader.error(f"unexpected {reader.next}")
    return condition


def signals_of(condition: Condition) -> Iterator[DebugSignal]:
    """Yield every signal that a condition reads."""
    match condition:
        case SignalContact(signal):
            yield signal
        case SignalComparison(_, left, right):
            yield left
            if not isinstance(right, int | float):
                yield right
        case SignalInverse(operand):
            yield from signals_of(operand)
        case SignalJoined(_, operands):
            for operand in operands:
                yield from signals_of(operand)


class _Reader:
    """Reader of the tokens of one condition."""

    def __init__(self, text: str, tokens: list[str], signal: Callable[[str], DebugSignal]) -> None:
        self._text, self._signal = text, signal
        self._tokens = tokens[::-1]

    @property
    def next(self) -> str | None:
        return self._tokens[-1] if self._tokens else None

    def error(self, reason: str) -> InputError:
        return InputError(f"{self._text.strip()!r}: {reason}; {_SYNTAX}")

    def either(self, depth: int) -> Condition:
        operands = [self._both(depth)]
        while self._takes(_OR):
            operands.append(self._both(depth))
        return operands[0] if len(operands) == 1 else SignalJoined(every=False, operands=tuple(operands))

    def _both(self, depth: int) -> Condition:
        operands = [self._one(depth)]
        while self._takes(_AND):
            operands.append(self._one(depth))
        return operands[0] if len(operands) == 1 else SignalJoined(every=True, operands=tuple(operands))

    def _one(self, depth: int) -> Condition:
        if depth > _DEEPEST:
            raise self.error("nested too deeply")
        if self._takes(_NOT):
            return SignalInverse(self._one(depth + 1))
        if self._takes({"("}):
            condition = self.either(depth + 1)
            if not self._takes({")"}):
                raise self.error("a closing parenthesis is missing")
            return condition
        left = self._signal(self._word())
        relation = _RELATIONS.get(self.next or "")
        if relation is None:
            return SignalContact(left)
        self._tokens.pop()
        word = self._word()
        try:
            right: DebugSignal | float = int(word)
        except ValueError:
            try:
                right = float(word)
            except ValueError:
                right = self._signal(word)
        return SignalComparison(relation, left, right)

    def _takes(self, words: set[str] | frozenset[str]) -> bool:
        if self.next is not None and self.next.lower() in words:
            self._tokens.pop()
            return True
        return False

    def _word(self) -> str:
        word = self.next
        if word is None:
            raise self.error("it ends too early")
        if _TOKEN.fullmatch(word) is None or word in "()&|~!" or word in _RELATIONS:
            raise self.error(f"unexpected {word}")
        return self._tokens.pop()
