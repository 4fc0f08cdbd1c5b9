"""The controller as a Modbus server for any operator panel: TCP, TLS and RTU, in a thread of its own.

There is no password in Modbus: the server listens on this computer alone unless told otherwise. The scan waits for no
client: what is read is a copy of the memory, what is written waits for the next scan.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import ssl
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Final, Self

from controller.hmi.alarm_list import AlarmList
from controller.hmi.hmi_device import Audit, Desk, HmiDevice
from controller.hmi.own_registers import Facts, LastCycles
from controller.hmi.snapshot import Snapshots
from controller.io.loop import LoopFigures
from controller.io.pace import Pace
from controller.io.runtime import Runtime
from controller.modbus.address import checked_host, listening_remedy
from controller.modbus.mbap import Frontend, Traffic
from controller.modbus.rtu import RtuServer, SerialLine

DEFAULT_PORT: Final = 5021
LOG_EVERY_S: Final = 60.0
HANDSHAKE_S: Final = 5.0
"""A client that has not finished the TLS handshake by then is dropped; it does not count as a connection yet."""
REFUSALS_NOTED_A_MINUTE: Final = 600
"""Refused writes beyond these are counted, not audited: a client gone mad must not fill the audit."""

_log = logging.getLogger(__name__)


class ServerError(Exception):
    """The server cannot serve as asked; one line with the remedy."""


@dataclass(frozen=True, slots=True)
class HmiOptions:
    """How the server is reached.

    Attributes:
        host: Address to listen on.
        port: TCP port; 0 = a free one.
        allow_remote: Permit an address that other computers can reach.
        certificate: Certificate file (PEM) for TLS; None = plain TCP.
        key: Its key file.
        clients: File of the authorities whose certificates clients must show; None = none asked.
        serial: Serial line for RTU beside TCP; None = none.
        max_connections: Connections beyond this many are closed at once.
        idle_timeout_s: A connection without a request for so long is closed, s.
    """

    host: str = "127.0.0.1"
    port: int = DEFAULT_PORT
    allow_remote: bool = False
    certificate: str | None = None
    key: str | None = None
    clients: str | None = None
    serial: SerialLine | None = None
    max_connections: int = 16
    idle_timeout_s: float = 60.0


class HmiServer:
    """Serves one runtime to Modbus clients from `__enter__` to `__exit__`.

    Attributes:
        cycles: Give it the events of production, for the cycle registers.
        refused_unaudited: Refused writes that were counted only.
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
    ) -> None:
        """Prepare the server and let it look at every scan.

        Args:
            runtime: The PLC on its link.
            alarms: The operator's alarm list.
            options: How the server is reached.
            figures: Timing of the scan loop, to be shown.
            pace: Speed of simulated time, to be changed; None on a real clock.
            audit: Told of every write: peer, name, what, value, "done" or why not.
            version: Revision told to clients.

        Raises:
            ServerError: An address, a certificate or a serial line that cannot be used.
        """
        self._options = options or HmiOptions()
        self.cycles = LastCycles()
        self.refused_unaudited = 0
        self._audit_to = audit
        self._noted = 0
        try:
            self._host = checked_host(
                self._options.host, allow_remote=self._options.allow_remote, option="--hmi-allow-remote"
            )
        except ValueError as error:
            raise ServerError(f"HMI server: {error}") from error
        self._tls = _tls(self._options)
        snapshots = Snapshots()
        facts = Facts(
            runtime, figures or LoopFigures(), pace, alarms.rows, self.cycles,
            connections=lambda: len(self._frontend.connections),
            refused_writes=lambda: self._desk.refused_writes,
        )  # fmt: skip
        identity = {0: "seedling-transplanter", 1: runtime.machine.program.name, 2: version}
        self._desk = Desk(runtime, alarms, snapshots, facts, self._audit, identity)
        self._frontend = Frontend(
            lambda peer: HmiDevice(self._desk, peer), self._options.max_connections, self._options.idle_timeout_s
        )
        runtime.observers.append(snapshots)
        self._thread = threading.Thread(target=self._run, name="hmi server", daemon=True)
        self._settled = threading.Event()
        self._error: Exception | None = None
        self._loop: asyncio.AbstractEventLoop
        self._ended: asyncio.Event
        self._port = self._options.port
        self._rtu: RtuServer | None = None

    @property
    def port(self) -> int:
        """TCP port; the real one once it listens."""
        return self._port

    @property
    def traffic(self) -> Traffic:
        """What the connections have seen since the start."""
        return self._frontend.traffic

    @property
    def refused_writes(self) -> int:
        """Writes refused since the start."""
        return self._desk.refused_writes

    def __enter__(self) -> Self:
        """Start the thread and wait until the server listens.

        Raises:
            ServerError: The port is taken, or the serial line cannot be opened.
        """
        self._thread.start()
        self._settled.wait()
        if self._error is not None:
            self._thread.join()
            raise ServerError(f"HMI server: {self._error}") from self._error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Drop the clients and stop listening."""
        with contextlib.suppress(RuntimeError):  # the loop has ended by itself
            self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()

    def call(self, function: Callable[[], None]) -> None:
        """Call a function in the server's thread, between two requests."""
        self._loop.call_soon_threadsafe(function)

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:  # noqa: BLE001 - told to whoever starts it, or logged: the machine goes on
            if self._settled.is_set():
                _log.exception("the HMI server failed; the machine goes on without it")
            self._error = error
        finally:
            self._settled.set()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._ended = asyncio.Event()
        options = self._options
        handshake_s = None if self._tls is None else HANDSHAKE_S
        try:
            listener = await self._loop.create_server(
                self._frontend, self._host, options.port, ssl=self._tls, ssl_handshake_timeout=handshake_s
            )
        except OSError as error:
            remedy = listening_remedy(error, host="--hmi-host", port="--hmi-port")
            raise ServerError(f"{error}; {remedy}, or --no-hmi") from error
        self._port = listener.sockets[0].getsockname()[1]
        reporting = self._loop.create_task(self._report())
        try:
            if options.serial is not None:
                self._rtu = self._serve_line(options.serial)
            self._settled.set()
            await self._ended.wait()
        finally:
            reporting.cancel()
            listener.close()
            self._frontend.close()
            if self._rtu is not None:
                self._rtu.stop()
            await listener.wait_closed()

    def _serve_line(self, line: SerialLine) -> RtuServer:
        server = RtuServer(line, HmiDevice(self._desk, line.path))
        try:
            server.start(self._loop)
        except ModuleNotFoundError as error:
            raise ServerError(
                f"no {error.name} here; install it: pip install 'seedling-transplanter[serial]'"
            ) from error
        except (OSError, ValueError, OverflowError) as error:
            raise ServerError(
                f"serial line {line.path}: {error}; give another --hmi-serial, or leave it out"
            ) from error
        return server

    async def _report(self) -> None:
        """Tell trouble made by clients once a minute at most, in one line."""
        told = (0, 0, 0)
        while True:
            await asyncio.sleep(LOG_EVERY_S)
            self._noted = 0
            traffic = self._frontend.traffic
            now = (traffic.bad_frames, traffic.refused, traffic.timed_out)
            if now != told:
                _log.warning("HMI clients since the start: %d bad frames, %d beyond the limit, %d idle", *now)
                told = now

    def _audit(self, peer: str, who: str, what: str, value: str, result: str) -> None:
        if self._audit_to is None:
            return
        if result.startswith("refused"):
            self._noted += 1
            if self._noted > REFUSALS_NOTED_A_MINUTE:
                self.refused_unaudited += 1
                return
        self._audit_to(peer, who, what, value, result)


def _tls(options: HmiOptions) -> ssl.SSLContext | None:
    if options.certificate is None:
        if options.key is not None or options.clients is not None:
            raise ServerError("HMI key or clients' authorities without a certificate; give --hmi-certificate, too")
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # a key with a password of its own would be asked for at a terminal that nobody watches
        context.load_cert_chain(options.certificate, options.key, password="")
        if options.clients is not None:
            context.load_verify_locations(options.clients)
            context.verify_mode = ssl.CERT_REQUIRED
    except (OSError, ssl.SSLError) as error:
        named = ", ".join(filter(None, (options.certificate, options.key, options.clients)))
        raise ServerError(f"HMI certificate ({named}): {error}; give PEM files that belong together") from error
    return context
