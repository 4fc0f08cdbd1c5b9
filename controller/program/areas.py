"""Device areas: ranges of consecutive devices, each with one owner."""

from __future__ import annotations

from controller.common.declarations import DeclarationError
from controller.core.expr import Bit, Timer, Word


class Area:
    """Allocator of consecutive devices of one kind."""

    def __init__(self, kind: str, first: int, last: int, owner: str = "") -> None:
        self._kind = kind
        self._first = first
        self._next = first
        self._last = last
        self._owner = f"{owner}." if owner else ""

    def _next_number(self) -> int:
        __tracebackhide__ = True
        number = self._next
        if number > self._last:
            span = f"{self._kind}{self._first} to {self._kind}{self._last}"
            user = self._owner.rstrip(".") or "the machine"
            raise DeclarationError(
                f"{span} are all used by {user}; docs/reference/devices.md lists the free numbers: enlarge this area, "
                "or add a second one"
            )
        self._next += 1
        return number

    def bit(self, name: str, comment: str) -> Bit:
        """Allocate the next bit."""
        __tracebackhide__ = True
        return Bit(self._kind, self._next_number(), self._owner + name, comment)

    def word(self, name: str, comment: str) -> Word:
        """Allocate the next data register."""
        __tracebackhide__ = True
        return Word(self._kind, self._next_number(), self._owner + name, comment)

    def timer(self, name: str, comment: str) -> Timer:
        """Allocate the next timer."""
        __tracebackhide__ = True
        return Timer(self._next_number(), self._owner + name, comment)
