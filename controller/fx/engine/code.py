"""Translated program: conditions, values and statements, from which each execution generates its own code.

A program is a body of rungs, labels and loops. A condition is evaluated from left to right, and its right part only if
the left part does not determine the result, so an operation in it is executed only if its result is required.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

from controller.fx.language.cpu_model import FX2N, CpuModel

BIT_ROWS: Final = ("X", "Y", "M", "S", "T", "C", "CE", "E", "A", "B", "L")
"""Rows of bits: those of `Memory`, and A (previous activity of the steps), B (operations that must also be executed
without drive) and L (states that a transfer has left in this scan)."""
WORD_ROWS: Final = ("D", "TV", "TS", "CV", "W")
"""Rows of words: those of `Memory`, and W (registers of the execution)."""
CONTACT_RECORD, POWER_RECORD, ZONE_RECORD = OBSERVED_ROWS = ("OC", "OP", "OZ")
"""Rows in which an observed program records, for each instruction when it is executed: the value of its contact, the
power after it, and whether the master control around it is on."""
GATES: Final = "N"
"""Row of the levels of master control; each function has its own, all on at its start."""
STEPS_LEFT, DEPTH, TRANSFERRED = range(3)
"""Numbers in the row W: remaining watchdog time in basic steps, nesting depth of subroutines, 1 after a transfer."""
EXECUTION_REGISTERS: Final = 3
MAIN: Final = "scan"
"""Name of the function of the main program."""


@dataclass(frozen=True, slots=True)
class RowElement:
    """Bit or word in a row of the memory.

    Attributes:
        row: Name in `BIT_ROWS` or `WORD_ROWS`, or `GATES`.
        number: Position in the row; for a device, its number.
    """

    row: str
    number: int


@dataclass(frozen=True, slots=True)
class LocalVariable:
    """Intermediate result that is used only in its own rung."""

    name: str


@dataclass(frozen=True, slots=True)
class Inverse:
    """Condition that is true while the operand is false."""

    operand: Condition


@dataclass(frozen=True, slots=True)
class Conjunction:
    """Condition that is true while both operands are true."""

    left: Condition
    right: Condition


@dataclass(frozen=True, slots=True)
class Disjunction:
    """Condition that is true while at least one operand is true."""

    left: Condition
    right: Condition


@dataclass(frozen=True, slots=True)
class Comparison:
    """Condition that is true while the relation holds."""

    relation: str
    left: Value
    right: Value


@dataclass(frozen=True, slots=True)
class Operation:
    """Execution of an instruction by a Python function; as a condition, its result.

    Attributes:
        index: Index of the instruction.
        drive: Drive state passed to the function; None = the function has no parameter.
    """

    index: int
    drive: Condition | None = None


@dataclass(frozen=True, slots=True)
class SharedCondition:
    """Condition that occurs in many places and has a function of its own.

    Attributes:
        number: Position in `TranslatedProgram.shared`.
    """

    number: int


Condition = (
    bool | SharedCondition | RowElement | LocalVariable | Inverse | Conjunction | Disjunction | Comparison | Operation
)


@dataclass(frozen=True, slots=True)
class Tick:
    """Scan time in units of a time base in ms."""

    base_ms: int


@dataclass(frozen=True, slots=True)
class Arithmetic:
    """Result of an operator on integers; >> keeps the sign."""

    operator: Literal["+", "-", "*", "&", "|", "^", "<<", ">>"]
    left: Value
    right: Value


@dataclass(frozen=True, slots=True)
class Selection:
    """One of two values."""

    condition: Condition
    one: Value
    other: Value


Value = int | RowElement | LocalVariable | Tick | Arithmetic | Selection


@dataclass(frozen=True, slots=True)
class Store:
    """Assignment to a bit or a word."""

    target: RowElement
    value: Condition | Value


@dataclass(frozen=True, slots=True)
class Let:
    """Assignment to a variable."""

    variable: LocalVariable
    value: Condition | Value


@dataclass(frozen=True, slots=True)
class Branch:
    """Statements executed if a condition is true, and others executed if it is false."""

    condition: Condition
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...] = ()


@dataclass(frozen=True, slots=True)
class ClearBits:
    """Reset of consecutive bits."""

    row: str
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Spend:
    """Subtraction of basic steps from the watchdog time; the program stops if no time remains."""

    steps: int


@dataclass(frozen=True, slots=True)
class StopTooDeep:
    """Stop of the program because subroutines are nested too deeply."""


@dataclass(frozen=True, slots=True)
class Jump:
    """Continuation at a label of the same body."""

    label: int


@dataclass(frozen=True, slots=True)
class Leave:
    """Return from the function: the end of the scan or of a subroutine."""


@dataclass(frozen=True, slots=True)
class RunSubroutine:
    """Execution of a subroutine."""

    label: int


Statement = Store | Let | Branch | ClearBits | Spend | StopTooDeep | Jump | Leave | RunSubroutine | Operation


@dataclass(frozen=True, slots=True)
class Network:
    """Statements of one rung or step.

    Attributes:
        statements: Statements in order.
        source: Instructions as text.
        begins_block: Whether a title precedes the network.
    """

    statements: tuple[Statement, ...]
    source: str
    begins_block: bool


@dataclass(frozen=True, slots=True)
class Label:
    """Target of a jump."""

    number: int


@dataclass(frozen=True, slots=True)
class Repetition:
    """Body that is executed several times.

    Attributes:
        index: Index of the instruction whose Python function returns the number of times, at least 1.
        body: Repeated part of the program.
    """

    index: int
    body: Body


Body = tuple[Network | Label | Repetition, ...]


@dataclass(frozen=True, slots=True)
class Routine:
    """Body of the main program or of a subroutine.

    Attributes:
        name: Name of its function: "scan", or that of a subroutine or an interrupt routine.
        gates: Levels of master control in the body.
        body: Networks, labels and loops.
    """

    name: str
    gates: tuple[int, ...]
    body: Body


@dataclass(frozen=True, slots=True)
class TranslatedProgram:
    """Program before it is executed.

    Attributes:
        main: Main program.
        subroutines: Subroutines.
        shared: Conditions that occur in many places.
        operations: Indexes of the instructions that Python functions execute, ascending.
        sources: States that a transfer can leave, ascending.
        edges: Number of bits in row E, which store levels for edge detection.
        steps: Number of bits in row A.
        levels: Number of bits in row B.
        cpu: CPU of the program.
        interrupts: Bodies of the interrupt routines.
        observed: Number of elements in each of `OBSERVED_ROWS`; 0 = the program is not observed.
    """

    main: Routine
    subroutines: tuple[Routine, ...]
    shared: tuple[Condition, ...]
    operations: tuple[int, ...]
    sources: tuple[int, ...]
    edges: int
    steps: int
    levels: int
    cpu: CpuModel = FX2N
    interrupts: tuple[Routine, ...] = ()
    observed: int = 0

    @property
    def routines(self) -> tuple[Routine, ...]:
        """Main program, subroutines and interrupt routines."""
        return (self.main, *self.subroutines, *self.interrupts)


def any_of(conditions: Sequence[Condition]) -> Condition:
    """Return a condition that is true while at least one is true; the nesting depth is logarithmic in their number."""
    if len(conditions) == 1:
        return conditions[0]
    half = len(conditions) // 2
    return Disjunction(any_of(conditions[:half]), any_of(conditions[half:]))


def is_word(value: Condition | Value) -> bool:
    """Return whether an operand, other than a variable, is a word and not a condition."""
    match value:
        case bool():
            return False
        case RowElement(row, _):
            return row in WORD_ROWS
    return isinstance(value, int | Tick | Arithmetic | Selection)


def subroutine_name(label: int) -> str:
    """Return the name of the function of a subroutine."""
    return f"sub_{label}"


def interrupt_name(number: int) -> str:
    """Return the name of the function of an interrupt routine."""
    return f"interrupt_{number}"
