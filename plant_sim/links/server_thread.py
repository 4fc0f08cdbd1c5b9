"""A plant server in a thread of its own, for programs that are not asyncio programs."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self, TypeVar

from plant_sim.links.modbus_server import PlantServer

T = TypeVar("T")


class ServerThread:
    """Runs a server from `__enter__` to `__exit__`.

    The plant belongs to the thread while it runs: look at it and touch it through `call`.
    """

    def __init__(self, server: PlantServer) -> None:
        """Prepare a thread for `server`, which must not have been started."""
        self.server = server
        self._thread = threading.Thread(target=self._run, name="plant server")
        self._is_settled = threading.Event()  # listening, or failed to
        self._error: Exception | None = None
        self._loop: asyncio.AbstractEventLoop

    def __enter__(self) -> Self:
        """Start the thread and wait until the server listens.

        Raises:
            OSError: the port is taken or the address is not ours.
        """
        self._thread.start()
        self._is_settled.wait()
        if self._error is not None:
            self._thread.join()
            raise self._error
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop the server and wait for the thread; raises what stopped the plant before, if so."""
        with contextlib.suppress(RuntimeError):  # the loop has ended by itself
            self._loop.call_soon_threadsafe(self.server.end)
        self._thread.join()
        if self._error is not None:
            raise self._error

    def call(self, function: Callable[[], T]) -> T:
        """Call a function in the server's thread, between two requests; return its result."""

        async def run() -> T:
            return function()

        return asyncio.run_coroutine_threadsafe(run(), self._loop).result()

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:  # noqa: BLE001 - raised again in the thread that waits
            self._error = error
        finally:
            self._is_settled.set()

    async def _serve(self) -> None:
        await self.server.start()
        self._loop = asyncio.get_running_loop()
        self._is_settled.set()
        try:
            await self.server.serve_forever()
        finally:
            await self.server.stop()
