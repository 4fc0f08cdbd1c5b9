"""Command ``debug``: record a trial, and look at it scan by scan, forwards and backwards."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from controller.cli.debugger import STDIO, present
from controller.cli.fx_options import cpu_of, peripherals_of
from controller.common.stop_request import INTERRUPTED
from controller.debug.commands import Debugger
from controller.debug.timeline import RunTimeline
from controller.iomap.loader import load_io_map
from plant_sim.cli.settings import check_program, faults_of, machine_of, rule_of, start_values_of
from plant_sim.twin.debug.machine import TwinMachine
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
    report, line = _record(options)
    if options.stop.is_set():
        return INTERRUPTED

    def serve_page(debugger: Debugger, port: int) -> int:
        from controller.cli.ladder.page_server import (  # noqa: PLC0415 - loads slowly
            program_of_file,
            program_of_machine,
            serve_recorded_page,
        )
        from plant_sim.twin.debug.picture import picture_of  # noqa: PLC0415 - loads slowly

        machine = line.machine
        if isinstance(machine, TwinMachine):
            program, _ = program_of_machine(machine.twin.machine)
        else:
            program = program_of_file(options.ladder.name, machine.ladder)
        return serve_recorded_page(debugger, program, port, options.stop, picture_of(machine))

    print(report, file=sys.stderr if options.dap == STDIO else sys.stdout, flush=True)
    return present(line, options, serve_page)


def _record(options: argparse.Namespace) -> tuple[str, RunTimeline]:
    """Run the trial of the controller, or of an FX program; return its report and the recorded run."""
    trial: dict[str, Any] = {
        "seed": options.seed,
        "trays": options.trays,
        "io_map": load_io_map(options.io_map),
        "parameters": machine_of(options),
        "faults": faults_of(options),
        "rule": rule_of(options, options.trays),
        "stop": options.stop,
    }
    if options.ladder is not None:
        ladder = load_ladder(options.ladder, cpu_of(options))
        recorder = LadderRecorder(options.length)
        text = run_ladder_trial(ladder, peripherals=peripherals_of(options), recorder=recorder, **trial).text()
        return text, recorder.close()
    recorders: list[TwinRecorder] = []

    def record(twin: Twin) -> None:
        recorders.append(TwinRecorder(twin, length=options.length))

    text = run_trial(set_points=start_values_of(options), prepare=record, **trial).text()
    return text, recorders[0].close()
