"""Command ``run``: run the machine's program on a field link, with history, console and Modbus server for panels."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from controller.cli.machine import add_io_map, machine_of
from controller.common.command_line import version
from controller.common.errors import InputError
from controller.common.file_lock import FileLockError, lock_file
from controller.common.modbus.rtu import SerialLine
from controller.common.stop_request import Stop, StopRequest
from controller.core.clock import MonotonicClock, utc_ms
from controller.core.expr import Word
from controller.core.retentive_store import DamagedStoreError, FileStore
from controller.core.scan import Plc
from controller.events.alarm_list import AlarmChange, AlarmList
from controller.events.cycle_edges import CycleEdges
from controller.events.production import Event, ProductionLog
from controller.events.writer import EventWriter, OutputsEvent, ServingEvent
from controller.history.schema import HistoryError
from controller.history.writer import HistoryWriter
from controller.hmi.console import Console, ConsoleReader
from controller.hmi.modbus.server import DEFAULT_PORT, HmiOptions, HmiServer
from controller.io.loop import LoopFigures, run_real_time, run_simulated_time
from controller.io.modbus_tcp import ModbusTcpLink
from controller.io.module_profiles import MODULE_PROFILES
from controller.io.output_guard import ModbusOutputGuard, ModuleKind
from controller.io.pace import Pace, PaceError
from controller.io.retentive_writer import DirectRetentiveWriter, RetentiveWriter, ThreadedRetentiveWriter
from controller.io.runtime import Runtime
from controller.program.machine import Transplanter
from controller.program.set_points import SetPointError

RETRY_S = 0.5
"""Interval between attempts to reach the field I/O, s."""
REMIND_S = 5.0
"""Interval between repeated reports that the field I/O does not respond, s."""
IDENTITY_MS = 50
"""Interval at which a module that lends its outputs is asked for refused writes, ms: half of the time within which both
sides must report a second master."""
SWITCH_INTERVAL_S = 0.0005
"""Thread switch interval, s: maximum time that the scan waits for another thread; one tenth of Python's default."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``run``."""
    add_io_map(parser)
    parser.add_argument("--host", default="127.0.0.1", help="Modbus TCP address of the field I/O")
    parser.add_argument("--port", type=int, default=5020, help="Modbus TCP port of the field I/O")
    parser.add_argument("--unit", type=int, default=1, help="Modbus unit identifier")
    parser.add_argument(
        "--module",
        choices=sorted(MODULE_PROFILES),
        default=None,
        help="I/O module whose write lock is set at the start (default: none)",
    )
    parser.add_argument("--timeout-ms", type=int, default=30, help="timeout of one response of the field I/O, ms")
    parser.add_argument(
        "--link-limit-ms",
        type=int,
        default=100,
        help="longest time until the loss of the field I/O is detected, ms",
    )
    parser.add_argument(
        "--panel-limit-ms",
        type=int,
        default=None,
        help="timeout of the operator panel, ms: if neither a Modbus request nor a line on standard input (which may "
        "be empty) arrives within this time, the machine completes the cycle and holds; active after the first request "
        "or line (default: no timeout)",
    )
    parser.add_argument("--retain", type=Path, default=Path("var/retentive.json"), help="retentive memory file")
    parser.add_argument("--scan-ms", type=int, default=10, help="scan period, ms")
    parser.add_argument("--input-filter-ms", type=int, default=10, help="input filter of X0-X17, ms; 0 = off")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="set_points",
        help="initial value of a set-point, e.g. trays_target=2; may be repeated",
    )
    parser.add_argument("--language", choices=("en", "zh"), default="en", help="language of the texts")
    parser.add_argument(
        "--events", choices=("text", "json"), default="text", help="format of the events on standard output"
    )
    parser.add_argument(
        "--no-console", action="store_true", help="do not read orders (one per line) from standard input"
    )
    parser.add_argument(
        "--history", type=Path, default=None, help="history file (default: history.sqlite in the folder of --retain)"
    )
    parser.add_argument("--no-history", action="store_true", help="do not record a history")
    parser.add_argument(
        "--simulated-time",
        action="store_true",
        help="for a plant in lock step: each scan advances the time by one period, independently of the wall clock; a "
        "panel can pause the time and change its speed. Never use this for a real machine",
    )
    parser.add_argument(
        "--pace",
        type=int,
        default=100,
        metavar="PERCENT",
        help="initial speed of simulated time: 0 = paused, 100 = real time, 65535 = as fast as possible",
    )
    _add_hmi(parser)


