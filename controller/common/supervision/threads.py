"""Threads of the commands: why each exists, and what an unexpected exception in it means.

Every thread is started by `supervised` with a name of `THREADS`. Errors that a thread expects, such as a full disk, are
handled where they arise; an exception that reaches its end is a defect, is reported, and has the stated consequence.
"""

from __future__ import annotations

import enum
import logging
import os
import signal
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

FAILED: Final = 70
"""Exit code of a process that a failed thread has ended: EX_SOFTWARE of sysexits.h."""
PAUSE_S: Final = 0.01
"""Pause before a thread works on, s: a defect that recurs at once leaves the processor to the scan."""

_log = logging.getLogger(__name__)
_process_failed = threading.Event()


class Reaction(enum.Enum):
    """Consequence of an unexpected exception in a thread."""

    DROP = "the item is dropped and counted; the thread works on"
    RETRY = "the work is tried again; meanwhile items wait, and beyond a limit they are dropped and counted"
    END = "the part ends; the process works on without it"
    TELL = "the part ends; the thread that waits for it is told"
    STOP = f"the process stops with safe outputs and exit code {FAILED}"
    EXIT = "the process ends at once"


@dataclass(frozen=True, slots=True)
class ThreadKind:
    """Declaration of a thread.

    Attributes:
        blocks: Call that can block, the reason for the thread.
        reaction: Consequence of an unexpected exception.
        is_daemon: True if the process ends without waiting for the thread.
    """

    blocks: str
    reaction: Reaction
    is_daemon: bool = True


THREADS: Final[Mapping[str, ThreadKind]] = {
    "events": ThreadKind("write to standard output, whose reader may be slow", Reaction.DROP),
    "history": ThreadKind("commit to the disk", Reaction.RETRY),
    "capture": ThreadKind("write to the disk", Reaction.END, is_daemon=False),
    "console": ThreadKind("read of standard input", Reaction.DROP, is_daemon=False),
    "device server": ThreadKind("wait for clients, outside the scan", Reaction.END),
    "retentive memory": ThreadKind("write and fsync to the disk", Reaction.STOP),
    "parent": ThreadKind("read of the lifeline", Reaction.STOP),
    "parent of a worker": ThreadKind("wait for the end of the parent", Reaction.EXIT),
    "plant server": ThreadKind("wait for clients, outside the caller", Reaction.TELL, is_daemon=False),
    "output of a process": ThreadKind("read of the output of a child process", Reaction.TELL),
    "late report": ThreadKind("wait that shows whether the process ends", Reaction.END),
}
"""All threads of the project by name."""


def supervised(name: str, work: Callable[[], object]) -> threading.Thread:
    """Return a thread, not yet started, that reacts to an unexpected exception as `THREADS` declares.

    Args:
        name: Name in `THREADS`.
        work: Function of the thread. With `DROP` and `RETRY`, it is called again after an exception; with `DROP`, it
            takes an item before it works on it. With `TELL`, it hands the error on by itself.
    """
    kind = THREADS[name]
    return threading.Thread(target=_run, args=(name, kind, work), name=name, daemon=kind.is_daemon)


def has_failed() -> bool:
    """Return True if a failed thread has stopped this process."""
    return _process_failed.is_set()


def _run(name: str, kind: ThreadKind, work: Callable[[], object]) -> None:
    failures = 0
    while True:
        try:
            work()
        except Exception:  # noqa: BLE001 - the supervision of all threads
            failures += 1
            if _is_reported(failures):
                _log.exception("thread %s: %s (%d since the start)", name, kind.reaction.value, failures)
            _react(kind.reaction)
            if kind.reaction not in {Reaction.DROP, Reaction.RETRY}:
                return
            threading.Event().wait(PAUSE_S)
        else:
            return


def _is_reported(count: int) -> bool:
    """Return True for 1, 10, 100 and so on: a defect that recurs must not fill the log."""
    return str(count).strip("0") == "1"


def _react(reaction: Reaction) -> None:
    if reaction is Reaction.STOP:
        _process_failed.set()
        os.kill(os.getpid(), signal.SIGTERM)
    elif reaction is Reaction.EXIT:
        os._exit(FAILED)
