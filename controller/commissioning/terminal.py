"""Terminal of the person who commissions: single keys without Enter, and the loss of the terminal."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from controller.common.errors import InputError
from controller.common.stop_request import StopRequest


class TerminalLostError(Exception):
    """Raised when the terminal has been closed; the outputs must go to their safe levels."""


class Keyboard(Protocol):
    """Source of key presses and place for texts."""

    def keys(self, within_s: float) -> str:
        """Return the keys pressed since the last call, or nothing after a time.

        Raises:
            TerminalLostError: The terminal has been closed.
        """

    def show(self, text: str) -> None:
        """Print a line."""


class Terminal:
    """Terminal on standard input and output."""

    def __init__(self, stop: StopRequest) -> None:
        """Create a keyboard on standard input; `single_keys` prepares it."""
        self._fd = sys.stdin.fileno()
        self._stop = stop

    def keys(self, within_s: float) -> str:
        """Return the keys pressed since the last call, or nothing after a time.

        Raises:
            TerminalLostError: The terminal has been closed.
        """
        ready, _, _ = select.select([self._fd, self._stop], [], [], within_s)
        if self._fd not in ready:
            return ""
        try:
            data = os.read(self._fd, 1_024)
        except OSError as error:
            raise TerminalLostError(str(error)) from error
        if not data:
            raise TerminalLostError("end of standard input")
        return data.decode("utf-8", "replace")

    def show(self, text: str) -> None:
        """Print a line.

        Raises:
            TerminalLostError: The terminal has been closed.
        """
        try:
            sys.stdout.write(f"{text}\n")
            sys.stdout.flush()
        except OSError as error:
            raise TerminalLostError(str(error)) from error


@contextmanager
def single_keys(stop: StopRequest) -> Iterator[Terminal]:
    """Deliver every key at once within a `with` block, without echo; Ctrl-Z and Ctrl-S do not stop the process.

    A closed terminal (SIGHUP) and the quit key (SIGQUIT) are requests to stop.

    Raises:
        InputError: Standard input is not a terminal.
    """
    if sys.stdin is None or not sys.stdin.isatty():
        raise InputError("check-io: standard input is not a terminal; outputs are switched by a held key only")
    import termios  # noqa: PLC0415 - not available on Windows

    fd = sys.stdin.fileno()
    before = termios.tcgetattr(fd)
    now = termios.tcgetattr(fd)
    now[0] &= ~termios.IXON
    now[3] &= ~(termios.ICANON | termios.ECHO)
    handlers = {
        **{number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGHUP, signal.SIGQUIT)},
        signal.SIGTSTP: signal.signal(signal.SIGTSTP, signal.SIG_IGN),
    }
    termios.tcsetattr(fd, termios.TCSAFLUSH, now)
    try:
        yield Terminal(stop)
    finally:
        with contextlib.suppress(termios.error):  # the terminal has been closed
            termios.tcsetattr(fd, termios.TCSADRAIN, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
