"""Command ``debug``: record a trial, and look at it scan by scan, forwards and backwards."""

from __future__ import annotations

import argparse
import sys

from controller.cli.debugger import STDIO, present
from controller.cli.fx_options import cpu_of, peripherals_of
from controller.common.stop_request import INTERRUPTED
from controller.debug.commands import Debugger
from controller.iomap.loader import load_io_map
from plant_sim.cli.settings import check_program, faults_of, machine_of, rule_of, start_values_of
from plant_sim.twin.debug.recorder import TwinRecorder
from plant_sim.twin.ladder.recording import LadderRecorder
from plant_sim.twin.ladder.trial import load_ladder, run_ladder_trial
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.trial import run_trial


def run(options: argparse.Namespace) -> int:
    """Record the trial and execute the commands.

    Returns:
        0; 130 after Ctrl-C or SIGTERM during the trial.

    Raises:
        InputError: An option, a file or a command is invalid.
    """
    check_program(options)
    return _debug_controller(options) if options.ladder is None else _debug_ladder(options)


def _debug_controller(options: argparse.Namespace) -> int:
    recorders: list[TwinRecorder] = []

    def record(twin: Twin) -> None:
        recorders.append(TwinRecorder(twin, length=options.length))

    report = run_trial(
        seed=options.seed,
        trays=options.trays,
        io_map=load_io_map(options.io_map),
        parameters=machine_of(options),
        set_points=start_values_of(options),
        faults=faults_of(options),
        rule=rule_of(options, options.trays),
        stop=options.stop,
        prepare=record,
    )
    if options.stop.is_set():
        return INTERRUPTED

    def serve_page(debugger: Debugger, port: int) -> int:
        from controller.cli.ladder.page_server import program_of_machine, serve_recorded_page  # noqa: PLC0415 - loads slowly

        program, _ = program_of_machine(recorders[0].twin.machine)
        return serve_recorded_page(debugger, program, port, options.stop)

    print(report.text(), file=sys.stderr if options.dap == STDIO else sys.stdout, flush=True)
    return present(recorders[0].close(), options, serve_page)


def _debug_ladder(options: argparse.Namespace) -> int:
    ladder, recorder = load_ladder(options.ladder, cpu_of(options)), LadderRecorder(options.length)
    report = run_ladder_trial(
        ladder,
        seed=options.seed,
        trays=options.trays,
        io_map=load_io_map(options.io_map),
        parameters=machine_of(options),
        peripherals=peripherals_of(options),
        faults=faults_of(options),
        rule=rule_of(options, options.trays),
        stop=options.stop,
        recorder=recorder,
    )
    if options.stop.is_set():
        return INTERRUPTED

    def serve_page(debugger: Debugger, port: int) -> int:
        from controller.cli.ladder.page_server import program_of_file, serve_recorded_page  # noqa: PLC0415 - loads slowly

        return serve_recorded_page(debugger, program_of_file(options.ladder.name, ladder), port, options.stop)

    print(report.text(), file=sys.stderr if options.dap == STDIO else sys.stdout, flush=True)
    return present(recorder.close(), options, serve_page)
