"""Command line of the controller: ``python -m controller`` runs it on a field link."""

from __future__ import annotations

import argparse
import fcntl
import importlib
import json
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from types import ModuleType
from typing import TextIO

from controller.core.clock import MonotonicClock
from controller.core.expr import Bit, Word
from controller.core.program import Program
from controller.core.retain import DamagedStoreError, FileStore
from controller.core.rungs import written_devices
from controller.core.scan import Plc
from controller.core.specification import Specification
from controller.fx.command import STEPPER_HZ, LadderCommand
from controller.fx.export import PulseTrain
from controller.fx.instruction import LadderError
from controller.fx.stimulus import StimulusError
from controller.hmi.alarm_list import AlarmChange, AlarmList
from controller.hmi.console import Console, OrderError
from controller.hmi.production import Event, ProductionLog
from controller.hmi.reference import write_reference
from controller.io.keeper import ThreadKeeper
from controller.io.loop import run_real_time
from controller.io.modbus_tcp import ModbusTcpLink
from controller.io.runtime import Runtime
from controller.io_map import DEFAULT_IO_MAP, IoMapError, load_io_map
from controller.program.machine import RuleError, Transplanter, build
from controller.program.proof import specification as specification_of
from controller.program.tags import SetPointError

RETRY_S = 0.5
REMIND_S = 5.0


