"""Special function modules: FROM TO (FNC 78, 79), RD3A WR3A (FNC 176, 177).

A missing module or word is an operation error with the code 6708 (no page found). The transfer takes no time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from controller.core.devices import WORD_MAX
from controller.fx.engine.access import Action, ActionFactory, reader, signed, within, words, writer
from controller.fx.engine.cpu import Cpu, OperationError
from controller.fx.engine.peripherals.analogue import CombinedAnalogue
from controller.fx.engine.peripherals.buffer_module import BufferModule
from controller.fx.language.instruction import Operand

MODULE_ERROR: Final = 6708
"""Error code in D8067 for FROM and TO without the module or the word (no page found)."""


def _module(cpu: Cpu, position: int) -> BufferModule:
    module = cpu.modules.get(position)
    if module is None:
        raise OperationError(MODULE_ERROR)
    return module


def from_(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """FROM m1 m2 d n: read n words from word m2 of the buffer memory of module m1 to d.

    The 32-bit form reads n pairs of words, low word first.
    """
    position, first, count = (reader(cpu, operands[n], wide) for n in (0, 1, 3))
    target = words(cpu, operands[2], wide)

    def run() -> None:
        module, n = _module(cpu, position()), within(count(), 1, WORD_MAX)
        target.places(n)
        try:
            found = module.read(first(), n * (2 if wide else 1), cpu.now_ms)
        except IndexError:
            raise OperationError(MODULE_ERROR) from None
        target.write(_pairs(found) if wide else found)

    return run


def _pairs(values: Sequence[int]) -> list[int]:
    """Return numbers of 32 bits from pairs of words, low word first."""
    return [signed((low & 0xFFFF) | high << 16, 32) for low, high in zip(values[::2], values[1::2], strict=True)]


def to(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """TO m1 m2 s n: write n words from s to the buffer memory of module m1 from word m2 on; a constant s is repeated.

    The 32-bit form writes n pairs of words, low word first.
    """
    position, first, count = (reader(cpu, operands[n], wide) for n in (0, 1, 3))
    source = words(cpu, operands[2], wide)

    def run() -> None:
        module = _module(cpu, position())
        values = source.read(within(count(), 1, WORD_MAX))
        if wide:
            values = [part for value in values for part in (signed(value, 16), signed(value >> 16, 16))]
        try:
            module.write(first(), values, cpu.now_ms)
        except IndexError:
            raise OperationError(MODULE_ERROR) from None

    return run


def _combined(cpu: Cpu, position: int) -> CombinedAnalogue:
    module = _module(cpu, position)
    if not isinstance(module, CombinedAnalogue):
        raise OperationError(MODULE_ERROR)
    return module


def rd3a(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """RD3A m1 m2 d: d := digital value (0 to 255) of input m2 (1 or 2) of the FX0N-3A at position m1."""
    position, channel, put = (
        reader(cpu, operands[0], wide),
        reader(cpu, operands[1], wide),
        writer(cpu, operands[2], wide),
    )

    def run() -> None:
        put(_combined(cpu, position()).channel(within(channel(), 1, 2), cpu.now_ms))

    return run


def wr3a(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """WR3A m1 m2 s: set the output of the FX0N-3A at position m1 to the low 8 bits of s; m2 is 1."""
    position, channel, get = (reader(cpu, operand, wide) for operand in operands)

    def run() -> None:
        within(channel(), 1, 1)
        _combined(cpu, position()).set_output(get())

    return run


ACTIONS: Final[dict[str, ActionFactory]] = {"FROM": from_, "TO": to, "RD3A": rd3a, "WR3A": wr3a}
