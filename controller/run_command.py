"""The command ``run``: the machine's program on a field link, with everything around it that an operator needs."""

from __future__ import annotations

import argparse
import importlib.metadata
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from controller.core.claim import ClaimError, claim
from controller.core.clock import MonotonicClock, utc_ms
from controller.core.expr import Word
from controller.core.retain import DamagedStoreError, FileStore
from controller.core.scan import Plc
from controller.hmi.alarm_list import AlarmChange, AlarmList
from controller.hmi.console import Console, OrderError
from controller.hmi.cycle_edges import CycleEdges
from controller.hmi.history import History
from controller.hmi.history_schema import HistoryError
from controller.hmi.modbus_server import DEFAULT_PORT, HmiOptions, HmiServer, ServerError
from controller.hmi.production import Event, ProductionLog
from controller.hmi.teller import ServingEvent, Teller
from controller.io.keeper import DirectKeeper, Keeper, ThreadKeeper
from controller.io.loop import LoopFigures, run_real_time, run_simulated_time
from controller.io.modbus_tcp import ModbusTcpLink
from controller.io.pace import Pace, PaceError
from controller.io.runtime import Runtime
from controller.io_map import DEFAULT_IO_MAP, load_io_map
from controller.modbus.rtu import SerialError, SerialLine
from controller.program.machine import Transplanter, build
from controller.program.tags import SetPointError

RETRY_S = 0.5
REMIND_S = 5.0
SWITCH_INTERVAL_S = 0.0005
"""Longest time the interpreter leaves the scan waiting for another thread's Python; its default is ten times that."""


class UsageError(ValueError):
    """An option that cannot be used; one line that names it and the remedy."""


class RunCommand:
    """The command and its options; `run` raises `UsageError` and the errors of the I/O map with one line each."""

    def add_to(self, parser: argparse.ArgumentParser) -> None:
        """Add the options to the parser of ``run``; the action is `run`."""
        parser.set_defaults(command=self.run)
        parser.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="the wires")
        parser.add_argument("--host", default="127.0.0.1", help="Modbus TCP address of the field I/O")
        parser.add_argument("--port", type=int, default=5020, help="Modbus TCP port of the field I/O")
        parser.add_argument("--unit", type=int, default=1, help="Modbus unit identifier")
        parser.add_argument("--timeout-ms", type=int, default=30, help="longest wait for one answer of the field, ms")
        parser.add_argument(
            "--link-limit-ms",
            type=int,
            default=100,
            help="the loss of the field is known after this time at the latest, ms",
        )
        parser.add_argument(
            "--panel-limit-ms",
            type=int,
            default=None,
            help="silence of the panel (lines on standard input, empty ones too), once it was heard, after "
            "which the cycle is finished and the machine held, ms; left out = it may be silent",
        )
        parser.add_argument(
            "--retain", type=Path, default=Path("var/retentive.json"), help="file of the retentive memory"
        )
        parser.add_argument("--scan-ms", type=int, default=10, help="scan period, ms")
        parser.add_argument("--input-filter-ms", type=int, default=10, help="input filter of X0-X17, ms; 0 = off")
        parser.add_argument(
            "--set",
            action="append",
            default=[],
            metavar="NAME=VALUE",
            dest="set_points",
            help="first value of a set-point, e.g. trays_target=2; may be repeated",
        )
        parser.add_argument("--language", choices=("en", "zh"), default="en", help="language of the texts")
        parser.add_argument(
            "--events", choices=("text", "json"), default="text", help="form of the events on standard output"
        )
        parser.add_argument("--no-console", action="store_true", help="take no orders (one a line) from standard input")
        parser.add_argument(
            "--history", type=Path, default=None, help="file of the history; left out = history.sqlite beside --retain"
        )
        parser.add_argument("--no-history", action="store_true", help="keep no history")
        parser.add_argument(
            "--simulated-time",
            action="store_true",
            help="for a plant in lock step: each scan one period after the last, whatever the clock on "
            "the wall says; can be paused and sped up by a panel. Never for a machine",
        )
        parser.add_argument(
            "--pace",
            type=int,
            default=100,
            metavar="PERCENT",
            help="speed of simulated time at the start, 0 = paused, 65535 = as fast as it can",
        )
        _add_hmi(parser)

    def run(self, options: argparse.Namespace) -> int:
        """Run until SIGINT or SIGTERM; return the exit code: 1 when the outputs could not be written safe."""
        _check_numbers(options)
        machine = build(load_io_map(options.io_map))
        try:
            plc = Plc(machine.program, input_filter_ms=options.input_filter_ms)
        except ValueError as error:
            raise UsageError(f"--input-filter-ms: {error}") from error
        stop = threading.Event()
        with ExitStack() as stack:
            store = stack.enter_context(_memory(machine, plc, options))
            link = ModbusTcpLink(
                options.host, options.port, machine.io_map, unit=options.unit, timeout_s=options.timeout_ms / 1000
            )
            stack.callback(link.close)
            pace = _pace(options)
            # Simulated time waits for the disk, as for everything; on a real clock the outputs wait alone.
            keeper: Keeper = ThreadKeeper(store) if pace is None else DirectKeeper(store)
            stack.callback(keeper.close)
            runtime = Runtime(
                machine,
                plc,
                link,
                keeper,
                link_limit_ms=options.link_limit_ms,
                link_wait_ms=options.timeout_ms + options.scan_ms,
                panel_limit_ms=options.panel_limit_ms,
                allow_forcing=options.allow_forcing,
            )
            figures = LoopFigures()
            stack.enter_context(_operators_side(runtime, figures, pace, options))
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, lambda *_: stop.set())
            if not _wait_for_field(link, options, stop):
                return 0
            if pace is None:
                run_real_time(runtime, MonotonicClock(), scan_ms=options.scan_ms, stop=stop, figures=figures)
            else:
                run_simulated_time(runtime, pace, scan_ms=options.scan_ms, stop=stop, figures=figures)
        print(
            f"stopped, outputs {'written safe' if figures.made_safe else 'NOT written: the field did not answer'}; "
            f"{figures.scans} scans of {options.scan_ms} ms, {figures.overruns} over it, "
            f"longest {figures.longest_ms} ms",
            file=sys.stderr,
        )
        return 0 if figures.made_safe else 1


