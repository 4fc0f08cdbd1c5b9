"""Command ``run``: the paper's trial with plant, controller and panel as separate processes, or in simulated time."""

from __future__ import annotations

import argparse
import contextlib
import sys

from controller.common.errors import InputError
from controller.iomap.loader import load_io_map
from plant_sim.cli.options import (
    add_fault_arguments,
    add_machine_arguments,
    add_network_arguments,
    add_record_argument,
    check_machine_arguments,
    check_port,
    faults_of,
    machine_of,
)
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.live import LiveOptions, live_trial
from plant_sim.twin.process import ChildError, LiveError
from plant_sim.twin.progress import ProgressView
from plant_sim.twin.report import TrialReport
from plant_sim.twin.trial import run_trial, show_progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``run``."""
    add_machine_arguments(parser)
    add_network_arguments(parser)
    parser.add_argument("--fast", action="store_true", help="run in lock step in simulated time, without Modbus")
    parser.add_argument(
        "--real-time",
        action="store_true",
        help="follow the wall clock, like a real machine; the run cannot be paused or sped up",
    )
    parser.add_argument(
        "--pace",
        type=int,
        default=100,
        metavar="PERCENT",
        help="initial speed of simulated time; a panel can change it (65535 = as fast as possible)",
    )
    parser.add_argument(
        "--by-hand", action="store_true", help="do not press buttons automatically; start and stop at the panel"
    )
    parser.add_argument("--hmi-port", type=int, default=5021, help="port for operator panels; 0 = any free port")
    parser.add_argument("--panel-port", type=int, default=8080, help="port of the web panel; 0 = any free port")
    parser.add_argument("--no-panel", action="store_true", help="do not start the web panel")
    parser.add_argument("--keep", action="store_true", help="continue to serve after the report, until Ctrl-C")
    parser.add_argument(
        "--language",
        choices=("en", "zh"),
        default=None,
        help="language of the controller's texts and of the panel's page (default: en, and on the page that of the "
        "browser)",
    )
    add_fault_arguments(parser)
    add_record_argument(parser)


def run(options: argparse.Namespace) -> int:
    """Run the trial and print the report.

    Returns:
        0 if the trial completed and every seedling is accounted for, and after Ctrl-C in a run by hand; the exit code
        of a failed process; else 1.

    Raises:
        InputError: An option or a file is invalid.
    """
    check_machine_arguments(options)
    check_port(options)
    _check_plant(options)
    if options.fast and options.keep:
        raise InputError("--keep: cannot be combined with --fast, which serves nothing; omit one of them")
    if options.fast:
        return _fast(options)
    if options.port == 0:
        raise InputError("--port 0: the controller must know the port; specify one")
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
        options.record,
        options.hmi_port,
        None if options.no_panel else options.panel_port,
        options.real_time,
        options.pace,
        options.by_hand,
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
    return _exit_code(report)


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
            prepare=show_progress(view, options.trays, options.language or "en"),
        )
    print(report.text())
    return _exit_code(report)


def _exit_code(report: TrialReport) -> int:
    return 0 if report.completed and report.accounted else 1
