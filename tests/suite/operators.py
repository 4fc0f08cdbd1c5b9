"""Damage operators: small changes of a source text, found in its syntax tree."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Final


class Kind(StrEnum):
    """Kind of damage."""

    COMPARISON = "comparison"
    BOUNDARY = "boundary"
    ARITHMETIC = "arithmetic operator"
    BOOLEAN = "boolean"
    CONSTANT = "constant"
    CONDITION = "negated condition"
    DELETED = "deleted statement"
    ARGUMENTS = "swapped arguments"
    RETURN = "return value"


@dataclass(frozen=True)
class Change:
    """Change of a source text.

    Attributes:
        kind: Kind of damage.
        line: Line of the first changed character, from 1.
        start: Offset of the first replaced byte.
        end: Offset after the last replaced byte.
        old: Replaced text.
        new: Replacement.
    """

    kind: Kind
    line: int
    start: int
    end: int
    old: str
    new: str

    def applied_to(self, text: str) -> str:
        """Return a source text with the change."""
        content = text.encode()
        return (content[: self.start] + self.new.encode() + content[self.end :]).decode()


_OPPOSITE: Final[dict[type[ast.cmpop], type[ast.cmpop]]] = {
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}
_BOUNDARY: Final[dict[type[ast.cmpop], type[ast.cmpop]]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
}
_ARITHMETIC: Final[dict[type[ast.operator], type[ast.operator]]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
_BITS: Final[dict[type[ast.operator], type[ast.operator]]] = {ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd}
_REPORTS: Final = {"print", "debug", "info", "warning", "error", "exception", "critical", "log"}
"""Functions whose arguments are texts for a reader."""


def changes(text: str) -> list[Change]:
    """Return every change of a source text, in the order of the text.

    Excluded are docstrings, annotations, decorators, texts of messages and exceptions, formatted texts, imports, and
    the blocks under a test of ``__name__`` or ``TYPE_CHECKING``.

    >>> [(change.old, change.new) for change in changes("ready = level < 5")]
    [('level < 5', 'level >= 5'), ('level < 5', 'level <= 5'), ('5', '6')]
    """
    starts = [0]
    for line in text.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = list[Change]()
    for node in _examined(ast.parse(text)):
        for operator in _OPERATORS:
            for kind, part, new in operator(node):
                assert part.end_lineno is not None
                assert part.end_col_offset is not None
                start, end = (
                    starts[part.lineno - 1] + part.col_offset,
                    starts[part.end_lineno - 1] + part.end_col_offset,
                )
                found.append(Change(kind, part.lineno, start, end, text.encode()[start:end].decode(), new))
    return sorted(found, key=lambda change: (change.start, change.end))


def _examined(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and the nodes below it that may be damaged."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list", "type_params"}:
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not _is_excluded(child):
                yield from _examined(child)


def _is_excluded(node: ast.AST) -> bool:
    if isinstance(node, ast.If):
        return {"__name__", "TYPE_CHECKING"} & {
            part.id for part in ast.walk(node.test) if isinstance(part, ast.Name)
        } != set()
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant) or _is_report(node.value)
    return isinstance(node, ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom | ast.Pass) or (
        isinstance(node, ast.Assert) or _is_report(node)
    )


def _is_report(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in _REPORTS


Found = Iterator[tuple[Kind, ast.expr | ast.stmt, str]]


def _comparisons(node: ast.AST) -> Found:
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        (operator,) = node.ops
        for kind, table in ((Kind.COMPARISON, _OPPOSITE), (Kind.BOUNDARY, _BOUNDARY)):
            if type(operator) in table:
                yield kind, node, ast.unparse(ast.Compare(node.left, [table[type(operator)]()], node.comparators))
    elif isinstance(node, ast.Compare):
        for place, operator in enumerate(node.ops):
            if type(operator) in _BOUNDARY:
                operators = [*node.ops[:place], _BOUNDARY[type(operator)](), *node.ops[place + 1 :]]
                yield Kind.BOUNDARY, node, ast.unparse(ast.Compare(node.left, operators, node.comparators))


def _operators(node: ast.AST) -> Found:
    if isinstance(node, ast.BoolOp):
        other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield Kind.BOOLEAN, node, f"({ast.unparse(ast.BoolOp(other, node.values))})"
    if not isinstance(node, ast.BinOp) or _is_text(node.left) or _is_text(node.right):
        return
    for kind, table in ((Kind.BOOLEAN, _BITS), (Kind.ARITHMETIC, _ARITHMETIC)):
        if type(node.op) in table:
            yield kind, node, f"({ast.unparse(ast.BinOp(node.left, table[type(node.op)](), node.right))})"


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str | bytes))


def _constants(node: ast.AST) -> Found:
    if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
        yield Kind.CONSTANT, node, repr(not node.value if isinstance(node.value, bool) else node.value + 1)


def _conditions(node: ast.AST) -> Found:
    if isinstance(node, ast.If | ast.While | ast.IfExp) and not isinstance(node.test, ast.Compare | ast.Constant):
        yield Kind.CONDITION, node.test, f"(not ({ast.unparse(node.test)}))"


def _statements(node: ast.AST) -> Found:
    body = getattr(node, "body", None)
    if not isinstance(body, list) or isinstance(node, ast.Module | ast.ClassDef):
        return
    for statement in body:
        call = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call | ast.Await)
        if (call and not _is_excluded(statement)) or isinstance(statement, ast.Assign | ast.AugAssign):
            yield Kind.DELETED, statement, "pass"


def _arguments(node: ast.AST) -> Found:
    if isinstance(node, ast.Call) and len(node.args) > 1 and not any(isinstance(a, ast.Starred) for a in node.args[:2]):
        first, second, *others = node.args
        if ast.dump(first) != ast.dump(second):
            swapped = ast.Call(node.func, [second, first, *others], node.keywords)
            yield Kind.ARGUMENTS, node, ast.unparse(swapped)


def _returns(node: ast.AST) -> Found:
    if isinstance(node, ast.Return) and node.value is not None and ast.unparse(node.value) != "None":
        yield Kind.RETURN, node.value, "None"


_OPERATORS: Final[tuple[Callable[[ast.AST], Found], ...]] = (
    _comparisons,
    _operators,
    _constants,
    _conditions,
    _statements,
    _arguments,
    _returns,
)
