"""Contacts that must change so that an output or a device turns on or off, within one observed scan.

The condition of an output is the one that the engine's builder makes of its contacts. A minimal set has no smaller
part that is sufficient. The search extends a set by one contact at a time: while the condition does not have the wanted
value, some contacts alone are the reason, and every sufficient set contains at least one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

from controller.fx.engine.code import (
    CONTACT_RECORD,
    Condition,
    Conjunction,
    Disjunction,
    Inverse,
    Let,
    LocalVariable,
    RowElement,
)
from controller.fx.engine.conditions import Numbering, RungBuilder, are_last_outputs
from controller.fx.language.instruction import DeviceOperand, Instruction, Ladder
from controller.fx.language.operand_rules import Key
from controller.fx.language.rung_shapes import ON_BUS, rungs_of
from controller.fx.observation.observation import ScanObservation

MOST_SETS: Final = 5
"""Number of sets that are returned."""
MOST_STEPS: Final = 20_000
"""Number of sets after which a search ends without having found all."""
_BREAK: Final = ("LDI", "ANI", "ORI")

Part = frozenset[int]
"""Some signals: devices, comparisons and pulses, each represented by the index of its first contact."""


@dataclass(frozen=True, slots=True)
class RequiredChange:
    """Device, comparison or pulse that must change.

    Attributes:
        contacts: Indexes of its contacts in the rung.
        device: Device; None = a comparison, or a contact of a bit of a register.
        on: Value that it must have: a device on, a comparison true, a pulse present.
    """

    contacts: tuple[int, ...]
    device: Key | None
    on: bool


@dataclass(frozen=True, slots=True)
class ChangeSet:
    """Minimal set of changes.

    Attributes:
        changes: Changes that can be looked for behind the contact.
        causes: Changes of guards and interlocks: to be named as the cause, never as contacts to bridge.
    """

    changes: tuple[RequiredChange, ...]
    causes: tuple[RequiredChange, ...]


@dataclass(frozen=True, slots=True)
class OutputReason:
    """Reason for which an output is on or off.

    Attributes:
        executed: Whether the output was executed; if not, the reason is a jump, or the step or the master control
            around it.
        driven: Whether the output had power.
        sets: Minimal sets of changes that would invert this, smallest first.
        complete: Whether no further set exists.
    """

    executed: bool
    driven: bool
    sets: tuple[ChangeSet, ...]
    complete: bool


class Reasons:
    """Reasons for the outputs of one program."""

    def __init__(self, ladder: Ladder, is_cause: Callable[[Key], bool] = lambda _: False) -> None:
        """Read the conditions of all outputs.

        Args:
            ladder: The program.
            is_cause: Function that returns whether a device is a guard or an interlock, whose change is named as cause.
        """
        self._list = ladder.instructions
        self._is_cause = is_cause
        self._conditions = dict(_output_conditions(ladder))

    def of_output(self, at: int, seen: ScanObservation, most: int = MOST_SETS) -> OutputReason:
        """Return the reason for which an output is on or off in an observed scan.

        Args:
            at: Index of the output instruction.
            seen: The scan, as executed.
            most: Largest number of sets.
        """
        if not seen.executed[at]:
            return OutputReason(executed=False, driven=False, sets=(), complete=True)
        return self._of_condition(self._conditions[at], seen, most, driven=bool(seen.powers[at]))

    def of_device(
        self, writers: Sequence[int], before: bool, seen: ScanObservation, most: int = MOST_SETS
    ) -> OutputReason:
        """Return the reason for which a device is on or off at END of an observed scan, from all of its outputs.

        OUT gives the device the value of its condition, SET turns it on, and RST and ZRST turn it off, in the order of
        the program: of two coils the last one counts. A jumped output has no effect; in an inactive step or a zone
        without master control, OUT turns its device off.

        Args:
            writers: Indexes of these outputs, in the order of the program.
            before: Whether the device was on before the scan.
            seen: The scan, as executed.
            most: Largest number of sets.
        """
        condition: Condition = before
        value = before
        for at in writers:
            power, name = bool(seen.powers[at]), self._list[at].name
            if not seen.executed[at]:
                if name == "OUT" and seen.powers[at] is not None:
                    condition = value = False
            elif name == "SET":
                condition, value = _either(condition, self._conditions[at]), value or power
            elif name in ("RST", "ZRST"):
                condition, value = _both(condition, Inverse(self._conditions[at])), value and not power
            else:
                condition, value = self._conditions[at], power
        reason = self._of_condition(condition, seen, most, driven=value)
        return replace(reason, executed=any(seen.executed[at] for at in writers))

    def _of_condition(self, condition: Condition, seen: ScanObservation, most: int, *, driven: bool) -> OutputReason:
        signals: dict[object, list[int]] = {}
        for contact in _contacts_of(condition):
            signals.setdefault(self._signal(contact, seen), []).append(contact)
        contacts = {ats[0]: ats for ats in signals.values()}
        values = {at: self._level(at, seen) for at in contacts}
        of_signals = self._of_signals(condition, {at: ats[0] for ats in contacts.values() for at in ats})
        found, complete = minimal_sets(of_signals, values, wanted=not driven, most=most)
        sets = []
        for part in found:
            changes = sorted((self._change(contacts[signal], values[signal]) for signal in part), key=_first_contact)
            causes = tuple(each for each in changes if each.device is not None and self._is_cause(each.device))
            sets.append(ChangeSet(tuple(each for each in changes if each not in causes), causes))
        return OutputReason(executed=True, driven=driven, sets=tuple(sets), complete=complete)

    def _change(self, contacts: list[int], level: bool) -> RequiredChange:
        match self._list[contacts[0]].operands:
            case (DeviceOperand(kind, number, ""),):
                return RequiredChange(tuple(contacts), (kind, number), not level)
        return RequiredChange(tuple(contacts), None, not level)

    def _signal(self, at: int, seen: ScanObservation) -> tuple[object, ...]:
        """Return what a contact reads; two contacts of a device differ if an output between them has changed it."""
        instruction = self._list[at]
        if len(instruction.operands) == 1 and instruction.name[-1] in "PF":
            return (at,)
        name = "" if len(instruction.operands) == 1 else instruction.name.lstrip("LANDOR")
        return (name, *instruction.operands, self._level(at, seen))

    def _level(self, at: int, seen: ScanObservation) -> bool:
        return bool(seen.contacts[at]) != (self._list[at].name in _BREAK)

    def _of_signals(self, condition: Condition, first: Mapping[int, int]) -> Condition:
        """Return a condition in which the first contact of each signal stands for the signal."""
        match condition:
            case RowElement(row, at):
                element = RowElement(row, first[at])
                return Inverse(element) if self._list[at].name in _BREAK else element
            case Inverse(operand):
                return Inverse(self._of_signals(operand, first))
            case Conjunction(left, right):
                return Conjunction(self._of_signals(left, first), self._of_signals(right, first))
            case Disjunction(left, right):
                return Disjunction(self._of_signals(left, first), self._of_signals(right, first))
        return condition


def minimal_sets(
    condition: Condition, values: Mapping[int, bool], *, wanted: bool, most: int | None = None
) -> tuple[list[Part], bool]:
    """Return the minimal sets of signals whose inversion gives a condition its wanted value, smallest first.

    Args:
        condition: Condition whose row elements are signals.
        values: Present value of each signal.
        wanted: Value that the condition is to have.
        most: Largest number of sets; None = all.

    Returns:
        The sets, and whether no further one exists.
    """
    found: list[Part] = []
    level: list[Part] = [frozenset()]
    searched = 0
    while level:
        further: dict[Part, None] = {}
        for part in level:
            if any(each <= part for each in found):
                continue
            searched += 1
            if searched > MOST_STEPS:
                return found, False
            value, reason = _reason(condition, values, part)
            if value == wanted:
                if most is not None and len(found) == most:
                    return found, False
                found.append(part)
            else:
                further.update(dict.fromkeys(part | {signal} for signal in reason - part))
        level = list(further)
    return found, True


def _reason(condition: Condition, values: Mapping[int, bool], inverted: Part) -> tuple[bool, Part]:
    """Return the value of a condition, and signals that alone determine it, as few as can be found easily."""
    match condition:
        case Inverse(operand):
            value, reason = _reason(operand, values, inverted)
            return not value, reason
        case Conjunction(left, right) | Disjunction(left, right):
            one, other = _reason(left, values, inverted), _reason(right, values, inverted)
            decisive = isinstance(condition, Disjunction)
            deciding = [reason for value, reason in (one, other) if value is decisive]
            if deciding:
                return decisive, min(deciding, key=lambda reason: len(reason - inverted))
            return not decisive, one[1] | other[1]
        case RowElement(_, signal):
            return values[signal] != (signal in inverted), frozenset((signal,))
        case bool():
            return condition, frozenset()
    raise TypeError(f"not a condition of contacts: {condition!r}")


class _ContactBuilder(RungBuilder):
    """Builder whose conditions refer to contacts by the index of their instruction."""

    def __init__(self) -> None:
        super().__init__([], Numbering())
        self._at = 0
        self.named_conditions: dict[str, Condition] = {}

    def add(self, i: int, instruction: Instruction) -> bool:
        self._at = i
        added = super().add(i, instruction)
        for statement in self.statements:
            match statement:
                case Let(LocalVariable(name), value) if name.startswith("t"):
                    self.named_conditions[name] = self.resolved(value)  # type: ignore[arg-type]
        self.statements.clear()
        return added

    def resolved(self, condition: Condition) -> Condition:
        """Return a condition without intermediate results."""
        match condition:
            case LocalVariable(name):
                return self.named_conditions[name]
            case Inverse(operand):
                return Inverse(self.resolved(operand))
            case Conjunction(left, right):
                return Conjunction(self.resolved(left), self.resolved(right))
            case Disjunction(left, right):
                return Disjunction(self.resolved(left), self.resolved(right))
        return condition

    def _connect(self, contact: Condition, join: str) -> None:  # noqa: ARG002 - the contact itself is not needed
        super()._connect(RowElement(CONTACT_RECORD, self._at), join)


def _output_conditions(ladder: Ladder) -> list[tuple[int, Condition]]:
    """Return the condition of each output, without the step and the master control around it."""
    conditions: list[tuple[int, Condition]] = []
    last = are_last_outputs(ladder.instructions)
    rungs = [*(rung.first for rung in rungs_of(ladder)), len(ladder.instructions)]
    for first, end in pairwise(rungs):
        builder = _ContactBuilder()
        for i in range(first, end):
            instruction = ladder.instructions[i]
            if instruction.name in ON_BUS or instruction.name == "NOP" or builder.add(i, instruction):
                continue
            condition = builder.condition
            conditions.append((i, True if condition is None else builder.resolved(condition)))
            if last[i]:
                builder.end_output()
    return conditions


def _either(left: Condition, right: Condition) -> Condition:
    """Return a disjunction, without constants."""
    if isinstance(left, bool):
        return True if left else right
    return True if right is True else Disjunction(left, right)


def _both(left: Condition, right: Condition) -> Condition:
    """Return a conjunction, without constants."""
    if isinstance(left, bool):
        return right if left else False
    return Conjunction(left, right)


def _contacts_of(condition: Condition) -> list[int]:
    match condition:
        case RowElement(_, at):
            return [at]
        case Inverse(operand):
            return _contacts_of(operand)
        case Conjunction(left, right) | Disjunction(left, right):
            return sorted({*_contacts_of(left), *_contacts_of(right)})
    return []


def _first_contact(change: RequiredChange) -> int:
    return change.contacts[0]