class UsageError(ValueError):
    """A wrong option; one line that names it and the remedy."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if not given or given[0] not in ("run", "docs", "prove", "replay", "ladder", "-h", "--help"):
        given.insert(0, "run")
    options = _parser().parse_args(given)
    try:
        command: Callable[[argparse.Namespace], int] = options.command
        return command(options)
    except (UsageError, IoMapError, RuleError, LadderError, StimulusError) as error:
        print(error, file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m controller", description="Soft PLC of the seedling transplanter.",
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    run = commands.add_parser("run", help="run the machine's program on a field link (default)",
                              formatter_class=argparse.ArgumentDefaultsHelpFormatter)  # fmt: skip
    run.set_defaults(command=_run)
    run.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="the wires")
    run.add_argument("--host", default="127.0.0.1", help="Modbus TCP address of the field I/O")
    run.add_argument("--port", type=int, default=5020, help="Modbus TCP port of the field I/O")
    run.add_argument("--unit", type=int, default=1, help="Modbus unit identifier")
    run.add_argument("--timeout-ms", type=int, default=30, help="longest wait for one answer of the field, ms")
    run.add_argument(
        "--link-limit-ms",
        type=int,
        default=100,
        help="the loss of the field is known after this time at the latest, ms",
    )
    run.add_argument("--panel-limit-ms", type=int, default=None,
                     help="silence of the panel (lines on standard input, empty ones too), once it was heard, after "
                     "which the cycle is finished and the machine held, ms; left out = it may be silent")  # fmt: skip
    run.add_argument("--retain", type=Path, default=Path("var/retentive.json"), help="file of the retentive memory")
    run.add_argument("--scan-ms", type=int, default=10, help="scan period, ms")
    run.add_argument("--input-filter-ms", type=int, default=10, help="input filter of X0-X17, ms; 0 = off")
    run.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="set_points",
                     help="first value of a set-point, e.g. trays_target=2; may be repeated")  # fmt: skip
    run.add_argument("--language", choices=("en", "zh"), default="en", help="language of the texts")
    run.add_argument("--events", choices=("text", "json"), default="text", help="form of the events on standard output")
    run.add_argument("--no-console", action="store_true", help="take no orders (one a line) from standard input")
    prove = commands.add_parser("prove", help="prove that no scan breaks a safety requirement, whatever the inputs do")
    prove.set_defaults(command=_prove)
    prove.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="the wires")
    prove.add_argument(
        "--goal", action="append", default=None, metavar="NAME", help="prove this alone; may be repeated"
    )
    prove.add_argument("--short", action="store_true", help="leave out traces, steps and ways out")
    prove.add_argument(
        "--without",
        action="append",
        default=[],
        metavar="RULE",
        help="leave an interlock rule out, to see what it prevents, as 'left: down at feed only'",
    )
    prove.add_argument("--json", action="store_true", help="print the report as JSON, traces included")
    prove.add_argument("--traces", type=Path, default=None, help="folder for the traces of what is broken")
    replay = commands.add_parser("replay", help="run a trace of 'prove --traces' on the PLC and show what it does")
    replay.set_defaults(command=_replay)
    replay.add_argument("trace", type=Path, help="the trace")
    replay.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="the wires")
    replay.add_argument("--without", action="append", default=[], metavar="RULE", help="rules that were left out")
    ladder = commands.add_parser("ladder", help="FX2N: export the machine's program; check, run, draw any program")
    ladder.set_defaults(command=_ladder)
    LadderCommand(lambda io_map: build(load_io_map(io_map)).program, _stepper).add_to(ladder, DEFAULT_IO_MAP)
    docs = commands.add_parser("docs", help="write the reference tables made from the program")
    docs.set_defaults(command=_docs)
    docs.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="the wires")
    docs.add_argument("--out", type=Path, required=True, help="folder for the tables")
    parser.epilog = f"Without a command:\n\n{run.format_help()}"
    return parser


def _docs(options: argparse.Namespace) -> int:
    for path in write_reference(build(load_io_map(options.io_map)), options.out):
        print(path)
    return 0


def _prove(options: argparse.Namespace) -> int:
    command, specify = _verification()
    specification = specify(build(load_io_map(options.io_map), without=options.without))
    clock = MonotonicClock()
    try:
        text, good = command.prove_command(
            specification, clock=lambda: clock.now_ms() / 1000, goals=options.goal, short=options.short,
            as_json=options.json,
            traces=options.traces,
        )  # fmt: skip
    except command.ModelError as error:
        raise UsageError(f"--goal: {error}") from error
    except OSError as error:
        raise UsageError(f"--traces {options.traces}: {error.strerror}; name a folder that can be written") from error
    print(text)
    return 0 if good else 1


def _replay(options: argparse.Namespace) -> int:
    command, specify = _verification()
    specification = specify(build(load_io_map(options.io_map), without=options.without))
    try:
        lines, holds = command.replay_command(specification, options.trace)
    except command.ModelError as error:
        raise UsageError(str(error)) from error
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{options.trace}: {error}; name a trace that 'prove --traces' has written") from error
    print("\n".join(lines))
    print("the requirement holds" if holds else "the requirement is broken")
    return 0 if holds else 1


def _ladder(options: argparse.Namespace) -> int:
    try:
        text, code = options.action(options)
    except OSError as error:
        raise UsageError(f"{error.filename}: {error.strerror}; name another place") from error
    print(text)
    return int(code)


def _stepper(program: Program) -> PulseTrain:
    """Return the output of the conveyor's stepper as a train of pulses."""
    output = next(bit for rung in program.rungs() for bit in written_devices(rung)
                  if isinstance(bit, Bit) and bit.kind == "Y" and bit.name == "tray_run")  # fmt: skip
    return PulseTrain(output, STEPPER_HZ)


def _verification() -> tuple[ModuleType, Callable[[Transplanter], Specification]]:
    """Return what proves and what is proved; the solver is an extra of the installation."""
    try:
        command = importlib.import_module("controller.verify.command")
    except ModuleNotFoundError as error:
        raise UsageError(f"no {error.name} here; install it: pip install 'seedling-transplanter[verify]'") from error
    return command, specification_of


