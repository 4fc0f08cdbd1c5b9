"""Command ``run``: run the machine's program on a field link, with history, console and Modbus server for panels."""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from controller.cli.machine import add_io_map, add_start_values, machine_of, start_values
from controller.cli.run_field import (
    add_field_arguments,
    add_link_limit,
    check_field_times,
    field_plan,
    output_guard,
    print_places,
    require_watchdogs,
    wait_for_field,
)
from controller.cli.run_files import check_files, check_memory_file, memory_until_end
from controller.cli.run_history import add_history_arguments
from controller.cli.run_operator import (
    add_hmi_arguments,
    add_mitsubishi_arguments,
    check_interfaces,
    operator_interfaces,
)
from controller.common.arguments.number_type import integer
from controller.common.capture import CONTROLLER, CaptureHeader, CaptureWriter, new_file_problem
from controller.common.command_line import version
from controller.common.errors import InputError
from controller.common.extras import DISTRIBUTION
from controller.common.files.state_folder import state_folder
from controller.common.modbus.io_map import IoMap
from controller.common.real_time import (
    RealTimeError,
    add_real_time_arguments,
    claim_real_time,
    doubts,
    exit_note,
    freeze_garbage,
    pin,
    trial_lateness_us,
)
from controller.common.service_manager import READY, ServiceManager
from controller.common.stop_request import Stop, StopRequest
from controller.core.clock import MonotonicClock, utc_ms, utc_text
from controller.core.input_filter import LONGEST_FILTER_MS
from controller.core.retentive_store import MemoryStore
from controller.core.scan import Plc
from controller.io.captured_plc import CapturedPlc
from controller.io.field.field_file import FieldPlan
from controller.io.field.link import DevicesLink
from controller.io.loop import LoopFigures, run_real_time, run_simulated_time
from controller.io.output_guard import ModbusOutputGuard
from controller.io.pace import FASTEST, FLAT_OUT, PAUSED, Pace
from controller.io.retentive_writer import DirectRetentiveWriter, RetentiveWriter, writer_until_end
from controller.io.runtime import Runtime
from controller.iomap.digest import map_digest
from controller.program.machine import Transplanter

