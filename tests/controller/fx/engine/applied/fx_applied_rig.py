"""Test rig for single applied instructions: operands as text, memory by device name."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from controller.core.devices import Memory
from controller.fx.engine.applied.table import ACTIONS, LEVELS
from controller.fx.engine.cpu import Cpu, index_register
from controller.fx.language.instruction import Constant, DeviceOperand, Digits, Operand
from controller.fx.language.instruction_set import FORMS
from tests.controller.core.core_rig import copied

State = Mapping[str, int | bool]

_OPERAND = re.compile(
    r"(?:K(?P<digits>\d)(?=[XYMS]))?(?P<kind>[KHXYMSTCDVZ])(?P<number>-?[0-9A-F]+)(?P<index>[VZ]\d)?$"
)


def operand(text: str) -> Operand:
    """Return the operand that a text denotes, for example "D0", "K-5", "HFF", "X10", "K4M0" or "D20V0"."""
    match = _OPERAND.match(text)
    assert match, text
    kind, number = match["kind"], match["number"]
    index: str = match["index"] or ""
    if kind == "K":
        return Constant(int(number), "K", index)
    if kind == "H":
        return Constant(int(number, 16), "H", index)
    device = DeviceOperand(kind, int(number, 8 if kind in "XY" else 10), index)
    return Digits(int(match["digits"]), device) if match["digits"] else device


def poke(memory: Memory, name: str, value: int | bool) -> None:
    """Set a bit, a word, the contact of a timer or counter ("T0 contact") or the start of a timer ("T0 start")."""
    device, _, part = name.partition(" ")
    kind, number = device[0], int(device[1:], 8 if device[0] in "XY" else 10)
    if part == "contact" or kind in "XYMS":
        memory.bits(kind)[number] = bool(value)
    elif part == "start":
        memory.TS[number] = value
    elif kind in "VZ":
        memory.D[index_register(device)] = value
    else:
        memory.set_word(kind, number, value)


def bits(head: str, levels: str) -> dict[str, int]:
    """Return consecutive bits: bits("M0", "101") sets M0 on, M1 off and M2 on."""
    kind, base = head[0], 8 if head[0] in "XY" else 10
    first = int(head[1:], base)
    return {f"{kind}{first + n:o}" if base == 8 else f"{kind}{first + n}": int(c) for n, c in enumerate(levels)}


class Rig:
    """CPU that runs single instructions."""

    def __init__(self, before: State | None = None) -> None:
        self.cpu = Cpu()
        self.memory = self.cpu.memory
        self.set(before or {})

    def set(self, state: State) -> None:
        for name, value in state.items():
            poke(self.memory, name, value)

    def action(self, text: str) -> Callable[[], None]:
        name, *operands = text.split()
        form = FORMS[name]
        return ACTIONS[form.kind.name](self.cpu, tuple(map(operand, operands)), form.wide)

    def level(self, text: str) -> Callable[[bool], None]:
        name, *operands = text.split()
        form = FORMS[name]
        return LEVELS[form.kind.name](self.cpu, tuple(map(operand, operands)), form.wide)

    def run(self, text: str) -> None:
        self.action(text)()

    def changes_only(self, text: str, after: State) -> None:
        """Run an instruction once and check that it sets these devices to these values and changes no others."""
        expected = copied(self.memory)
        for name, value in after.items():
            poke(expected, name, value)
        self.run(text)
        assert_same(self.memory, expected)


def assert_same(memory: Memory, expected: Memory) -> None:
    """Check that two memories are equal; the message lists only the devices that differ."""
    different = {
        f"{field}[{n}]": (was, wanted)
        for field in Memory.__slots__
        if getattr(memory, field) != getattr(expected, field)
        for n, (was, wanted) in enumerate(zip(getattr(memory, field), getattr(expected, field), strict=True))
        if was != wanted
    }
    assert not different, f"(actual, expected): {different}"
