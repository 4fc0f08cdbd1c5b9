"""Command ``trial``: the paper's trial in lock step, run once or several times, optionally with a ladder program."""

from __future__ import annotations

import argparse

from controller.cli.fx_options import cpu_of, peripherals_of
from controller.common.errors import InputError
from controller.common.stop_request import INTERRUPTED
from controller.iomap.loader import load_io_map
from plant_sim.cli.reproduce.origin import print_json, provenance_of
from plant_sim.cli.reproduce.result_folder import result_folder
from plant_sim.cli.settings import (
    changed_machine,
    check_program,
    faults_of,
    machine_of,
    rule_of,
    start_values_of,
    with_changes,
)
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.crop.seedling import TRAY_CELLS
from plant_sim.twin.ladder.scan_timing import ScanTiming
from plant_sim.twin.ladder.trial import LadderReport, ScanRow, load_ladder, run_ladder_trial, table
from plant_sim.twin.repeats import Repeats
from plant_sim.twin.report import TrialReport
from plant_sim.twin.trial import run_trial


def run(options: argparse.Namespace) -> int:
    """Run the trials and print the report.

    Returns:
        0 if all trials completed and every seedling is accounted for; 130 after Ctrl-C or SIGTERM, with the report of
        the trials so far; else 1.

    Raises:
        InputError: An option or a file is invalid.
    """
    _check(options)
    check_program(options)
    if options.ladder is not None:
        return _ladder_trial(options)
    provenance = provenance_of(options)
    with result_folder(options, provenance) as files:
        reports = _trials(options, provenance)
        repeats = Repeats(reports)
        if files is not None:
            files.json("trial.json", with_changes(options, repeats.untimed_record()))
            files.csv("trials.csv", *repeats.table())
    if options.csv:
        print(repeats.csv(provenance), end="")
    else:
        shown = repeats if options.repeat > 1 else reports[0]
        if options.json:
            print_json(with_changes(options, shown.record()), provenance)
        else:
            print("\n".join([*changed_machine(options), shown.text()]))
    return _exit_code(options, succeeded=repeats.completed and repeats.accounted)


def _exit_code(options: argparse.Namespace, *, succeeded: bool) -> int:
    if options.stop.is_set():
        return INTERRUPTED
    return 0 if succeeded else 1


def _check(options: argparse.Namespace) -> None:
    if options.repeat > 1 and options.record is not None:
        raise InputError("--record: a recording contains one trial; omit --repeat")


def _trials(options: argparse.Namespace, provenance: Provenance) -> list[TrialReport]:
    """Run the trials with consecutive seeds."""
    io_map, machine, faults = load_io_map(options.io_map), machine_of(options), faults_of(options)
    values = start_values_of(options)
    trays = options.trays if options.seedlings is None else -(-options.seedlings // TRAY_CELLS)
    reports: list[TrialReport] = []
    for seed in range(options.seed, options.seed + options.repeat):
        report = run_trial(
            seed=seed,
            trays=trays,
            seedlings=options.seedlings,
            io_map=io_map,
            parameters=machine,
            set_points=values,
            faults=faults,
            record=options.record,
            provenance=provenance,
            rule=rule_of(options, trays),
            stop=options.stop,
        )
        reports.append(report)
        if options.stop.is_set():
            break
    return reports


def _ladder_trial(options: argparse.Namespace) -> int:
    _check_ladder(options)
    provenance = provenance_of(options)
    with result_folder(options, provenance) as files:
        reports = _ladder_reports(options)
        if files is not None:
            trials = [each.record() for _, of_timing in reports for each in of_timing]
            files.json("trial.json", with_changes(options, {"trials": trials}))
    if options.scan_ms is None or len(reports) == options.repeat == 1:
        ((_, (report,)),) = reports
        if options.json:
            print_json(with_changes(options, report.record()), provenance)
        else:
            print("\n".join([*changed_machine(options), report.text()]))
        return _exit_code(options, succeeded=report.completed)
    rows = [ScanRow(timing, each) for timing, each in reports if timing is not None]
    if options.json:
        print_json(with_changes(options, {"scans": [row.record() for row in rows]}), provenance)
    else:
        print("\n".join([*changed_machine(options), table(rows)]), end="")
    return _exit_code(options, succeeded=all(report.completed for row in rows for report in row.reports))


def _check_ladder(options: argparse.Namespace) -> None:
    if options.record is not None:
        raise InputError("--ladder: recordings are not supported; omit --record")
    if options.csv or options.seedlings is not None or (options.repeat > 1 and options.scan_ms is None):
        raise InputError("--ladder: runs full trays once; omit --csv, --seedlings and --repeat, or add --scan-ms")
    if options.scan_ms is None:
        if options.jitter_ms or options.long_scan_ms:
            raise InputError("--jitter-ms and --long-scan-ms: change the scan time; add --scan-ms")
        return
    for scan_ms in options.scan_ms:
        if options.jitter_ms >= scan_ms:
            raise InputError(
                f"--scan-ms {scan_ms} --jitter-ms {options.jitter_ms}: the scan time must be more than the jitter"
            )


def _ladder_reports(options: argparse.Namespace) -> list[tuple[ScanTiming | None, list[LadderReport]]]:
    """Run the ladder program with each scan timing and each seed."""
    ladder = load_ladder(options.ladder, cpu_of(options))
    io_map, machine, faults = load_io_map(options.io_map), machine_of(options), faults_of(options)
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
            faults=faults,
            rule=rule_of(options, options.trays),
            stop=options.stop,
        )

    seeds = range(options.seed, options.seed + options.repeat)
    reports: list[tuple[ScanTiming | None, list[LadderReport]]] = []
    for timing in timings or [None]:
        reports.append((timing, []))
        for seed in seeds:
            reports[-1][1].append(report(timing, seed))
            if options.stop.is_set():
                return reports
    return reports
