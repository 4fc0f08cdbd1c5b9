"""Command ``capture``: capture field traffic by a proxy, and replay a capture on the program."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from controller.cli.machine import add_io_map, machine_of
from controller.common.arguments.number_type import PORT, REMOTE_PORT
from controller.common.capture import PROXY, Capture, CaptureHeader, CaptureWriter, read_capture
from controller.common.command_line import version
from controller.common.errors import InputError
from controller.common.extras import DISTRIBUTION
from controller.common.supervision.tasks import run_supervised
from controller.core.clock import MonotonicClock, utc_ms, utc_text
from controller.core.scan import Plc
from controller.io.capture_proxy import Decoder, forward
from controller.io.captured_plc import ReplayDifference, replay
from controller.iomap.digest import map_digest
from controller.iomap.loader import load_io_map
from controller.program.machine import Transplanter
from controller.program.states import State


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the subcommands of ``capture``."""
    actions = parser.add_subparsers(required=True, metavar="ACTION", dest="action")
    record = actions.add_parser("record", help="forward Modbus TCP to the field I/O and capture it")
    record.add_argument("file", type=Path, help="new file")
    record.add_argument("--listen-port", type=PORT, default=5030, help="TCP port for the controller; 0 = any free port")
    record.add_argument("--host", default="127.0.0.1", help="Modbus TCP address of the field I/O")
    record.add_argument("--port", type=REMOTE_PORT, default=5020, help="Modbus TCP port of the field I/O")
    add_io_map(record)
    record.set_defaults(capture=_record)
    again = actions.add_parser(
        "replay",
        help="scan the program with captured inputs and show the first difference of the outputs",
    )
    again.add_argument("file", type=Path, help="capture of 'run --capture'")
    add_io_map(again)
    again.set_defaults(capture=_replay)


def run(options: argparse.Namespace) -> int:
    """Capture until the request to stop, or replay; return 1 if the replay differs.

    Raises:
        InputError: An option or the file is invalid, or the port is in use.
    """
    code: int = options.capture(options)
    return code


def _record(options: argparse.Namespace) -> int:
    io_map = load_io_map(options.io_map)
    header = CaptureHeader(
        made_by=f"{DISTRIBUTION} {version()}",
        source=PROXY,
        io_map=map_digest(io_map),
        inputs=io_map.input_count,
        outputs=io_map.output_count,
        scan_ms=0,
        input_filter_ms=0,
        begun_utc=utc_text(utc_ms()),
    )

    def ready(port: int) -> None:
        print(f"capturing: connect the controller to 127.0.0.1:{port}", flush=True)

    with CaptureWriter(options.file, header) as writer:
        decoder = Decoder(io_map, writer, MonotonicClock())
        listen, field = ("127.0.0.1", options.listen_port), (options.host, options.port)
        try:
            run_supervised(forward(listen, field, decoder, options.stop, ready))
        except OSError as error:
            options.file.unlink()
            raise InputError(f"--listen-port {options.listen_port}: {error.strerror}; choose a free port") from error
    return 0


def _replay(options: argparse.Namespace) -> int:
    options.stop.interrupt()
    capture = read_capture(options.file)
    machine = machine_of(options)
    capture.check_map(map_digest(machine.io_map))
    plc = Plc(machine.program, input_filter_ms=capture.header.input_filter_ms)
    scans, difference = replay(capture, plc)
    if not capture.is_closed:
        print(f"{capture.path}: not closed; replayed up to its last line", file=sys.stderr)
    print(f"{scans} scans, {capture.end_ms / 1000:.3f} s, captured with {capture.header.made_by}")
    if difference is None:
        print("the program writes the captured outputs")
        return 0
    print("\n".join(_lines(capture, machine, plc, difference)))
    return 1


def _lines(capture: Capture, machine: Transplanter, plc: Plc, found: ReplayDifference) -> list[str]:
    """Return the first difference with its time, its points and the states of the program."""
    names = {False: "off", True: "on"}
    differing = [
        f"  {point.address} {point.tag}: captured {names[found.captured[point.number]]}, "
        f"program {names[found.replayed[point.number]]}"
        for point in machine.io_map.outputs
        if found.captured[point.number] != found.replayed[point.number]
    ]
    steps = [
        f"  {sequence.name}: {', '.join(title for title, bit in sequence.bits.items() if plc.read(bit)) or '-'}"
        for sequence in machine.program.sequences()
    ]
    state = State(plc.read(machine.tags.machine.state)).name
    return [
        f"first difference at {found.at_ms / 1000:.3f} s, scan {found.scan} ({capture.path}:{found.line}):",
        *differing,
        f"  state: {state}",
        *steps,
    ]
