"""What the scan loop needs from any way to the field, and when that way counts as lost.

An image is a `list[bool]` of raw terminal levels, indexed by the octal value of the address
(X10 is index 8). Polarity is no business of a link.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class LinkError(OSError):
    """The field could not be reached, did not answer in time or refused; `str()` is one line."""


class FieldLink(Protocol):
    """A way to the field I/O.

    Every method but `close` raises `OSError` when it cannot do its work. Links of the controller
    raise `LinkError`; the links of the simulated plant, which know nothing of the controller,
    raise their own `OSError`. Callers therefore catch `OSError`.

    After any `OSError` the link is closed: it neither answers nor reconnects by itself until
    `open` is called again. An image of the wrong length is a mistake of the caller (`ValueError`)
    and leaves the link as it is.
    """

    def open(self) -> None:
        """Reach the far side; does nothing on an open link.

        Raises:
            OSError: the far side is not there.
        """

    def read_inputs(self) -> list[bool]:
        """Read the raw X image.

        Returns:
            Levels by X number, `IoMap.input_count` long.

        Raises:
            OSError: the link is closed, silent, or the far side refused.
        """

    def write_outputs(self, image: Sequence[bool]) -> None:
        """Write the raw Y image.

        Args:
            image: Levels by Y number, `IoMap.output_count` long.

        Raises:
            OSError: the link is closed, silent, or the far side refused.
            ValueError: the image has the wrong length.
        """

    def close(self) -> None:
        """Let go of the far side; does nothing on a closed link."""


class LinkWatchdog:
    """Says when the field has been silent for too long. Pure logic: every instant is passed in.

    The limit runs from the last good exchange, or from the first question asked when there has
    been none. Once lost stays lost, whatever arrives later, until `reset`.

    >>> watchdog = LinkWatchdog(limit_ms=100)
    >>> watchdog.good(0)
    >>> watchdog.lost(99), watchdog.lost(100)
    (False, True)
    >>> watchdog.good(101)
    >>> watchdog.lost(101)
    True
    """

    def __init__(self, limit_ms: int = 100) -> None:
        """Create a watchdog that has seen nothing yet.

        Args:
            limit_ms: Silence that is too long, ms.

        Raises:
            ValueError: the limit is not positive.
        """
        if limit_ms <= 0:
            raise ValueError(f"limit_ms is {limit_ms}: a link watchdog needs at least 1 ms")
        self._limit_ms = limit_ms
        self._last_good_ms: int | None = None
        self._lost = False

    def good(self, now_ms: int) -> None:
        """Note a good exchange at `now_ms`; one that comes too late is not good enough."""
        if not self.lost(now_ms):
            self._last_good_ms = now_ms

    def lost(self, now_ms: int) -> bool:
        """Whether the silence has reached the limit by `now_ms` or ever since the last reset."""
        if self._last_good_ms is None:
            self._last_good_ms = now_ms
        if now_ms - self._last_good_ms >= self._limit_ms:
            self._lost = True
        return self._lost

    def reset(self) -> None:
        """Forget the loss; the limit starts anew at the next call."""
        self._lost = False
        self._last_good_ms = None
