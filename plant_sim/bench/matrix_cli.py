"""``python -m plant_sim faults``: the fault matrix, its cases spread over processes."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from plant_sim.bench.matrix import Subject, subjects
from plant_sim.bench.matrix_report import Row, summary, write_report
from plant_sim.bench.matrix_run import Outcome, Setting, run_case, undisturbed
from plant_sim.faults import Fault, FaultError

MOMENTS = 10


def add_matrix_arguments(parser: argparse.ArgumentParser) -> None:
    """Give the command `faults` its options, beside wires, machine, seed and trays."""
    parser.add_argument("--all", action="store_true", help="every fault of the machine")
    parser.add_argument("--fault", action="append", default=[], metavar="KIND[:TARGET]",
                        help="only this fault; may be given several times")  # fmt: skip
    parser.add_argument("--moments", type=int, default=MOMENTS, help="at so many random moments each")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes side by side")
    parser.add_argument("--out", type=Path, default=None, metavar="DIR", help="folder for the table, CSV and JSON")


def matrix_command(options: argparse.Namespace) -> int:
    """Run the matrix, write the table, print a summary.

    Returns:
        0 if everything is as expected, else 1.

    Raises:
        FaultError: an option cannot be used.
        IoMapError: the wires cannot.
        MachineError: the machine cannot.
    """
    _check(options)
    setting = Setting(options.seed, options.trays, options.io_map, options.machine)
    chosen = subjects(setting.twin().plant, options.fault)
    folder = _made(options.out) if options.out is not None else None
    began_s = time.perf_counter()
    rows = run_matrix(chosen, setting, moments=options.moments, jobs=options.jobs)
    sys.stdout.write(f"{summary(rows, time.perf_counter() - began_s)}\n")
    if folder is not None:
        for path in write_report(rows, folder):
            sys.stdout.write(f"{path}\n")
    return 1 if any(row.findings for row in rows) else 0


def run_matrix(chosen: Sequence[Subject], setting: Setting, *, moments: int, jobs: int) -> list[Row]:
    """Run every case of some subjects.

    Args:
        chosen: The subjects.
        setting: Machine and trial.
        moments: How often each strikes.
        jobs: Processes side by side; 1 is this one.

    Returns:
        One row a subject, in the same order.
    """
    sound = undisturbed(setting)
    cases = [
        (subject, fault)
        for subject in chosen
        for fault in subject.faults(moments, seed=setting.seed, from_ms=sound.begins_ms, to_ms=sound.ends_ms)
    ]
    outcomes: dict[Subject, list[Outcome]] = {subject: [] for subject in chosen}
    with _progress(len(cases)) as progress, _results([fault for _, fault in cases], setting, jobs) as results:
        for (subject, _), outcome in zip(cases, results, strict=True):
            outcomes[subject].append(outcome)
            progress.update(progress.task_ids[0], advance=1, description=str(subject))
    return [Row(subject, found) for subject, found in outcomes.items()]


def _progress(cases: int) -> Progress:
    columns = (MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    progress = Progress(*columns, console=Console(stderr=True))
    progress.add_task("", total=cases)
    return progress


@contextmanager
def _results(faults: Sequence[Fault], setting: Setting, jobs: int) -> Iterator[Iterator[Outcome]]:
    """Run cases in some processes; leaving early gives up those that have not begun."""
    run = partial(run_case, setting=setting)
    if jobs == 1:
        yield map(run, faults)
        return
    pool = ProcessPoolExecutor(jobs, initializer=_leave_interrupts_to_the_parent)
    try:
        yield pool.map(run, faults)
    finally:
        pool.shutdown(cancel_futures=True)


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _check(options: argparse.Namespace) -> None:
    """Refuse what cannot be run.

    Raises:
        FaultError: with what to give instead.
    """
    if options.all == bool(options.fault):
        raise FaultError("faults: give either --all, or --fault KIND[:TARGET] as --fault jammed:left.slide")
    for name in ("moments", "jobs"):
        if not 1 <= getattr(options, name) <= 1000:
            raise FaultError(f"--{name} {getattr(options, name)}: give 1 to 1000")


def _made(folder: Path) -> Path:
    """Make a folder that can be written to, before anything is run."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FaultError(f"--out {folder}: {error.strerror}; name another folder") from error
    if not os.access(folder, os.W_OK):
        raise FaultError(f"--out {folder}: cannot be written to; name another folder")
    return folder
