"""Command ``trial``: the paper's trial in lock step, run once or several times, optionally with a ladder program."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from controller.cli.fx_options import PROGRAM_FILE, add_cpu, add_modules, cpu_of, peripherals_of
from controller.common.errors import InputError
from controller.fx.language.cpu_model import FX2N
from controller.iomap.loader import load_io_map
from plant_sim.cli.options import (
    add_air_argument,
    add_fault_arguments,
    add_machine_arguments,
    add_record_argument,
    check_machine_arguments,
    faults_of,
    machine_of,
)
from plant_sim.twin.ladder_trial import load_ladder, run_ladder_trial
from plant_sim.twin.repeats import Repeats
from plant_sim.twin.report import TrialReport
from plant_sim.twin.trial import run_trial

MOST_SEEDLINGS = 72_000
MOST_TRIALS = 10_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trial``."""
    add_machine_arguments(parser)
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print one JSON object")
    output.add_argument("--csv", action="store_true", help="print a header and one line per trial")
    parser.add_argument(
        "--seedlings",
        type=int,
        default=None,
        metavar="N",
        help="number of seedlings, in as many trays as required; --trays is ignored",
    )
    parser.add_argument(
        "--repeat", type=int, default=1, metavar="K", help="number of trials, with consecutive seeds from --seed"
    )
    parser.add_argument(
        "--ladder",
        type=Path,
        default=None,
        metavar="FILE",
        help=f"{PROGRAM_FILE}, that replaces the controller",
    )
    add_cpu(parser)
    add_modules(parser)
    add_air_argument(parser)
    add_fault_arguments(parser)
    add_record_argument(parser)


def run(options: argparse.Namespace) -> int:
    """Run the trials and print the report.

    Returns:
        0 if all trials completed and every seedling is accounted for, else 1.

    Raises:
        InputError: An option or a file is invalid.
    """
    _check(options)
    if options.ladder is not None:
        return _ladder_trial(options)
    if options.modules is not None or options.cpu != FX2N.key:
        raise InputError("--cpu and --modules: belong to an FX program; specify it with --ladder")
    reports = _trials(options)
    repeats = Repeats(reports)
    if options.csv:
        print(repeats.csv(), end="")
    else:
        shown = repeats if options.repeat > 1 else reports[0]
        print(json.dumps(shown.record()) if options.json else shown.text())
    return 0 if repeats.completed and repeats.accounted else 1


def _check(options: argparse.Namespace) -> None:
    check_machine_arguments(options)
    if options.seedlings is not None and not 1 <= options.seedlings <= MOST_SEEDLINGS:
        raise InputError(f"--seedlings {options.seedlings}: must be 1 to {MOST_SEEDLINGS}")
    if not 1 <= options.repeat <= MOST_TRIALS:
        raise InputError(f"--repeat {options.repeat}: must be 1 to {MOST_TRIALS}")
    if options.repeat > 1 and options.record is not None:
        raise InputError("--record: a recording contains one trial; omit --repeat")


def _trials(options: argparse.Namespace) -> list[TrialReport]:
    """Run the trials with consecutive seeds."""
    io_map, machine, faults = load_io_map(options.io_map), machine_of(options), faults_of(options)
    return [
        run_trial(
            seed=seed,
            trays=options.trays,
            seedlings=options.seedlings,
            io_map=io_map,
            parameters=machine,
            faults=faults,
            record=options.record,
        )
        for seed in range(options.seed, options.seed + options.repeat)
    ]


def _ladder_trial(options: argparse.Namespace) -> int:
    if options.fault or options.record is not None:
        raise InputError("--ladder: faults and recordings are not supported; omit --fault and --record")
    if options.csv or options.seedlings is not None or options.repeat > 1:
        raise InputError("--ladder: runs full trays once; omit --csv, --seedlings and --repeat")
    report = run_ladder_trial(
        load_ladder(options.ladder, cpu_of(options)),
        seed=options.seed,
        trays=options.trays,
        io_map=load_io_map(options.io_map),
        parameters=machine_of(options),
        peripherals=peripherals_of(options),
    )
    print(json.dumps(report.record()) if options.json else report.text())
    return 0 if report.completed else 1
