"""Conditions as data: expressions over devices for compilation, export, proof and drawing.

Write ``x.left.lift_down & ~m.hold | (d.count >= 12)``. The operators ``and``, ``or`` and ``not`` raise TypeError.
"""

from __future__ import annotations

import operator
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, NoReturn

from controller.core.devices import Memory, check_device, device_name, timer_base_ms


class Expr:
    """Condition that is true or false in each scan."""

    __slots__ = ()

    def __and__(self, other: Expr) -> Expr:
        """Return the series connection of the two contacts."""
        return all_of(self, other)

    def __or__(self, other: Expr) -> Expr:
        """Return the parallel connection of the two contacts."""
        return any_of(self, other)

    def __invert__(self) -> Expr:
        """Return the normally closed contact."""
        return (
            self.operand if isinstance(self, Not) else FALSE if self is TRUE else TRUE if self is FALSE else Not(self)
        )

    def __bool__(self) -> NoReturn:
        """Reject Python's and / or / not, which would evaluate the condition at declaration, not in the scan."""
        raise TypeError("a condition is data: use & | ~ instead of and / or / not")


@dataclass(frozen=True, slots=True)
class Bit(Expr):
    """Contact of an X, Y, M, S, T or C device. Equality and hash depend only on `kind` and `number`.

    Attributes:
        kind: Device kind.
        number: Device number; for X and Y, the value of the octal label.
        name: Tag name for texts and exports.
        comment: Device comment for texts and exports.
    """

    kind: str
    number: int
    name: str = field(default="", compare=False)
    comment: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        check_device(self.kind, self.number)
        if self.kind == "D":
            raise TypeError(f"{self}: a data register is a word; use a comparison")

    def __str__(self) -> str:
        return device_name(self.kind, self.number)


class CompiledCondition(Expr, ABC):
    """Condition over data outside the PLC, which exists only as machine code; a program cannot contain it."""

    __slots__ = ()

    @abstractmethod
    def emit(self, code: Any) -> str:
        """Add the evaluation to an LLVM function and return the name of the result, of type i1."""


@dataclass(frozen=True, slots=True)
class Not(Expr):
    """Condition that is true while the operand is false."""

    operand: Expr

    def __str__(self) -> str:
        return f"~{self.operand}" if isinstance(self.operand, Bit) else f"~({self.operand})"


@dataclass(frozen=True, slots=True)
class And(Expr):
    """Condition that is true while every operand is true."""

    operands: tuple[Expr, ...]

    def __str__(self) -> str:
        return " & ".join(f"({o})" if isinstance(o, Or) else str(o) for o in self.operands)


@dataclass(frozen=True, slots=True)
class Or(Expr):
    """Condition that is true while at least one operand is true."""

    operands: tuple[Expr, ...]

    def __str__(self) -> str:
        return " | ".join(f"({o})" if isinstance(o, And) else str(o) for o in self.operands)


@dataclass(frozen=True, slots=True)
class Const(Expr):
    """Condition that is always true (M8000) or always false (M8001)."""

    value: bool

    def __str__(self) -> str:
        return "always" if self.value else "never"


TRUE: Final = Const(value=True)
FALSE: Final = Const(value=False)

