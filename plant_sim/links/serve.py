"""Plant process, which runs the Modbus server until it receives a signal."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable

from plant_sim.links.modbus_server import PlantServer


async def serve(server: PlantServer, *, listening: Callable[[int], None]) -> None:
    """Serve until SIGINT or SIGTERM, then set the outputs to safe levels and disconnect the clients.

    Args:
        server: A server that has not been started.
        listening: Callback with the port once clients can connect.

    Raises:
        OSError: The port is in use or the address is not local.
    """
    loop = asyncio.get_running_loop()
    serving = asyncio.ensure_future(_serve(server, listening))
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, serving.cancel)
    try:
        await serving
    except asyncio.CancelledError:
        pass
    finally:
        await server.stop()


async def _serve(server: PlantServer, listening: Callable[[int], None]) -> None:
    await server.start()
    listening(server.port)
    await server.serve_forever()
