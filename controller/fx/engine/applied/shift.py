"""Rotation and shift: ROR ROL RCR RCL SFTR SFTL WSFR WSFL SFWR SFRD (FNC 30-39).

Details are from memory unless a docstring states otherwise; no page of a manual was found for the shifts and the queue.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, TypeVar

from controller.fx.engine.access import Action, ActionFactory, bits, reader, width_of, within, words
from controller.fx.engine.cpu import CARRY, ZERO, Cpu, OperationError
from controller.fx.language.instruction import Digits, Operand

_LONGEST_BIT_ROW: Final = 1024
_LONGEST_WORD_ROW: Final = 512

T = TypeVar("T")


def _rotation(*, left: bool, through_carry: bool) -> ActionFactory:
    """ROR ROL RCR RCL d n: rotate d by n bits (0 to the width of d); the last bit shifted out is in M8022.

    A bit group must fill the word: K4, or K8 in the 32-bit form. This is verified for ROL (docs/sources/fx2n.md 1.2).
    RCR and RCL include M8022 in the rotation.
    """

    def make(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
        width, target, special = width_of(wide), operands[0], cpu.memory.M
        row, count = words(cpu, target, wide), reader(cpu, operands[1], wide)
        short = isinstance(target, Digits) and 4 * target.digits != width

        def run() -> None:
            if short:
                raise OperationError
            n, place = within(count(), 0, width), row.places().start
            if n == 0:
                return
            value = row.get(place) & ((1 << width) - 1)
            if through_carry:
                ring = _rotate(value | special[CARRY] << width, n if left else -n, width + 1)
                special[CARRY] = bool(ring >> width & 1)
            else:
                ring = _rotate(value, n if left else -n, width)
                special[CARRY] = bool(ring & 1) if left else bool(ring >> (width - 1))
            row.put(place, ring)

        return run

    return make


def _rotate(value: int, n: int, width: int) -> int:
    """Return the low bits of a value rotated left by n, or right if n is negative."""
    n %= width
    return (value << n | value >> (width - n)) & ((1 << width) - 1)


def _down(row: Sequence[T], fill: Sequence[T]) -> list[T]:
    return [*row[len(fill) :], *fill]


def _up(row: Sequence[T], fill: Sequence[T]) -> list[T]:
    return [*fill, *row[: len(row) - len(fill)]]


def _bit_shift(shifted: Callable[[Sequence[bool], Sequence[bool]], list[bool]]) -> ActionFactory:
    """SFTR SFTL s d n1 n2: shift n1 bits (1-1024) from d by n2 (0-n1), and fill with n2 bits from s.

    SFTR shifts towards lower numbers, SFTL towards higher ones (source for SFTL: docs/sources/fx2n.md 1.2).
    """

    def make(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
        (source, source_row), (target, target_row) = bits(cpu, operands[0]), bits(cpu, operands[1])
        length, count = reader(cpu, operands[2], wide), reader(cpu, operands[3], wide)

        def run() -> None:
            n1 = within(length(), 1, _LONGEST_BIT_ROW)
            n2 = within(count(), 0, n1)
            row = target_row(n1)
            if n2:
                target[row] = shifted(target[row], source[source_row(n2)])

        return run

    return make


def _word_shift(shifted: Callable[[Sequence[int], Sequence[int]], list[int]]) -> ActionFactory:
    """WSFR WSFL s d n1 n2: shift n1 words (1-512) from d by n2 (0-n1), and fill with n2 words from s."""

    def make(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
        source, target = words(cpu, operands[0], wide), words(cpu, operands[1], wide)
        length, count = reader(cpu, operands[2], wide), reader(cpu, operands[3], wide)

        def run() -> None:
            n1 = within(length(), 1, _LONGEST_WORD_ROW)
            n2 = within(count(), 0, n1)
            row = target.read(n1)
            if n2:
                target.write(shifted(row, source.read(n2)))

        return run

    return make


def sfwr(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """SFWR s d n: append s to the queue of n words (2-512) at d.

    The first word is the number of entries, and the entries follow it. A full queue (n-1 entries) is
    unchanged, and M8022 is set.
    """
    get, row, count = reader(cpu, operands[0], wide), words(cpu, operands[1], wide), reader(cpu, operands[2], wide)
    special = cpu.memory.M

    def run() -> None:
        n = within(count(), 2, _LONGEST_WORD_ROW)
        places = row.places(n)
        filled, value = within(row.get(places[0]), 0, n - 1), get()
        special[CARRY] = filled == n - 1
        if filled < n - 1:
            row.put(places[filled + 1], value)
            row.put(places[0], filled + 1)

    return run


def sfrd(cpu: Cpu, operands: tuple[Operand, ...], wide: bool) -> Action:
    """SFRD s d n: move the oldest entry of the queue of n words (2-512) at s to d; the others advance by one word.

    The last word is unchanged. If the queue is empty, d is unchanged, and M8020 is set.
    """
    row, target, count = words(cpu, operands[0], wide), words(cpu, operands[1], wide), reader(cpu, operands[2], wide)
    special = cpu.memory.M

    def run() -> None:
        n = within(count(), 2, _LONGEST_WORD_ROW)
        pointer, *queue = row.read(n)
        filled, target_place = within(pointer, 0, n - 1), target.places().start
        special[ZERO] = filled == 0
        if filled:
            row.write([filled - 1, *queue[1:], queue[-1]])
            target.put(target_place, queue[0])

    return run


ACTIONS: Final[dict[str, ActionFactory]] = {
    "ROR": _rotation(left=False, through_carry=False),
    "ROL": _rotation(left=True, through_carry=False),
    "RCR": _rotation(left=False, through_carry=True),
    "RCL": _rotation(left=True, through_carry=True),
    "SFTR": _bit_shift(_down),
    "SFTL": _bit_shift(_up),
    "WSFR": _word_shift(_down),
    "WSFL": _word_shift(_up),
    "SFWR": sfwr,
    "SFRD": sfrd,
}
