"""Threads of the commands: why each exists, and what an unexpected exception in it means.

Every thread is started by `supervised` with a name of `THREADS`, and every call in a thread of an event loop is made by
`in_thread` with a name of `CALLS`. Errors that a thread expects, such as a full disk, are handled where they arise; an
exception that reaches its end is a defect, is reported and counted, and has the stated consequence.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, ParamSpec, TypeVar

from controller.common.supervision.failures import Reaction, failed

PAUSE_S: Final = 0.01
"""Pause before a thread works on, s: a defect that recurs at once leaves the processor to the scan."""

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


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

CALLS: Final[Mapping[str, str]] = {
    "password check": "computation of a hash, slow on purpose",
    "password file": "write and fsync to the disk",
    "history of the panel": "read of a database that may be large or locked",
    "trends of the panel": "read of a database and computation of an answer",
    "trend file": "commit to the disk",
    "ladder page": "translation of a program, which takes seconds for a large one",
}
"""All calls in threads of an event loop by name, with what can block; the task that waits is told of an exception."""


def supervised(name: str, work: Callable[[], object]) -> threading.Thread:
    """Return a thread, not yet started, that reacts to an unexpected exception as `THREADS` declares.

    Args:
        name: Name in `THREADS`.
        work: Function of the thread. With `DROP` and `RETRY`, it is called again after an exception; with `DROP`, it
            takes an item before it works on it. With `TELL`, it hands the error on by itself.
    """
    kind = THREADS[name]
    return threading.Thread(target=_run, args=(name, kind, work), name=name, daemon=kind.is_daemon)


async def in_thread(
    name: str, function: Callable[Arguments, Result], *args: Arguments.args, **named: Arguments.kwargs
) -> Result:
    """Call a function that can block in a thread of the event loop, and return its result.

    Args:
        name: Name in `CALLS`.
        function: Function; its exception is raised here.
        *args: Arguments of the function.
        **named: Named arguments of the function.
    """
    if name not in CALLS:
        raise KeyError(name)
    return await asyncio.to_thread(function, *args, **named)


def _run(name: str, kind: ThreadKind, work: Callable[[], object]) -> None:
    while True:
        try:
            work()
        except Exception as error:  # noqa: BLE001 - the supervision of all threads
            failed(name, kind.reaction, error)
            if kind.reaction not in {Reaction.DROP, Reaction.RETRY}:
                return
            threading.Event().wait(PAUSE_S)
        else:
            return
