"""Contacts of an answer: names, places in the program, and which of them are safeguards."""

from __future__ import annotations

from controller.core.devices import device_name
from controller.debug.why.answer import WhyContact, WhySet
from controller.debug.why.program import ExplainedProgram
from controller.fx.language.operand_rules import Key
from controller.fx.observation.device_use import device_uses
from controller.fx.observation.why import ChangeSet, RequiredChange
from controller.program.texts.operator import Text


class Contacts:
    """Contacts of one program."""

    def __init__(self, program: ExplainedProgram) -> None:
        """Take a program."""
        self._program = program
        self._list = program.reference.ladder.instructions

    def set_of(self, of: Key, each: ChangeSet) -> WhySet:
        """Return a minimal set for a device; safeguards and interlocks of this device are its causes."""
        changes = (*each.changes, *each.causes)
        guards = [change for change in changes if self._is_guard(change, of)]
        return WhySet(
            tuple(self.contact(change) for change in changes if change not in guards),
            tuple(self.contact(change) for change in guards),
        )

    def _is_guard(self, change: RequiredChange, of: Key) -> bool:
        return any(self._program.is_safeguard(key, of) for key in self.read_by(change))

    def contact(self, change: RequiredChange) -> WhyContact:
        """Return a contact with its place in the program."""
        at, reference = change.contacts[0], self._program.reference
        instruction = self._list[at]
        device = device_name(*change.device) if change.device else str(instruction).partition(" ")[2]
        if change.device is None and instruction.name.lstrip("LANDOR")[:1] in "=<>":
            device = f"{instruction.operands[0]} {instruction.name.lstrip('LANDOR')} {instruction.operands[1]}"
        tag = self._program.tag(change.device) if change.device else Text("", "")
        number = reference.rung_at(at)
        return WhyContact(device, tag, change.on, at, number, reference.step_numbers[at], str(instruction))

    def read_by(self, change: RequiredChange) -> list[Key]:
        """Return the devices of a contact or a comparison."""
        if change.device is not None:
            return [change.device]
        return [key for key, _ in device_uses(self._list[change.contacts[0]])]
