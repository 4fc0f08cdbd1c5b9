"""Child processes of a live run, with their output, and the signals that end the run."""

from __future__ import annotations

import queue
import signal
import subprocess
import sys
from collections.abc import Sequence
from types import FrameType, TracebackType
from typing import Self

from controller.common.stop_request import StopRequest
from controller.common.supervision.parent import Lifeline
from controller.common.supervision.threads import supervised

STOP_S = 30.0
"""Limit of the stop of a process, s: the end of a hang; a busy computer may need several seconds."""


class LiveError(Exception):
    """Timeout or unexpected state of a process or of the machine; the message is one line."""


class ChildError(Exception):
    """Unexpected end of a child process, which has printed the reason to standard error.

    Attributes:
        exit_code: Exit code of the process.
    """

    def __init__(self, name: str, exit_code: int) -> None:
        super().__init__(f"the {name} ended with exit code {exit_code}")
        self.exit_code = exit_code


class Process:
    """Child process with its standard output in a queue of lines; stopped with SIGINT.

    Attributes:
        lifeline: Lifeline, through which a program of this project also ends if this process is killed.
    """

    def __init__(self, name: str, arguments: Sequence[str], *, ends_before: Sequence[Process] = ()) -> None:
        """Start a process.

        Args:
            name: Name in messages.
            arguments: Module and its arguments.
            ends_before: Processes that this one still needs if the parent of all is killed; they end after it.
        """
        self.name = name
        # The messages of the process appear on this console, and its output has the same encoding.
        encoding = sys.stderr.encoding
        self.lifeline: Lifeline = Lifeline([process.lifeline for process in ends_before])
        # Separate session: Ctrl-C reaches only this program, which then stops controller and plant in order.
        self._process = subprocess.Popen(  # noqa: S603 - our own programs
            [sys.executable, "-m", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            encoding=encoding,
            errors="replace",
            start_new_session=True,
            env={**self.lifeline.environment(), "PYTHONIOENCODING": encoding},
            pass_fds=self.lifeline.descriptors,
        )
        self.lifeline.started()
        self._has_output = False
        self.lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._reader = supervised("output of a process", self._read)
        self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    @property
    def exit_code(self) -> int | None:
        """Exit code; None while the process runs."""
        return self._process.poll()

    def next_line(self, within_s: float) -> str | None:
        """Return the next line of output; None at the end of the output.

        Raises:
            LiveError: There was no output within `within_s`.
        """
        try:
            return self.lines.get(timeout=within_s)
        except queue.Empty:
            raise LiveError(f"the {self.name} wrote no output for {within_s:.0f} s") from None

    def kill(self) -> None:
        """Kill the process without clean-up, as in a power failure."""
        self._process.kill()

    def stop(self) -> int:
        """Stop the process with SIGINT, or by force after a timeout; return its exit code.

        A process that has not written any output has not started its work and is killed immediately.
        """
        if self._process.poll() is None and not self._has_output:
            self._process.kill()
        elif self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
        code = self._process.wait()
        self.lifeline.close()
        self._reader.join()
        if self._process.stdout is not None:
            self._process.stdout.close()
        return code

    def _read(self) -> None:
        try:
            for line in self._process.stdout or ():
                self._has_output = True
                self.lines.put(line.rstrip("\n"))
        finally:  # the reader of the queue treats a failure as the end of the process
            self.lines.put(None)


class Interrupts:
    """Handler of Ctrl-C and SIGTERM: raises `KeyboardInterrupt` once, and at every `check` after a request to stop.

    The interpreter discards an exception raised in a destructor. The check makes sure that the request to stop is not
    lost. Further signals must not interrupt the stopping of the processes.
    """

    def __init__(self, stop: StopRequest | None = None) -> None:
        """Create a handler.

        Args:
            stop: Request to stop, which may have been made before; None = none.
        """
        self._stop = stop
        self._received = False

    def __enter__(self) -> Self:
        self._previous = {number: signal.signal(number, self._handle) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def check(self) -> None:
        """Raise `KeyboardInterrupt` if a signal was received, or the request to stop was made."""
        if self._received or (self._stop is not None and self._stop.is_set()):
            raise KeyboardInterrupt

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if not self._received:
            self._received = True
            previous = self._previous[signal.Signals(number)]
            if callable(previous):
                previous(number, frame)  # which raises, and counts what follows soon as repetitions
            raise KeyboardInterrupt
