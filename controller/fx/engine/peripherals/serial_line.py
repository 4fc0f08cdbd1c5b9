"""Serial line of a communication board, with a partner that sends at given times and answers requests."""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction


@dataclass(frozen=True, slots=True)
class SerialAnswer:
    """Answer of the partner to a request.

    Attributes:
        request: Bytes of the complete request.
        delay_ms: Time from the end of the request to the beginning of the answer, ms.
        answer: Bytes of the answer.
    """

    request: bytes
    delay_ms: int
    answer: bytes


class FxSerialLine:
    """Serial line of one PLC.

    Attributes:
        sent: Transmissions of the PLC, each with the time of its end, rounded up to ms.
    """

    def __init__(self, received: Iterable[tuple[int, bytes]] = (), answers: Iterable[SerialAnswer] = ()) -> None:
        """Connect a partner.

        Args:
            received: Times in ms at which the partner begins to send, with its bytes.
            answers: Answers of the partner; the first one with the request is used.
        """
        self.sent: list[tuple[int, bytes]] = []
        self._answers = tuple(answers)
        self._waiting = [(Fraction(at_ms), data) for at_ms, data in received]
        heapq.heapify(self._waiting)
        self._free_ms = Fraction(0)

    def send(self, data: bytes, end_ms: Fraction) -> None:
        """Send bytes to the partner; the transmission ends at a time in ms."""
        self.sent.append((-(-end_ms.numerator // end_ms.denominator), data))
        answer = next((each for each in self._answers if each.request == data), None)
        if answer is not None:
            heapq.heappush(self._waiting, (end_ms + answer.delay_ms, answer.answer))

    def take(self, now_ms: int, byte_ms: Fraction) -> list[tuple[Fraction, int]]:
        """Return the bytes whose reception has ended by now, each with the time of its end in ms.

        Args:
            now_ms: Time, ms.
            byte_ms: Time of one byte, ms.
        """
        taken: list[tuple[Fraction, int]] = []
        while self._waiting and max(self._waiting[0][0], self._free_ms) + byte_ms <= now_ms:
            wanted_ms, data = heapq.heappop(self._waiting)
            begin_ms = max(wanted_ms, self._free_ms)
            count = min(len(data), (now_ms - begin_ms) // byte_ms)
            taken += [(begin_ms + (n + 1) * byte_ms, data[n]) for n in range(count)]
            self._free_ms = begin_ms + count * byte_ms
            if count < len(data):
                # with its original time, so that no other transmission starts between its bytes
                heapq.heappush(self._waiting, (wanted_ms, data[count:]))
                break
        return taken
