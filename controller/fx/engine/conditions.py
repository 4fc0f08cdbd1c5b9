"""Translation of contacts and blocks to the condition of a rung, and the records of an observed program."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from controller.fx.engine.code import (
    CONTACT_RECORD,
    POWER_RECORD,
    ZONE_RECORD,
    Comparison,
    Condition,
    Conjunction,
    Disjunction,
    Inverse,
    Let,
    LocalVariable,
    Operation,
    RowElement,
    SharedCondition,
    Statement,
    Store,
)
from controller.fx.engine.coils import NOW, contact, plain_word
from controller.fx.language.instruction import Instruction
from controller.fx.language.instruction_set import FORMS, JOINS, RELATIONS

DEEPEST: Final = 50
"""Largest nesting depth of a condition; Python accepts 200 nested parentheses."""
_CONTACTS: Final = {f"{join}{end}": (join, end) for join in JOINS for end in ("", "I", "P", "F")} | {
    "ANI": ("AND", "I"),
    "ORI": ("OR", "I"),
}

_NEXT_RUNG: Final = frozenset(
    {
        "LD",
        "LDI",
        "LDP",
        "LDF",
        "STL",
        "RET",
        "MCR",
        "END",
        "FEND",
        "SRET",
        "IRET",
        "EI",
        "DI",
        "FOR",
        "NEXT",
        "P",
        "I",
        "MRD",
        "MPP",
    }
)
"""Instructions that end the current rung."""


class Numbering:
    """Elements of the internal rows, and operations, that a program under translation uses.

    Attributes:
        edges: Stored level of each edge instruction, by index of the instruction.
        levels: Activity of each operation with a drive state, by index of the instruction.
        operations: Indexes of the instructions that Python functions execute.
        sources: States that a transfer can leave.
        shared: Conditions that occur in many places, with their numbers.
    """

    def __init__(self) -> None:
        self.edges: dict[int, RowElement] = {}
        self.levels: dict[int, RowElement] = {}
        self.operations: set[int] = set()
        self.sources: set[int] = set()
        self.shared: dict[Condition, SharedCondition] = {}

    def edge(self, i: int) -> RowElement:
        """Return the stored level of an edge instruction."""
        return self.edges.setdefault(i, RowElement("E", len(self.edges)))

    def level(self, i: int) -> RowElement:
        """Return the activity of an operation with a drive state."""
        return self.levels.setdefault(i, RowElement("B", len(self.levels)))

    def operation(self, i: int, drive: Condition | None = None) -> Operation:
        """Return the execution of an instruction by a Python function."""
        self.operations.add(i)
        return Operation(i, drive)

    def shared_condition(self, condition: Condition) -> SharedCondition:
        """Return a reference to a condition that occurs in many places."""
        return self.shared.setdefault(condition, SharedCondition(len(self.shared)))


class _Nested(NamedTuple):
    """Condition with its nesting depth."""

    condition: Condition
    depth: int = 1


class RungBuilder:
    """Builder of the conditions of one rung.

    Attributes:
        statements: Statements of the rung.
        contact: Contact added last; None if the instruction added last is not a contact.
    """

    def __init__(self, statements: list[Statement], numbering: Numbering) -> None:
        """Begin a rung whose statements are added to a list."""
        self.statements = statements
        self.contact: Condition | None = None
        self._numbering = numbering
        self._blocks: list[_Nested] = []
        self._branches: list[LocalVariable] = []
        self._named = 0

    @property
    def empty(self) -> bool:
        """True if there is neither a pending condition nor a branch."""
        return not (self._blocks or self._branches)

    @property
    def condition(self) -> Condition | None:
        """Pending condition; None = connected to the left rail."""
        return self._blocks[-1].condition if self._blocks else None

    def add(self, i: int, instruction: Instruction) -> bool:
        """Add an instruction that changes the condition; return False if it is another one."""
        name, form = instruction.name, FORMS.get(instruction.name)
        self.contact = None
        if name in _CONTACTS:
            self._contact(i, instruction, *_CONTACTS[name])
        elif form is not None and form.kind.name[-1] in "=<>":
            self._compare(i, instruction)
        elif name in ("ANB", "ORB"):
            self._join(self._blocks.pop(), "AND" if name == "ANB" else "OR")
        elif name == "INV":
            last = self._blocks.pop()
            self._push(_Nested(Inverse(last.condition), last.depth + 1))
        elif name == "MPS":
            self._branches.append(self.named())
        elif name in ("MRD", "MPP"):
            self._blocks = [_Nested(self._branches[-1] if name == "MRD" else self._branches.pop())]
        else:
            return False
        return True

    def clear(self) -> None:
        """Drop all conditions and branches."""
        self._blocks, self._branches, self._named = [], [], 0

    def end_output(self) -> None:
        """Drop the condition of an output after which no other output follows."""
        self._blocks = []
        if not self._branches:
            self._named = 0

    def named(self) -> LocalVariable:
        """Assign the pending condition to a variable, so that later statements cannot change it, and return it."""
        condition = self.condition
        if isinstance(condition, LocalVariable):
            return condition
        variable = LocalVariable(f"t{self._named}")
        self._named += 1
        self.statements.append(Let(variable, True if condition is None else condition))
        self._blocks[-1:] = [_Nested(variable)]
        return variable

    def _contact(self, i: int, instruction: Instruction, join: str, end: str) -> None:
        level = contact(instruction.operands[0])
        if end in ("P", "F"):
            edge, pulse = self._numbering.edge(i), LocalVariable(f"p{i}")
            self.statements += [Let(NOW, level), Let(pulse, edge_pulse(edge, falling=end == "F")), Store(edge, NOW)]
            level = pulse
        self._connect(Inverse(level) if end == "I" else level, join)

    def _compare(self, i: int, instruction: Instruction) -> None:
        form = FORMS[instruction.name]
        join = next(join for join in JOINS if form.kind.name.startswith(join))
        left, right = (plain_word(operand, wide=form.wide) for operand in instruction.operands)
        if left is None or right is None:
            self._connect(self._numbering.operation(i), join)
        else:
            relation = RELATIONS[form.kind.name.removeprefix(join)]
            self._connect(Comparison(relation, left, right), join)

    def _connect(self, contact: Condition, join: str) -> None:
        self.contact = contact
        self._join(_Nested(contact), join)

    def _join(self, block: _Nested, join: str) -> None:
        if join == "LD":
            self._push(block)
            return
        last = self._blocks.pop()
        connect = Conjunction if join == "AND" else Disjunction
        self._push(_Nested(connect(last.condition, block.condition), max(last.depth, block.depth) + 1))

    def _push(self, block: _Nested) -> None:
        self._blocks.append(block)
        if block.depth > DEEPEST:
            self.named()


def edge_pulse(edge: RowElement, *, falling: bool) -> Condition:
    """Return the condition that the level `NOW` has risen or fallen since it was stored."""
    return Conjunction(Inverse(NOW), edge) if falling else Conjunction(NOW, Inverse(edge))


def are_last_outputs(instructions: Sequence[Instruction]) -> list[bool]:
    """Return, for each instruction, whether another rung or branch begins after it."""
    last, following = [False] * len(instructions), "END"
    for i in reversed(range(len(instructions))):
        last[i] = (
            following in _NEXT_RUNG
            or (following.startswith("LD") and following not in FORMS)
            or (following in FORMS and FORMS[following].kind.name.startswith("LD"))
        )
        if instructions[i].name != "NOP":
            following = instructions[i].name
    return last


class RungRecorder:
    """Writer of the statements that record; it writes none for a program that is not observed.

    A contact is recorded at its own position in the rung. A comparison that a Python function executes is recorded from
    a trial of the function, because the program executes the comparison only if its result is required. A contact of
    the error relay M8067 after such a comparison in the same rung is therefore recorded as before the comparison.

    Attributes:
        count: Number of elements in each row of records; 0 = the program is not observed. The trial of the function of
            instruction i has the index i + `count`.
    """

    def __init__(self, count: int) -> None:
        self.count = count

    def contact(self, i: int, rung: RungBuilder, gates: Iterable[Condition]) -> Iterator[Store]:
        """Yield the records of a contact or of a connection, which has been added to a rung."""
        if not self.count or rung.condition is None:
            return
        if rung.contact is not None:
            value = Operation(i + self.count) if isinstance(rung.contact, Operation) else rung.contact
            yield Store(RowElement(CONTACT_RECORD, i), value)
        yield from self.power(i, _from_records(rung.condition), gates)

    def power(self, i: int, power: Condition, gates: Iterable[Condition] = ()) -> Iterator[Store]:
        """Yield the records of the power after an instruction.

        Args:
            i: Index of the instruction.
            power: Power without master control.
            gates: Levels of master control around the instruction.
        """
        if not self.count:
            return
        zone = None
        for gate in gates:
            zone = gate if zone is None else Conjunction(zone, gate)
        if zone is not None:
            yield Store(RowElement(ZONE_RECORD, i), zone)
            power = Conjunction(RowElement(ZONE_RECORD, i), power)
        yield Store(RowElement(POWER_RECORD, i), power)


def _from_records(condition: Condition) -> Condition:
    """Return a condition that reads the record of each comparison instead of executing it."""
    match condition:
        case Operation(i):
            return RowElement(CONTACT_RECORD, i)
        case Inverse(operand):
            return Inverse(_from_records(operand))
        case Conjunction(left, right):
            return Conjunction(_from_records(left), _from_records(right))
        case Disjunction(left, right):
            return Disjunction(_from_records(left), _from_records(right))
    return condition
