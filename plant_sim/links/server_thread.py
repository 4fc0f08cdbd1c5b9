"""Plant server in a separate thread, for programs that do not use asyncio."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self, TypeVar

from controller.common.supervision.tasks import run_supervised
from controller.common.supervision.threads import supervised
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.real_time import precise_loop

T = TypeVar("T")


class ServerThread:
    """Context manager that runs a server in a thread.

    The plant belongs to the thread while it runs: access it only through `call`.
    """

    def __init__(self, server: PlantServer) -> None:
        """Create a thread for a server that has not been started."""
        self.server = server
        self._thread = supervised("plant server", self._run)
        self._is_settled = threading.Event()  # listening, or failed to start
        self._error: Exception | None = None
        self._loop: asyncio.AbstractEventLoop

    def __enter__(self) -> Self:
        """Start the thread and wait until the server listens.

        Raises:
            OSError: The port is in use or the address is not local.
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
        """Stop the server and wait for the thread; raise the error that stopped the plant, if any."""
        with contextlib.suppress(RuntimeError):  # the loop has already ended
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
            run_supervised(self._serve(), precise_loop)
        except Exception as error:  # noqa: BLE001 - raised again in the waiting thread
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
