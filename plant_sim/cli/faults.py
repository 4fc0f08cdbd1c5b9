"""Command ``faults``: the tables of the fault matrix, with their cases distributed over processes."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from controller.common.output_streams import prepare_output_streams
from controller.common.stop_request import interrupts_blocked
from controller.common.supervision.threads import supervised
from plant_sim.cli.reproduce.origin import provenance_of
from plant_sim.cli.settings import machine_of
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.fault_matrix import air_report, report, rest_report
from plant_sim.fault_matrix.air_report import AirResult
from plant_sim.fault_matrix.cases import Subject, subjects
from plant_sim.fault_matrix.report import MatrixRow
from plant_sim.fault_matrix.rest_report import RestResult
from plant_sim.fault_matrix.rest_table import (
    RestSelection,
    jobs_at,
    jobs_of,
    periods,
    results_of,
    run_job,
    search,
    selection,
)
from plant_sim.fault_matrix.run import MatrixSetup, Outcome, run_case, undisturbed
from plant_sim.fault_matrix.situations import Spell
from plant_sim.fault_matrix.stored_air import REMEDIES, AirCase, AirOutcome, air_cases, run_air_case
from plant_sim.fault_matrix.yield_inputs import yield_report
from plant_sim.fault_matrix.yield_inputs.fitted import YIELD_INPUTS, YieldResult, fitted_with, rows_to_run, silent_rows
from plant_sim.faults import FaultError
from plant_sim.twin.lock_step import SCAN_MS

Task = TypeVar("Task")
Done = TypeVar("Done")


def run(options: argparse.Namespace) -> int:
    """Run the matrix, write the table and print a summary.

    Returns:
        0 if all results are as expected, or if other sizes are recorded without being judged, else 1.

    Raises:
        FaultError: An option is invalid.
        IoMapError: The I/O map is invalid.
        MachineError: The machine parameters are invalid.
    """
    provenance = provenance_of(options)
    machine_of(options)  # prints warnings about ratings
    _check(options)
    setting = MatrixSetup(options.seed, options.trays, options.io_map, options.machine)
    if options.stored_air:
        return _run_with_stored_air(options, setting, provenance)
    if options.yield_inputs:
        return _run_with_yield_inputs(options, setting, provenance)
    return (
        _run_at_rest(options, setting, provenance) if options.at_rest else _run_in_motion(options, setting, provenance)
    )


def _run_in_motion(options: argparse.Namespace, setting: MatrixSetup, provenance: Provenance) -> int:
    chosen = subjects(setting.twin().plant, options.fault, options.factors)
    if not chosen:
        raise FaultError("--times: no fault has another size within its range; specify other factors or faults")
    folder = _create_folder(options.out) if options.out is not None else None
    start_s = time.perf_counter()
    rows = run_matrix(chosen, setting, moments=options.moments, jobs=options.jobs)
    judged = not options.factors
    print((report.summary if judged else report.sizes_summary)(rows, time.perf_counter() - start_s))
    if folder is not None:
        for path in (report.write_report if judged else report.write_sizes_report)(rows, folder, provenance):
            print(path)
    return 1 if judged and any(row.findings for row in rows) else 0


def _run_at_rest(options: argparse.Namespace, setting: MatrixSetup, provenance: Provenance) -> int:
    chosen = selection(options.stops, options.fault)
    folder = _create_folder(options.out) if options.out is not None else None
    start_s = time.perf_counter()
    results = run_table(chosen, setting, every_ms=options.every, jobs=options.jobs)
    print(rest_report.summary(results, time.perf_counter() - start_s))
    if folder is not None:
        for path in rest_report.write_report(results, folder, provenance):
            print(path)
    return 1 if any(result.findings for result in results) else 0


def _run_with_stored_air(options: argparse.Namespace, setting: MatrixSetup, provenance: Provenance) -> int:
    folder = _create_folder(options.out) if options.out is not None else None
    start_s = time.perf_counter()
    results = run_stored_air(setting, moments=options.moments, jobs=options.jobs)
    print(air_report.summary(results, time.perf_counter() - start_s))
    if folder is not None:
        for path in air_report.write_report(results, folder, provenance):
            print(path)
    return 1 if air_report.all_findings(results) else 0


def _run_with_yield_inputs(options: argparse.Namespace, setting: MatrixSetup, provenance: Provenance) -> int:
    chosen, own = rows_to_run(setting, options.fault)
    folder = _create_folder(options.out) if options.out is not None else None
    start_s = time.perf_counter()
    result = run_with_yield_inputs(chosen, own, setting, moments=options.moments, jobs=options.jobs)
    print(yield_report.summary(result, time.perf_counter() - start_s))
    if folder is not None:
        for path in yield_report.write_report(result, folder, provenance):
            print(path)
    return 1 if result.findings else 0


def run_with_yield_inputs(
    chosen: Sequence[Subject], own: Sequence[Subject], setting: MatrixSetup, *, moments: int, jobs: int
) -> YieldResult:
    """Run rows without and with the yield inputs.

    Args:
        chosen: Rows to run without and with all of the inputs; those that are silent also with each kind alone.
        own: Rows of the inputs themselves.
        setting: Machine and trial, without the inputs.
        moments: Random moments per fault.
        jobs: Parallel processes; 1 = this process only.
    """
    run_rows = partial(run_matrix, moments=moments, jobs=jobs)
    without = run_rows(chosen, setting)
    fitted = fitted_with(setting, YIELD_INPUTS)
    silent = silent_rows(without)
    single = {name: run_rows(silent, fitted_with(setting, [name])) for name in YIELD_INPUTS}
    return YieldResult(without, run_rows(chosen, fitted), run_rows(own, fitted), single)


def run_stored_air(setting: MatrixSetup, *, moments: int, jobs: int) -> list[AirResult]:
    """Run the cases of the third table with every remedy.

    Args:
        setting: Machine and trial.
        moments: Moments per condition, arm and jammed device.
        jobs: Parallel processes; 1 = this process only.
    """
    tasks = [(remedy, case) for remedy in REMEDIES for case in air_cases(setting, remedy, moments=moments)]
    results: list[AirResult] = []
    with _progress(len(tasks)) as progress, _results(partial(_run_air, setting=setting), tasks, jobs) as outcomes:
        for (remedy, case), outcome in zip(tasks, outcomes, strict=True):
            results.append(AirResult(remedy, outcome))
            progress.update(progress.task_ids[0], advance=1, description=f"{remedy}: {case.condition}")
    return results


def _run_air(task: tuple[str, AirCase], setting: MatrixSetup) -> AirOutcome:
    remedy, case = task
    return run_air_case(case, setting, remedy)


def run_table(chosen: RestSelection, setting: MatrixSetup, *, every_ms: int | None, jobs: int) -> list[RestResult]:
    """Run the cases of the second table.

    Args:
        chosen: Kinds of stop, and faults.
        setting: Machine and trial.
        every_ms: Distance of the moments of the stop, ms; None = once in every rest situation.
        jobs: Parallel processes; 1 = this process only.

    Returns:
        The results in the order of the moments, each stop without a fault first.
    """
    trial = undisturbed(setting)
    if every_ms is not None:
        tasks = jobs_at(range(trial.begins_ms, trial.ends_ms, every_ms), chosen)
    else:
        stretches = periods(setting)
        spells: list[Spell] = []
        look = partial(search, setting=setting, stops=chosen.stops)
        with _progress(len(stretches)) as progress, _results(look, stretches, jobs) as found:
            for some in found:
                spells += some
                progress.update(progress.task_ids[0], advance=1, description="rest situations")
        tasks = jobs_of(spells, chosen)
    results: list[RestResult] = []
    with _progress(len(tasks)) as progress, _results(partial(run_job, setting=setting), tasks, jobs) as outcomes:
        for task, of_task in zip(tasks, outcomes, strict=True):
            results += results_of(task, of_task)
            progress.update(progress.task_ids[0], advance=1, description=task.stop)
    return results


def run_matrix(chosen: Sequence[Subject], setting: MatrixSetup, *, moments: int, jobs: int) -> list[MatrixRow]:
    """Run all cases of the chosen subjects.

    Args:
        chosen: The subjects.
        setting: Machine and trial.
        moments: Random moments per fault.
        jobs: Parallel processes; 1 = this process only.

    Returns:
        One row per subject, in the same order.
    """
    if not chosen:
        return []
    reference = undisturbed(setting)
    cases = [
        (subject, fault)
        for subject in chosen
        for fault in subject.faults(moments, seed=setting.seed, from_ms=reference.begins_ms, to_ms=reference.ends_ms)
    ]
    run_one = partial(run_case, setting=setting)
    outcomes: dict[Subject, list[Outcome]] = {subject: [] for subject in chosen}
    with _progress(len(cases)) as progress, _results(run_one, [fault for _, fault in cases], jobs) as results:
        for (subject, _), outcome in zip(cases, results, strict=True):
            outcomes[subject].append(outcome)
            progress.update(progress.task_ids[0], advance=1, description=str(subject))
    return [MatrixRow(subject, results_of_subject) for subject, results_of_subject in outcomes.items()]


def _progress(cases: int) -> Progress:
    columns = (MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    progress = Progress(*columns, console=Console(stderr=True))
    progress.add_task("", total=cases)
    return progress


@contextmanager
def _results(run_one: Callable[[Task], Done], tasks: Sequence[Task], jobs: int) -> Iterator[Iterator[Done]]:
    """Yield the results of the tasks; leaving the context early cancels the tasks that have not started."""
    if jobs == 1:
        yield map(run_one, tasks)
        return
    pool = ProcessPoolExecutor(jobs, initializer=_prepare_worker)
    try:
        with interrupts_blocked():
            outcomes = pool.map(run_one, tasks)
        yield outcomes
    finally:
        pool.shutdown(cancel_futures=True)


def _prepare_worker() -> None:
    """Prepare the output of a worker, leave Ctrl-C to its parent, and end after a parent that was killed."""
    prepare_output_streams()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    supervised("parent of a worker", _end_after_parent).start()


def _end_after_parent() -> None:
    """End this worker after its parent; otherwise it would wait for its next task for ever."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os._exit(1)


