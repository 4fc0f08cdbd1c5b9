"""Input registers in which an I/O module reports who owns its outputs.

An exception response contains no text. A module that lends its outputs to one client at a time therefore reports the
address of the owner, and the writes that it has refused, in a block of input registers. The block begins with a
signature, by which such a module is recognised. It ends with the output watchdog: the number of its trips, because the
writes of a controller that was suspended with all outputs off are not refused, and its time.
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
_TRIPS_AT: Final = _SIGNATURE_WORDS + _COUNT_WORDS + 2 * _ADDRESS_WORDS
REPORT_WORDS: Final = _TRIPS_AT + 2 * _COUNT_WORDS


@dataclass(frozen=True, slots=True)
class OwnerReport:
    """Owner of the outputs of an I/O module, the refused writes, and the output watchdog.

    Attributes:
        owner: Address and port of the client that owns the outputs; empty = none.
        refused: Number of refused writes since the start of the module.
        rival: Address and port of the client whose write was refused last; empty = none.
        trips: Number of trips of the output watchdog since the start of the module.
        watchdog_ms: Time of the output watchdog, ms.
    """

    owner: str
    refused: int
    rival: str
    trips: int
    watchdog_ms: int

    def encode(self) -> list[int]:
        """Return the registers: signature, refused writes, owner, rival, trips, time; high words first."""
        return [
            *_words(_SIGNATURE, _SIGNATURE_WORDS),
            *_double(self.refused),
            *_words(self.owner, _ADDRESS_WORDS),
            *_words(self.rival, _ADDRESS_WORDS),
            *_double(self.trips),
            *_double(self.watchdog_ms),
        ]

    @classmethod
    def decode(cls, words: Sequence[int]) -> OwnerReport | None:
        """Return the report in `REPORT_WORDS` registers; None without the signature."""
        if _text(words[:_SIGNATURE_WORDS]) != _SIGNATURE:
            return None
        refused, trips, watchdog_ms = (
            words[at] << 16 | words[at + 1] for at in (_SIGNATURE_WORDS, _TRIPS_AT, _TRIPS_AT + _COUNT_WORDS)
        )
        owner_at = _SIGNATURE_WORDS + _COUNT_WORDS
        rival_at = owner_at + _ADDRESS_WORDS
        owner, rival = _text(words[owner_at:rival_at]), _text(words[rival_at:_TRIPS_AT])
        return cls(owner, refused, rival, trips, watchdog_ms)


def _double(number: int) -> list[int]:
    return [number >> 16 & 0xFFFF, number & 0xFFFF]


def _words(text: str, count: int) -> list[int]:
    data = text.encode("ascii")[: 2 * count].ljust(2 * count, b"\0")
    return [data[n] << 8 | data[n + 1] for n in range(0, len(data), 2)]


def _text(words: Sequence[int]) -> str:
    return b"".join(word.to_bytes(2) for word in words).rstrip(b"\0").decode("ascii", errors="replace")
