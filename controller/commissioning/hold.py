"""Hold-to-run: an output is on only while a held key renews its lease."""

from __future__ import annotations

from typing import Final

LEASE_MS: Final = 300
"""Time for which one repetition of the key keeps the output on, ms. Terminals repeat a held key at least every 100 ms
after a delay of 250 to 660 ms (general knowledge)."""
LONGEST_MS: Final = 10_000
"""Longest time for which a held key keeps the output on, ms (assumed): longer than any stroke of the machine."""


class HoldToRun:
    """Lease of one output. It does not read a clock.

    A single key press never switches the output on: it takes a repetition within the lease, as a held key sends it.

    >>> held = HoldToRun()
    >>> held.press(0)
    >>> held.is_on(1)
    False
    >>> held.press(200)
    >>> held.is_on(499), held.is_on(500)
    (True, False)
    """

    def __init__(self) -> None:
        self._pressed_ms: int | None = None
        self._since_ms: int | None = None
        self._exhausted = False

    def press(self, now_ms: int) -> None:
        """Renew the lease by one arrival of the key."""
        repeated = self._pressed_ms is not None and now_ms - self._pressed_ms < LEASE_MS
        self._pressed_ms = now_ms
        if not repeated:
            self._since_ms, self._exhausted = None, False
        elif self._since_ms is None and not self._exhausted:
            self._since_ms = now_ms

    def is_on(self, now_ms: int) -> bool:
        """Return True while the lease runs; after `LONGEST_MS` the key must be released first."""
        if self._since_ms is None or self._pressed_ms is None:
            return False
        if now_ms - self._since_ms >= LONGEST_MS:
            self._since_ms, self._exhausted = None, True
        elif now_ms - self._pressed_ms >= LEASE_MS:
            self._since_ms = None
        return self._since_ms is not None

    def end(self) -> None:
        """End the lease at once; the key must be released before it is effective again."""
        self._exhausted = self._exhausted or self._since_ms is not None
        self._since_ms = None
