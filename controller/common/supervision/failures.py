"""Unexpected exceptions in threads and tasks, and items that are lost: their consequences and their counts.

The counts are those of this process since its start; the metrics of the panel show them (`docs/panel.md`).
"""

from __future__ import annotations

import enum
import logging
import os
import signal
import threading
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Final

FAILED: Final = 70
"""Exit code of a process that a failed thread has ended: EX_SOFTWARE of sysexits.h."""
ITEMS: Final[Mapping[str, str]] = {
    "events": "events that could not be written to standard output",
    "history": "records that could not be written to the history",
    "capture": "lines that could not be written to the capture",
    "log": "lines that could not be written to standard error",
    "trends": "periods of the trends that could not be written before newer ones took their place",
}
"""Meanings of the counts of lost items by name."""

_log = logging.getLogger(__name__)
_process_failed = threading.Event()
_lock = threading.Lock()
_failures: Counter[str] = Counter()
_dropped: Counter[str] = Counter()


class Reaction(enum.Enum):
    """Consequence of an unexpected exception in a thread or a task."""

    DROP = "the item is dropped and counted; the work goes on"
    RETRY = "the work is tried again; meanwhile items wait, and beyond a limit they are dropped and counted"
    RESTART = "the part starts again, which is counted"
    END = "the part ends; the process works on without it"
    TELL = "the part ends; the caller that waits for it is told"
    STOP = f"the process stops with safe outputs and exit code {FAILED}"
    EXIT = "the process ends at once"


def failed(name: str, reaction: Reaction, error: BaseException, kind: str = "thread") -> None:
    """Count and report an unexpected exception; stop or end the process if this is the reaction.

    Args:
        name: Name of the thread or the task.
        reaction: Stated consequence.
        error: The exception.
        kind: "thread" or "task".
    """
    with _lock:
        _failures[name] += 1
        count = _failures[name]
    if is_reported(count):
        _log.error("%s %s: %s (%d since the start)", kind, name, reaction.value, count, exc_info=error)
    if reaction is Reaction.STOP:
        _process_failed.set()
        os.kill(os.getpid(), signal.SIGTERM)
    elif reaction is Reaction.EXIT:
        os._exit(FAILED)


def has_failed() -> bool:
    """Return True if a failed thread has stopped this process."""
    return _process_failed.is_set()


def failures() -> dict[str, int]:
    """Return the number of unexpected exceptions by the name of the thread or the task."""
    with _lock:
        return dict(_failures)


def drop(item: str, count: int = 1) -> None:
    """Count items of `ITEMS` that are lost."""
    if item not in ITEMS:
        raise KeyError(item)
    with _lock:
        _dropped[item] += count


def dropped(item: str) -> int:
    """Return the number of lost items of `ITEMS`."""
    with _lock:
        return _dropped[item]


@contextmanager
def counted(item: str) -> Iterator[None]:
    """Count an item of `ITEMS` as lost if an exception ends a `with` block."""
    try:
        yield
    except BaseException:
        drop(item)
        raise


def is_reported(count: int) -> bool:
    """Return True for 1, 10, 100 and so on: a defect that recurs must not fill the log."""
    return str(count).strip("0") == "1"
