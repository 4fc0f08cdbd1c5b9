"""The simulated machine as a Modbus TCP device: I/O module, operator box and telemetry.

| table             | from | content                                             | functions |
|-------------------|------|-----------------------------------------------------|-----------|
| discrete inputs   | 0    | X points at their offsets in io_map.yaml            | 2         |
| coils             | 0    | Y points at their offsets in io_map.yaml            | 1, 5, 15  |
| coils             | 100  | operator box, `plant_sim.links.box.BOX_COILS`       | 1, 5, 15  |
| input registers   | 0    | telemetry, `plant_sim.links.telemetry.TELEMETRY`    | 4         |

Any unit identifier is answered: there is one device behind one address. There is no password in
Modbus, so the server listens on this computer alone unless told otherwise.

Plant time passes in one of two ways. *Real time*: in ticks of 5 ms after the clock. *Lock step*:
by a fixed time at each completed write of the Y block and never otherwise; a trial over real
sockets is then deterministic, however fast or slow the computers are.
"""

from __future__ import annotations

import asyncio

from pymodbus.constants import ExcCodes

from controller.modbus.address import checked_host
from controller.modbus.mbap import Frontend, Traffic
from controller.modbus.requests import RefusedError
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_image import ModbusImage
from plant_sim.links.pacing import Pacer

DEFAULT_PORT = 5020


class PlantServer:
    """Modbus TCP server of one I/O module. Use from one event loop.

    Attributes:
        module: What is served.
        pacer: Real-time bookkeeping, `dropped_ms` among it; None in lock step.
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
        """Prepare the server; it listens after `start`.

        Args:
            module: What is served.
            host: Address to listen on: an IP address, or localhost for 127.0.0.1.
            port: TCP port; 0 takes a free one.
            lock_step_ms: Plant time per completed write of the Y block, ms; None for real time.
            allow_remote: Permit an address that other computers can reach.
            max_connections: Connections beyond this many are closed at once.
            idle_timeout_s: A connection without a request for so long is closed, s.

        Raises:
            ValueError: an address or a time that cannot be served.
            IoMapError: the I/O map puts an output where the operator box is.
        """
        _check_lock_step(lock_step_ms, module.watchdog_ms)
        self.module = module
        self.pacer = Pacer() if lock_step_ms is None else None
        self._host = checked_host(host, allow_remote=allow_remote, option="--allow-remote")
        self._port = port
        self._lock_step_ms = lock_step_ms
        self._blocks_seen = module.block_writes
        image = ModbusImage(module, self._written)
        self._frontend = Frontend(lambda _: image, max_connections, idle_timeout_s)
        self._listener: asyncio.Server | None = None
        self._time_base: asyncio.Task[None] | None = None
        self._ended: asyncio.Future[None]

    @property
    def host(self) -> str:
        """Address to listen on."""
        return self._host

    @property
    def port(self) -> int:
        """TCP port; the real one after `start` when 0 was asked for."""
        return self._port

    @property
    def traffic(self) -> Traffic:
        """What the connections have seen since the start."""
        return self._frontend.traffic

    async def start(self) -> None:
        """Listen, and let plant time run in real-time mode. A server is started once.

        Raises:
            OSError: the port is taken or the address is not ours; `str()` says which.
        """
        loop = asyncio.get_running_loop()
        self._listener = await loop.create_server(self._frontend, self._host, self._port)
        self._port = self._listener.sockets[0].getsockname()[1]
        self._ended = loop.create_future()
        if self.pacer is not None:
            self._time_base = loop.create_task(self._follow_clock(self.pacer))

    async def serve_forever(self) -> None:
        """Wait for `end`, or until the plant fails; its error is raised here."""
        await self._ended

    def end(self) -> None:
        """Let `serve_forever` return; fit for a signal handler."""
        if not self._ended.done():
            self._ended.set_result(None)

    async def stop(self) -> None:
        """Drop the clients, put the outputs safe, stop listening. Does nothing when stopped."""
        if self._listener is None:
            return
        self._listener.close()
        self._frontend.close()
        self.module.make_safe()  # nobody can write any more
        if self._time_base is not None:
            self._time_base.cancel()
            await asyncio.wait([self._time_base])
        await self._listener.wait_closed()
        self._listener = None

    def _written(self) -> None:
        """In lock step, let plant time pass once the whole Y block has been written."""
        if self._lock_step_ms is None or self.module.block_writes == self._blocks_seen:
            return
        self._blocks_seen = self.module.block_writes
        if not self._advance(self._lock_step_ms):
            raise RefusedError(ExcCodes.DEVICE_FAILURE)

    async def _follow_clock(self, pacer: Pacer) -> None:
        """Advance the plant by whole ticks, each due at an instant counted from the start."""
        loop = asyncio.get_running_loop()
        start_s = loop.time()
        while True:
            elapsed_ms = int((loop.time() - start_s) * 1_000)
            for _ in range(pacer.ticks_due(elapsed_ms)):
                if not self._advance(pacer.tick_ms):
                    return
                await asyncio.sleep(0)  # clients are answered while time is made good
            deadline_s = start_s + pacer.next_deadline_ms / 1_000
            await asyncio.sleep(max(0.0, deadline_s - loop.time()))

    def _advance(self, for_ms: int) -> bool:
        """Let plant time pass; False when the plant failed, which ends the server."""
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
            "or the output watchdog would trip between two writes"
        )
