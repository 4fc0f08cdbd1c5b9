"""State of a program that is not part of its devices, so that nobody can read it from a running controller."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from controller.fx.engine.applied.table import LEVELS
from controller.fx.engine.cpu import RETENTIVE_TIMER_NUMBERS
from controller.fx.language.instruction import Constant, DeviceOperand, Digits, Instruction, Ladder
from controller.fx.language.instruction_set import FORMS
from controller.fx.language.operand_rules import FIRST_HIGH_SPEED, Key
from controller.fx.language.rung_shapes import CONTACTS
from controller.fx.observation.device_use import device_uses

_BETWEEN_SCANS: Final = frozenset({"EI", "DI", "REF", "REFF", "FROM", "TO", "RD3A", "WR3A", "TRD"})
"""Instructions that depend on terminals, special function modules or the clock, or let a routine run at any time."""


def hidden_instructions(ladder: Ladder) -> Iterator[int]:
    """Yield the indexes of the instructions that depend on more than devices and the levels they have stored.

    These are instructions with a drive state (PWM, PID, RAMP and others), devices with an index, because which device
    they are is known only at run time, high-speed counters, what takes place between two scans, and the coils of timers
    whose current value does not tell when they were started.
    """
    unclear = {at for timer in _on_delay_timers(ladder.instructions) if timer.is_unclear for at in timer.coils}
    for at, each in enumerate(ladder.instructions):
        if at in unclear or _has_hidden_state(each):
            yield at


def _has_hidden_state(instruction: Instruction) -> bool:
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


class _OnDelayTimer(NamedTuple):
    """Timer that is not retentive.

    Its current value tells when it was started, until it reaches the preset and stays there. With a higher preset, or
    after jumped scans, the recomputed value at END differs, unless the same scan changes the value once more.

    Attributes:
        coils: Indexes of its coils.
        is_constant: Whether all coils have the same constant preset.
        is_written: Whether another instruction writes the current value, so that a stopped timer can have one.
        is_changed_again: Whether a scan can change the value after a coil: by another coil, RST, or a loop.
    """

    coils: Sequence[int]
    is_constant: bool
    is_written: bool
    is_changed_again: bool

    @property
    def is_unclear(self) -> bool:
        """True if its current value does not tell in every scan when it was started."""
        return self.is_written or (self.is_changed_again and not self.is_constant)


def _on_delay_timers(instructions: Sequence[Instruction]) -> Iterator[_OnDelayTimer]:
    """Yield the timers with a coil that are not retentive."""
    coils: dict[int, list[int]] = defaultdict(list)
    written: set[Key] = set()
    cleared: set[Key] = set()
    for at, each in enumerate(instructions):
        match each.name, each.operands:
            case "OUT", (DeviceOperand("T", number), *_):
                coils[number].append(at)
            case _:
                keys = cleared if each.name in ("RST", "ZRST", "ZRSTP") else written
                keys.update(key for key, is_written in device_uses(each) if is_written)
    repeated = _repeated(instructions)
    for number, places in coils.items():
        if number not in RETENTIVE_TIMER_NUMBERS:
            key, presets = ("T", number), {instructions[at].operands[1] for at in places}
            yield _OnDelayTimer(
                places,
                is_constant=len(presets) == 1 and isinstance(presets.pop(), Constant),
                is_written=key in written,
                is_changed_again=key in cleared or len(places) > 1 or not repeated.isdisjoint(places),
            )


def _repeated(instructions: Sequence[Instruction]) -> frozenset[int]:
    """Return the indexes of the instructions that one scan may execute more than once: loops and subroutines."""
    found: set[int] = set()
    loops: list[int] = []
    labels: dict[object, int] = {}
    for at, each in enumerate(instructions):
        match each.name:
            case "FOR":
                loops.append(at)
            case "NEXT" if loops:
                found.update(range(loops.pop(), at))
            case "P":
                labels[each.operands[0]] = at
            case "CJ" | "CJP":
                found.update(range(labels.get(each.operands[0], at), at))
            case "FEND":
                found.update(range(at, len(instructions)))
    return frozenset(found)


def stored_levels(ladder: Ladder) -> Iterator[int]:
    """Yield the indexes of the instructions that keep the level of their last execution.

    They are STL, the pulse contacts and, outside steps, PLS, PLF, the pulsed forms, counters, retentive timers, and
    other timers that one scan changes more than once; a step that turns off clears those of its outputs.
    """
    in_step = False
    again = {at for timer in _on_delay_timers(ladder.instructions) if timer.is_changed_again for at in timer.coils}
    for at, instruction in enumerate(ladder.instructions):
        if instruction.name in ("STL", "RET"):
            in_step = instruction.name == "STL"
            if in_step:
                yield at
        elif instruction.name in CONTACTS:
            if instruction.name[-1] in "PF":
                yield at
        elif not in_step and (at in again or _stores_level(instruction)):
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
