"""SIGINT, SIGTERM and SIGHUP: the request to stop, from the first line of a process to its end.

A service, such as the controller, must write its outputs and close its files before it ends. Its handler therefore only
records the request, and the service looks for it. Any other command is interrupted by `KeyboardInterrupt`.
"""

from __future__ import annotations

import atexit
import ctypes
import math
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Final, NoReturn, Protocol, Self

from controller.common.output_streams import prepare_output_streams
from controller.common.supervision.failures import FAILED, has_failed
from controller.common.supervision.parent import end_with_parent

SIGNALS: Final = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end a process; SIGHUP, which Windows lacks, comes from a terminal that is closed."""
REPEAT_S: Final = 1.0
"""Time within which repeated signals count as one interruption of a command, s (assumed): a held key."""
INTERRUPTED: Final = 128 + signal.SIGINT
"""Exit code of a command whose work was interrupted by Ctrl-C: 128 + SIGINT, by shell convention."""


class Stop(Protocol):
    """Event that ends a loop; `threading.Event` and `StopRequest` are such events."""

    def is_set(self) -> bool:
        """Return True if the loop must end."""

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the event is set or the timeout, s, has elapsed; return True if it is set."""


class StopRequest:
    """Request to stop this process, made by one of `SIGNALS` and never withdrawn.

    A handler runs between two instructions of the main thread, which may hold the lock of a `threading.Event`. `set`
    therefore takes no lock: it writes to a socket, for which `wait`, and any `select`, can wait in every thread.
    """

    def __init__(self) -> None:
        self._is_set = False
        self._listens = False
        self._raised_s = -math.inf
        self._actions: list[Callable[[], object]] = []
        self._receiver, self._sender = socket.socketpair()
        self._sender.setblocking(False)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._receiver.close()
        self._sender.close()

    def fileno(self) -> int:
        """Return the file descriptor that becomes readable, and stays so, when the request is made."""
        return self._receiver.fileno()

    def is_set(self) -> bool:
        """Return True if the request has been made."""
        return self._is_set

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the request is made or the timeout, s, has elapsed; return True if it has been made."""
        select.select([self._receiver], [], [], timeout)
        return self._is_set

    def set(self) -> None:
        """Make the request; no effect if it has been made."""
        if not self._is_set:
            self._is_set = True
            self._sender.send(b"\0")
            for action in tuple(self._actions):
                action()

    @contextmanager
    def calling(self, action: Callable[[], object]) -> Iterator[None]:
        """Call a function when the request is made within a `with` block, or at once if it has been made before.

        Args:
            action: Function that takes no lock, such as `loop.call_soon_threadsafe` of an event loop.
        """
        self._actions.append(action)
        try:
            if self._is_set:
                action()
            yield
        finally:
            self._actions.remove(action)

    def listen(self) -> None:
        """Let the signals make the request; SIGHUP only if it is not ignored, as it is after ``nohup``."""
        self._listens = True
        for number in _effective():
            signal.signal(number, lambda *_: self.set())

    def interrupt(self) -> None:
        """Let the signals raise `KeyboardInterrupt` instead; no effect before `listen`.

        Raises:
            KeyboardInterrupt: The request has been made.
        """
        if not self._listens:
            return
        for number in _effective():
            signal.signal(number, self._raise)
        if self._is_set:
            self._raise()

    def collect(self) -> None:
        """Let the signals make the request again, after `interrupt`; no effect before `listen`."""
        if self._listens:
            self.listen()

    def _raise(self, *_: object) -> None:
        """Raise `KeyboardInterrupt`, which may interrupt the clean-up after an earlier one only after `REPEAT_S`."""
        now_s = time.perf_counter()
        if now_s - self._raised_s >= REPEAT_S:
            self._raised_s = now_s
            raise KeyboardInterrupt


def _effective() -> list[int]:
    """Return the signals that can end this process."""
    return [number for number in SIGNALS if number in SIGNALS[:2] or signal.getsignal(number) is not signal.SIG_IGN]


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Delay SIGINT to the end of a `with` block of the main thread that starts processes.

    Ctrl-C at a terminal reaches every process in the foreground. A process that is started meanwhile never receives it,
    from its first instruction, on systems with signal masks: its parent is interrupted and ends it. The parent is not
    interrupted between two starts, because nothing would end the first process. No effect in other threads.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: received.append(number))  # for signals to other threads
    try:
        mask = getattr(signal, "pthread_sigmask", None)
        before = mask(signal.SIG_BLOCK, {signal.SIGINT}) if mask is not None else None
        try:
            yield
        finally:
            if mask is not None:
                mask(signal.SIG_SETMASK, before)
    finally:
        signal.signal(signal.SIGINT, handler)
        if received:
            signal.raise_signal(signal.SIGINT)


def discard_signals() -> None:
    """Let the system ignore the signals from now on, at the end of a process.

    The interpreter joins threads and calls exit functions after the main function. A signal in this phase would print
    "Exception ignored". Python keeps a handler without effect, because a signal for which it has none is printed as an
    error ("ignored due to race condition"): any thread may have received one that Python has not seen yet.
    """
    ignore_in_system = ctypes.pythonapi.PyOS_setsig
    ignore_in_system.argtypes = (ctypes.c_int, ctypes.c_void_p)
    ignore_in_system.restype = ctypes.c_void_p
    for number in SIGNALS:
        signal.signal(number, lambda *_: None)
        ignore_in_system(number, signal.SIG_IGN)


def _ignore_signals() -> None:
    """Remove the handlers of the signals; the interpreter would else let them end the process in its last moment."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def run_process(main: Callable[[StopRequest], int]) -> NoReturn:
    """Run the main function of a process, with prepared output streams, and exit with its exit code.

    The end of the parent that started it with a lifeline is a request to stop, too.

    Args:
        main: Main function; it imports the command, so that a signal during the imports, too, is a request to stop.
    """
    atexit.register(_ignore_signals)  # called last, because it is registered first
    stop = StopRequest()
    stop.listen()
    prepare_output_streams()
    end_with_parent()
    try:
        code = main(stop)
    except KeyboardInterrupt:  # between two instructions after the command has ended
        code = INTERRUPTED
    else:
        code = FAILED if has_failed() else code
    finally:
        discard_signals()
    sys.exit(code)