COMPARISONS: Final[dict[str, Callable[[int, int], bool]]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@dataclass(frozen=True, slots=True)
class Word:
    """Word device: data register D, or the current value of a timer (T) or counter (C).

    Comparisons return contacts, for example ``d.count >= 12``. Use ``d.state.equals(6)`` to test for equality.
    """

    kind: str
    number: int
    name: str = field(default="", compare=False)
    comment: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        check_device(self.kind, self.number)
        if self.kind not in "DTC":
            raise TypeError(f"{self}: only D, T and C are words")

    def __str__(self) -> str:
        return device_name(self.kind, self.number)

    def equals(self, other: Word | int) -> Compare:
        """Return a contact that is on while the word equals other."""
        return Compare("==", self, other)

    def differs(self, other: Word | int) -> Compare:
        """Return a contact that is on while the word differs from other."""
        return Compare("!=", self, other)

    def __lt__(self, other: Word | int) -> Compare:
        return Compare("<", self, other)

    def __le__(self, other: Word | int) -> Compare:
        return Compare("<=", self, other)

    def __gt__(self, other: Word | int) -> Compare:
        return Compare(">", self, other)

    def __ge__(self, other: Word | int) -> Compare:
        return Compare(">=", self, other)


@dataclass(frozen=True, slots=True)
class Compare(Expr):
    """Comparison contact of two words (LD=, LD<>, LD<, ...)."""

    relation: str
    left: Word
    right: Word | int

    def __str__(self) -> str:
        return f"{self.left} {self.relation} {self.right}"


@dataclass(frozen=True, slots=True)
class Timer:
    """Timer T; its contact and its current value have the same number."""

    number: int
    name: str = field(default="", compare=False)
    comment: str = field(default="", compare=False)

    @property
    def done(self) -> Bit:
        """Contact of the timer."""
        return Bit("T", self.number, self.name, self.comment)

    @property
    def value(self) -> Word:
        """Current value of the timer, in counts of its base."""
        return Word("T", self.number, self.name, self.comment)

    @property
    def base_ms(self) -> int:
        """Time base of the timer, ms."""
        return timer_base_ms(self.number)

    def __str__(self) -> str:
        return f"T{self.number}"


@dataclass(frozen=True, slots=True)
class Counter:
    """Counter C; its contact and its current value have the same number."""

    number: int
    name: str = field(default="", compare=False)
    comment: str = field(default="", compare=False)

    @property
    def done(self) -> Bit:
        """Contact of the counter."""
        return Bit("C", self.number, self.name, self.comment)

    @property
    def value(self) -> Word:
        """Current value of the counter."""
        return Word("C", self.number, self.name, self.comment)

    def __str__(self) -> str:
        return f"C{self.number}"


def all_of(*operands: Expr) -> Expr:
    """Return the series connection of contacts, flattened; an empty series is always true."""
    parts: list[Expr] = []
    for operand in operands:
        if operand is FALSE:
            return FALSE
        if operand is not TRUE:
            parts.extend(operand.operands if isinstance(operand, And) else (operand,))
    return TRUE if not parts else parts[0] if len(parts) == 1 else And(tuple(parts))


def any_of(*operands: Expr) -> Expr:
    """Return the parallel connection of contacts, flattened; an empty connection is never true."""
    parts: list[Expr] = []
    for operand in operands:
        if operand is TRUE:
            return TRUE
        if operand is not FALSE:
            parts.extend(operand.operands if isinstance(operand, Or) else (operand,))
    return FALSE if not parts else parts[0] if len(parts) == 1 else Or(tuple(parts))


def evaluate(expr: Expr, memory: Memory) -> bool:
    """Evaluate a condition by interpretation; this is the reference for every compiled form."""
    match expr:
        case Bit(kind, number):
            return memory.bits(kind)[number]
        case Not(operand):
            return not evaluate(operand, memory)
        case And(operands):
            return all(evaluate(o, memory) for o in operands)
        case Or(operands):
            return any(evaluate(o, memory) for o in operands)
        case Const(value):
            return value
        case Compare(relation, left, right):
            other = right if isinstance(right, int) else memory.word(right.kind, right.number)
            return COMPARISONS[relation](memory.word(left.kind, left.number), other)
    raise TypeError(f"not a condition: {expr!r}")


def leaves(expr: Expr) -> Iterator[Bit | Word]:
    """Yield every device that a condition reads."""
    pending = [expr]
    while pending:
        part = pending.pop()
        if isinstance(part, Bit):
            yield part
        elif isinstance(part, Not):
            pending.append(part.operand)
        elif isinstance(part, And | Or):
            pending.extend(reversed(part.operands))
        elif isinstance(part, Compare):
            yield part.left
            if isinstance(part.right, Word):
                yield part.right


def readable(expr: Expr) -> str:
    """Return a condition as Markdown code, with tag names in brackets in place of device addresses."""
    names = {str(leaf): leaf.name for leaf in leaves(expr) if leaf.name}
    text = re.sub(r"[XYMSTCD]\d+", lambda match: f"[{names.get(match[0], match[0])}]", str(expr))
    return f"`{text}`"
