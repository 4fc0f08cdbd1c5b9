"""Operand rules of an FX2N: devices, numbers, groups, single instructions, and the devices that an operand covers.

The ranges of devices follow fx2n.md 1.5, whose verification marks apply here too. The following are from memory and
have not been verified: the limits of numbers, the rules of individual instructions, that basic instructions accept no
index, that Z names a 32-bit number in index registers, and that C200 to C255 are valid only in 32-bit forms.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from controller.core.devices import device_name, is_32_bit_counter
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
from controller.fx.language.instruction_set import FORMS, Form


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


SPECIAL: Final = 8000
"""Number of the first special relay and register."""
FIRST_HIGH_SPEED: Final = 235
"""First counter that counts a terminal instead of its rung (docs/sources/fx2n.md 1.5, verified)."""


def limits(kind: str, cpu: CpuModel = FX2N) -> str:
    """Return the number ranges of a kind of device as text.

    Examples:
        >>> limits("X"), limits("M")
        ('X0 to X377', 'M0 to M3071 and M8000 to M8255')
    """
    joined = (range(cpu.ranges["D"][-1].stop),) if kind == "D" else cpu.ranges[kind]
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
    wide = form.wide or (place == "preset" and is_32_bit_counter_operand(instruction.operands[0]))
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


def is_32_bit_counter_operand(operand: Operand) -> bool:
    """Return whether an operand is one of C200 to C255."""
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
    if is_32_bit_counter_operand(device):
        return None if wide else f"{device} has 32 bits; use the 32-bit form (D...) or one of C0 to C199"
    if wide and device.kind == "V":
        return f"{device} is the high half of a 32-bit number; write Z{device.number}, which includes both halves"
    if wide and device.kind != "Z":
        require_in_range(device.kind, device.number, 2 * span, cpu)
    elif span > 1:
        require_in_range(device.kind, device.number, span, cpu)
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


MATRIX_SPACING: Final = 10
"""Number of relays from one row of MTR to the next."""
Key = tuple[str, int]
"""Kind and number of a device."""
_COUNTED: Final = {
    ("SFTR", 0): 3,
    ("SFTL", 0): 3,
    ("SFTR", 1): 2,
    ("SFTL", 1): 2,
    ("ABSD", 2): 3,
    ("INCD", 2): 3,
    ("BMOV", 0): 2,
    ("BMOV", 1): 2,
    ("FMOV", 1): 2,
    ("DECO", 0): 2,
    ("DECO", 1): 2,
    ("ENCO", 0): 2,
    ("WSFR", 0): 3,
    ("WSFL", 0): 3,
    ("WSFR", 1): 2,
    ("WSFL", 1): 2,
    ("MEAN", 0): 2,
    ("MTR", 2): 3,
    ("FROM", 2): 3,
    ("TO", 2): 3,
    ("ASCI", 1): 2,
    ("CCD", 0): 2,
    ("SFWR", 1): 2,
    ("SFRD", 0): 2,
}
"""Index of the operand that contains the device count of another operand."""


def device_count(instruction: Instruction, n: int) -> int | None:
    """Return the number of devices in operand `n`, counting a bit group as one; None = known only at run time."""
    if instruction.name not in FORMS:
        return 1
    name = FORMS[instruction.name].kind.name
    if (name, n) not in _COUNTED:
        return SPANS.get((name, n), 1)
    count = instruction.operands[_COUNTED[name, n]]
    if not isinstance(count, Constant) or count.index:
        return None
    if name == "MTR":
        return MATRIX_SPACING * (count.value - 1) + 8
    return 2**count.value if (name, n) in {("DECO", 1), ("ENCO", 0)} else count.value


def covered_devices(instruction: Instruction, n: int, operand: Operand) -> Iterator[Key]:
    """Yield the devices covered by operand `n`."""
    count = device_count(instruction, n) or 1
    match operand:
        case Digits(digits, device):
            first, length = device, digits * 4 * count
        case DeviceOperand():
            first, length = operand, count
        case WordBit(number):
            first, length = DeviceOperand("D", number), 1
        case _:
            return
    yield from ((first.kind, number) for number in range(first.number, first.number + length))
