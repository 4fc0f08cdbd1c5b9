"""The simulated machine as a Modbus TCP device: I/O module, operator box and telemetry.

| table             | from | content                                             | functions |
|-------------------|------|-----------------------------------------------------|-----------|
| discrete inputs   | 0    | X points at their offsets in io_map.yaml            | 2         |
| coils             | 0    | Y points at their offsets in io_map.yaml            | 1, 5, 15  |
| coils             | 100  | operator box, `plant_sim.links.box.BOX_COILS`       | 1, 5, 15  |
| input registers   | 0    | telemetry, `plant_sim.links.telemetry.TELEMETRY`    | 4         |
| input registers   | 1000 | owner of the outputs, `output_owner.OwnerReport`    | 4         |

Requests with any unit identifier are answered: the server is a single device. Modbus has no
authentication, so the server listens on the loopback address by default.

Plant time advances in one of two modes. *Real time*: in ticks of 5 ms by the wall clock. *Lock step*:
by a fixed time at each completed write of the Y block and at no other time. In lock step a trial over
real sockets is deterministic and independent of computer speed.
"""

from __future__ import annotations

import asyncio

from pymodbus.constants import ExcCodes

from controller.common.connections import Traffic
from controller.common.modbus.address import checked_host
from controller.common.modbus.mbap import MbapServer
from controller.common.modbus.requests import RequestRefusedError
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_image import image_of
from plant_sim.links.pacing import Pacer

DEFAULT_PORT = 5020


class PlantServer:
    """Modbus TCP server of one I/O module, for use from one event loop.

    Attributes:
        module: Served module.
        pacer: Real-time accounting, including `dropped_ms`; None in lock step.
    """

    def __init__(
        self,
        module: IoModule,
        *,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        lock_step_ms: int | None = None,
        allow_remote: bool = False,
        max_connections: int = 8,
        idle_timeout_s: float = 60.0,
    ) -> None:
        """Create the server; `start` opens the port.

        Args:
            module: Module to serve.
            host: IP address to listen on; localhost is 127.0.0.1.
            port: TCP port; 0 selects a free port.
            lock_step_ms: Plant time per completed write of the Y block, ms; None for real time.
            allow_remote: True permits an address that other computers can reach.
            max_connections: Maximum number of connections; further ones are closed immediately.
            idle_timeout_s: Time without a request after which a connection is closed, s.

        Raises:
            ValueError: The address or a time is invalid.
            IoMapError: An output in the I/O map has the address of a button of the operator box.
        """
        _check_lock_step(lock_step_ms, module.watchdog_ms)
        self.module = module
        self.pacer = Pacer() if lock_step_ms is None else None
        self._host = checked_host(host, allow_remote=allow_remote, option="--allow-remote")
        self._port = port
        self._lock_step_ms = lock_step_ms
        self._blocks_seen = module.block_writes
        self._frontend = MbapServer(
            lambda client: image_of(module, client, self._written), max_connections, idle_timeout_s
        )
        image_of(module, "")  # reports an invalid I/O map now
        self._listener: asyncio.Server | None = None
        self._time_base: asyncio.Task[None] | None = None
        self._ended: asyncio.Future[None]

    @property
    def host(self) -> str:
        """Address to listen on."""
        return self._host

    @property
    def port(self) -> int:
        """TCP port; after `start` the actual one if 0 was requested."""
        return self._port

    @property
    def traffic(self) -> Traffic:
        """Connection statistics since the start."""
        return self._frontend.traffic

    async def start(self) -> None:
        """Open the port and, in real-time mode, start plant time. A server can be started only once.

        Raises:
            OSError: The port is in use or the address is not local; the message states which.
        """
        loop = asyncio.get_running_loop()
        self._listener = await loop.create_server(self._frontend, self._host, self._port)
        self._port = self._listener.sockets[0].getsockname()[1]
        self._ended = loop.create_future()
        if self.pacer is not None:
            self._time_base = loop.create_task(self._follow_clock(self.pacer))

    async def serve_forever(self) -> None:
        """Wait for `end` or for a failure of the plant, which is raised as an exception."""
        await self._ended

    def end(self) -> None:
        """Make `serve_forever` return; may be called from a signal handler."""
        if not self._ended.done():
            self._ended.set_result(None)

    async def stop(self) -> None:
        """Disconnect the clients, set the outputs to safe levels and close the port. No effect if stopped."""
        if self._listener is None:
            return
        self._listener.close()
        self._frontend.close()
        self.module.make_safe()  # no client is connected
        if self._time_base is not None:
            self._time_base.cancel()
            await asyncio.wait([self._time_base])
        await self._listener.wait_closed()
        self._listener = None

    def _written(self) -> None:
        """Advance plant time in lock step after a complete write of the Y block."""
        if self._lock_step_ms is None or self.module.block_writes == self._blocks_seen:
            return
        self._blocks_seen = self.module.block_writes
        if not self._advance(self._lock_step_ms):
            raise RequestRefusedError(ExcCodes.DEVICE_FAILURE)

    async def _follow_clock(self, pacer: Pacer) -> None:
        """Advance the plant in ticks, each due at an absolute time after the start."""
        loop = asyncio.get_running_loop()
        start_s = loop.time()
        while True:
            elapsed_ms = int((loop.time() - start_s) * 1_000)
            for _ in range(pacer.ticks_due(elapsed_ms)):
                if not self._advance(pacer.tick_ms):
                    return
                await asyncio.sleep(0)  # serves clients while making up a delay
            deadline_s = start_s + pacer.next_deadline_ms / 1_000
            await asyncio.sleep(max(0.0, deadline_s - loop.time()))

    def _advance(self, for_ms: int) -> bool:
        """Advance plant time; return False if the plant failed, which ends the server."""
        try:
            self.module.advance(for_ms)
        except Exception as error:  # noqa: BLE001 - raised by serve_forever
            if not self._ended.done():
                self._ended.set_exception(error)
            return False
        return True


def _check_lock_step(lock_step_ms: int | None, watchdog_ms: int) -> None:
    if lock_step_ms is not None and not 0 < lock_step_ms <= watchdog_ms:
        raise ValueError(
            f"lock_step_ms is {lock_step_ms}: it must be 1 to {watchdog_ms} ms, "
            "otherwise the output watchdog trips between two writes"
        )
