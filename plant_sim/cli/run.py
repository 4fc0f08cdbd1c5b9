"""Command ``run``: the paper's trial with plant, controller and panel as separate processes, or in simulated time."""

from __future__ import annotations

import argparse
import contextlib
import sys

from controller.common.errors import InputError
from controller.common.stop_request import INTERRUPTED
from controller.iomap.loader import load_io_map
from plant_sim.cli.settings import faults_of, machine_of, max_ms_of, rule_of
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.live import LiveOptions, live_trial
from plant_sim.twin.process import ChildError, LiveError
from plant_sim.twin.progress import ProgressView
from plant_sim.twin.report import TrialReport
from plant_sim.twin.trial import run_trial, show_progress


def run(options: argparse.Namespace) -> int:
    """Run the trial and print the report.

    Returns:
        0 if the trial completed and every seedling is accounted for, and after Ctrl-C in a run by hand; 130 after
        another Ctrl-C or SIGTERM, with the report of the trial so far; the exit code of a failed process; else 1.

    Raises:
        InputError: An option or a file is invalid.
    """
    _check_plant(options)
    if options.fast and options.keep:
        raise InputError("--keep: cannot be combined with --fast, which serves nothing; omit one of them")
    if options.fast:
        return _fast(options)
    try:
        return _live(options)
    except KeyboardInterrupt:
        if options.by_hand:  # stopped by the user who operates the machine: no trial has failed
            return 0
        raise
    except BrokenPipeError:  # also a ConnectionError, but caused by closed standard output
        raise
    except (LiveError, ConnectionError) as error:
        print(error, file=sys.stderr)
        return 1
    except ChildError as error:  # the process has printed the reason
        return error.exit_code or 1


def _check_plant(options: argparse.Namespace) -> None:
    """Build the plant once, so that invalid files and faults are reported before any process is started."""
    Plant(
        load_io_map(options.io_map),
        load_machine(options.machine),
        seed=options.seed,
        trays=options.trays,
        faults=faults_of(options),
    )


def _live(options: argparse.Namespace) -> int:
    live = LiveOptions(
        options.seed,
        options.trays,
        options.host,
        options.port,
        options.io_map,
        options.machine,
        options.language,
        tuple(options.fault),
        options.planting_frequency,
        options.record,
        options.hmi_port,
        None if options.no_panel else options.panel_port,
        options.real_time,
        options.pace,
        options.by_hand,
        max_ms=max_ms_of(options),
        waits=options.wait,
    )
    with ProgressView() as view, live_trial(live, view) as trial:
        print(trial.panel, file=sys.stderr, flush=True)
        report = trial.run()
        # The trial is complete: from here on, Ctrl-C ends the program with the exit code of the report.
        with contextlib.suppress(KeyboardInterrupt):
            print(report.text(), flush=True)
            if options.keep:
                print("serving until Ctrl-C", file=sys.stderr, flush=True)
                trial.serve()
    return _exit_code(report) if trial.exit_code is None else trial.exit_code


def _fast(options: argparse.Namespace) -> int:
    io_map, machine, faults = load_io_map(options.io_map), machine_of(options), faults_of(options)
    with ProgressView() as view:
        report = run_trial(
            seed=options.seed,
            trays=options.trays,
            io_map=io_map,
            parameters=machine,
            faults=faults,
            record=options.record,
            rule=rule_of(options, options.trays),
            stop=options.stop,
            language=options.language or "en",
            prepare=show_progress(view, options.trays),
        )
    print(report.text(), flush=True)
    return INTERRUPTED if options.stop.is_set() else _exit_code(report)


def _exit_code(report: TrialReport) -> int:
    return 0 if report.completed and report.accounted else 1