def _add_hmi(parser: argparse.ArgumentParser) -> None:
    """Add the options of the Modbus server for panels."""
    hmi = parser.add_argument_group("Modbus server for operator panels")
    hmi.add_argument("--no-hmi", action="store_true", help="serve no panel")
    hmi.add_argument("--hmi-host", default="127.0.0.1", help="address to listen on")
    hmi.add_argument(
        "--hmi-port", type=int, default=DEFAULT_PORT, help="TCP port; 0 = a free one, told when it listens"
    )
    hmi.add_argument("--hmi-allow-remote", action="store_true", help="permit an address other computers can reach")
    hmi.add_argument("--hmi-certificate", default=None, metavar="FILE", help="certificate (PEM): TLS instead of TCP")
    hmi.add_argument("--hmi-key", default=None, metavar="FILE", help="its key (PEM)")
    hmi.add_argument(
        "--hmi-clients",
        default=None,
        metavar="FILE",
        help="authorities (PEM) whose certificates clients must show; left out = none asked",
    )
    hmi.add_argument(
        "--hmi-serial", default=None, metavar="DEVICE:BAUD:8E1:UNIT", help="serve Modbus RTU on a line, too"
    )
    hmi.add_argument(
        "--allow-forcing",
        action="store_true",
        help="let a panel force inputs while the machine stands in manual mode; nothing moves then",
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
            raise UsageError(f"{name} {value}: give {least} to {most}")
    if options.panel_limit_ms is not None and not 100 <= options.panel_limit_ms <= 600_000:
        raise UsageError(f"--panel-limit-ms {options.panel_limit_ms}: give 100 to 600000")
    wait_ms = options.timeout_ms + options.scan_ms
    # In simulated time an answer costs none of it.
    if options.link_limit_ms <= wait_ms and not options.simulated_time:
        raise UsageError(f"--link-limit-ms {options.link_limit_ms}: give more than a time-out and a scan, {wait_ms} ms")


@contextmanager
def _memory(machine: Transplanter, plc: Plc, options: argparse.Namespace) -> Iterator[FileStore]:
    """Put back what was kept, with the first set-points, and keep the file for this process."""
    store = FileStore(options.retain)
    try:
        lock = claim(options.retain)
    except ClaimError as error:
        raise UsageError(f"--retain {options.retain}: {error}") from error
    with lock:
        _restore(machine, plc, store)
        for word, value in _set_points(machine, options.set_points):
            plc.write(word, value)
        try:
            store.save(plc.retained())
        except OSError as error:
            raise UsageError(f"--retain {options.retain}: {error.strerror}; name a file that can be written") from error
        yield store


def _pace(options: argparse.Namespace) -> Pace | None:
    try:
        return Pace(options.pace) if options.simulated_time else None
    except PaceError as error:
        raise UsageError(f"--pace: {error}") from error


@contextmanager
def _operators_side(
    runtime: Runtime, figures: LoopFigures, pace: Pace | None, options: argparse.Namespace
) -> Iterator[None]:
    """Events on standard output, history, alarm list, orders from the console and from panels."""
    machine = runtime.machine
    with ExitStack() as stack:
        teller = Teller(options.events, sys.stdout)
        stack.callback(teller.close)
        told: list[Callable[[Event | AlarmChange], None]] = [teller.tell]
        edges = CycleEdges(machine)
        history = _history(machine, edges, options)
        if history is not None:
            stack.callback(history.close)
            told.append(history.tell)
            runtime.observers.append(edges)

        def tell(event: Event | AlarmChange) -> None:
            for take in told:
                take(event)

        def audit(peer: str, who: str, what: str, value: str, result: str) -> None:
            if history is not None:
                history.audit(peer, who, what, value, result, runtime.now_ms)

        runtime.observers.append(ProductionLog(machine, tell, options.language))
        alarms = AlarmList(machine.alarms, machine.tags.machine.first_out, tell, options.language)
        runtime.observers.append(alarms)
        if not options.no_hmi:
            server = _server(runtime, alarms, options, figures=figures, pace=pace, audit=audit)
            told.append(server.cycles.take)
            sys.setswitchinterval(SWITCH_INTERVAL_S)
            try:
                stack.enter_context(server)
            except ServerError as error:
                raise UsageError(str(error)) from error
            teller.tell(ServingEvent(runtime.now_ms, server.port))
        if not options.no_console and sys.stdin is not None:  # None = closed by whoever started us
            console = Console(runtime, alarms)
            threading.Thread(target=_read_console, args=(console,), name="console", daemon=True).start()
        yield


def _history(machine: Transplanter, edges: CycleEdges, options: argparse.Namespace) -> History | None:
    if options.no_history:
        return None
    path = options.history or options.retain.with_name("history.sqlite")
    try:
        return History(
            path,
            wall_ms=utc_ms,
            program=machine.program.name,
            version=_version(),
            edges_of=edges.of,
            language=options.language,
        )
    except HistoryError as error:
        raise UsageError(f"--history: {error}") from error


def _server(
    runtime: Runtime,
    alarms: AlarmList,
    options: argparse.Namespace,
    *,
    figures: LoopFigures,
    pace: Pace | None,
    audit: Callable[[str, str, str, str, str], None],
) -> HmiServer:
    try:
        serial = None if options.hmi_serial is None else SerialLine.parsed(options.hmi_serial)
        reached = HmiOptions(
            options.hmi_host,
            options.hmi_port,
            options.hmi_allow_remote,
            options.hmi_certificate,
            options.hmi_key,
            options.hmi_clients,
            serial,
        )
        return HmiServer(runtime, alarms, reached, figures=figures, pace=pace, audit=audit, version=_version())
    except (SerialError, ServerError) as error:
        raise UsageError(str(error)) from error


def _version() -> str:
    return importlib.metadata.version("seedling-transplanter")


def _restore(machine: Transplanter, plc: Plc, store: FileStore) -> None:
    """Put back what the last run kept. What cannot be trusted is set aside and reported, and the program told."""
    try:
        kept = store.load()
        if kept is not None:
            plc.restore(kept)
    except (DamagedStoreError, ValueError) as error:
        where = "" if isinstance(error, DamagedStoreError) else f"{store.path}: "
        try:
            aside = store.set_aside()
        except OSError as refused:
            raise UsageError(f"--retain {store.path}: {refused.strerror}; name a file that can be written") from refused
        print(f"{where}{error}; moved to {aside}", file=sys.stderr)
        plc.write(machine.tags.system.memory_lost, 1)


def _set_points(machine: Transplanter, given: Sequence[str]) -> list[tuple[Word, int]]:
    values = []
    for text in given:
        name, _, value = text.partition("=")
        try:
            values.append(machine.tags.sp.checked(name, value))
        except SetPointError as error:
            raise UsageError(f"--set {text}: {error}") from error
    return values


def _wait_for_field(link: ModbusTcpLink, options: argparse.Namespace, stop: threading.Event) -> bool:
    """Try until the field answers; say at once and then now and again that it does not."""
    tries = 0
    while not stop.is_set():
        try:
            link.open()
            link.read_inputs()
        except OSError as error:
            if tries % round(REMIND_S / RETRY_S) == 0:
                print(f"{error}; trying again", file=sys.stderr, flush=True)
            tries += 1
            stop.wait(RETRY_S)
        else:
            print(f"field I/O at {options.host}:{options.port} answers", file=sys.stderr, flush=True)
            return True
    return False


def _read_console(console: Console) -> None:
    """Take orders from standard input until it ends; bytes that are no text do not end it."""
    for line in sys.stdin.buffer:
        try:
            console.take(line.decode(errors="replace"))
        except OrderError as error:
            print(error, file=sys.stderr, flush=True)
