"""Requests of the MC protocol, independent of the frame, and their replies.

Words are unsigned here. A word read from a bit device contains 16 consecutive bits, the first in bit 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from controller.common.mitsubishi.devices import FIRST_32_BIT_COUNTER, Device

BITS_PER_WORD: Final = 16


@dataclass(frozen=True, slots=True)
class ReadBits:
    """Read of consecutive bits; the reply contains one level per bit."""

    first: Device
    count: int


@dataclass(frozen=True, slots=True)
class ReadWords:
    """Read of consecutive words; the reply contains `count` words, two of them per 32-bit counter (low word first)."""

    first: Device
    count: int


@dataclass(frozen=True, slots=True)
class WriteBits:
    """Write of consecutive bits."""

    first: Device
    levels: tuple[bool, ...]


@dataclass(frozen=True, slots=True)
class WriteWords:
    """Write of consecutive words."""

    first: Device
    values: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ReadRandom:
    """Read of words and double words of arbitrary devices; the reply contains the words, then the double words."""

    words: tuple[Device, ...]
    double_words: tuple[Device, ...] = ()


@dataclass(frozen=True, slots=True)
class WriteRandomBits:
    """Write of arbitrary bits."""

    levels: tuple[tuple[Device, bool], ...]


@dataclass(frozen=True, slots=True)
class WriteRandomWords:
    """Write of words and double words of arbitrary devices."""

    words: tuple[tuple[Device, int], ...]
    double_words: tuple[tuple[Device, int], ...] = ()


@dataclass(frozen=True, slots=True)
class ReadBlocks:
    """Read of several blocks of consecutive words (word devices first); the reply contains all words in this order."""

    word_blocks: tuple[ReadWords, ...]
    bit_blocks: tuple[ReadWords, ...] = ()


@dataclass(frozen=True, slots=True)
class WriteBlocks:
    """Write of several blocks of consecutive words."""

    word_blocks: tuple[WriteWords, ...]
    bit_blocks: tuple[WriteWords, ...] = ()


@dataclass(frozen=True, slots=True)
class RemoteRun:
    """Start of the program by the communication partner."""


@dataclass(frozen=True, slots=True)
class RemoteStop:
    """Stop of the program by the communication partner."""


@dataclass(frozen=True, slots=True)
class ReadTypeName:
    """Read of the model; the reply is a `TypeName`."""


@dataclass(frozen=True, slots=True)
class SelfTest:
    """Loopback test; the reply contains the same data."""

    data: bytes


@dataclass(frozen=True, slots=True)
class TypeName:
    """Model of a PLC.

    Attributes:
        code: Model code.
        name: Model name, at most 16 ASCII characters; a 1E frame does not contain it.
    """

    code: int
    name: str = ""


Request = (
    ReadBits
    | ReadWords
    | WriteBits
    | WriteWords
    | ReadRandom
    | WriteRandomBits
    | WriteRandomWords
    | ReadBlocks
    | WriteBlocks
    | RemoteRun
    | RemoteStop
    | ReadTypeName
    | SelfTest
)
Reply = tuple[bool, ...] | tuple[int, ...] | bytes | TypeName | None
"""Bits, words, data of a self-test, model, or None for a request that returns no data."""


class RequestError(Exception):
    """Raised for a request that is answered with an end code.

    Attributes:
        code: End code of the frame.
    """

    def __init__(self, code: int) -> None:
        super().__init__(f"end code {code:04X}h")
        self.code = code


class FrameError(ValueError):
    """Raised for data that is not a frame of the protocol: no answer is possible."""


class RefusedError(OSError):
    """Raised by a client for a reply with an end code other than 0.

    Attributes:
        code: End code of the reply.
        abnormal_code: Further code of a 1E frame with end code 5Bh, otherwise 0.
    """

    def __init__(self, request: Request, code: int, abnormal_code: int = 0) -> None:
        further = f", abnormal code {abnormal_code:02X}h" if abnormal_code else ""
        super().__init__(f"{type(request).__name__} refused with end code {code:04X}h{further}")
        self.code = code
        self.abnormal_code = abnormal_code


def has_two_words(device: Device) -> bool:
    """Return True for the current value of a 32-bit counter."""
    return device.kind == "CN" and device.number >= FIRST_32_BIT_COUNTER


def bits_of_words(words: tuple[int, ...]) -> tuple[bool, ...]:
    """Return the bits of words, 16 per word, bit 0 first."""
    return tuple(bool(word >> bit & 1) for word in words for bit in range(BITS_PER_WORD))


def words_of_bits(bits: tuple[bool, ...]) -> tuple[int, ...]:
    """Return words with the given bits, 16 per word, the first in bit 0; missing bits are 0."""
    starts = range(0, len(bits), BITS_PER_WORD)
    return tuple(sum(level << bit for bit, level in enumerate(bits[at : at + BITS_PER_WORD])) for at in starts)