LAMP: Final = "lamp_amber"
"""Lamp that shows a question to the operator of a machine without a panel."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``run``."""
    add_io_map(parser)
    add_field_arguments(parser)
    add_link_limit(parser)
    parser.add_argument(
        "--check",
        action="store_true",
        help="check all options and files, print the place of every wire in the field, and exit; nothing is connected "
        "or written, and a port or a file that another program uses is not noticed",
    )
    parser.add_argument(
        "--panel-limit-ms",
        type=integer(100, 600_000),
        default=None,
        help="timeout of the operator panel, ms: if neither a Modbus request nor a line on standard input (which may "
        "be empty) arrives within this time, the machine completes the cycle and holds; active after the first request "
        "or line (default: no timeout)",
    )
    parser.add_argument("--retain", type=Path, default=state_folder() / "retentive.json", help="retentive memory file")
    parser.add_argument(
        "--new-machine",
        action="store_true",
        help="at installation only: the retentive memory has never been written; a tray in the machine is conveyed out "
        "by the first homing. Without it, a missing memory file is a lost memory, and the operator is asked",
    )
    parser.add_argument(
        "--capture",
        type=Path,
        default=None,
        metavar="FILE",
        help="capture the inputs, writes and outputs of every scan in this new file, for 'capture replay'",
    )
    parser.add_argument("--scan-ms", type=integer(1, 100), default=10, help="scan period, ms")
    add_real_time_arguments(parser)
    parser.add_argument(
        "--input-filter-ms", type=integer(0, LONGEST_FILTER_MS), default=10, help="input filter of X0-X17, ms; 0 = off"
    )
    add_start_values(parser, example="trays_target=2")
    parser.add_argument("--language", choices=("en", "zh"), default="en", help="language of the texts")
    parser.add_argument(
        "--events", choices=("text", "json"), default="text", help="format of the events on standard output"
    )
    parser.add_argument(
        "--no-console", action="store_true", help="do not read orders (one per line) from standard input"
    )
    add_history_arguments(parser)
    parser.add_argument(
        "--simulated-time",
        action="store_true",
        help="for a plant in lock step: each scan advances the time by one period, independently of the wall clock; a "
        "panel can pause the time and change its speed. Never use this for a real machine",
    )
    parser.add_argument(
        "--pace",
        type=integer(PAUSED, FASTEST, also=FLAT_OUT),
        default=100,
        metavar="PERCENT",
        help="initial speed of simulated time: 0 = paused, 100 = real time, 65535 = as fast as possible",
    )
    add_hmi_arguments(parser)
    add_mitsubishi_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Run until the request to stop and return the exit code, which is 1 if the safe outputs could not be written.

    Outputs that belong to another master are not written, and this is no failure.

    Raises:
        InputError: An option or a file is invalid.
    """
    _check_options(options)
    claim_real_time(options)
    machine = machine_of(options)
    plan = field_plan(machine.io_map, options)
    figures = LoopFigures()
    link = link_of(plan, machine.io_map, figures, options)
    _report_lamp(machine.io_map)
    given = start_values(machine, options)
    plc = (Plc if options.capture is None else CapturedPlc)(machine.program, input_filter_ms=options.input_filter_ms)
    stop: StopRequest = options.stop
    pace = Pace(options.pace) if options.simulated_time else None
    check_memory_file(options)
    if options.check:
        check_files(options)
        writer: RetentiveWriter = DirectRetentiveWriter(MemoryStore())
        runtime = _runtime(machine, plc, link, writer=writer, guard=output_guard(link, options), options=options)
        check_interfaces(runtime, figures, pace, options)
        print_places(plan, machine.io_map)
        return 0
    with ExitStack() as stack:
        store = stack.enter_context(memory_until_end(machine, plc, given, figures, options))
        stack.callback(link.close)
        # In simulated time, the scan waits for the disk; in real time, only the outputs wait.
        writer = stack.enter_context(writer_until_end(store, threaded=pace is None))
        guard = output_guard(link, options)
        runtime = _runtime(machine, plc, link, writer=writer, guard=guard, options=options)
        stack.enter_context(operator_interfaces(runtime, link, figures, pace, options))
        if isinstance(plc, CapturedPlc):
            stack.enter_context(_capture(plc, runtime, options))
        if store.missing and not options.new_machine:
            _report_no_memory(options.retain)
        if not wait_for_field(link, guard, stop):
            return 0
        require_watchdogs(link, options)
        _report_ready(runtime, stack)
        if pace is None:
            _prepare_real_time(options, stop)
            run_real_time(runtime, MonotonicClock(), scan_ms=options.scan_ms, stop=stop, figures=figures)
        else:
            run_simulated_time(runtime, pace, scan_ms=options.scan_ms, stop=stop, figures=figures)
    _report_end(runtime, link, figures, options)
    return 0 if figures.outputs_safe or runtime.ownership.taken or not link.unwritten else 1


def link_of(plan: FieldPlan, io_map: IoMap, figures: LoopFigures, options: argparse.Namespace) -> DevicesLink:
    """Return the link; the output watchdogs of the devices have the time of the scans."""
    if options.simulated_time:
        return DevicesLink(plan, io_map, now_s=lambda: figures.scans * options.scan_ms / 1_000)
    return DevicesLink(plan, io_map)


def _runtime(
    machine: Transplanter,
    plc: Plc,
    link: DevicesLink,
    *,
    writer: RetentiveWriter,
    guard: ModbusOutputGuard,
    options: argparse.Namespace,
) -> Runtime:
    return Runtime(
        machine,
        plc,
        link,
        writer,
        link_limit_ms=options.link_limit_ms,
        link_wait_ms=link.wait_ms + options.scan_ms,
        panel_limit_ms=options.panel_limit_ms,
        allow_forcing=options.allow_forcing,
        guard=guard,
        modules=link,
    )


def _capture(plc: CapturedPlc, runtime: Runtime, options: argparse.Namespace) -> CaptureWriter:
    """Begin the capture of the field traffic."""
    io_map = runtime.machine.io_map

    def writer(memory: dict[str, int]) -> CaptureWriter:
        header = CaptureHeader(
            made_by=f"{DISTRIBUTION} {version()}",
            source=CONTROLLER,
            io_map=map_digest(io_map),
            inputs=io_map.input_count,
            outputs=io_map.output_count,
            scan_ms=options.scan_ms,
            input_filter_ms=options.input_filter_ms,
            begun_utc=utc_text(utc_ms()),
            memory=memory,
        )
        return CaptureWriter(options.capture, header)

    runtime.observers.append(lambda now_ms, _: plc.released(now_ms, runtime.released))
    return plc.begin(writer, scan_ms=options.scan_ms)


def _report_lamp(io_map: IoMap) -> None:
    """Report a map without the amber lamp: the buttons answer a question only while a lamp or a panel shows it."""
    if LAMP in io_map:
        return
    place, remedy = str(io_map.path), f"add {LAMP}"
    for point in io_map.unwired:
        if point.tag == LAMP:
            place, remedy = f"{io_map.path}:{point.line}", f"set wired: true ({point.address})"
    print(
        f"{place}: {LAMP} is not wired: questions need a panel or a command; with a lamp, {remedy}",
        file=sys.stderr,
        flush=True,
    )


def _report_no_memory(path: Path) -> None:
    """Report a missing memory file, once nothing else ends the start."""
    print(
        f"{path}: no memory, which counts as lost; at the installation of a new machine, use --new-machine, or "
        "give the command new_machine",
        file=sys.stderr,
        flush=True,
    )


def _report_ready(runtime: Runtime, stack: ExitStack) -> None:
    """Report to the service manager that the field responds, then each scan, and the end."""
    manager = ServiceManager()
    stack.callback(manager.close)
    runtime.observers.append(lambda now_ms, _: manager.alive(now_ms))
    manager.send(READY)


def _report_end(runtime: Runtime, link: DevicesLink, figures: LoopFigures, options: argparse.Namespace) -> None:
    outputs = "set to their safe levels"
    if runtime.ownership.taken:
        outputs = f"NOT written: {runtime.ownership.taken}"
    elif link.unwritten and not figures.outputs_safe:
        others = "" if len(link.devices) == 1 else "; those of all other devices are at their safe levels"
        outputs = f"NOT written: no response from field I/O {', '.join(link.unwritten)}{others}"
    note = ""
    if not options.simulated_time:
        note = exit_note(
            options,
            limit_ms=_tolerance_ms(options),
            latest_us=figures.latest_us,
            overruns=figures.overruns,
            scans=figures.scans,
        )
    print(
        f"stopped, outputs {outputs}; "
        f"{figures.scans} scans of {options.scan_ms} ms, {figures.overruns} overruns, "
        f"longest {figures.longest_ms} ms{note}",
        file=sys.stderr,
    )


def _prepare_real_time(options: argparse.Namespace, stop: Stop) -> None:
    """Prepare the thread of the scan after all others have been started, and warn of limits that may not hold."""
    pin(options)
    freeze_garbage()
    lateness_us = trial_lateness_us(stop)
    limit_ms = _tolerance_ms(options)
    for doubt in doubts(options, scan_ms=options.scan_ms, limit_ms=limit_ms, lateness_us=lateness_us):
        print(f"warning: {doubt}", file=sys.stderr, flush=True)


def _tolerance_ms(options: argparse.Namespace) -> int:
    """Return the lateness of a scan from which the field link counts as lost, ms."""
    return int(options.link_limit_ms - options.scan_ms)


def _check_options(options: argparse.Namespace) -> None:
    if options.simulated_time and options.real_time_priority is not None:
        raise RealTimeError("--real-time-priority: simulated time does not follow the clock; omit --simulated-time")
    if options.capture is not None and (problem := new_file_problem(options.capture)):
        raise InputError(f"--capture {options.capture}: {problem}; choose a new file in a writable folder")
    check_field_times(options)
