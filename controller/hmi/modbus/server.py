"""Modbus server of the controller for operator panels: TCP, TLS and RTU, in a separate thread.

Modbus has no passwords, so by default the server listens on the local computer only. Clients never delay the scan:
reads return a copy of the memory, writes are queued for the next scan.
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

from controller.common.errors import InputError
from controller.common.extras import install_hint
from controller.common.modbus.address import checked_host, listening_remedy
from controller.common.modbus.mbap import MbapServer, Traffic
from controller.common.modbus.rtu import RtuServer, SerialLine
from controller.events.alarm_list import AlarmList
from controller.hmi.modbus.session import Audit, HmiSession, HmiState
from controller.hmi.modbus.snapshot import Snapshots
from controller.hmi.modbus.status_registers import LastCycles, StatusSource
from controller.io.loop import LoopFigures
from controller.io.pace import Pace
from controller.io.runtime import Runtime

DEFAULT_PORT: Final = 5021
LOG_EVERY_S: Final = 60.0
"""Period of the client error report, s."""
HANDSHAKE_S: Final = 5.0
"""TLS handshake timeout, s; a client still in the handshake does not count as a connection."""
AUDITED_REFUSALS_PER_MINUTE: Final = 600
"""Rate above which refused writes are counted but not audited, so that a faulty client cannot fill the audit log."""

_log = logging.getLogger(__name__)


class ServerError(InputError):
    """Raised for invalid server options or an unavailable port; the message is one line with the remedy."""


@dataclass(frozen=True, slots=True)
class HmiOptions:
    """Network and serial settings of the server.

    Attributes:
        host: Address to listen on.
        port: TCP port; 0 selects a free port.
        allow_remote: True to permit listening on an address that other computers can reach.
        certificate: Certificate file (PEM) for TLS; None selects plain TCP.
        key: Key file of the certificate.
        clients: File with the CA certificates that verify client certificates; None = client certificates not required.
        serial: Serial line for RTU in addition to TCP; None selects TCP only.
        max_connections: Connection limit; further connections are closed immediately.
        idle_timeout_s: Time without a request after which a connection is closed, s.
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
    """Modbus server of one runtime; a context manager that serves between `__enter__` and `__exit__`.

    Attributes:
        cycles: Receiver of production events and source of the cycle registers.
        refused_unaudited: Number of refused writes that were counted but not audited.
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
        """Initialise the server and register it as an observer of the runtime.

        Args:
            runtime: PLC on its field link.
            alarms: The operator's alarm list.
            options: Network and serial settings.
            figures: Timing of the scan loop.
            pace: Speed of simulated time; None in real time.
            audit: Callback for every write: peer, name, target, value, and "done" or the reason for the refusal.
            version: Revision reported to clients.

        Raises:
            ServerError: The address or the certificate is invalid.
        """
        self._options = options or HmiOptions()
        self.cycles = LastCycles()
        self.refused_unaudited = 0
        self._audit_to = audit
        self._audited_refusals = 0
        try:
            self._host = checked_host(
                self._options.host, allow_remote=self._options.allow_remote, option="--hmi-allow-remote"
            )
        except ValueError as error:
            raise ServerError(f"HMI server: {error}") from error
        self._tls = _tls(self._options)
        snapshots = Snapshots()
        source = StatusSource(
            runtime,
            figures or LoopFigures(),
            pace,
            alarms.rows,
            self.cycles,
            connections=lambda: len(self._frontend.connections),
            refused_writes=lambda: self._state.refused_writes,
        )
        identity = {0: "seedling-transplanter", 1: runtime.machine.program.name, 2: version}
        self._state = HmiState(runtime, alarms, snapshots, source, self._audit, identity)
        self._frontend = MbapServer(
            lambda peer: HmiSession(self._state, peer), self._options.max_connections, self._options.idle_timeout_s
        )
        runtime.observers.append(snapshots)
        self._thread = threading.Thread(target=self._run, name="hmi server", daemon=True)
        self._started = threading.Event()
        self._error: Exception | None = None
        self._loop: asyncio.AbstractEventLoop
        self._ended: asyncio.Event
        self._port = self._options.port
        self._rtu: RtuServer | None = None

    @property
    def port(self) -> int:
        """Configured TCP port; the actual port once the server is listening."""
        return self._port

    @property
    def traffic(self) -> Traffic:
        """Traffic counters of the connections since the start."""
        return self._frontend.traffic

    @property
    def refused_writes(self) -> int:
        """Number of refused writes since the start."""
        return self._state.refused_writes

    def __enter__(self) -> Self:
        """Start the thread and wait until the server listens.

        Raises:
            ServerError: The port is in use, or the serial line cannot be opened.
        """
        self._thread.start()
        self._started.wait()
        if self._error is not None:
            self._thread.join()
            raise ServerError(f"HMI server: {self._error}") from self._error
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
            asyncio.run(self._serve())
        except Exception as error:  # noqa: BLE001 - raised by `__enter__`, or logged: the machine keeps running
            if self._started.is_set():
                _log.exception("the HMI server failed; the machine keeps running without it")
            self._error = error
        finally:
            self._started.set()

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
        reporter = self._loop.create_task(self._report())
        try:
            if options.serial is not None:
                self._rtu = self._serve_rtu(options.serial)
            self._started.set()
            await self._ended.wait()
        finally:
            reporter.cancel()
            listener.close()
            self._frontend.close()
            if self._rtu is not None:
                self._rtu.stop()
            await listener.wait_closed()

    def _serve_rtu(self, line: SerialLine) -> RtuServer:
        server = RtuServer(line, HmiSession(self._state, line.path))
        try:
            server.start(self._loop)
        except ModuleNotFoundError as error:
            raise ServerError(f"--hmi-serial: {install_hint(error)}") from error
        except (OSError, ValueError, OverflowError) as error:
            raise ServerError(f"serial line {line.path}: {error}; specify another --hmi-serial, or omit it") from error
        return server

    async def _report(self) -> None:
        """Log client errors in one line, at most once a minute."""
        logged = (0, 0, 0)
        while True:
            await asyncio.sleep(LOG_EVERY_S)
            self._audited_refusals = 0
            traffic = self._frontend.traffic
            counts = (traffic.bad_frames, traffic.refused, traffic.timed_out)
            if counts != logged:
                _log.warning(
                    "HMI clients since the start: %d bad frames, %d over the connection limit, %d idle", *counts
                )
                logged = counts

    def _audit(self, peer: str, who: str, what: str, value: str, result: str) -> None:
        if self._audit_to is None:
            return
        if result.startswith("refused"):
            self._audited_refusals += 1
            if self._audited_refusals > AUDITED_REFUSALS_PER_MINUTE:
                self.refused_unaudited += 1
                return
        self._audit_to(peer, who, what, value, result)


def _tls(options: HmiOptions) -> ssl.SSLContext | None:
    if options.certificate is None:
        if options.key is not None or options.clients is not None:
            raise ServerError("--hmi-key and --hmi-clients require a certificate; add --hmi-certificate")
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # without an explicit password, an encrypted key would prompt at the terminal and block
        context.load_cert_chain(options.certificate, options.key, password="")
        if options.clients is not None:
            context.load_verify_locations(options.clients)
            context.verify_mode = ssl.CERT_REQUIRED
    except (OSError, ssl.SSLError) as error:
        files = ", ".join(filter(None, (options.certificate, options.key, options.clients)))
        raise ServerError(f"HMI certificate ({files}): {error}; specify a matching set of PEM files") from error
    return context
