"""Command ``run``: the paper's trial with plant, controller and panel as separate processes, or in simulated time."""

from __future__ import annotations

import argparse
import contextlib
import sys

from controller.common.errors import InputError
from controller.common.stop_request import INTERRUPTED
from controller.iomap.loader import load_io_map
from plant_sim.cli.reproduce.origin import provenance_of
from plant_sim.cli.reproduce.result_folder import result_folder
from plant_sim.cli.settings import changed_machine, faults_of, machine_of, max_ms_of, rule_of, with_changes
from plant_sim.common.provenance.result_files import ResultFiles
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.ending import rule
from plant_sim.twin.live import LiveOptions, live_trial
from plant_sim.twin.process import ChildError, LiveError
from plant_sim.twin.progress import ProgressView
from plant_sim.twin.repeats import Repeats
from plant_sim.twin.report import TrialReport, make_report
from plant_sim.twin.trial import run_trial, show_progress


def run(options: argparse.Namespace) -> int:
    """Run the trial and print the report.

    Returns:
        0 if the trial completed and every seedling is accounted for, and after Ctrl-C in a run by hand; 130 after
        another Ctrl-C or SIGTERM, with the report of the trial so far; the exit code of a failed process; else 1.

    Raises:
        InputError: An option or a file is invalid.
    """
    if options.fast and options.keep:
        raise InputError("--keep: cannot be combined with --fast, which serves nothing; omit one of them")
    if options.fast:
        return _fast(options)
    _plant(options)  # invalid files and faults are reported before any process is started
    try:
        return _live(options)
    except KeyboardInterrupt:  # before the trial: plant and controller have been stopped
        print(_not_begun(options).text(), flush=True)
        return 0 if options.by_hand else INTERRUPTED  # a user who operates the machine has ended no trial
    except BrokenPipeError:  # also a ConnectionError, but caused by closed standard output
        raise
    except (LiveError, ConnectionError) as error:
        print(error, file=sys.stderr)
        return 1
    except ChildError as error:  # the process has printed the reason
        return error.exit_code or 1


def _plant(options: argparse.Namespace) -> Plant:
    """Return the plant as it is before the trial.

    Raises:
        InputError: A file or a fault is invalid.
    """
    return Plant(
        load_io_map(options.io_map),
        load_machine(options.machine),
        seed=options.seed,
        trays=options.trays,
        faults=faults_of(options),
    )


def _not_begun(options: argparse.Namespace) -> TrialReport:
    """Return the report of a trial that was interrupted during the start of plant and controller."""
    counts = _plant(options).counts()
    return make_report(
        seed=options.seed, counts=counts, events=[], reason=rule.INTERRUPTED, simulated_s=0.0, wall_s=0.0
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
    provenance = provenance_of(options)
    with ProgressView() as view, live_trial(live, view, options.stop) as trial:
        print(trial.panel, file=sys.stderr, flush=True)
        with result_folder(options, provenance) as files:
            report = trial.run()
            _write(options, files, report)
        # The trial is complete: from here on, Ctrl-C ends the program with the exit code of the report.
        with contextlib.suppress(KeyboardInterrupt):
            print("\n".join([*changed_machine(options), report.text()]), flush=True)
            if options.keep:
                print("serving until Ctrl-C", file=sys.stderr, flush=True)
                trial.serve()
    return _exit_code(report) if trial.exit_code is None else trial.exit_code


def _fast(options: argparse.Namespace) -> int:
    io_map, machine, faults = load_io_map(options.io_map), machine_of(options), faults_of(options)
    provenance = provenance_of(options)
    with ProgressView() as view, result_folder(options, provenance) as files:
        report = run_trial(
            seed=options.seed,
            trays=options.trays,
            io_map=io_map,
            parameters=machine,
            faults=faults,
            record=options.record,
            provenance=provenance,
            rule=rule_of(options, options.trays),
            stop=options.stop,
            prepare=show_progress(view, options.trays, options.language or "en"),
        )
        _write(options, files, report)
    print("\n".join([*changed_machine(options), report.text()]), flush=True)
    return INTERRUPTED if options.stop.is_set() else _exit_code(report)


def _write(options: argparse.Namespace, files: ResultFiles | None, report: TrialReport) -> None:
    if files is not None:
        trials = Repeats([report])
        files.json("trial.json", with_changes(options, trials.untimed_record()))
        files.csv("trials.csv", *trials.table())


def _exit_code(report: TrialReport) -> int:
    return 0 if report.completed and report.accounted else 1
