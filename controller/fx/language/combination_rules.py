"""Rules of an FX2N for the combination of operands of individual instructions.

The rules are from memory and have not been verified.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from controller.core.devices import ANNUNCIATORS
from controller.fx.language.instruction import Constant, DeviceOperand, Instruction, Operand, Pointer
from controller.fx.language.instruction_set import Form
from controller.fx.language.operand_rules import (
    COUNTER_INTERRUPTS,
    FIRST_HIGH_SPEED,
    SPECIAL,
    is_32_bit_counter_operand,
)


def check_combination(instruction: Instruction, form: Form) -> str | None:
    """Return the error in the combination of operands; None = no error."""
    rule = _RULES.get(form.kind.name)
    return rule(instruction.operands) if rule else None


Rule = Callable[[tuple[Operand, ...]], str | None]


def _out(operands: tuple[Operand, ...]) -> str | None:
    coil, preset = operands[0], operands[1:]
    timed = isinstance(coil, DeviceOperand) and coil.kind in "TC"
    if timed and not preset:
        return f"the preset of {coil} is missing; write OUT {coil} K10 or OUT {coil} D0"
    if preset and not timed:
        return f"{coil} takes no preset; only T and C have one"
    least = 1 if isinstance(coil, DeviceOperand) and coil.kind == "T" else 0
    if (
        preset
        and isinstance(preset[0], Constant)
        and not is_32_bit_counter_operand(coil)
        and not least <= preset[0].value <= 32767
    ):
        return f"{preset[0]} is not a valid preset; expected K{least} to K32767"
    return None


def _no_special(operands: tuple[Operand, ...]) -> str | None:
    device = operands[-1]
    if isinstance(device, DeviceOperand) and device.kind == "M" and device.number >= 8000:
        return f"{device} is a special relay; use Y or an M below M8000"
    return None


def _state(operands: tuple[Operand, ...]) -> str | None:
    device = operands[0]
    if isinstance(device, DeviceOperand) and device.number in ANNUNCIATORS:
        return f"{device} is an annunciator, not a step; use S0 to S899"
    return None


def _zone(operands: tuple[Operand, ...]) -> str | None:
    first, last = operands
    if not (isinstance(first, DeviceOperand) and isinstance(last, DeviceOperand)):
        return None
    if first.kind != last.kind or is_32_bit_counter_operand(first) != is_32_bit_counter_operand(last):
        return f"{first} and {last} are of different kinds; write the first and last device of one kind"
    if first.number > last.number and not (first.index or last.index):
        return f"{first} is after {last}; write the lower device first"
    if first.kind in "MD" and first.number < SPECIAL <= last.number:
        return f"{first} to {last} extends into the special devices; end it before {first.kind}{SPECIAL}"
    return None


def _annunciator(operands: tuple[Operand, ...]) -> str | None:
    state = operands[2]
    if isinstance(state, DeviceOperand) and state.number not in ANNUNCIATORS:
        return f"{state} is not an annunciator; use S900 to S999"
    return _special_timer(operands)


def _special_timer(operands: tuple[Operand, ...]) -> str | None:
    timer = operands[0]
    if isinstance(timer, DeviceOperand) and timer.number >= 200:
        return f"{timer} is not a 100 ms timer; use T0 to T199"
    return None


def _refresh(operands: tuple[Operand, ...]) -> str | None:
    head, count = operands
    if isinstance(head, DeviceOperand) and not head.index and head.number % 8:
        return f"{head} is not the first of a group of eight; use a number that ends in 0"
    if isinstance(count, Constant) and not count.index and count.value % 8:
        return f"{count} is not a multiple of eight; write K8, K16 and so on"
    return None


def _modes(operands: tuple[Operand, ...]) -> str | None:
    first, last = operands[1:]
    assert isinstance(first, DeviceOperand)  # noqa: S101 - narrows; the kinds were checked
    assert isinstance(last, DeviceOperand)  # noqa: S101 - narrows; the kinds were checked
    if not 20 <= first.number < last.number <= 899:
        return f"{first} and {last} are not a range of automatic steps; expected two of S20 to S899, the lower first"
    return None


def _call(operands: tuple[Operand, ...]) -> str | None:
    if operands[0] == Pointer("P", 63):
        return "P63 is END, not a subroutine; call another label"
    return None


def _fast_output(operands: tuple[Operand, ...]) -> str | None:
    output = operands[-1]
    if isinstance(output, DeviceOperand) and output.number > 1:
        return f"{output} is not a pulse output; use Y0 or Y1"
    return None


def _positioning_output(operands: tuple[Operand, ...]) -> str | None:
    output = operands[2]
    if isinstance(output, DeviceOperand) and output.number > 2:
        return f"{output} is not a positioning output; use Y0 to Y2"
    return None


def _high_speed(operands: tuple[Operand, ...]) -> str | None:
    counter, target = operands[-2:]
    if not (isinstance(counter, DeviceOperand) and counter.number >= FIRST_HIGH_SPEED):
        return f"{counter} is not a high-speed counter; use C235 to C255"
    if isinstance(target, DeviceOperand) and target.kind == "C" and target != counter:
        return f"{target} is another counter; only {counter} itself can be reset"
    if isinstance(target, Pointer) and target.number not in COUNTER_INTERRUPTS:
        return f"{target} is not a counter interrupt; use I010, I020, I030, I040, I050 or I060"
    return None


def _speed_input(operands: tuple[Operand, ...]) -> str | None:
    terminal = operands[0]
    if isinstance(terminal, DeviceOperand) and terminal.number > 5:
        return f"{terminal} is not a fast input; use X0 to X5"
    return None


def _matrix(operands: tuple[Operand, ...]) -> str | None:
    inputs, outputs = operands[:2]
    for head in (inputs, outputs):
        if isinstance(head, DeviceOperand) and head.number % 8:
            return f"{head} is not the first of a group of eight; use a number that ends in 0"
    return None


def _shift(operands: tuple[Operand, ...]) -> str | None:
    length, by = operands[2:]
    if isinstance(length, Constant) and isinstance(by, Constant) and by.value > length.value:
        return f"{by} is more than the {length.value} devices shifted; expected {length} or less"
    return None


_RULES: Final[dict[str, Rule]] = {
    "OUT": _out,
    "MC": _no_special,
    "PLS": _no_special,
    "PLF": _no_special,
    "STL": _state,
    "ZRST": _zone,
    "ANS": _annunciator,
    "STMR": _special_timer,
    "REF": _refresh,
    "IST": _modes,
    "CALL": _call,
    "PLSY": _fast_output,
    "PLSR": _fast_output,
    "PWM": _fast_output,
    "DRVI": _positioning_output,
    "DRVA": _positioning_output,
    "HSCS": _high_speed,
    "HSCR": _high_speed,
    "HSZ": _high_speed,
    "SPD": _speed_input,
    "MTR": _matrix,
    "SFTR": _shift,
    "SFTL": _shift,
    "WSFR": _shift,
    "WSFL": _shift,
}
