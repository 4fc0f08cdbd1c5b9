"""Client of Modbus without input and output: frames of its requests, and their answers among the received bytes.

On no kind of line is a late answer taken for that of a later request. What a client has to do for this besides is
stated at the class of its frames.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from typing import Final

from controller.common.modbus.mbap import HEADER, MAX_LENGTH, MIN_LENGTH, UNCOUNTED_BYTES
from controller.common.modbus.rtu import LONGEST_FRAME, framed, is_checksum_valid

_log = logging.getLogger(__name__)

EXCEPTION: Final = 0x80
"""Bit of the function code that marks an exception response."""
_MIRRORED: Final = frozenset({5, 6, 8})
"""Functions whose answers repeat the request."""
_COUNTED: Final = frozenset({1, 2, 3, 4, 23})
"""Functions whose answers contain a byte count; the data of the others has four bytes."""
_COUNT_INDEX: Final = 2
_SHORTEST: Final = 5
"""Bytes of an exception response on a serial line, the shortest answer."""
_CONFIRMATION: Final = 8
"""Bytes of an answer on a serial line that confirms a write."""


class ClientFrames(ABC):
    """Frames of one line, for one request at a time.

    Attributes:
        other: Description of a frame that was no answer to the last request; empty = none was received.
    """

    def __init__(self) -> None:
        """Begin without a request: no answer is accepted."""
        self.other = ""
        self._received = bytearray()

    @abstractmethod
    def request(self, unit: int, pdu: bytes) -> bytes:
        """Return the frame of a request; from now on only its answer is accepted.

        Args:
            unit: Unit identifier.
            pdu: Function code and data.
        """

    @abstractmethod
    def answer(self) -> bytes | None:
        """Return the PDU of the answer to the last request, and remove it; None = not received completely."""

    def feed(self, data: bytes) -> None:
        """Take over received bytes."""
        self._received += data

    def discard(self) -> None:
        """Discard the received bytes."""
        self._received.clear()


class TcpFrames(ClientFrames):
    """Frames of a TCP connection, in which every request has another transaction number.

    The number returns after 65,536 requests, and some servers answer with another one: after a request without an
    answer the connection must also be closed. Source: Modbus Messaging on TCP/IP Implementation Guide V1.0b, section 3.
    """

    def __init__(self) -> None:
        """Begin without a request: no answer is accepted."""
        super().__init__()
        self._transaction = 0
        self._unit: int | None = None

    def request(self, unit: int, pdu: bytes) -> bytes:
        """Return the frame of a request with the next transaction number."""
        self._transaction, self._unit = (self._transaction + 1) & 0xFFFF, unit
        self.other = ""
        return HEADER.pack(self._transaction, 0, len(pdu) + 1, unit) + pdu

    def answer(self) -> bytes | None:
        """Return the PDU of the frame with the number and the unit of the last request; other frames are discarded."""
        received = self._received
        while len(received) >= HEADER.size:
            transaction, protocol, length, unit = HEADER.unpack_from(received)
            if protocol != 0 or not MIN_LENGTH <= length <= MAX_LENGTH:
                self.other = _described(received)
                return None  # the frames that follow cannot be found: the exchange fails
            end = UNCOUNTED_BYTES + length
            if len(received) < end:
                return None
            pdu = bytes(received[HEADER.size : end])
            is_answer = (transaction, unit) == (self._transaction, self._unit)
            if not is_answer:
                self.other = _described(received)
            del received[:end]
            if is_answer:
                return pdu
        return None


class RtuFrames(ClientFrames):
    """Frames of a serial line. Answers have no number: unit, function, length and checksum must be those expected.

    After a request without an answer, the line must be silent until its answer can no longer come, or the next request
    must be one whose answer is unmistakable. Source: Modbus over Serial Line V1.02, 2.4 and 2.5.1.

    Some RS-485 adapters receive what they send. A request that comes back first is removed. Some answers are equal to
    their requests (functions 5, 6 and 8), so that only other requests show whether an adapter does this:

    * A request that comes back first, and whose answer cannot be equal to it: the adapter returns what is sent.
    * An answer that comes first: it does not.
    * Until one of both has happened, bytes that are equal to such a request are no answer.
    * On a line that returns what is sent, an answer counts only after the request has come back unchanged.

    Attributes:
        returns_requests: Whether the adapter returns what is sent; None = not known.
    """

    def __init__(self, port: str = "serial line") -> None:
        """Begin without a request: no answer is accepted.

        Args:
            port: Name of the line in the log.
        """
        super().__init__()
        self.returns_requests: bool | None = None
        self._port = port
        self._is_told = False
        self._expected: tuple[int, int] | None = None
        self._sent = b""
        self._is_unmistakable = True
        self._at_start = True
        """Whether none of the bytes after the request have been removed."""

    def request(self, unit: int, pdu: bytes) -> bytes:
        """Return the frame of a request; the bytes received before it are discarded."""
        self.discard()
        self._expected = unit, pdu[0]
        self._sent = framed(unit, pdu)
        self._is_unmistakable = not may_equal_request(self._sent)
        self._at_start = True
        return self._sent

    def answer(self) -> bytes | None:
        """Return the PDU of the answer; bytes that are not part of it are discarded."""
        if self._at_start and not self._remove_request():
            return None
        received = self._received
        while self._expected is not None and len(received) >= _SHORTEST:
            length = answer_length(received)
            is_candidate = (received[0], received[1] & ~EXCEPTION) == self._expected and length <= LONGEST_FRAME
            if is_candidate and len(received) < length:
                return None
            if is_candidate and is_checksum_valid(frame := bytes(received[:length])):
                return self._accepted(frame)
            if self._at_start and self.returns_requests:
                self._expected = None  # the request has come back damaged, and perhaps reached the unit so
                return None
            self._at_start = False
            del received[0]
        return None

    def forget_adapter(self) -> None:
        """Forget whether the adapter returns what is sent: it may be another one."""
        self.returns_requests = None

    def _remove_request(self) -> bool:
        """Remove the request at the start of the received bytes; return False if more bytes must show what they are."""
        received, sent = self._received, self._sent
        if not sent.startswith(received[: len(sent)]):
            return True
        if len(received) < len(sent):
            return self._is_answer_complete()
        if self._is_unmistakable:
            self._note_returned()
        if self.returns_requests:
            del received[: len(sent)]
            self._at_start = False
        return True

    def _is_answer_complete(self) -> bool:
        received = self._received
        if len(received) < _SHORTEST:
            return False
        length = answer_length(received)
        return length <= len(received) and is_checksum_valid(received[:length])

    def _accepted(self, frame: bytes) -> bytes | None:
        """Return the PDU of a frame that has the form of the answer; None if it may be the returned request."""
        self._expected = None  # a unit sends nothing unasked, so bytes after the answer are noise
        if self.returns_requests is None and frame == self._sent:
            return None
        if self._at_start:
            self.returns_requests = False
        return frame[1:-2]

    def _note_returned(self) -> None:
        self.returns_requests = True
        if not self._is_told:
            self._is_told = True
            _log.warning("%s: the adapter returns what is sent; the returned bytes are removed", self._port)


def may_equal_request(frame: bytes) -> bool:
    """Return whether the answer to a request on a serial line may consist of the same bytes.

    >>> may_equal_request(framed(1, bytes([6, 0, 0, 0, 7]))), may_equal_request(framed(1, bytes([3, 0, 0, 0, 7])))
    (True, False)
    """
    return frame[1] in _MIRRORED or (frame[1] in _COUNTED and answer_length(frame) == len(frame))


def _described(frame: bytearray) -> str:
    transaction, protocol, length, unit = HEADER.unpack_from(frame)
    return f"transaction {transaction}, protocol {protocol}, length {length} and unit {unit}"


def answer_length(received: bytes | bytearray) -> int:
    """Return the length of the answer at the start of at least 3 bytes, with address and checksum, bytes.

    >>> answer_length(bytes([1, 3, 4, 0, 10]))
    9
    """
    if received[1] & EXCEPTION:
        return _SHORTEST
    return _SHORTEST + received[_COUNT_INDEX] if received[1] in _COUNTED else _CONFIRMATION
