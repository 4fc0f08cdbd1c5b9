"""Levels packed into words and bytes, the first level in bit 0."""

from __future__ import annotations

from collections.abc import Sequence


def packed_words(levels: Sequence[bool]) -> list[int]:
    """Return levels as words.

    >>> packed_words([True, False, True] + 13 * [False] + [True])
    [5, 1]
    """
    return [_number(levels[first : first + 16]) for first in range(0, len(levels), 16)]


def packed_bytes(levels: Sequence[bool]) -> bytes:
    """Return levels as bytes.

    >>> packed_bytes([True, False, True] + 5 * [False] + [True]).hex()
    '0501'
    """
    return bytes(_number(levels[first : first + 8]) for first in range(0, len(levels), 8))


def levels_of(numbers: Sequence[int], count: int, *, width: int = 16) -> list[bool]:
    """Return the first levels that are packed into numbers.

    Args:
        numbers: Words or bytes, unsigned; enough for the levels.
        count: Number of levels.
        width: Bits of a number, 16 for words, 8 for bytes.

    >>> levels_of([5, 1], 17)[14:]
    [False, False, True]
    """
    return [bool(numbers[n // width] >> n % width & 1) for n in range(count)]


def _number(levels: Sequence[bool]) -> int:
    return sum(level << place for place, level in enumerate(levels))