def _check(options: argparse.Namespace) -> None:
    """Raise `FaultError` if an option is invalid."""
    if options.stored_air and (options.all or options.fault or options.at_rest):
        raise FaultError("--stored-air: has cases of its own; omit --all, --fault and --at-rest")
    if not options.stored_air and options.all == bool(options.fault):
        raise FaultError("faults: specify either --all or --fault KIND[:TARGET], for example --fault jammed:left.slide")
    if options.yield_inputs and (options.stored_air or options.at_rest or options.factors):
        raise FaultError("--yield-inputs: compares faults in motion; omit --at-rest, --stored-air and --times")
    if options.factors and (options.stored_air or options.at_rest):
        raise FaultError("--times: applies to faults in motion; omit --at-rest and --stored-air")
    if not options.at_rest and (options.stops or options.every is not None):
        raise FaultError("--stop and --every: apply only with --at-rest")
    if options.every is not None and options.every % SCAN_MS:
        raise FaultError(f"--every {options.every}: must be a multiple of {SCAN_MS} ms")


def _create_folder(folder: Path) -> Path:
    """Create the output folder, so that an invalid one is reported before the run."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FaultError(f"--out {folder}: {error.strerror}; specify another folder") from error
    if not os.access(folder, os.W_OK):
        raise FaultError(f"--out {folder}: not writable; specify another folder")
    return folder
