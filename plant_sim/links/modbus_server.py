"""The simulated machine as a Modbus device: I/O module, operator box and telemetry, over TCP and over a serial line.

| table             | from | content                                             | functions |
|-------------------|------|-----------------------------------------------------|-----------|
| discrete inputs   | 0    | X points at their offsets in io_map.yaml            | 2         |
| coils             | 0    | Y points at their offsets in io_map.yaml            | 1, 5, 15  |
| coils             | 100  | operator box, `plant_sim.links.box.BOX_COILS`       | 1, 5, 15  |
| input registers   | 0    | telemetry, `plant_sim.links.telemetry.TELEMETRY`    | 4         |
| input registers   | 1000 | owner of the outputs, `output_owner.OwnerReport`    | 4         |

Requests with any unit identifier are answered: the server is a single device. Modbus has no
authentication, so the server listens on the loopback address by default.

Plant time advances in one of two modes. *Real time*: in ticks of 1 ms by the wall clock. *Lock step*: by a fixed time
at each completed write of the Y block, or at each exchange with a PLC of which the plant is a client, and at no other
time. In lock step a trial over real sockets is deterministic and independent of computer speed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from functools import partial

from pymodbus.constants import ExcCodes

from controller.common.connections import Traffic
from controller.common.modbus.address import checked_host
from controller.common.modbus.mbap import MbapServer
from controller.common.modbus.requests import RequestRefusedError
from controller.common.modbus.rtu import RtuServer, SerialError, SerialLine
from controller.common.supervision.tasks import supervised_task
from plant_sim.common.defaults import DEFAULT_PORT
from plant_sim.links.gap_watch import GapWatch
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_image import ModbusImage, image_of
from plant_sim.links.plc.client import PlcClient
from plant_sim.links.real_time import RealTime


class PlantServer:
    """Modbus server of one I/O module, for use from one event loop.

    Attributes:
        module: Served module.
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
        serial: SerialLine | None = None,
        models_wire: bool = False,
        plc: PlcClient | None = None,
        gap_limit_ms: int | None = None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Create the server; `start` opens the port.

        Args:
            module: Module to serve.
            host: IP address to listen on; localhost is 127.0.0.1.
            port: TCP port; 0 selects a free port.
            lock_step_ms: Plant time per completed write of the Y block, or per exchange with the PLC, ms; None for
                real time.
            allow_remote: True permits an address that other computers can reach.
            max_connections: Number of slots of the clients; the least active one makes room for a new one.
            idle_timeout_s: Time without a request after which a connection is closed, s.
            serial: Serial line on which the module is a Modbus RTU server as well.
            models_wire: True to model the transmission time of the serial line; see `RtuServer`.
            plc: PLC of which the plant is a client; the outputs then belong to it.
            gap_limit_ms: Longest time between two output writes that is not a gap, ms; None = half of the time of the
                output watchdog.
            tell: Function that reports a line about gaps, losses and the PLC.

        Raises:
            ValueError: The address or a time is invalid.
            IoMapError: An output in the I/O map has the address of a button of the operator box.
        """
        _check_lock_step(lock_step_ms, module.watchdog_ms)
        self.module = module
        self._real_time = RealTime(self._advance, module.timing) if lock_step_ms is None else None
        self._host = checked_host(host, allow_remote=allow_remote, option="--allow-remote")
        self._port = port
        self._lock_step_ms = lock_step_ms
        self._blocks_seen = module.block_writes
        self._frontend = MbapServer(self._device, max_connections, idle_timeout_s)
        image_of(module, "")  # reports an invalid I/O map now
        self._serial = None
        if serial is not None:
            self._serial = RtuServer(serial, self._device(serial.path), models_wire=models_wire)
        self._plc = plc
        limit_ms = max(1, module.watchdog_ms // 2) if gap_limit_ms is None else gap_limit_ms
        self._gaps = GapWatch(module, limit_ms=limit_ms, tell=tell)
        self._listener: asyncio.Server | None = None
        self._tasks: list[asyncio.Task[None]] = []
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
            SerialError: The serial line cannot be opened; the message is one line.
            ModuleNotFoundError: pyserial is not installed.
        """
        loop = asyncio.get_running_loop()
        self._start_serial(loop)
        self._listener = await loop.create_server(self._frontend, self._host, self._port)
        self._port = self._listener.sockets[0].getsockname()[1]
        self._ended = loop.create_future()
        self.module.write_observers.append(self._time_write)
        if self._real_time is not None:
            self._tasks.append(supervised_task("plant time", self._real_time.run, self._fail))
        if self._plc is not None:
            run = partial(self._plc.run, self._advance_for_plc)
            self._tasks.append(supervised_task("plant at a PLC", run, self._fail))

    def _start_serial(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._serial is None:
            return
        try:
            self._serial.start(loop)
        except (OSError, ValueError, OverflowError) as error:
            raise SerialError(f"serial line {self._serial.path}: {error}; specify another line, or omit it") from error

    async def serve_forever(self) -> None:
        """Wait for `end` or for a failure of the plant, which is raised as an exception."""
        await self._ended

    def end(self) -> None:
        """Make `serve_forever` return; may be called from a signal handler."""
        if not self._ended.done():
            self._ended.set_result(None)

    async def stop(self) -> None:
        """Disconnect the clients, set the outputs to safe levels and close the port. No effect if stopped."""
        if self._serial is not None:
            self._serial.stop()
        if self._listener is None:
            return
        self.module.make_safe()  # first, because closing may fail; nothing is received until the next await
        self._listener.close()
        self._frontend.close()
        for task in self._tasks:
            task.cancel()
        if self._tasks:
            await asyncio.wait(self._tasks)
        self._gaps.finish()
        await self._listener.wait_closed()
        self._listener = None

    def _device(self, client: str) -> ModbusImage:
        requested = self._real_time.catch_up if self._real_time is not None else lambda: None
        return image_of(self.module, client, self._written, requested)

    def _time_write(self, client: str, levels: Mapping[int, bool]) -> None:
        """Measure a write by the clock of the event loop, in lock step by plant time."""
        now_s = self.module.plant.time_ms / 1_000 if self._real_time is None else asyncio.get_running_loop().time()
        self.module.timing.add(client, min(levels), max(levels), now_s)

    def _written(self) -> None:
        """Advance plant time in lock step after a complete write of the Y block by a client of the server."""
        if self._lock_step_ms is None or self._plc is not None or self.module.block_writes == self._blocks_seen:
            return
        self._blocks_seen = self.module.block_writes
        if not self._advance(self._lock_step_ms):
            raise RequestRefusedError(ExcCodes.DEVICE_FAILURE)

    def _advance_for_plc(self, *, exchanged: bool) -> bool:
        """Advance plant time to now, or in lock step by one step after each exchange; return False after a failure."""
        if self._real_time is not None:
            self._real_time.catch_up()
        elif exchanged and self._lock_step_ms is not None:
            return self._advance(self._lock_step_ms)
        return not self._ended.done()

    def _fail(self, error: Exception) -> None:
        if not self._ended.done():
            self._ended.set_exception(error)

    def _advance(self, for_ms: int) -> bool:
        """Advance plant time; return False if the plant failed, which ends the server."""
        try:
            self.module.advance(for_ms)
        except Exception as error:  # noqa: BLE001 - raised by serve_forever
            self._fail(error)
            return False
        return True


def _check_lock_step(lock_step_ms: int | None, watchdog_ms: int) -> None:
    if lock_step_ms is not None and not 0 < lock_step_ms <= watchdog_ms:
        raise ValueError(
            f"lock_step_ms is {lock_step_ms}: it must be 1 to {watchdog_ms} ms, "
            "otherwise the output watchdog trips between two writes"
        )