def run(options: argparse.Namespace) -> int:
    """Run until the request to stop and return the exit code, which is 1 if the safe outputs could not be written.

    Outputs that belong to another master are not written, and this is no failure.

    Raises:
        InputError: An option or a file is invalid.
    """
    _check_numbers(options)
    machine = machine_of(options)
    try:
        plc = Plc(machine.program, input_filter_ms=options.input_filter_ms)
    except ValueError as error:
        raise InputError(f"--input-filter-ms: {error}") from error
    stop: StopRequest = options.stop
    with ExitStack() as stack:
        store = stack.enter_context(_memory(machine, plc, options))
        link = ModbusTcpLink(
            options.host, options.port, machine.io_map, unit=options.unit, timeout_s=options.timeout_ms / 1000
        )
        stack.callback(link.close)
        pace = _pace(options)
        # In simulated time, the scan waits for the disk; in real time, only the outputs wait.
        writer: RetentiveWriter = ThreadedRetentiveWriter(store) if pace is None else DirectRetentiveWriter(store)
        stack.callback(writer.close)
        guard = ModbusOutputGuard(link, every=max(1, IDENTITY_MS // options.scan_ms))
        runtime = Runtime(
            machine,
            plc,
            link,
            writer,
            link_limit_ms=options.link_limit_ms,
            link_wait_ms=options.timeout_ms + options.scan_ms,
            panel_limit_ms=options.panel_limit_ms,
            allow_forcing=options.allow_forcing,
            guard=guard,
        )
        figures = LoopFigures()
        stack.enter_context(_operator_interfaces(runtime, figures, pace, options))
        if not _wait_for_field(link, guard, options, stop):
            return 0
        if pace is None:
            run_real_time(runtime, MonotonicClock(), scan_ms=options.scan_ms, stop=stop, figures=figures)
        else:
            run_simulated_time(runtime, pace, scan_ms=options.scan_ms, stop=stop, figures=figures)
    left = runtime.ownership.taken or "no response from the field"
    outputs = "set to their safe levels" if figures.outputs_safe else f"NOT written: {left}"
    print(
        f"stopped, outputs {outputs}; "
        f"{figures.scans} scans of {options.scan_ms} ms, {figures.overruns} overruns, "
        f"longest {figures.longest_ms} ms",
        file=sys.stderr,
    )
    return 0 if figures.outputs_safe or runtime.ownership.taken else 1


def _add_hmi(parser: argparse.ArgumentParser) -> None:
    """Add the options of the Modbus server for panels."""
    hmi = parser.add_argument_group("Modbus server for operator panels")
    hmi.add_argument("--no-hmi", action="store_true", help="do not start this server")
    hmi.add_argument("--hmi-host", default="127.0.0.1", help="address to listen on")
    hmi.add_argument(
        "--hmi-port", type=int, default=DEFAULT_PORT, help="TCP port; 0 = any free port, reported by an event"
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


def _check_numbers(options: argparse.Namespace) -> None:
    for name, value, least, most in (
        ("--scan-ms", options.scan_ms, 1, 100),
        ("--port", options.port, 1, 65_535),
        ("--unit", options.unit, 1, 255),
        ("--timeout-ms", options.timeout_ms, 1, 10_000),
        ("--link-limit-ms", options.link_limit_ms, 1, 10_000),
        ("--hmi-port", options.hmi_port, 0, 65_535),
    ):
        if not least <= value <= most:
            raise InputError(f"{name} {value}: must be {least} to {most}")
    if options.panel_limit_ms is not None and not 100 <= options.panel_limit_ms <= 600_000:
        raise InputError(f"--panel-limit-ms {options.panel_limit_ms}: must be 100 to 600000")
    wait_ms = options.timeout_ms + options.scan_ms
    # A response takes no simulated time.
    if options.link_limit_ms <= wait_ms and not options.simulated_time:
        raise InputError(
            f"--link-limit-ms {options.link_limit_ms}: must be more than --timeout-ms plus --scan-ms, {wait_ms} ms"
        )


@contextmanager
def _memory(machine: Transplanter, plc: Plc, options: argparse.Namespace) -> Iterator[FileStore]:
    """Restore the retentive memory, apply the initial set-points, and lock the file for this process."""
    store = FileStore(options.retain)
    try:
        lock = lock_file(options.retain)
    except FileLockError as error:
        raise InputError(f"--retain {options.retain}: {error}") from error
    try:
        _restore(machine, plc, store)
        for word, value in _set_points(machine, options.set_points):
            plc.write(word, value)
        try:
            store.save(plc.retained())
        except OSError as error:
            raise InputError(f"--retain {options.retain}: {error.strerror}; choose a writable file") from error
        yield store
    finally:
        lock.release()


def _pace(options: argparse.Namespace) -> Pace | None:
    try:
        return Pace(options.pace) if options.simulated_time else None
    except PaceError as error:
        raise InputError(f"--pace: {error}") from error


@contextmanager
def _operator_interfaces(
    runtime: Runtime, figures: LoopFigures, pace: Pace | None, options: argparse.Namespace
) -> Iterator[None]:
    """Connect the runtime to event output, history, alarm list, console and Modbus server."""
    machine = runtime.machine
    with ExitStack() as stack:
        printer = EventWriter(options.events, sys.stdout)
        stack.callback(printer.close)
        receivers: list[Callable[[Event | AlarmChange], None]] = [printer.write]
        edges = CycleEdges(machine)
        history = _history(machine, edges, options)
        if history is not None:
            stack.callback(history.close)
            receivers.append(history.write)
            runtime.observers.append(edges)

        def publish(event: Event | AlarmChange) -> None:
            for receive in receivers:
                receive(event)

        def audit(peer: str, who: str, what: str, value: str, result: str) -> None:
            if history is not None:
                history.audit(peer, who, what, value, result, runtime.now_ms)

        runtime.observers.append(ProductionLog(machine, publish, options.language))
        alarms = AlarmList(machine.alarms, machine.tags.machine.first_out, publish, options.language)
        runtime.observers.append(alarms)
        runtime.observers.append(_OutputReport(runtime, printer))
        if not options.no_hmi:
            server = _server(runtime, alarms, options, figures=figures, pace=pace, audit=audit)
            receivers.append(server.cycles.record)
            sys.setswitchinterval(SWITCH_INTERVAL_S)
            stack.enter_context(server)
            printer.write(ServingEvent(runtime.now_ms, server.port))
        if not options.no_console and sys.stdin is not None:  # None = closed by the parent process
            stack.enter_context(ConsoleReader(Console(runtime, alarms), sys.stdin.fileno()))
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


def _history(machine: Transplanter, edges: CycleEdges, options: argparse.Namespace) -> HistoryWriter | None:
    if options.no_history:
        return None
    path = options.history or options.retain.with_name("history.sqlite")
    try:
        return HistoryWriter(
            path,
            wall_ms=utc_ms,
            program=machine.program.name,
            version=version(),
            edges_of=edges.of,
            language=options.language,
        )
    except HistoryError as error:
        raise InputError(f"--history: {error}") from error


def _server(
    runtime: Runtime,
    alarms: AlarmList,
    options: argparse.Namespace,
    *,
    figures: LoopFigures,
    pace: Pace | None,
    audit: Callable[[str, str, str, str, str], None],
) -> HmiServer:
    serial = None if options.hmi_serial is None else SerialLine.parsed(options.hmi_serial)
    hmi_options = HmiOptions(
        options.hmi_host,
        options.hmi_port,
        options.hmi_allow_remote,
        options.hmi_certificate,
        options.hmi_key,
        options.hmi_clients,
        serial,
    )
    return HmiServer(runtime, alarms, hmi_options, figures=figures, pace=pace, audit=audit, version=version())


def _restore(machine: Transplanter, plc: Plc, store: FileStore) -> None:
    """Restore the memory stored by the last run. A damaged file is renamed and reported, and `memory_lost` is set."""
    try:
        values = store.load()
        if values is not None:
            plc.restore_retained(values)
    except (DamagedStoreError, ValueError) as error:
        prefix = "" if isinstance(error, DamagedStoreError) else f"{store.path}: "
        try:
            aside = store.set_aside()
        except OSError as refused:
            raise InputError(f"--retain {store.path}: {refused.strerror}; choose a writable file") from refused
        print(f"{prefix}{error}; renamed to {aside}", file=sys.stderr)
        plc.write(machine.tags.system.memory_lost, 1)


def _set_points(machine: Transplanter, assignments: Sequence[str]) -> list[tuple[Word, int]]:
    values = []
    for text in assignments:
        name, _, value = text.partition("=")
        try:
            values.append(machine.tags.sp.checked(name, value))
        except SetPointError as error:
            raise InputError(f"--set {text}: {error}") from error
    return values


def _wait_for_field(link: ModbusTcpLink, guard: ModbusOutputGuard, options: argparse.Namespace, stop: Stop) -> bool:
    """Wait until the field I/O responds, with periodic reports while it does not; return False if `stop` is set."""
    tries = 0
    while not stop.is_set():
        try:
            link.open()
            link.read_inputs()
            if options.module is not None:
                MODULE_PROFILES[options.module].apply(link)
            kind = guard.identify()
        except OSError as error:
            if tries % round(REMIND_S / RETRY_S) == 0:
                print(f"{error}; retrying", file=sys.stderr, flush=True)
            tries += 1
            stop.wait(RETRY_S)
        else:
            print(f"field I/O at {options.host}:{options.port} responds", file=sys.stderr, flush=True)
            if kind is ModuleKind.BLIND:
                print("its outputs cannot be read back: another master is not detected", file=sys.stderr, flush=True)
            return True
    return False
