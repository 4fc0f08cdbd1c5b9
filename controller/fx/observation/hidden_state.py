"""State of a program that is not part of its devices, so that nobody can read it from a running controller."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from controller.fx.engine.applied.table import LEVELS
from controller.fx.engine.cpu import RETENTIVE_TIMER_NUMBERS
from controller.fx.language.instruction import DeviceOperand, Digits, Instruction, Ladder
from controller.fx.language.instruction_set import FORMS
from controller.fx.language.operand_rules import FIRST_HIGH_SPEED
from controller.fx.language.rung_shapes import CONTACTS

_BETWEEN_SCANS: Final = frozenset({"EI", "DI", "REF", "REFF", "FROM", "TO", "RD3A", "WR3A", "TRD"})
"""Instructions that depend on terminals, special function modules or the clock, or let a routine run at any time."""


def has_hidden_state(instruction: Instruction) -> bool:
    """Return whether an instruction depends on more than devices and the levels it has stored.

    These are instructions with a drive state (PWM, PID, RAMP and others), devices with an index, because which device
    they are is known only at run time, high-speed counters, and what takes place between two scans.
    """
    name, operands = instruction.name, instruction.operands
    kind = FORMS[name].kind.name if name in FORMS else name
    return name == "I" or kind in LEVELS or kind in _BETWEEN_SCANS or any(map(_is_hidden, operands))


def _is_hidden(operand: object) -> bool:
    device = operand.device if isinstance(operand, Digits) else operand
    if getattr(device, "index", ""):
        return True
    if not isinstance(device, DeviceOperand):
        return False
    return device.kind in "VZ" or (device.kind == "C" and device.number >= FIRST_HIGH_SPEED)


def stored_levels(ladder: Ladder) -> Iterator[int]:
    """Yield the indexes of the instructions that keep the level of their last execution.

    They are STL, the pulse contacts and, outside steps, PLS, PLF, the pulsed forms, counters and retentive timers; a
    step that turns off clears those of its outputs.
    """
    in_step = False
    for at, instruction in enumerate(ladder.instructions):
        if instruction.name in ("STL", "RET"):
            in_step = instruction.name == "STL"
            if in_step:
                yield at
        elif instruction.name in CONTACTS:
            if instruction.name[-1] in "PF":
                yield at
        elif not in_step and _stores_level(instruction):
            yield at


def _stores_level(instruction: Instruction) -> bool:
    if instruction.name in ("PLS", "PLF"):
        return True
    match instruction.name, instruction.operands:
        case "OUT", (DeviceOperand("C"), *_):
            return True
        case "OUT", (DeviceOperand("T", number), *_):
            return number in RETENTIVE_TIMER_NUMBERS
    return instruction.name in FORMS and FORMS[instruction.name].pulsed
