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
from plant_sim.twin.ladder.scan_timing import ScanTiming
from plant_sim.twin.ladder.trial import LadderReport, ScanRow, load_ladder, run_ladder_trial, table
from plant_sim.twin.repeats import Repeats
from plant_sim.twin.report import TrialReport
from plant_sim.twin.trial import run_trial

MOST_SEEDLINGS = 72_000
MOST_TRIALS = 10_000
LONGEST_SCAN_MS = 200
"""Longest scan of an FX2N, ms: its watchdog (docs/sources/fx2n.md 1.4)."""


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
    parser.add_argument(
        "--scan-ms",
        type=int,
        nargs="+",
        default=None,
        metavar="MS",
        help="with --ladder: time between two scans, ms; the input filter samples the terminals between them. Several "
        "times, or --repeat, print a table",
    )
    parser.add_argument("--jitter-ms", type=int, default=0, metavar="MS", help="with --scan-ms: largest deviation, ms")
    parser.add_argument(
        "--long-scan-ms", type=int, default=0, metavar="MS", help="with --scan-ms: one scan in 1000 takes this time, ms"
    )
    parser.add_argument(
        "--scan-estimate", action="store_true", help="with --ladder: estimate the scan time of a real FX2N"
    )
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
    _check_ladder(options)
    reports = _ladder_reports(options)
    if options.scan_ms is None or len(reports) == options.repeat == 1:
        ((_, (report,)),) = reports
        print(json.dumps(report.record()) if options.json else report.text())
        return 0 if report.completed else 1
    rows = [ScanRow(timing, each) for timing, each in reports if timing is not None]
    print(json.dumps([row.record() for row in rows]) if options.json else "\n".join(table(rows)))
    return 0 if all(report.completed for row in rows for report in row.reports) else 1


def _check_ladder(options: argparse.Namespace) -> None:
    if options.fault or options.record is not None:
        raise InputError("--ladder: faults and recordings are not supported; omit --fault and --record")
    if options.csv or options.seedlings is not None or (options.repeat > 1 and options.scan_ms is None):
        raise InputError("--ladder: runs full trays once; omit --csv, --seedlings and --repeat, or add --scan-ms")
    if options.scan_ms is None:
        if options.jitter_ms or options.long_scan_ms:
            raise InputError("--jitter-ms and --long-scan-ms: change the scan time; add --scan-ms")
        return
    for scan_ms in options.scan_ms:
        if not 0 <= options.jitter_ms < scan_ms <= LONGEST_SCAN_MS:
            raise InputError(
                f"--scan-ms {scan_ms} --jitter-ms {options.jitter_ms}: the scan time must be 1 to {LONGEST_SCAN_MS} ms "
                "and more than the jitter, and the jitter 0 or more"
            )
    if not 0 <= options.long_scan_ms <= LONGEST_SCAN_MS:
        raise InputError(f"--long-scan-ms {options.long_scan_ms}: must be 0 to {LONGEST_SCAN_MS}")


def _ladder_reports(options: argparse.Namespace) -> list[tuple[ScanTiming | None, list[LadderReport]]]:
    """Run the ladder program with each scan timing and each seed."""
    ladder = load_ladder(options.ladder, cpu_of(options))
    io_map, machine = load_io_map(options.io_map), machine_of(options)
    timings: list[ScanTiming | None] = [
        ScanTiming(scan_ms, options.jitter_ms, options.long_scan_ms) for scan_ms in options.scan_ms or ()
    ]

    def report(timing: ScanTiming | None, seed: int) -> LadderReport:
        return run_ladder_trial(
            ladder,
            seed=seed,
            trays=options.trays,
            io_map=io_map,
            parameters=machine,
            timing=timing,
            estimates=options.scan_estimate,
            peripherals=peripherals_of(options),
        )

    seeds = range(options.seed, options.seed + options.repeat)
    return [(timing, [report(timing, seed) for seed in seeds]) for timing in timings or [None]]
