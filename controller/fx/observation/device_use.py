"""Devices that an instruction reads and drives, by the roles of its operands."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from controller.fx.language.instruction import Constant, DeviceOperand, Digits, Instruction
from controller.fx.language.instruction_set import DRIVEN, FORMS
from controller.fx.language.operand_rules import Key, covered_devices

_WRITTEN: Final = DRIVEN | {"reset", "zone", "reset at once", "Y", "X or Y", "D", "C"}
_ONLY_READ: Final = frozenset({"STL", "ABSD", "INCD", "ECMP", "EZCP", "TCMP", "TZCP", "TO", "WR3A"})
_LAST_WRITTEN: Final = frozenset(
    {"SQR", "FLT", "EMOV", "EADD", "ESUB", "EMUL", "EDIV", "ESQR", "INT", "SIN", "COS", "TAN", "RAD", "DEG", "SPD"}
)
"""Instructions whose role "D" is read, except the last operand."""
_WORK_WORDS: Final = frozenset({("TTMR", 0), ("RAMP", 2)})
"""Instructions that keep a value in the word after an operand."""


def device_uses(instruction: Instruction) -> Iterator[tuple[Key, bool]]:
    """Yield each device of an instruction, and whether the instruction writes it; otherwise it reads it.

    A device that is read and written, such as that of INC, is written. The second operand of ZRST extends the zone of
    the first. Devices with an index are not yielded, because they are known only at run time.

    Examples:
        >>> [(key, written) for key, written in device_uses(Instruction("SET", (DeviceOperand("M", 5),)))]
        [(('M', 5), True)]
    """
    name, operands = instruction.name, instruction.operands
    if name not in FORMS:
        return
    kind = FORMS[name].kind
    if kind.name == "ZRST":
        yield from _zone(instruction)
        return
    for n, (role, operand) in enumerate(zip(kind.operands, operands, strict=False)):
        device = operand.device if isinstance(operand, Digits) else operand
        if isinstance(device, DeviceOperand) and device.index:
            yield ((f"{device.index[0]}", int(device.index[1:])), False)
            continue
        written = role in _WRITTEN and _is_written(kind.name, role, n, len(operands))
        yield from ((key, written) for key in covered_devices(instruction, n, operand))
        yield from ((key, written) for key in _further_words(instruction, n))


def _further_words(instruction: Instruction, n: int) -> Iterator[Key]:
    """Yield the devices after those of `covered_devices`: high words of 32 bits and of products, work words."""
    form, operand = FORMS[instruction.name], instruction.operands[n]
    if not isinstance(operand, DeviceOperand) or operand.index:
        return
    covered = len(list(covered_devices(instruction, n, operand)))
    count = covered
    if operand.kind in "DR":
        product = form.kind.name in ("MUL", "DIV") and n == 2
        count *= (2 if form.wide else 1) * (2 if product else 1)
        count += (form.kind.name, n) in _WORK_WORDS
    elif (form.kind.name, n) == ("MTR", 1) and isinstance(outputs := instruction.operands[3], Constant):
        count = outputs.value
    yield from ((operand.kind, operand.number + extra) for extra in range(covered, count))


def _is_written(name: str, role: str, n: int, count: int) -> bool:
    if name in _ONLY_READ:
        return role == "coil"
    if role == "D" and name in _LAST_WRITTEN:
        return n == count - 1
    if name in ("HSCS", "HSCR", "HSZ"):
        return n >= 2 and role != "C"
    return not (name == "TRD" and role != "clock")


def _zone(instruction: Instruction) -> Iterator[tuple[Key, bool]]:
    match instruction.operands:
        case (DeviceOperand(kind, first, ""), DeviceOperand(_, last, "")):
            yield from (((kind, number), True) for number in range(first, last + 1))
