"""Input registers in which an I/O module reports who owns its outputs.

An exception response contains no text. A module that lends its outputs to one client at a time therefore reports the
address of the owner, and the writes that it has refused, in a block of input registers. The block begins with a
signature, by which such a module is recognised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

REPORT_OFFSET: Final = 1_000
"""First input register of the report."""
_SIGNATURE: Final = "OUTOWNER"
_SIGNATURE_WORDS: Final = 4
_ADDRESS_WORDS: Final = 24
"""Length of an address, words: 47 characters for IPv6 with its port; the rest is zero."""
_COUNT_WORDS: Final = 2
REPORT_WORDS: Final = _SIGNATURE_WORDS + _COUNT_WORDS + 2 * _ADDRESS_WORDS


@dataclass(frozen=True, slots=True)
class OwnerReport:
    """Owner of the outputs of an I/O module, and the refused writes.

    Attributes:
        owner: Address and port of the client that owns the outputs; empty = none.
        refused: Number of refused writes since the start of the module.
        rival: Address and port of the client whose write was refused last; empty = none.
    """

    owner: str
    refused: int
    rival: str

    def encode(self) -> list[int]:
        """Return the registers: signature, number of refused writes (high word first), owner, rival."""
        count = self.refused % (1 << 32)
        return [
            *_words(_SIGNATURE, _SIGNATURE_WORDS),
            count >> 16,
            count & 0xFFFF,
            *_words(self.owner, _ADDRESS_WORDS),
            *_words(self.rival, _ADDRESS_WORDS),
        ]

    @classmethod
    def decode(cls, words: Sequence[int]) -> OwnerReport | None:
        """Return the report in `REPORT_WORDS` registers; None without the signature."""
        if _text(words[:_SIGNATURE_WORDS]) != _SIGNATURE:
            return None
        high, low = words[_SIGNATURE_WORDS : _SIGNATURE_WORDS + _COUNT_WORDS]
        addresses = words[_SIGNATURE_WORDS + _COUNT_WORDS :]
        return cls(_text(addresses[:_ADDRESS_WORDS]), high << 16 | low, _text(addresses[_ADDRESS_WORDS:]))


def _words(text: str, count: int) -> list[int]:
    data = text.encode("ascii")[: 2 * count].ljust(2 * count, b"\0")
    return [data[n] << 8 | data[n + 1] for n in range(0, len(data), 2)]


def _text(words: Sequence[int]) -> str:
    return b"".join(word.to_bytes(2) for word in words).rstrip(b"\0").decode("ascii", errors="replace")
