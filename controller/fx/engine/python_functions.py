"""Execution of a translated program as Python functions, without interpretation during a scan."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from types import CodeType
from typing import Final, NoReturn

from controller.core.devices import MS_10, MS_100, Memory
from controller.fx.engine.code import (
    BIT_ROWS,
    EXECUTION_REGISTERS,
    GATES,
    OBSERVED_ROWS,
    STEPS_LEFT,
    WORD_ROWS,
    Arithmetic,
    Body,
    Branch,
    ClearBits,
    Comparison,
    Condition,
    Conjunction,
    Disjunction,
    Inverse,
    Jump,
    Label,
    Leave,
    Let,
    LocalVariable,
    Network,
    Operation,
    Repetition,
    Routine,
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
    interrupt_name,
    subroutine_name,
)
from controller.fx.engine.cpu import call_error, watchdog_error
from controller.fx.engine.execution import Functions, FxExecution

INDENT: Final = "    "
_ROWS: Final = (*BIT_ROWS, *WORD_ROWS, *OBSERVED_ROWS)
_TICKS: Final = {MS_100: "tick_100", MS_10: "tick_10"}
_PARAMETERS: Final = ("tick_100", "tick_10", "tick_1")


class PythonFunctions:
    """Execution of a program as Python functions over the lists of a memory.

    Attributes:
        memory: All devices.
        activity: Row A.
        driven: Row B.
        leaving: Row L.
        registers: Row W.
        functions: Functions of the instructions that Python executes.
        records: Rows in which an observed program records; None = the instruction has not been executed.
    """

    def __init__(self, program: TranslatedProgram, shared: FxExecution | None = None) -> None:
        """Translate a program into functions.

        Args:
            program: The program.
            shared: Another execution of the program, on whose rows the functions operate; None = on rows of their own.
        """
        self.memory = Memory.of_size(program.cpu.sizes, program.edges) if shared is None else shared.memory
        self.activity = [False] * program.steps if shared is None else shared.activity
        self.driven = [False] * program.levels if shared is None else shared.driven
        self.leaving = [False] * program.cpu.sizes["S"] if shared is None else shared.leaving
        self.registers = [0] * EXECUTION_REGISTERS if shared is None else shared.registers
        self.functions: Functions = {}
        self.records: dict[str, list[bool | None]] = {row: [None] * program.observed for row in OBSERVED_ROWS}
        rows = {
            "A": self.activity,
            "B": self.driven,
            "L": self.leaving,
            "W": self.registers,
        } | self.records
        self._space: dict[str, object] = {
            "overdue": _raise_watchdog_error,
            "too_deep": _raise_call_error,
            **{name: rows[name] if name in rows else getattr(self.memory, name) for name in _ROWS},
        }
        text = "".join(_FunctionText(routine).text() for routine in program.routines)
        for number, condition in enumerate(program.shared):
            text += f"def {_shared_name(number)}():\n{INDENT}return {_text(condition)}\n"
        exec(_compiled(text), self._space)  # noqa: S102 - text of checked instructions
        self._scan = self._space[program.main.name]

    def save(self) -> None:
        """Return nothing: the rows of the memory are lists."""

    def restore(self, saved: None) -> None:
        """Restore nothing."""

    def link(self, functions: Functions) -> None:
        """Set the functions of the instructions that Python executes."""
        self.functions = functions
        self._space.update({_function_name(i): function for i, function in functions.items()})

    def run(self, now_ms: int) -> None:
        """Execute the program from step 0 to END."""
        self._scan(now_ms // MS_100, now_ms // MS_10, now_ms)  # type: ignore[operator]

    def run_interrupt(self, number: int, now_ms: int) -> None:
        """Execute an interrupt routine."""
        self._space[interrupt_name(number)](now_ms // MS_100, now_ms // MS_10, now_ms)  # type: ignore[operator]


@lru_cache(maxsize=8)
def _compiled(text: str) -> CodeType:
    """Return the code of a program, which several PLCs with the same program share."""
    return compile(text, "<program>", "exec")


def _raise_watchdog_error() -> NoReturn:
    raise watchdog_error()


def _raise_call_error() -> NoReturn:
    raise call_error()


def _function_name(index: int) -> str:
    return f"i{index}"


def _shared_name(number: int) -> str:
    return f"c{number}"


class _FunctionText:
    """Python text of one function, with the time in ticks as its arguments."""

    def __init__(self, routine: Routine) -> None:
        self._routine = routine
        self._lines: list[str] = []
        self._depth = 1
        self._bodies = 0
        self._jump: tuple[str, dict[int, int]] = ("", {})

    def text(self) -> str:
        self._add(*(f"{_gate(level)} = True" for level in self._routine.gates))
        self._body(self._routine.body)
        used = "\n".join(self._lines)
        rows = [name for name in _ROWS if f"{name}[" in used]
        arguments = ", ".join([*_PARAMETERS, *(f"{name}={name}" for name in rows)])
        return f"def {self._routine.name}({arguments}):\n{used or INDENT + 'pass'}\n"

    def _add(self, *lines: str) -> None:
        self._lines.extend(INDENT * self._depth + line for line in lines)

    @contextmanager
    def _deeper(self) -> Iterator[None]:
        self._depth += 1
        yield
        self._depth -= 1

    # structure

    def _body(self, body: Body) -> None:
        """Write a body; a body with labels becomes the sections of a loop that is repeated only after a jump."""
        labels = [part.number for part in body if isinstance(part, Label)]
        if not labels:
            for part in body:
                self._part(part)
            return
        outer, self._bodies = self._jump, self._bodies + 1
        variable = f"j{self._bodies}"
        self._jump = (variable, {label: n for n, label in enumerate(labels, 1)})
        self._add(f"{variable} = 0", "while True:")
        with self._deeper():
            self._add(f"if {variable} <= 0:", f"{INDENT}pass")
            for part in body:
                if isinstance(part, Label):
                    self._add(f"if {variable} <= {self._jump[1][part.number]}:", f"{INDENT}pass")
                else:
                    with self._deeper():
                        self._part(part)
            self._add("break")
        self._jump = outer

    def _part(self, part: Network | Label | Repetition) -> None:
        match part:
            case Network():
                self._statements(part.statements)
            case Repetition(index, body):
                self._add(f"for _ in range({_function_name(index)}()):")
                with self._deeper():
                    self._body(body)

    def _statements(self, statements: Iterable[Statement]) -> None:
        for statement in statements:
            self._statement(statement)

    def _statement(self, statement: Statement) -> None:
        match statement:
            case Store(target, value) | Let(target, value):
                self._add(f"{_text(target)} = {_text(value)}")
            case Branch(condition, then, otherwise):
                self._branch("if", condition, then, otherwise)
            case ClearBits(row, first, last):
                self._add(f"{row}[{first}:{last + 1}] = [False] * {last + 1 - first}")
            case Spend(steps):
                self._add(f"W[{STEPS_LEFT}] -= {steps}", f"if W[{STEPS_LEFT}] < 0: overdue()")
            case StopTooDeep():
                self._add("too_deep()")
            case Jump(label):
                variable, sections = self._jump
                self._add(f"{variable} = {sections[label]}", "continue")
            case Leave():
                self._add("return")
            case RunSubroutine(label):
                self._add(f"{subroutine_name(label)}({', '.join(_PARAMETERS)})")
            case Operation():
                self._add(_text(statement))

    def _branch(
        self, word: str, condition: Condition, then: tuple[Statement, ...], otherwise: tuple[Statement, ...]
    ) -> None:
        self._add(f"{word} {_text(condition)}:")
        with self._deeper():
            self._statements(then)
            if not then:
                self._add("pass")
        match otherwise:
            case ():
                return
            case (Branch(condition, then, otherwise),):
                self._branch("elif", condition, then, otherwise)
            case _:
                self._add("else:")
                with self._deeper():
                    self._statements(otherwise)


def _gate(level: int) -> str:
    return f"n{level}"


def _text(operand: Condition | Value) -> str:
    """Return a condition or value as Python text."""
    match operand:
        case RowElement(row, number):
            return _gate(number) if row == GATES else f"{row}[{number}]"
        case LocalVariable(name):
            return name
        case Inverse(condition):
            text = _text(condition)
            return f"not ({text})" if isinstance(condition, Conjunction | Disjunction) else f"not {text}"
        case Conjunction(left, right):
            return f"{_in_series(left)} and {_in_series(right)}"
        case Disjunction(left, right):
            return f"{_text(left)} or {_text(right)}"
        case Comparison(relation, one, other):
            return f"{_text(one)} {relation} {_text(other)}"
        case Operation(index, drive):
            return f"{_function_name(index)}({'' if drive is None else _text(drive)})"
        case SharedCondition(number):
            return f"{_shared_name(number)}()"
        case _:
            return _value_text(operand)


def _value_text(value: int | Tick | Arithmetic | Selection) -> str:
    match value:
        case int():
            return str(value)
        case Tick(base_ms):
            return _TICKS.get(base_ms, "tick_1")
        case Arithmetic(operator, one, other):
            return f"({_text(one)} {operator} {_text(other)})"
        case Selection(condition, one, other):
            return f"({_text(one)} if {_text(condition)} else {_text(other)})"


def _in_series(condition: Condition) -> str:
    """Return a condition as Python text that can be an operand of `and`."""
    text = _text(condition)
    return f"({text})" if isinstance(condition, Disjunction) else text
