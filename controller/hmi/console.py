"""Text console: operator orders line by line, for a machine without a panel."""

from __future__ import annotations

import os
import select
import sys
from collections import deque
from collections.abc import Iterable
from types import TracebackType
from typing import Final, Self

from controller.common.stop_request import StopRequest
from controller.common.supervision.threads import supervised
from controller.events.alarm_list import AlarmList, AlarmRefusalError
from controller.io.runtime import Runtime
from controller.program.set_points import LONGEST_NUMBER, SetPointError

OPERATOR: Final = "console"
MINUTE_MS: Final = 60_000
RECEIVED_BYTES: Final = 4_096
FORMS: Final = (
    "a command of the table",
    "set NAME=VALUE",
    "acknowledge [ALARM]",
    "shelve ALARM MINUTES",
    "unshelve ALARM",
)


class OrderError(ValueError):
    """Raised for an unknown or refused order; the message is one line with the remedy."""


class Console:
    """Line interpreter; every line, including an empty one, also counts as an operator heartbeat."""

    def __init__(self, runtime: Runtime, alarms: AlarmList) -> None:
        """Initialise a console for a runtime and its alarm list."""
        self._runtime = runtime
        self._alarms = alarms

    def execute(self, line: str) -> None:
        """Execute one line.

        Raises:
            OrderError: The order is unknown or refused; nothing has changed.
        """
        self._runtime.panel.heartbeat()
        word, *rest = line.split() or [""]
        try:
            if word:
                self._dispatch(word, rest)
        except (AlarmRefusalError, SetPointError) as error:
            raise OrderError(f"{line.strip()}: {error}") from error

    def _dispatch(self, word: str, rest: list[str]) -> None:
        match word, rest:
            case "set", [text]:
                name, _, value = text.partition("=")
                self._runtime.set_points({name: value})
            case "acknowledge", []:
                self._alarms.acknowledge(by=OPERATOR)
                self._runtime.order(word)
            case "acknowledge", [alarm]:
                self._alarms.acknowledge(_whole_number(alarm), by=OPERATOR)
            case "shelve", [alarm, minutes]:
                self._alarms.shelve(_whole_number(alarm), _whole_number(minutes) * MINUTE_MS, by=OPERATOR)
            case "unshelve", [alarm]:
                self._alarms.unshelve(_whole_number(alarm), by=OPERATOR)
            case _, []:
                self._order(word)
            case _:
                raise OrderError(f"unknown order {' '.join([word, *rest])!r}; expected {_either(FORMS)}")

    def _order(self, name: str) -> None:
        try:
            self._runtime.order(name)
        except KeyError as error:
            raise OrderError(str(error.args[0])) from error


class ConsoleReader:
    """Thread that passes the lines of standard input to a console for the duration of a `with` block.

    It waits for input and for its own end at the same time, so that it never blocks in a read: a thread that holds the
    lock of standard input when the interpreter ends aborts the process.
    """

    def __init__(self, console: Console, descriptor: int) -> None:
        """Create a reader.

        Args:
            console: Console that executes the lines; refusals are printed on standard error.
            descriptor: File descriptor to read from until end of file.
        """
        self._console = console
        self._descriptor = descriptor
        self._end = StopRequest()
        self._lines: deque[bytes] = deque()
        self._rest = b""
        self._thread = supervised("console", self._run)

    def __enter__(self) -> Self:
        """Start the thread."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """End the thread; input that has not been read is ignored."""
        with self._end:
            self._end.set()
            self._thread.join()

    def _run(self) -> None:
        while self._lines or self._fill():
            while self._lines:
                self._execute(self._lines.popleft())
        rest, self._rest = self._rest, b""
        if rest and not self._end.is_set():
            self._execute(rest)

    def _fill(self) -> bool:
        """Wait for input; return False at its end."""
        received = self._receive()
        *lines, self._rest = (self._rest + received).split(b"\n")
        self._lines.extend(lines)
        return bool(received)

    def _receive(self) -> bytes:
        """Return the next bytes; none at the end of file, after the terminal has been closed, and at the end."""
        select.select([self._descriptor, self._end.fileno()], [], [])
        if self._end.is_set():
            return b""
        try:
            return os.read(self._descriptor, RECEIVED_BYTES)
        except OSError:
            return b""

    def _execute(self, line: bytes) -> None:
        """Execute one line; undecodable bytes are replaced."""
        try:
            self._console.execute(line.decode(errors="replace"))
        except OrderError as error:
            sys.stderr.write(f"{error}\n")
            sys.stderr.flush()


def _whole_number(text: str) -> int:
    if not text.isdecimal() or len(text) > LONGEST_NUMBER:
        raise OrderError(f"{text[:20]!r} is not a whole number of up to {LONGEST_NUMBER} digits")
    return int(text)


def _either(forms: Iterable[str]) -> str:
    *others, last = forms
    return f"{', '.join(others)} or {last}"
