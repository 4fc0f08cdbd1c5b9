"""Devices as Python source text: contacts, words, and the effect of a coil with and without power."""

from __future__ import annotations

from controller.core.devices import MS_10, MS_100, is_32_bit_counter, timer_base_ms
from controller.fx.engine.access import signed
from controller.fx.engine.cpu import RETENTIVE_TIMERS, index_register
from controller.fx.language.instruction import Constant, DeviceOperand, Operand, WordBit


def contact(operand: Operand) -> str:
    """Return a contact as a Python expression.

    Examples:
        >>> contact(DeviceOperand("X", 8)), contact(WordBit(100, 3))
        ('X[8]', '(D[100] >> 3 & 1 == 1)')
    """
    if isinstance(operand, WordBit):
        return f"(D[{operand.number}] >> {operand.bit} & 1 == 1)"
    assert isinstance(operand, DeviceOperand)  # noqa: S101 - operands are checked by the parser
    return f"{operand.kind}[{operand.number}]"


def plain_word(operand: Operand) -> str | None:
    """Return a 16-bit word as a Python expression, or None if it needs more than a lookup.

    Examples:
        >>> device = DeviceOperand("D", 5)
        >>> plain_word(device), plain_word(Constant(0xFFFF, "H")), plain_word(DeviceOperand("D", 5, "Z0"))
        ('D[5]', '-1', None)
    """
    match operand:
        case Constant(value, _, ""):
            return str(value - 0x10000 if value > 0x7FFF else value)
        case DeviceOperand("D", number, ""):
            return f"D[{number}]"
        case DeviceOperand("T", number, ""):
            return f"TV[{number}]"
        case DeviceOperand("C", number, "") if not is_32_bit_counter(number):
            return f"CV[{number}]"
        case DeviceOperand("V" | "Z" as kind, number, ""):
            return f"D[{index_register(f'{kind}{number}')}]"
    return None


def set_to(operand: Operand, *, on: bool) -> str:
    """Return the statement for SET or RST; RST also clears the value of a timer or counter, and sets a word to 0."""
    match operand:
        case WordBit(number, bit):
            return f"put_bit({number}, {bit}, {on})"
        case DeviceOperand("T", n):
            return f"TV[{n}] = 0; TS[{n}] = -1; T[{n}] = False"
        case DeviceOperand("C", n):
            return f"CV[{n}] = 0; C[{n}] = False"
        case DeviceOperand("D" | "V" | "Z"):
            return f"{plain_word(operand)} = 0"
    return f"{contact(operand)} = {on}"


def driven_off(operand: Operand) -> str:
    """Return the statement for a coil that is executed without power."""
    match operand:
        case WordBit(number, bit):
            return f"put_bit({number}, {bit}, False)"
        case DeviceOperand("C", n):
            return f"CE[{n}] = False"
        case DeviceOperand("T", n):
            return f"TS[{n}] = -1" + ("" if n >= RETENTIVE_TIMERS else f"; TV[{n}] = 0; T[{n}] = False")
    return f"{contact(operand)} = False"


def timer(n: int, preset: Operand, power: str) -> list[str]:
    """Return the statements for OUT T: an on-delay timer, or a retentive timer from T246 on."""
    tick = {MS_100: "tick_100", MS_10: "tick_10"}.get(timer_base_ms(n), "tick_1")
    counts = plain_word(preset)
    if n >= RETENTIVE_TIMERS:
        return [
            f"if {power}:",
            f"    if TS[{n}] >= 0: TV[{n}] = min(TV[{n}] + {tick} - TS[{n}], 32767)",
            f"    TS[{n}] = {tick}",
            f"    if TV[{n}] >= {counts}: T[{n}] = True",
            f"else: TS[{n}] = -1",
        ]
    return [
        f"if {power}:",
        f"    if TS[{n}] < 0: TS[{n}] = {tick}",
        f"    v = {tick} - TS[{n}]",
        f"    T[{n}] = v >= {counts}",
        f"    TV[{n}] = {counts} if v >= {counts} else v",
        f"elif TS[{n}] >= 0: TS[{n}] = -1; TV[{n}] = 0; T[{n}] = False",
    ]


def counter(n: int, preset: Operand, power: str) -> list[str]:
    """Return the statements for OUT C: count up to the preset or, from C200 on, up and down with 32-bit wrap-around."""
    if is_32_bit_counter(n):
        counts = (
            f"wide({preset.number})" if isinstance(preset, DeviceOperand) else signed(getattr(preset, "value", 0), 32)
        )
        count = [
            f"    v, limit = CV[{n}], {counts}",
            f"    CV[{n}] = (v + {2**31 - 1} if M[{8000 + n}] else v + {2**31 + 1}) % {2**32} - {2**31}",
            f"    if v == limit - 1 and CV[{n}] == limit: C[{n}] = True",
            f"    elif v == limit and CV[{n}] == limit - 1: C[{n}] = False",
        ]
    else:
        counts = plain_word(preset) or "0"
        count = [f"    if CV[{n}] < {counts}: CV[{n}] += 1", f"    if CV[{n}] >= {counts}: C[{n}] = True"]
    return [f"now = {power}", f"if now and not CE[{n}]:", *count, f"CE[{n}] = now"]
