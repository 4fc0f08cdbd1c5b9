"""Timeout of the operator panel."""

from __future__ import annotations

from typing import ClassVar

from controller.common.saved import Saved

SHOWN_MS = 3_000
"""Time after the last request of an operator panel for which the questions count as shown, ms."""


class PanelWatch(Saved):
    """Times since the operator panel last sent a message and last read the state.

    Attributes:
        limit_ms: Timeout, ms, active after the first message; None = none.
    """

    SAVED: ClassVar[tuple[str, ...]] = ("_message", "_message_ms", "_request", "_request_ms")

    def __init__(self, limit_ms: int | None) -> None:
        """Create a watch.

        Args:
            limit_ms: Timeout, ms, active after the first message; None = none.
        """
        self.limit_ms = limit_ms
        self._message = self._request = False
        self._message_ms: int | None = None
        self._request_ms: int | None = None

    def heartbeat(self) -> None:
        """Report a message; thread-safe."""
        self._message = True

    def read(self) -> None:
        """Report a request of a panel that shows the open questions; thread-safe."""
        self._message = self._request = True

    def adopt(self, now_ms: int) -> None:
        """Adopt the messages since the last scan."""
        if self._message:
            self._message, self._message_ms = False, now_ms
        if self._request:
            self._request, self._request_ms = False, now_ms

    def is_silent(self, now_ms: int) -> bool:
        """Return True if the timeout has expired."""
        if self.limit_ms is None or self._message_ms is None:
            return False
        return now_ms - self._message_ms >= self.limit_ms

    def is_shown(self, now_ms: int) -> bool:
        """Return True if a panel has recently read the state."""
        return self._request_ms is not None and now_ms - self._request_ms < SHOWN_MS

    @property
    def is_idle(self) -> bool:
        """True if there is no timeout, and no message since the last scan."""
        return self.limit_ms is None and not (self._message or self._request)
