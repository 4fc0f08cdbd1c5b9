"""Server thread: an event loop that serves all endpoints, so that clients never delay the scan."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Final, Self

from controller.common.supervision.tasks import run_supervised, supervised_task
from controller.common.supervision.threads import supervised
from controller.hmi.serving.endpoints import Endpoint, ServerError
from controller.io.scan_writes import ScanWrites

REPORT_EVERY_S: Final = 60.0
"""Period of the client error report, s."""

_log = logging.getLogger(__name__)


class DeviceServer:
    """Thread that serves between `__enter__` and `__exit__`."""

    def __init__(
        self, endpoints: Sequence[Endpoint], writes: ScanWrites, every_minute: Callable[[], None] = lambda: None
    ) -> None:
        """Initialise without a thread.

        Args:
            endpoints: TCP ports and serial lines.
            writes: Writes of their partners.
            every_minute: Function called once a minute in the thread of the server.
        """
        self._endpoints = tuple(endpoints)
        self._writes = writes
        self._every_minute = every_minute
        self._thread = supervised("device server", self._run)
        self._started = threading.Event()
        self._error: Exception | None = None
        self._loop: asyncio.AbstractEventLoop
        self._ended: asyncio.Event

    @property
    def connections(self) -> int:
        """Number of clients connected to all endpoints."""
        return sum(endpoint.connections for endpoint in self._endpoints)

    def __enter__(self) -> Self:
        """Start the thread and wait until all endpoints listen.

        Raises:
            ServerError: A port is in use, or a serial line cannot be opened; nothing is served.
        """
        self._thread.start()
        self._started.wait()
        if self._error is not None:
            self._thread.join()
            if isinstance(self._error, ServerError):
                raise self._error
            raise ServerError(f"device server: {self._error}") from self._error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close all connections and stop listening."""
        with contextlib.suppress(RuntimeError):  # the loop has already ended
            self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()

    def call(self, function: Callable[[], None]) -> None:
        """Call a function in the server thread, between two requests."""
        self._loop.call_soon_threadsafe(function)

    def _run(self) -> None:
        try:
            run_supervised(self._serve())
        except Exception as error:
            if self._started.is_set():
                raise
            self._error = error  # raised by `__enter__`
        finally:
            self._started.set()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._ended = asyncio.Event()
        reporter = supervised_task("client report", self._report)
        try:
            for endpoint in self._endpoints:
                await endpoint.start(self._loop)
            self._started.set()
            await self._ended.wait()
        finally:
            reporter.cancel()
            self._writes.withdraw_all()
            await asyncio.sleep(0)  # their partners are told
            for endpoint in self._endpoints:
                await endpoint.stop()

    async def _report(self) -> None:
        """Log client errors in one line, at most once a minute."""
        logged = (0, 0, 0)
        while True:
            await asyncio.sleep(REPORT_EVERY_S)
            self._every_minute()
            traffic = [endpoint.traffic for endpoint in self._endpoints]
            counts = (
                sum(each.bad_frames for each in traffic),
                sum(each.refused + each.displaced for each in traffic),
                sum(each.timed_out for each in traffic),
            )
            if counts != logged:
                _log.warning("clients since the start: %d bad frames, %d over the connection limit, %d idle", *counts)
                logged = counts
