"""Operand rules of an FX2N: ranges of devices, numbers and groups, and rules of individual instructions.

The ranges of devices follow fx2n.md 1.5, whose verification marks apply here too. The following are from memory and
have not been verified: the limits of numbers, the rules of individual instructions, that basic instructions accept no
index, that Z names a 32-bit number in index registers, and that C200 to C255 are valid only in 32-bit forms.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from controller.core.devices import ANNUNCIATORS, device_name, is_32_bit_counter
from controller.fx.language.cpu_model import FX2N, FX3U, CpuModel
from controller.fx.language.instruction import (
    Constant,
    DeviceOperand,
    Digits,
    Instruction,
    Nest,
    Operand,
    Pointer,
    RealConstant,
    WordBit,
)
from controller.fx.language.instruction_set import Form


class OperandError(ValueError):
    """Raised for an invalid FX2N operand; the message states the error and, after a semicolon, the expected form."""


_WORDS: Final = frozenset(
    {
        "source",
        "target",
        "words",
        "target words",
        "source words",
        "count",
        "float",
        "D",
        "real",
        "preset",
        "bit or word",
        "bit or target",
    }
)
"""Operand roles in which T, C, D, V and Z are used as numbers."""

_NUMBERS: Final = {
    ("SMOV", 1): (1, 4),
    ("SMOV", 2): (1, 4),
    ("SMOV", 4): (1, 4),
    ("MTR", 3): (2, 8),
    ("FROM", 0): (0, 7),
    ("TO", 0): (0, 7),
    ("FROM", 1): (0, 32767),
    ("TO", 1): (0, 32767),
    ("FROM", 3): (1, 32767),
    ("TO", 3): (1, 32767),
    ("RD3A", 0): (0, 7),
    ("WR3A", 0): (0, 7),
    ("RD3A", 1): (1, 2),
    ("WR3A", 1): (1, 2),
    ("RS", 1): (0, 4096),
    ("RS", 3): (0, 4096),
    ("ASCI", 2): (1, 256),
    ("HEX", 2): (1, 256),
    ("CCD", 2): (1, 256),
    ("BMOV", 2): (1, 512),
    ("FMOV", 2): (1, 512),
    ("ROR", 1): (1, 16),
    ("ROL", 1): (1, 16),
    ("RCR", 1): (1, 16),
    ("RCL", 1): (1, 16),
    ("SFTR", 2): (1, 1024),
    ("SFTL", 2): (1, 1024),
    ("SFTR", 3): (1, 1024),
    ("SFTL", 3): (1, 1024),
    ("WSFR", 2): (1, 512),
    ("WSFL", 2): (1, 512),
    ("WSFR", 3): (1, 512),
    ("WSFL", 3): (1, 512),
    ("SFWR", 2): (2, 512),
    ("SFRD", 2): (2, 512),
    ("DECO", 2): (1, 8),
    ("ENCO", 2): (1, 8),
    ("BON", 2): (0, 15),
    ("MEAN", 2): (1, 64),
    ("ANS", 1): (1, 32767),
    ("STMR", 1): (1, 32767),
    ("REF", 1): (8, 256),
    ("REFF", 0): (0, 60),
    ("ABSD", 3): (1, 64),
    ("INCD", 3): (1, 64),
    ("TTMR", 1): (0, 2),
    ("RAMP", 3): (1, 32767),
}
"""Lowest and highest constant that an instruction accepts for an operand (from memory)."""
_WIDE_NUMBERS: Final = {
    ("ROR", 1): (1, 32),
    ("ROL", 1): (1, 32),
    ("RCR", 1): (1, 32),
    ("RCL", 1): (1, 32),
    ("BON", 2): (0, 31),
}
"""Limits that differ from `_NUMBERS` in the 32-bit form (from memory)."""

SPANS: Final = {
    ("CMP", 2): 3,
    ("ZCP", 3): 3,
    ("ECMP", 2): 3,
    ("EZCP", 3): 3,
    ("TCMP", 4): 3,
    ("TZCP", 3): 3,
    ("TCMP", 3): 3,
    ("TZCP", 0): 3,
    ("TZCP", 1): 3,
    ("TZCP", 2): 3,
    ("TRD", 0): 7,
    ("IST", 0): 8,
    ("STMR", 2): 4,
    ("HSZ", 3): 3,
    ("SPD", 2): 3,
    ("PID", 2): 25,
    ("MTR", 0): 8,
}
"""Number of consecutive devices covered by an operand (docs/sources/fx2n.md 1.2, from memory)."""


def limits(kind: str, cpu: CpuModel = FX2N) -> str:
    """Return the number ranges of a kind of device as text.

    Examples:
        >>> limits("X"), limits("M")
        ('X0 to X377', 'M0 to M3071 and M8000 to M8255')
    """
    joined = (range(cpu.sizes["D"]),) if kind == "D" else cpu.ranges[kind]
    return " and ".join(f"{device_name(kind, span[0])} to {device_name(kind, span[-1])}" for span in joined)


def require_in_range(kind: str, number: int, count: int = 1, cpu: CpuModel = FX2N) -> None:
    """Raise OperandError unless the CPU has the device and the `count` - 1 devices after it."""
    span = next((span for span in cpu.ranges[kind] if number in span), None)
    if span is None:
        other = "" if cpu.is_fx3 or not FX3U.has(kind, number) else ", or use --cpu fx3u"
        name = device_name(kind, number)
        raise OperandError(f"{name} does not exist on an {cpu.name}; it has {limits(kind, cpu)}{other}")
    if number + count > span.stop:
        first, last = device_name(kind, number), device_name(kind, span[-1])
        raise OperandError(f"{count} devices starting at {first} extend beyond {last}; start lower")


def check_operand(instruction: Instruction, form: Form, n: int, cpu: CpuModel = FX2N) -> str | None:
    """Return the error in operand `n`, which is of a valid kind; None = no error."""
    operand, place = instruction.operands[n], form.kind.operands[n]
    wide = form.wide or (place == "preset" and _is_32_bit_counter(instruction.operands[0]))
    if form.kind.fnc is None and _index(operand):
        return f"{operand} has an index, which only an FX3 accepts in {instruction.name}; remove it"
    try:
        match operand:
            case Constant(value, base):
                return _constant_error(value, base, wide) or _number_error(form, n, value)
            case Digits(digits, device):
                if not 1 <= digits <= (8 if wide else 4):
                    return f"{operand} has {digits} digits; expected K1 to K{8 if wide else 4}"
                require_in_range(device.kind, device.number, 4 * digits, cpu)
            case DeviceOperand(kind, number):
                span = SPANS.get((form.kind.name, n), 1)
                if place in _WORDS:
                    return _word_error(operand, cpu, span, wide=wide)
                require_in_range(kind, number, span, cpu)
            case WordBit() | Pointer() | Nest() | RealConstant():
                pass
    except OperandError as error:
        return str(error)
    return None


def _is_32_bit_counter(operand: Operand) -> bool:
    return isinstance(operand, DeviceOperand) and operand.kind == "C" and is_32_bit_counter(operand.number)


def _index(operand: Operand) -> str:
    match operand:
        case DeviceOperand(_, _, index) | Constant(_, _, index) | Digits(_, DeviceOperand(_, _, index)):
            return index
        case _:
            return ""


def _constant_error(value: int, base: str, wide: bool) -> str | None:
    bits = 32 if wide else 16
    low, high = (0, 2**bits - 1) if base == "H" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    if low <= value <= high:
        return None
    span = f"H0 to H{high:X}" if base == "H" else f"K{low} to K{high}"
    return f"{Constant(value, 'H' if base == 'H' else 'K')} does not fit into {bits} bits; expected {span}"


def _number_error(form: Form, n: int, value: int) -> str | None:
    at = (form.kind.name, n)
    span = (_WIDE_NUMBERS.get(at) if form.wide else None) or _NUMBERS.get(at)
    if span is None or span[0] <= value <= span[1]:
        return None
    return f"{value} is outside its range; expected K{span[0]} to K{span[1]}"


def _word_error(device: DeviceOperand, cpu: CpuModel, span: int, *, wide: bool) -> str | None:
    """Return the error in a device used as one or more numbers of 16 or 32 bits; None = no error."""
    if device.kind in "XYMS":
        return None
    if _is_32_bit_counter(device):
        return None if wide else f"{device} has 32 bits; use the 32-bit form (D...) or one of C0 to C199"
    if wide and device.kind == "V":
        return f"{device} is the high half of a 32-bit number; write Z{device.number}, which includes both halves"
    if wide and device.kind != "Z":
        require_in_range(device.kind, device.number, 2 * span, cpu)
    elif span > 1:
        require_in_range(device.kind, device.number, span, cpu)
    return None


def check_combination(instruction: Instruction, form: Form) -> str | None:
    """Return the error in the combination of operands; None = no error."""
    rule = _RULES.get(form.kind.name)
    return rule(instruction.operands) if rule else None


SPECIAL: Final = 8000
"""Number of the first special relay and register."""
FIRST_HIGH_SPEED: Final = 235
"""First counter that counts a terminal instead of its rung (docs/sources/fx2n.md 1.5, verified)."""

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
        and not _is_32_bit_counter(coil)
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
    if first.kind != last.kind or _is_32_bit_counter(first) != _is_32_bit_counter(last):
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


COUNTER_INTERRUPTS: Final = range(10, 61, 10)
"""Numbers of the interrupts I010 to I060."""
_INPUT_INTERRUPTS: Final = tuple(100 * n + edge for n in range(6) for edge in (0, 1))
_TIMER_INTERRUPTS: Final = tuple(100 * n + period_ms for n in (6, 7, 8) for period_ms in range(10, 100))
INTERRUPTS: Final = frozenset((*COUNTER_INTERRUPTS, *_INPUT_INTERRUPTS, *_TIMER_INTERRUPTS))
"""Numbers of the interrupt labels: inputs I000 to I501 (1 = rising edge of X0 to X5), timers I610 to I899 (period 10 to
99 ms) and counters I010 to I060. Verified in source [13]; the direction of the edges from memory."""


def require_interrupt(number: int) -> None:
    """Raise OperandError unless the number is that of an interrupt label."""
    if number not in INTERRUPTS:
        raise OperandError(
            f"I{number:03} is not an interrupt; use I000 to I501 (inputs), I610 to I899 (timers) or I010 to I060"
        )


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
