"""Field link interface of the scan loop, and the link watchdog.

An image is a `list[bool]` of raw terminal levels, indexed by the value of the octal address
(X10 is index 8). Links do not apply the polarity.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from controller.common.saved import Saved


class LinkError(OSError):
    """Raised if the field I/O is unreachable, does not answer in time or returns an error; the message is one line."""


class OutputsTakenError(Exception):
    """Raised if the field I/O refuses a write because its outputs belong to another master; the link remains open.

    The message is one line and names the owner.
    """


class FieldLink(Protocol):
    """Link to the field I/O.

    Every method except `close` raises `OSError` on failure. Links of the controller raise
    `LinkError`. The links of the simulated plant do not depend on the controller and raise
    other subclasses of `OSError`. Callers therefore catch `OSError`.

    After any `OSError` the link is closed; it does not reconnect until `open` is called again.
    A link of several devices then still writes to those that respond, and raises for the others.
    An image of the wrong length is a programming error (`ValueError`) and does not close the
    link.
    """

    def open(self) -> None:
        """Connect to the field I/O; no effect on an open link.

        Raises:
            OSError: The field I/O is not reachable.
        """

    def read_inputs(self) -> list[bool]:
        """Read the raw X image.

        Returns:
            Levels by X number, of length `IoMap.input_count`.

        Raises:
            OSError: The link is closed, there is no response, or the field I/O returns an error.
        """

    def write_outputs(self, image: Sequence[bool]) -> None:
        """Write the raw Y image.

        Args:
            image: Levels by Y number, of length `IoMap.output_count`.

        Raises:
            OSError: The link is closed, there is no response, or the field I/O returns an error.
            ValueError: The image has the wrong length.
        """

    def write_registers(self, values: Sequence[int]) -> None:
        """Write the output registers; called only if the I/O map has any.

        Args:
            values: Values by the order of `IoMap.registers`, 0 to 32767.

        Raises:
            OSError: The link is closed, there is no response, or the field I/O returns an error.
            ValueError: The number of values is wrong.
        """

    def close(self) -> None:
        """Disconnect; no effect on a closed link."""


class LinkWatchdog(Saved):
    """Timeout of the field link. It does not read a clock; the caller passes all times.

    The timeout runs from the last successful exchange, or from the first call if there has been
    none. An expired watchdog stays expired until `reset`, regardless of later exchanges.

    >>> watchdog = LinkWatchdog(limit_ms=100)
    >>> watchdog.feed(0)
    >>> watchdog.expired(99), watchdog.expired(100)
    (False, True)
    >>> watchdog.feed(101)
    >>> watchdog.expired(101)
    True
    """

    SAVED = ("_expired", "_last_fed_ms")

    def __init__(self, limit_ms: int = 100) -> None:
        """Create a watchdog whose timeout starts at the first call.

        Args:
            limit_ms: Timeout, ms.

        Raises:
            ValueError: The timeout is not positive.
        """
        if limit_ms <= 0:
            raise ValueError(f"limit_ms must be at least 1, not {limit_ms}")
        self._limit_ms = limit_ms
        self._last_fed_ms: int | None = None
        self._expired = False

    def feed(self, now_ms: int) -> None:
        """Record a successful exchange at `now_ms`; an exchange after the timeout has no effect."""
        if not self.expired(now_ms):
            self._last_fed_ms = now_ms

    def expired(self, now_ms: int) -> bool:
        """Return True if the timeout has elapsed at `now_ms` or at any time since the last reset."""
        if self._last_fed_ms is None:
            self._last_fed_ms = now_ms
        if now_ms - self._last_fed_ms >= self._limit_ms:
            self._expired = True
        return self._expired

    def reset(self) -> None:
        """Reset the watchdog; the timeout restarts at the next call."""
        self._expired = False
        self._last_fed_ms = None
