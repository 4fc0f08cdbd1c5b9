"""Operator interfaces of the command ``run``: events, history, alarm list, console and servers for panels."""

from __future__ import annotations

import argparse
import errno
import importlib
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from controller.cli.run_history import recorded_history, report_history
from controller.common.arguments.number_type import PORT
from controller.common.command_line import version
from controller.common.errors import InputError
from controller.common.modbus.rtu import SerialLine
from controller.core.scan import Plc
from controller.events.alarm_list import AlarmChange, AlarmList
from controller.events.cycle_edges import CycleEdges
from controller.events.field_devices import FieldDevices, FieldReport
from controller.events.kinds import Event
from controller.events.production import ProductionLog
from controller.events.writer import EventWriter, McServingEvent, OutputsEvent, ServingEvent
from controller.hmi.access.server import HmiServer
from controller.hmi.console import Console, ConsoleReader
from controller.hmi.mitsubishi.mc import DEFAULT_PORT as DEFAULT_MC_PORT
from controller.hmi.mitsubishi.mc import FRAMES, mc_tcp
from controller.hmi.mitsubishi.port_line import programming_port
from controller.hmi.modbus.endpoint import DEFAULT_PORT, HmiOptions
from controller.hmi.serving.devices import AccessSource
from controller.hmi.serving.endpoints import Endpoint, TcpEndpoint, TcpSettings
from controller.io.loop import LoopFigures
from controller.io.pace import Pace
from controller.io.runtime import Runtime

SWITCH_INTERVAL_S = 0.0005
"""Thread switch interval, s: maximum time that the scan waits for another thread; one tenth of Python's default."""


def add_hmi_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the Modbus server for panels."""
    hmi = parser.add_argument_group("Modbus server for operator panels")
    hmi.add_argument("--no-hmi", action="store_true", help="do not start this server")
    hmi.add_argument("--hmi-host", default="127.0.0.1", help="address to listen on")
    hmi.add_argument(
        "--hmi-port", type=PORT, default=DEFAULT_PORT, help="TCP port; 0 = any free port, reported by an event"
    )
    hmi.add_argument("--hmi-allow-remote", action="store_true", help="permit an address that other computers can reach")
    hmi.add_argument("--hmi-certificate", default=None, metavar="FILE", help="certificate (PEM) for TLS")
    hmi.add_argument("--hmi-key", default=None, metavar="FILE", help="private key of the certificate (PEM)")
    hmi.add_argument(
        "--hmi-clients",
        default=None,
        metavar="FILE",
        help="certificate authorities (PEM) of the required client certificates (default: none required)",
    )
    hmi.add_argument(
        "--hmi-serial", default=None, metavar="DEVICE:BAUD:8E1:UNIT", help="also serve Modbus RTU on a serial line"
    )
    hmi.add_argument(
        "--allow-forcing",
        action="store_true",
        help="permit a panel to force inputs while the machine is Stopped in manual mode; motion is then inhibited",
    )


def add_mitsubishi_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the servers for tools that speak the protocols of Mitsubishi PLCs."""
    group = parser.add_argument_group("servers for Mitsubishi tools, with the same permissions as Modbus")
    group.add_argument(
        "--mc", choices=FRAMES, default=None, help="serve the MC protocol: frames 1E (FX3U), or 3E and 4E (FX5U)"
    )
    group.add_argument("--mc-host", default="127.0.0.1", help="address to listen on")
    group.add_argument(
        "--mc-port", type=PORT, default=DEFAULT_MC_PORT, help="TCP port; 0 = any free port, reported by an event"
    )
    group.add_argument(
        "--mc-allow-remote", action="store_true", help="permit an address that other computers can reach"
    )
    group.add_argument(
        "--fx-port",
        default=None,
        metavar="DEVICE",
        help="serve the programming port of an FX2N on a serial line, 9600 bit/s 7E1",
    )


