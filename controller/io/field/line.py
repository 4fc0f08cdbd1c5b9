"""Lines to field devices: one exchange at a time on each line, exchanges on different lines at the same time."""

from __future__ import annotations

import select
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from controller.common.modbus.client_requests import AnswerError, ExceptionReplyError, ModbusRequest
from controller.io.link import LinkError

T = TypeVar("T")


class BusLine(ABC):
    """Line to one or more devices. Times are those of `time.perf_counter`, s.

    After `fail` and `close`, no answer to an earlier request is accepted as the answer to a later one.

    Attributes:
        address: Address for messages.
        ready_s: Time before which nothing may be sent, s.
        sequenced: True if answers carry the number of their request.
    """

    sequenced = True

    def __init__(self, address: str) -> None:
        """Create a closed line."""
        self.address = address
        self.ready_s = 0.0

    @property
    @abstractmethod
    def is_open(self) -> bool:
        """True if requests can be sent."""

    @abstractmethod
    def begin(self) -> None:
        """Begin to open a closed line.

        Raises:
            OSError: The line cannot be opened.
        """

    @abstractmethod
    def finish(self, deadline_s: float) -> None:
        """Wait until the line is open.

        Raises:
            OSError: The line cannot be opened, or not before the deadline.
        """

    @abstractmethod
    def fileno(self) -> int:
        """Return the file descriptor that becomes readable when data arrives."""

    @abstractmethod
    def send(self, unit: int, request: ModbusRequest) -> None:
        """Send a request.

        Raises:
            OSError: The line has failed.
        """

    @abstractmethod
    def receive(self) -> bytes | None:
        """Return the PDU of the answer to the request sent last, from the data that has arrived; None = not complete.

        Raises:
            OSError: The line has failed.
        """

    @abstractmethod
    def fail(self) -> None:
        """Note that the last request has no valid answer."""

    @abstractmethod
    def close(self) -> None:
        """Close the line; no effect on a closed one."""


@dataclass(slots=True)
class Exchange:
    """Request to one device, and its answer.

    Attributes:
        line: Line of the device.
        unit: Unit identifier.
        timeout_s: Longest time from the request to its complete answer, s.
        request: The request.
        data: Data of the answer; None if there is no valid answer.
        error: Reason for which there is no valid answer; empty = none.
        refusal: Code of an exception response; 0 = none.
        is_answered: True if an answer has come, also a refusal or one that is not valid for the request.
        took_s: Time from the request to its complete answer or to its failure, s; zero before.
    """

    line: BusLine
    unit: int
    timeout_s: float
    request: ModbusRequest
    data: bytes | None = None
    error: str = ""
    refusal: int = 0
    is_answered: bool = False
    took_s: float = 0.0
    _deadline_s: float | None = None

    def advance(self, now_s: float) -> bool:
        """Send the request, or look for its answer; return True at the end."""
        try:
            if self._deadline_s is None:
                self._send(now_s)
            elif (answer := self.line.receive()) is not None:
                self.is_answered = True
                self.data = self.request.data(answer)
        except ExceptionReplyError as refused:
            self.error, self.refusal = str(refused), refused.code
        except AnswerError as invalid:
            self._failed(str(invalid))
        except (ConnectionError, EOFError):
            self._failed("connection lost")
            self.line.close()
        except OSError as error:
            self._failed(error.strerror or str(error))
            self.line.close()
        # after the data has been read: an answer that has arrived counts, even if this process looks late
        if self._deadline_s is not None and now_s >= self._deadline_s and self.data is None and not self.error:
            self._failed(f"no valid answer within {round(self.timeout_s * 1_000)} ms")
        is_done = self.data is not None or bool(self.error)
        if is_done and self._deadline_s is not None:
            self.took_s = now_s - self._deadline_s + self.timeout_s
        return is_done

    @property
    def is_sent(self) -> bool:
        """True if the answer is awaited."""
        return self._deadline_s is not None

    def due_s(self) -> float:
        """Return the time at which `advance` must be called even if no data arrives."""
        return self.line.ready_s if self._deadline_s is None else self._deadline_s

    def _send(self, now_s: float) -> None:
        if not self.line.is_open:
            self.error = "the link is not open"
        elif now_s >= self.line.ready_s:
            self._deadline_s = now_s + self.timeout_s
            self.line.send(self.unit, self.request)

    def _failed(self, reason: str) -> None:
        self.error = reason
        self.line.fail()


def exchange_all(exchanges: Iterable[Exchange]) -> None:
    """Execute exchanges: those on one line in order, those on different lines at the same time.

    After a failed exchange, the remaining ones with the same device are not executed.
    """
    queues: dict[BusLine, deque[Exchange]] = {}
    for each in exchanges:
        queues.setdefault(each.line, deque()).append(each)
    while queues:
        _wait([queue[0] for queue in queues.values()])
        for line, queue in tuple(queues.items()):
            while queue and queue[0].advance(time.perf_counter()):
                done = queue.popleft()
                for other in queue:
                    if done.error and other.unit == done.unit:
                        other.error = done.error
                while queue and queue[0].error:
                    queue.popleft()
            if not queue:
                del queues[line]


def complete(steps: Generator[Exchange, None, T]) -> T:
    """Execute exchanges one after another, each of which may depend on the ones before; return the result."""
    while True:
        try:
            each = next(steps)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]
        exchange_all([each])


def complete_all(works: Iterable[Generator[Exchange, None, object]]) -> list[str]:
    """Execute several sequences of exchanges at the same time; return the errors of those that have failed."""
    errors: list[str] = []
    waiting = list(works)
    while waiting:
        going: list[tuple[Generator[Exchange, None, object], Exchange]] = []
        for steps in waiting:
            try:
                going.append((steps, next(steps)))
            except StopIteration:
                continue
            except LinkError as error:
                errors.append(str(error))
        exchange_all(each for _, each in going)
        waiting = [steps for steps, _ in going]
    return errors


def _wait(first: Sequence[Exchange]) -> None:
    """Wait until data arrives for one of the exchanges, or one of them is due."""
    sent = [each.line for each in first if each.is_sent and each.line.is_open]
    left_s = min(each.due_s() for each in first) - time.perf_counter()
    if left_s > 0:
        select.select(sent, [], [], left_s)
