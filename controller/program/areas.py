"""Areas: runs of consecutive devices that belong to one owner."""

from __future__ import annotations

from controller.core.expr import Bit, Timer, Word


class Area:
    """Hands out consecutive devices of one kind."""

    def __init__(self, kind: str, first: int, last: int, owner: str = "") -> None:
        self._kind = kind
        self._next = first
        self._last = last
        self._owner = f"{owner}." if owner else ""

    def _take(self) -> int:
        number = self._next
        if number > self._last:
            raise ValueError(f"area of {self._kind} ends at {self._last}")
        self._next += 1
        return number

    def bit(self, name: str, comment: str) -> Bit:
        """Return the next bit."""
        return Bit(self._kind, self._take(), self._owner + name, comment)

    def word(self, name: str, comment: str) -> Word:
        """Return the next data register."""
        return Word(self._kind, self._take(), self._owner + name, comment)

    def timer(self, name: str, comment: str) -> Timer:
        """Return the next timer."""
        return Timer(self._take(), self._owner + name, comment)