def _run(options: argparse.Namespace) -> int:
    for name, value, most in (
        ("--scan-ms", options.scan_ms, 100),
        ("--port", options.port, 65_535),
        ("--timeout-ms", options.timeout_ms, 10_000),
        ("--link-limit-ms", options.link_limit_ms, 10_000),
    ):
        if not 1 <= value <= most:
            raise UsageError(f"{name} {value}: give 1 to {most}")
    if options.panel_limit_ms is not None and not 100 <= options.panel_limit_ms <= 600_000:
        raise UsageError(f"--panel-limit-ms {options.panel_limit_ms}: give 100 to 600000")
    wait_ms = options.timeout_ms + options.scan_ms
    if options.link_limit_ms <= wait_ms:
        raise UsageError(f"--link-limit-ms {options.link_limit_ms}: give more than a time-out and a scan, "
                         f"{wait_ms} ms")  # fmt: skip
    machine = build(load_io_map(options.io_map))
    try:
        plc = Plc(machine.program, input_filter_ms=options.input_filter_ms)
    except ValueError as error:
        raise UsageError(f"--input-filter-ms: {error}") from error
    store = FileStore(options.retain)
    claim = _claim(options.retain)
    _restore(machine, plc, store)
    for word, value in _set_points(machine, options.set_points):
        plc.write(word, value)
    try:
        store.save(plc.retained())
    except OSError as error:
        raise UsageError(f"--retain {options.retain}: {error.strerror}; name a file that can be written") from error
    link = ModbusTcpLink(options.host, options.port, machine.io_map, unit=options.unit,
                         timeout_s=options.timeout_ms / 1000)  # fmt: skip
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    if not _wait_for_field(link, options, stop):
        return 0
    keeper = ThreadKeeper(store)
    runtime = Runtime(machine, plc, link, keeper, link_limit_ms=options.link_limit_ms, link_wait_ms=wait_ms,
                      panel_limit_ms=options.panel_limit_ms)  # fmt: skip
    teller = Teller(options.events)
    runtime.observers.append(ProductionLog(machine, teller.tell, options.language))
    alarms = AlarmList(machine.alarms, machine.tags.machine.first_out, teller.tell, options.language)
    runtime.observers.append(alarms)
    if not options.no_console:
        console = Console(runtime, alarms)
        threading.Thread(target=_read_console, args=(console,), name="console", daemon=True).start()
    try:
        figures = run_real_time(runtime, MonotonicClock(), scan_ms=options.scan_ms, stop=stop)
    finally:
        link.close()
        keeper.close()
        teller.close()
        claim.close()
    print(
        f"stopped, outputs {'written safe' if figures.made_safe else 'NOT written: the field did not answer'}; "
        f"{figures.scans} scans of {options.scan_ms} ms, {figures.overruns} over it, "
        f"longest {figures.longest_ms} ms",
        file=sys.stderr,
    )
    return 0 if figures.made_safe else 1


def _claim(retain: Path) -> TextIO:
    """Take the retentive memory for this process alone; the operating system lets it go when the process ends."""
    if retain.is_dir():
        raise UsageError(f"--retain {retain}: is a folder; name a file")
    try:
        retain.parent.mkdir(parents=True, exist_ok=True)
        claim = retain.with_name(retain.name + ".lock").open("w", encoding="utf-8")
    except OSError as error:
        raise UsageError(f"--retain {retain}: {error.strerror}; name a file that can be written") from error
    try:
        fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        claim.close()
        raise UsageError(
            f"--retain {retain}: another controller is using it; stop that one or name another file"
        ) from None
    return claim


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
    """Take orders from standard input until it ends."""
    for line in sys.stdin:
        try:
            console.take(line)
        except OrderError as error:
            print(error, file=sys.stderr, flush=True)


class Teller:
    """Writes events to standard output in a thread of its own: a reader that is slow or gone does not hold the scan."""

    def __init__(self, form: str) -> None:
        self._form = form
        self._events: queue.SimpleQueue[Event | AlarmChange | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._write, name="events", daemon=True)
        self._thread.start()

    def tell(self, event: Event | AlarmChange) -> None:
        """Take an event; it is written when its turn comes."""
        self._events.put(event)

    def close(self) -> None:
        """Write what is left, if anybody still reads."""
        self._events.put(None)
        self._thread.join(timeout=1.0)

    def _write(self) -> None:
        while (event := self._events.get()) is not None:
            try:
                print(self._line(asdict(event)), flush=True)
            except OSError:  # nobody reads any more, or the disk is full: what comes is taken and dropped
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

    def _line(self, record: dict[str, object]) -> str:
        if self._form == "json":
            return json.dumps(record, ensure_ascii=False)
        at_ms, kind = record.pop("at_ms"), record.pop("event")
        return f"{at_ms:>9} ms  {kind:9}" + "  ".join(f"{k}={v}" for k, v in record.items())


if __name__ == "__main__":
    sys.exit(main())
