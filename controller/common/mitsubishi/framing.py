"""Fields of MC protocol frames: little-endian binary numbers, or hexadecimal digits with the highest digit first.

Source: FX3U-ENET user's manual 9.2 and FX5 user's manual (MELSEC communication protocol), message formats.
"""

from __future__ import annotations

from collections.abc import Sequence

from controller.common.mitsubishi.requests import FrameError


class ShortFrameError(FrameError):
    """Raised if a frame ends before its last field."""


class DigitError(FrameError):
    """Raised for a character that is not a hexadecimal digit."""


class FrameWriter:
    """Frame under construction."""

    def __init__(self, *, is_ascii: bool) -> None:
        """Start an empty frame in binary or ASCII code."""
        self.is_ascii = is_ascii
        self._parts: list[bytes] = []

    def __bytes__(self) -> bytes:
        """Return the fields written so far."""
        return b"".join(self._parts)

    def number(self, value: int, size: int) -> None:
        """Append a number of `size` bytes (twice as many digits in ASCII code)."""
        self._parts.append(b"%0*X" % (2 * size, value) if self.is_ascii else value.to_bytes(size, "little"))

    def numbers(self, values: Sequence[int], size: int) -> None:
        """Append several numbers of `size` bytes."""
        for value in values:
            self.number(value, size)

    def raw(self, data: bytes) -> None:
        """Append data that is identical in both codes."""
        self._parts.append(data)

    def bits(self, levels: Sequence[bool], *, pad: bool = False) -> None:
        """Append one digit per bit: in binary code two per byte, the first in the high half.

        Args:
            levels: The bits.
            pad: True to append a dummy digit to an odd number of bits in ASCII code too (frame 1E).
        """
        digits = "".join("1" if level else "0" for level in levels)
        if len(levels) % 2 and (pad or not self.is_ascii):
            digits += "0"
        self._parts.append(digits.encode() if self.is_ascii else bytes.fromhex(digits))


class FrameReader:
    """Frame that is read field by field."""

    def __init__(self, data: bytes, *, is_ascii: bool) -> None:
        """Read from the start of the data, which is in binary or ASCII code."""
        self.is_ascii = is_ascii
        self._data = data
        self._at = 0

    @property
    def left(self) -> int:
        """Number of bytes (characters in ASCII code) not read yet."""
        return len(self._data) - self._at

    def raw(self, size: int) -> bytes:
        """Return the next bytes.

        Raises:
            ShortFrameError: The frame ends before.
        """
        if size > self.left:
            raise ShortFrameError(f"{size} bytes expected, {self.left} left")
        self._at += size
        return self._data[self._at - size : self._at]

    def number(self, size: int) -> int:
        """Return the number in the next field of `size` bytes (twice as many digits in ASCII code).

        Raises:
            ShortFrameError: The frame ends before.
            DigitError: A character is not a hexadecimal digit.
        """
        if not self.is_ascii:
            return int.from_bytes(self.raw(size), "little")
        return parsed(self.raw(2 * size), 16)

    def numbers(self, count: int, size: int) -> tuple[int, ...]:
        """Return several numbers of `size` bytes."""
        return tuple(self.number(size) for _ in range(count))

    def bits(self, count: int, *, pad: bool = False) -> tuple[bool, ...]:
        """Return bits written by `FrameWriter.bits`."""
        if self.is_ascii:
            digits = self.raw(count + count % 2 if pad else count)[:count]
        else:
            digits = self.raw((count + 1) // 2).hex()[:count].encode()
        if set(digits) - set(b"01"):
            raise DigitError(f"{digits!r} contains a digit other than 0 and 1")
        return tuple(digit == ord("1") for digit in digits)


def parsed(digits: bytes, base: int) -> int:
    """Return the number that consists of the given digits only.

    Raises:
        DigitError: There is no digit, or a character is not a digit; signs, blanks and underscores are not digits.
    """
    allowed = b"0123456789ABCDEFabcdef" if base == 16 else b"0123456789"
    if not digits or set(digits) - set(allowed):
        raise DigitError(f"{digits!r} is not a number of base {base}")
    return int(digits, base)
