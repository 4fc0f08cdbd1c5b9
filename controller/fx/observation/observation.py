"""Contacts, power and coils of one scan, by index of the instruction."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from controller.fx.language.instruction import Instruction
from controller.fx.language.rung_shapes import CONTACTS, ON_BUS

_JOINS: Final = frozenset({"INV", "ANB", "ORB", "MPS", "MRD", "MPP", "NOP"})

Value = bool | None
"""Value of a contact, a coil or a power; None = unknown, or the instruction has none."""


class ObservedAt(StrEnum):
    """Time to which the values of an observation refer."""

    AS_EXECUTED = "as executed"
    """Each contact at the time when its rung was executed."""
    END_VALUES = "END values"
    """All contacts from the devices at END, as in the monitor of GX Works."""


class FlowState(StrEnum):
    """FlowState of a symbol or a wire, for its colour; the value is the name of its CSS class."""

    ON = "on"
    OFF = "off"
    NOT_EXECUTED = "not-executed"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class ScanObservation:
    """One view of one scan. Every tuple has one element for each instruction.

    Attributes:
        view: Time to which the values refer.
        executed: Whether the instruction was executed: false if it was skipped by a jump, or is in an inactive step,
            in a zone without master control or in a subroutine that was not called. In a loop, the last execution
            counts.
            END values do not show jumps and calls. None = END, NEXT and others that have no record.
        contacts: Whether the contact connects; an LDI connects while its device is off. None for other instructions.
        powers: Power after the instruction: the result of its block up to here, without the contacts to the left of a
            block that ANB connects, or the drive of an output.
        coils: Whether the output was driven; in END values, whether its device is on (for a timer or counter,
            its coil). None for contacts, and in END values for applied instructions.
    """

    view: ObservedAt
    executed: tuple[Value, ...]
    contacts: tuple[Value, ...]
    powers: tuple[Value, ...]
    coils: tuple[Value, ...]

    def state(self, i: int, instruction: Instruction) -> FlowState:
        """Return the state of the symbol of an instruction.

        A contact is on if it connects, and an output if it is driven; all others have the state of their power.
        """
        if self.executed[i] is False and not (is_output(instruction) and self.coils[i] is not None):
            return FlowState.NOT_EXECUTED
        if is_contact(instruction):
            return state_of(self.contacts[i])
        if is_output(instruction):
            return state_of(self.coils[i])
        return state_of(self.powers[i])


def state_of(value: Value) -> FlowState:
    """Return the state of something that is on, off or unknown."""
    return FlowState.UNKNOWN if value is None else FlowState.ON if value else FlowState.OFF


def is_contact(instruction: Instruction) -> bool:
    """Return whether an instruction is a contact or a comparison."""
    return instruction.name in CONTACTS


def is_output(instruction: Instruction) -> bool:
    """Return whether an instruction is a coil or an applied instruction at the end of a rung."""
    name = instruction.name
    return name not in CONTACTS and name not in _JOINS and name not in ON_BUS
