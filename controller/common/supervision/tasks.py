"""Tasks and callbacks of the event loops: the work of each, and what an unexpected exception in it means.

Every task is started by `supervised_task` with a name of `TASKS`, and every event loop is run by `run_supervised`,
which supervises the callbacks of connections, lines and timers as well. Errors that a task expects, such as a partner
that disconnects, are handled where they arise; any other exception is a defect, is reported and counted, and has the
stated consequence.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from controller.common.supervision.failures import Reaction, failed

PAUSE_S: Final = 0.1
"""Pause before a task starts again, s: a defect that recurs at once leaves the event loop to the others."""

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class TaskKind:
    """Declaration of a task.

    Attributes:
        work: Work of the task.
        reaction: Consequence of an unexpected exception.
        effect: Effect of the reaction on the machine or on persons.
    """

    work: str
    reaction: Reaction
    effect: str


CALLBACK: Final = "callback"
REQUEST: Final = "panel request"

TASKS: Final[Mapping[str, TaskKind]] = {
    CALLBACK: TaskKind(
        "data, timer or end of a connection or a serial line, in every event loop",
        Reaction.DROP,
        "a TCP connection is closed: outputs and jogs that it holds are released; a serial line works on",
    ),
    "client report": TaskKind("count of client errors, once a minute", Reaction.RESTART, "a report is late"),
    "captured connection": TaskKind(
        "connection of a master to the capture proxy", Reaction.DROP, "both sides of the connection are closed"
    ),
    "captured direction": TaskKind(
        "one direction of a captured connection", Reaction.DROP, "both sides of the connection are closed"
    ),
    "panel poll": TaskKind(
        "read of the controller", Reaction.RESTART, "the view ages; jogs are refused after one second"
    ),
    "telemetry poll": TaskKind("read of the telemetry source", Reaction.RESTART, "its values are shown as missing"),
    "panel view": TaskKind("view for all browsers, ten times a second", Reaction.RESTART, "a view is late"),
    "forced inputs": TaskKind(
        "renewal of forced inputs", Reaction.RESTART, "the controller releases the forced inputs"
    ),
    "newest alarm": TaskKind("look for a history and its newest alarm", Reaction.RESTART, "a list is older"),
    "trend writer": TaskKind("write of the trends, once a minute", Reaction.RESTART, "the periods wait in memory"),
    "jog": TaskKind(
        "renewal of a jogged output", Reaction.DROP, "the output is released; the button must be pressed again"
    ),
    "panel connections": TaskKind(
        "end of connections whose request does not arrive", Reaction.RESTART, "such a connection is closed later"
    ),
    "browser slot": TaskKind(
        "end of a browser whose slot another one gets", Reaction.DROP, "its socket is closed, as by that end"
    ),
    "browser views": TaskKind(
        "views to one browser", Reaction.DROP, "its socket is closed: what it jogs, presses or forces is released"
    ),
    "browser orders": TaskKind(
        "messages of one browser", Reaction.DROP, "its socket is closed: what it jogs, presses or forces is released"
    ),
    "ladder page": TaskKind(
        "translation of the program of a ladder page", Reaction.DROP, "the page shows the rungs without values"
    ),
    "order": TaskKind("execution of an order", Reaction.DROP, "the browser tells that there is no reply"),
    REQUEST: TaskKind("answer to a page, a login or a list", Reaction.DROP, "status 500"),
    "plant time": TaskKind(
        "plant time by the clock of the computer",
        Reaction.TELL,
        "the plant stops with safe outputs and an exit code other than 0",
    ),
    "plant at a PLC": TaskKind(
        "exchange with the PLC of which the plant is a client",
        Reaction.TELL,
        "the plant stops with safe outputs and an exit code other than 0",
    ),
}
"""All tasks of the project by name."""


def supervised_task(
    name: str, work: Callable[[], Coroutine[Any, Any, None]], told: Callable[[Exception], None] = lambda _: None
) -> asyncio.Task[None]:
    """Start a task that reacts to an unexpected exception as `TASKS` declares; it raises none.

    Args:
        name: Name in `TASKS`.
        work: Function that returns the coroutine; with `RESTART`, it is called again after an exception.
        told: Function that receives the exception, after the report.
    """
    return asyncio.get_running_loop().create_task(_run(name, TASKS[name].reaction, work, told), name=name)


@contextmanager
def supervised_item(name: str) -> Iterator[None]:
    """Drop and count the work of a `with` block, in a task of another library, that ends with an exception."""
    try:
        yield
    except Exception as error:  # noqa: BLE001 - the supervision of work in tasks of other libraries
        failed(name, TASKS[name].reaction, error, "task")


def run_supervised(
    main: Coroutine[Any, Any, Result], loop_factory: Callable[[], asyncio.AbstractEventLoop] | None = None
) -> Result:
    """Run an event loop until a coroutine ends, and return its result; exceptions in callbacks are supervised.

    Args:
        main: Coroutine; its exception is raised here.
        loop_factory: Function that returns the event loop; None = that of the system.
    """
    with asyncio.Runner(loop_factory=loop_factory) as runner:
        runner.get_loop().set_exception_handler(_callback_failed)
        return runner.run(main)


def _callback_failed(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    error = context.get("exception")
    if isinstance(error, Exception):
        failed(CALLBACK, TASKS[CALLBACK].reaction, error, "task")
    else:
        loop.default_exception_handler(context)


async def _run(
    name: str, reaction: Reaction, work: Callable[[], Coroutine[Any, Any, None]], told: Callable[[Exception], None]
) -> None:
    while True:
        try:
            await work()
        except Exception as error:  # noqa: BLE001 - the supervision of all tasks
            failed(name, reaction, error, "task")
            told(error)
            if reaction is not Reaction.RESTART:
                return
            await asyncio.sleep(PAUSE_S)
        else:
            return
