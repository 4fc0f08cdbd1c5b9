"""Server of the controller for operator panels and other tools, in a separate thread.

The protocols have no passwords, so by default the server listens on the local computer only. Clients never delay the
scan: reads return a copy of the memory, writes are queued for the next scan and answered at its end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from controller.common.connections import Traffic
from controller.events.alarm_list import AlarmList
from controller.hmi.access.machine import Audit, MachineAccess
from controller.hmi.access.status_registers import LastCycles, StatusSource
from controller.hmi.modbus.endpoint import HmiOptions, modbus_rtu, modbus_tcp, tls_context
from controller.hmi.serving.devices import AccessSource
from controller.hmi.serving.endpoints import Endpoint, TcpEndpoint, TcpSettings
from controller.hmi.serving.server import DeviceServer
from controller.hmi.serving.snapshot import Snapshots
from controller.io.loop import LoopFigures
from controller.io.pace import Pace
from controller.io.runtime import Runtime

FurtherEndpoints = Callable[[AccessSource], Sequence[Endpoint]]
"""Function that returns the endpoints of other protocols."""


class HmiServer(DeviceServer):
    """Server of one runtime: Modbus and, as requested, other protocols.

    Attributes:
        access: Whitelist, audit and counters that all protocols share.
        cycles: Receiver of production events and source of the cycle registers.
        identity: Vendor, product and revision reported to Modbus clients.
        modbus: Modbus TCP port; None if not served.
    """

    def __init__(
        self,
        runtime: Runtime,
        alarms: AlarmList,
        options: HmiOptions | None = None,
        *,
        figures: LoopFigures | None = None,
        pace: Pace | None = None,
        audit: Audit | None = None,
        version: str = "",
        further: FurtherEndpoints = lambda _source: (),
    ) -> None:
        """Initialise the server and register it as an observer of the runtime.

        Args:
            runtime: PLC on its field link.
            alarms: The operator's alarm list.
            options: Network and serial settings of Modbus.
            figures: Timing of the scan loop.
            pace: Speed of simulated time; None in real time.
            audit: Callback for every write: peer, name, target, value, and "done" or the reason for the refusal.
            version: Revision reported to clients.
            further: Function that returns the endpoints of other protocols.

        Raises:
            ServerError: An address or the certificate is invalid.
        """
        options = options or HmiOptions()
        self.cycles = LastCycles()
        snapshots = Snapshots()
        source = StatusSource(
            runtime,
            figures or LoopFigures(),
            pace,
            alarms,
            self.cycles,
            connections=lambda: self.connections,
            refused_writes=lambda: self.access.refused_writes,
        )
        self.access = MachineAccess(runtime, alarms, snapshots, source, audit)
        self.identity = {0: "seedling-transplanter", 1: runtime.machine.program.name, 2: version}
        tls = tls_context(options)
        endpoints: list[Endpoint] = []
        self.modbus: TcpEndpoint | None = None
        if options.port is not None:
            settings = TcpSettings(
                options.host,
                options.port,
                options.allow_remote,
                options.max_connections,
                options.idle_timeout_s,
                options.reserved,
            )
            self.modbus = modbus_tcp(self.access, self.identity, settings, tls=tls)
            endpoints.append(self.modbus)
        if options.serial is not None:
            endpoints.append(modbus_rtu(self.access, self.identity, options.serial))
        super().__init__([*endpoints, *further(self.access)], runtime.writes, self.access.start_minute)
        runtime.observers.append(snapshots)

    @property
    def port(self) -> int:
        """TCP port of Modbus: the configured one, and the actual one once the server is listening."""
        return self._modbus.port

    @property
    def traffic(self) -> Traffic:
        """Traffic counters of the Modbus connections since the start."""
        return self._modbus.traffic

    @property
    def _modbus(self) -> TcpEndpoint:
        if self.modbus is None:
            raise ValueError("the server has no Modbus port")
        return self.modbus