@contextmanager
def operator_interfaces(
    runtime: Runtime, devices: FieldDevices, figures: LoopFigures, pace: Pace | None, options: argparse.Namespace
) -> Iterator[None]:
    """Connect the runtime to event output, history, alarm list, console and Modbus server."""
    machine = runtime.machine
    with ExitStack() as stack:
        printer = EventWriter(options.events, sys.stdout, options.language)
        stack.callback(printer.close)
        scan_ms = None if options.simulated_time else options.scan_ms
        field = FieldReport(devices, machine, printer.write, scan_ms=scan_ms)
        runtime.observers.append(field)
        receivers: list[Callable[[Event | AlarmChange], None]] = [printer.write]
        edges = CycleEdges(machine)
        history = stack.enter_context(recorded_history(machine, edges, figures, options))
        if history is not None:
            receivers.append(history.write)
            runtime.observers.append(edges)

        def publish(event: Event | AlarmChange) -> None:
            named = field.named(event)
            for receive in receivers:
                receive(named)

        def audit(peer: str, who: str, what: str, value: str, result: str) -> None:
            if history is not None:
                history.audit(peer, who, what, value, result, runtime.now_ms)

        runtime.observers.append(ProductionLog(machine, publish))
        alarms = AlarmList(machine.alarms, machine.tags.machine.first_out, publish)
        runtime.observers.append(alarms)
        runtime.observers.append(_OutputReport(runtime, printer))
        if _has_server(options):
            server, mc = _server(runtime, alarms, options, figures=figures, pace=pace, audit=audit)
            receivers.append(server.cycles.record)
            sys.setswitchinterval(SWITCH_INTERVAL_S)
            stack.enter_context(server)
            if server.modbus is not None:
                printer.write(ServingEvent(runtime.now_ms, server.port))
            for port in mc:
                printer.write(McServingEvent(runtime.now_ms, port.port))
        if not options.no_console and sys.stdin is not None:  # None = closed by the parent process
            stack.enter_context(ConsoleReader(Console(runtime, alarms), sys.stdin.fileno()))
        if history is not None:
            report_history(history, options)
        yield


class _OutputReport:
    """Observer that reports another master after its alarm has been set."""

    def __init__(self, runtime: Runtime, printer: EventWriter) -> None:
        self._ownership = runtime.ownership
        self._printer = printer
        self._system = runtime.machine.tags.system
        self._reported = ("", "")

    def __call__(self, now_ms: int, plc: Plc) -> None:
        taken = self._ownership.taken if plc.read(self._system.outputs_taken) else ""
        rival = self._ownership.rival if plc.read(self._system.outputs_contested) else ""
        if taken not in ("", self._reported[0]):
            self._printer.write(OutputsEvent(now_ms, taken, taken=True))
        if rival not in ("", self._reported[1]):
            number, _, address = rival.partition(" ")
            text = f"write by {address} refused by the field I/O ({number} so far)"
            self._printer.write(OutputsEvent(now_ms, text, taken=False))
        self._reported = taken, rival


def check_interfaces(runtime: Runtime, figures: LoopFigures, pace: Pace | None, options: argparse.Namespace) -> None:
    """Check addresses, certificates and lines of the servers, as a start does before it listens.

    Raises:
        InputError: An option or a file is invalid.
    """
    if _has_server(options):
        alarms = AlarmList(runtime.machine.alarms, runtime.machine.tags.machine.first_out, lambda _: None)
        _server(runtime, alarms, options, figures=figures, pace=pace, audit=lambda *_: None)
    serial = None if options.no_hmi or options.hmi_serial is None else SerialLine.parsed(options.hmi_serial).path
    for option, path in (("--hmi-serial", serial), ("--fx-port", options.fx_port)):
        if path is None:
            continue
        importlib.import_module("serial")  # a missing one is reported with the command that installs it
        if not os.access(path, os.R_OK | os.W_OK):
            number = errno.EACCES if Path(path).exists() else errno.ENOENT
            raise InputError(f"serial line {path}: {os.strerror(number)}; specify another {option}, or omit it")


def _has_server(options: argparse.Namespace) -> bool:
    return not options.no_hmi or options.mc is not None or options.fx_port is not None


def _server(
    runtime: Runtime,
    alarms: AlarmList,
    options: argparse.Namespace,
    *,
    figures: LoopFigures,
    pace: Pace | None,
    audit: Callable[[str, str, str, str, str], None],
) -> tuple[HmiServer, list[TcpEndpoint]]:
    """Return the server and its ports with the MC protocol, of which there is at most one."""
    serial = None if options.no_hmi or options.hmi_serial is None else SerialLine.parsed(options.hmi_serial)
    hmi_options = HmiOptions(
        options.hmi_host,
        None if options.no_hmi else options.hmi_port,
        options.hmi_allow_remote,
        options.hmi_certificate,
        options.hmi_key,
        options.hmi_clients,
        serial,
    )
    mc: list[TcpEndpoint] = []

    def further(source: AccessSource) -> list[Endpoint]:
        if options.mc is not None:
            settings = TcpSettings(options.mc_host, options.mc_port, options.mc_allow_remote)
            mc.append(mc_tcp(source, options.mc, settings))
        line = [] if options.fx_port is None else [programming_port(source, options.fx_port, "--fx-port")]
        return [*mc, *line]

    server = HmiServer(
        runtime, alarms, hmi_options, figures=figures, pace=pace, audit=audit, version=version(), further=further
    )
    return server, mc
