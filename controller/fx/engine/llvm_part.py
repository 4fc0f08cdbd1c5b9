"""LLVM functions of the rungs and steps of an FX program, and the arrangement of their memory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, cast

from controller.core.devices import MS_10, MS_100
from controller.core.llvm_function import FunctionBody
from controller.core.memory_layout import WORD_BYTES, MemoryLayout, MemoryRow
from controller.fx.engine.code import (
    EXECUTION_REGISTERS,
    GATES,
    STEPS_LEFT,
    WORD_ROWS,
    Arithmetic,
    Branch,
    ClearBits,
    Comparison,
    Condition,
    Conjunction,
    Disjunction,
    Inverse,
    Jump,
    Leave,
    Let,
    LocalVariable,
    Operation,
    RowElement,
    RunSubroutine,
    Selection,
    SharedCondition,
    Spend,
    Statement,
    StopTooDeep,
    Store,
    Tick,
    TranslatedProgram,
    Value,
    is_word,
    subroutine_name,
)

END, LEFT, STOPPED, OVERDUE, TOO_DEEP = range(5)
"""Results of a function: executed to its end, left, stopped by an exception of an operation, stopped by the watchdog,
and stopped because subroutines are nested too deeply."""
FIRST_LABEL: Final = 16
"""Result of a part that jumps to P0."""
CALLBACK: Final = EXECUTION_REGISTERS
"""Register with the address of the function that executes operations."""
TICK_REGISTERS: Final = {MS_100: CALLBACK + 1, MS_10: CALLBACK + 2, 1: CALLBACK + 3}
_REGISTERS: Final = CALLBACK + 4
GATE_LEVELS: Final = 8
NO_DRIVE: Final = -1
_OPERATORS: Final = {
    "+": "add",
    "-": "sub",
    "*": "mul",
    "&": "and",
    "|": "or",
    "^": "xor",
    "<<": "shl",
    ">>": "ashr",
}
MOVED_ROWS: Final = ("E", "A", "B")
"""Rows whose elements are numbered in program order; a part receives the address of its first element in each."""
PART_PARAMETERS: Final = "ptr %m, ptr %gates, ptr %E, ptr %A, ptr %B, i64 %operations"


class FxLayout(MemoryLayout):
    """Arrangement of the memory of an FX program.

    The rows whose length depends on the program are the last ones, so that the other positions are always the same.
    """

    def __init__(self, program: TranslatedProgram) -> None:
        super().__init__(edges=0, devices=program.cpu.sizes)
        at = -(-self.size // WORD_BYTES) * WORD_BYTES
        self.words["W"] = MemoryRow(at, _REGISTERS)
        at += _REGISTERS * WORD_BYTES
        for name, length in (("E", program.edges), ("A", program.steps), ("B", program.levels)):
            self.bits[name] = MemoryRow(at, length)
            at += length
        self.size = at


@dataclass(frozen=True, slots=True)
class PartBases:
    """First element of each numbered row, and first operation, that a part uses."""

    rows: dict[str, int]
    operation: int


class OperationBody(FunctionBody):
    """Builder of a function that can execute operations by Python functions."""

    def operation(self, index: str, drive: str) -> str:
        """Execute an operation and return its result; return from the function if it has raised an exception."""
        callback = self.value(f"inttoptr i64 {self.word('W', CALLBACK)} to ptr")
        result = self.value(f"call i64 {callback}(i64 {index}, i64 {drive})")
        with self.on(self.compare("<", result, 0)):
            self.leave(STOPPED)
        return result

    def leave(self, result: int | str) -> None:
        """Return from the function; operations added later in the same branch are not executed."""
        self.add(f"ret i64 {result}")
        self._begin(self._label())


class PartBody(OperationBody):
    """Builder of the function of a part.

    Attributes:
        declarations: Declarations of the functions that the part calls.
    """

    def __init__(self, layout: MemoryLayout, shared: Sequence[str]) -> None:
        """Begin a part.

        Args:
            layout: Arrangement of the memory.
            shared: Names of the functions of the shared conditions.
        """
        super().__init__(layout)
        self.declarations: dict[str, None] = {}
        self._shared = shared
        self._variables: dict[str, str] = {}
        self._rows: dict[str, int] = {}
        self._operation: int | None = None

    @property
    def bases(self) -> PartBases:
        """Elements to which the positions in the text refer."""
        return PartBases(self._rows, self._operation or 0)

    @property
    def used(self) -> bool:
        """True if the part contains statements."""
        return self.size > 1

    # memory

    def _bit_pointer(self, element: RowElement) -> str:
        row, number = element.row, element.number
        if row == GATES:
            return self.value(f"getelementptr i8, ptr %gates, i64 {number}")
        if row in MOVED_ROWS:
            number -= self._rows.setdefault(row, number)
            return self.value(f"getelementptr i8, ptr %{row}, i64 {number}")
        return self._pointer(self._layout.bit(row, number))

    def _executed(self, operation: Operation) -> str:
        """Execute an operation and return its result."""
        if self._operation is None:
            self._operation = operation.index
        drive = str(NO_DRIVE)
        if operation.drive is not None:
            drive = self.value(f"zext i1 {self._condition(operation.drive)} to i64")
        return self.operation(self.sum("%operations", operation.index - self._operation), drive)

    # conditions and values

    def _condition(self, condition: Condition) -> str:
        match condition:
            case bool():
                return "true" if condition else "false"
            case RowElement():
                return self._loaded_bit(self._bit_pointer(condition))
            case LocalVariable(name):
                return self._variables[name]
            case SharedCondition(number):
                return self._call("i1", self._shared[number])
            case Inverse(operand):
                return self.inverse(self._condition(operand))
            case Conjunction(left, right):
                return self._joined(left, right, series=True)
            case Disjunction(left, right):
                return self._joined(left, right, series=False)
            case Comparison(relation, one, other):
                return self.compare(relation, self._word(one), self._word(other))
            case Operation():
                return self.compare("!=", self._executed(condition), 0)

    def _joined(self, left: Condition, right: Condition, *, series: bool) -> str:
        """Return a connection of two conditions; an operation in the right one is executed only if required."""
        first = self._condition(left)
        if not _has_operation(right):
            both = (first, self._condition(right))
            return self.all_of(both) if series else self.any_of(both)
        before = self.block
        with self.on(first if series else self.inverse(first)):
            second = self._condition(right)
            end = self.block
        known = "false" if series else "true"
        return self.value(f"phi i1 [{known}, %{before}], [{second}, %{end}]")

    def _word(self, value: Value) -> str:
        match value:
            case int():
                return str(value)
            case RowElement(row, number):
                return self.word(row, number)
            case LocalVariable(name):
                return self._variables[name]
            case Tick(base_ms):
                return self.word("W", TICK_REGISTERS[base_ms])
            case Arithmetic(operator, left, right):
                return self.value(f"{_OPERATORS[operator]} i64 {self._word(left)}, {self._word(right)}")
            case Selection(condition, one, other):
                return self.choice(self._condition(condition), self._word(one), self._word(other))

    # statements

    def statements(self, statements: Iterable[Statement]) -> None:
        """Add statements."""
        for statement in statements:
            self._statement(statement)

    def _statement(self, statement: Statement) -> None:
        match statement:
            case Store(RowElement(row, number), value) if row in WORD_ROWS:
                self.set_word(row, number, self._value(value))
            case Store(target, value):
                power = self._value(value)
                self._store_bit(self._bit_pointer(target), power)
            case Let(LocalVariable(name), value):
                self._variables[name] = self._value(value)
            case Branch(condition, then, otherwise):
                self._branch(self._condition(condition), then, otherwise)
            case ClearBits(row, first, last):
                self.clear_bits(row, first, last)
            case Spend(steps):
                self._spend(steps)
            case StopTooDeep():
                self.leave(TOO_DEEP)
            case Jump(label):
                self.leave(FIRST_LABEL + label)
            case Leave():
                self.leave(LEFT)
            case RunSubroutine(label):
                self._run_subroutine(label)
            case Operation():
                self._executed(statement)

    def _value(self, value: Condition | Value) -> str:
        return self._word(cast("Value", value)) if is_word(value) else self._condition(cast("Condition", value))

    def _branch(self, condition: str, then: Iterable[Statement], otherwise: tuple[Statement, ...]) -> None:
        inside, other, after = self._label(), self._label(), self._label()
        self.add(f"br i1 {condition}, label %{inside}, label %{other}")
        for label, statements in ((inside, then), (other, otherwise)):
            self._begin(label)
            self.statements(statements)
            self.add(f"br label %{after}")
        self._begin(after)

    def _spend(self, steps: int) -> None:
        left = self.sum(self.word("W", STEPS_LEFT), -steps)
        self.set_word("W", STEPS_LEFT, left)
        with self.on(self.compare("<", left, 0)):
            self.leave(OVERDUE)

    def _run_subroutine(self, label: int) -> None:
        result = self._call("i64", subroutine_name(label))
        with self.on(self.compare("!=", result, END)):
            self.leave(result)

    def _call(self, result: str, name: str) -> str:
        """Call a function with the address of the memory and return its result."""
        self.declarations[f"declare {result} @{name}(ptr)"] = None
        return self.value(f"call {result} @{name}(ptr %m)")

    def condition_text(self, condition: Condition) -> str:
        """Return the body of a function that returns a condition."""
        self.add(f"ret i1 {self._condition(condition)}")
        return self.text()


def _has_operation(condition: Condition) -> bool:
    """Return whether a condition executes an operation."""
    match condition:
        case Operation():
            return True
        case Inverse(operand):
            return _has_operation(operand)
        case Conjunction(left, right) | Disjunction(left, right):
            return _has_operation(left) or _has_operation(right)
    return False
