"""Answers of a serial server that come back, because the RS-485 adapter receives what it sends.

A returned answer to functions 5, 6 and 8 has the bytes of a request, and would be executed as one. The first bytes
after an answer show what the adapter does:

* An answer that is not a request comes back: the adapter returns what is sent, and each returned answer is removed.
* A request comes first that differs from the answer: it does not, and each request is executed.
* Until one of both has happened, a frame that is equal to the answer and comes at once is removed. If it was a request
  all the same, its partner receives no answer and repeats it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import Final

RETURN_S: Final = 0.03
"""Time after the transmission of an answer within which it comes back, s: USB adapters pass bytes on every 16 ms."""

_log = logging.getLogger(__name__)


class ReturnedAnswers:
    """Removes returned answers from the received bytes.

    Attributes:
        are_returned: Whether the adapter returns what is sent; None = not known.
    """

    def __init__(self, port: str, is_request: Callable[[bytes], bool]) -> None:
        """Begin without an answer.

        Args:
            port: Name of the line in the log.
            is_request: Function that returns whether a frame is a complete request.
        """
        self.are_returned: bool | None = None
        self._port = port
        self._is_request = is_request
        self._answer = b""
        self._until_s = 0.0
        self._is_first = False
        """Whether nothing has been received since the answer."""

    def sent(self, answer: bytes, end_s: float) -> None:
        """Note an answer.

        Args:
            answer: Its frame.
            end_s: End of its transmission, s.
        """
        self._answer, self._until_s, self._is_first = answer, end_s + RETURN_S, True

    def remove(self, received: bytearray, now_s: float) -> bool:
        """Remove a returned answer from the start of the received bytes; return False if more bytes must show it.

        Args:
            received: Received bytes that have not been processed.
            now_s: Time, s.
        """
        answer = self._answer
        if not answer or not received:
            return True
        if now_s > self._until_s or not answer.startswith(received[: len(answer)]):
            self._answer = b""
            return True
        if len(received) < len(answer):
            self._until_s = math.inf  # it has begun in time
            return False
        self._answer = b""
        if not self._is_request(answer):
            self._note_returned()
        if self.are_returned is not False:
            del received[: len(answer)]
            self._is_first = False
        return True

    def request_served(self) -> None:
        """Note that a request has been received."""
        if self._is_first and self.are_returned is None:
            self.are_returned = False
        self._is_first = False

    def noise_received(self) -> None:
        """Note that bytes have been skipped: they may be a damaged answer."""
        self._answer, self._is_first = b"", False

    def forget(self) -> None:
        """Forget the answer and the adapter: the line has been closed, and the next adapter may be another one."""
        self.are_returned, self._answer, self._is_first = None, b"", False

    def _note_returned(self) -> None:
        if not self.are_returned:
            _log.warning("%s: the adapter returns what is sent; the returned bytes are removed", self._port)
        self.are_returned = True
