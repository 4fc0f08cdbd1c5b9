"""Plant process, which runs the Modbus server until it is stopped."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from controller.common.stop_request import StopRequest
from plant_sim.links.modbus_server import PlantServer


async def serve(server: PlantServer, stop: StopRequest, *, listening: Callable[[int], None]) -> None:
    """Serve until the request to stop, then set the outputs to safe levels and disconnect the clients.

    Args:
        server: A server that has not been started.
        stop: Request to stop.
        listening: Callback with the port once clients can connect.

    Raises:
        OSError: The port is in use or the address is not local.
    """
    loop = asyncio.get_running_loop()
    try:
        await server.start()
        with stop.calling(lambda: loop.call_soon_threadsafe(server.end)):
            listening(server.port)
            await server.serve_forever()
    finally:
        await server.stop()
