"""Command ``prove``: prove the machine's program, print a report as text or JSON, and write traces."""

from __future__ import annotations

import argparse
import errno
import os
import re
import sys
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Final, Literal

from controller.cli.machine import machine_of, read_constants
from controller.cli.mutants import run_mutants
from controller.common.errors import InputError
from controller.core.clock import MonotonicClock
from controller.core.specification import Specification
from controller.program.requirements.proof import specification as specification_of
from controller.verify.cells import ModelError
from controller.verify.report import Report, prove

PROGRESS_S: Final = 5.0
"""Time between two lines about parts of one kind, s."""


def run(options: argparse.Namespace) -> int:
    """Print the report; return 0 if all goals are proved, or every surviving mutant is classified, otherwise 1."""
    clock = MonotonicClock()
    if options.mutants is not None:
        return run_mutants(options, lambda: clock.now_ms() / 1000)
    machine = machine_of(options, without=options.without)
    data = read_constants(machine.tags.sp, options.constants)
    try:
        text, good = prove_command(
            specification_of(machine, data),
            clock=lambda: clock.now_ms() / 1000,
            goals=options.goal,
            short=options.short,
            form="json" if options.json else "verbose" if options.verbose else "summary",
            report_file=options.report,
            traces=options.traces,
        )
    except ModelError as error:
        raise InputError(f"--goal: {error}") from error
    except OSError as error:
        option = "--report" if str(error.filename) == str(options.report) else "--traces"
        raise InputError(f"{option} {error.filename}: {error.strerror}; choose a writable folder") from error
    print(text)
    return 0 if good else 1


def prove_command(
    specification: Specification,
    *,
    clock: Callable[[], float],
    goals: Collection[str] | None,
    short: bool = False,
    form: Literal["summary", "verbose", "json"] = "summary",
    report_file: Path | None = None,
    traces: Path | None = None,
) -> tuple[str, bool]:
    """Prove a specification.

    Args:
        specification: Requirements, invariants and program.
        clock: Monotonic time, s.
        goals: Names of the goals to prove; None = all.
        short: True to omit traces, steps and ways out.
        form: Form of the returned text: the summary, every goal with its details, or JSON.
        report_file: File for the text with every goal and its details.
        traces: Folder for the traces of violated goals.

    Returns:
        The text to print, and True if all goals are proved.

    Raises:
        ModelError: A goal is unknown.
        OSError: The file or the folder is not writable; raised before the proof.
    """
    if traces is not None:
        traces.mkdir(parents=True, exist_ok=True)
    if report_file is not None:
        _check_place(report_file)
    report = prove(specification, clock=clock, only=goals, short=short, tell=_Progress(clock))
    if traces is not None:
        _write_traces(report, traces)
    if report_file is not None:
        report_file.write_text(report.text() + "\n", encoding="utf-8")
    forms = {"summary": report.summary, "verbose": report.text, "json": report.to_json}
    return forms[form](), report.good


def _check_place(file: Path) -> None:
    """Raise `OSError` if a file cannot be written, without writing it."""
    place = file if file.exists() else file.parent
    number = errno.EISDIR if file.is_dir() else errno.ENOENT if not file.parent.is_dir() else errno.EACCES
    if number != errno.EACCES or not os.access(place, os.W_OK):
        raise OSError(number, os.strerror(number), str(file))


class _Progress:
    """Prints the part of the proof that begins and the elapsed time, on standard error.

    Parts of one kind that follow each other quickly share a line.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._began_s = clock()
        self._kind = ""
        self._due_s = 0.0

    def __call__(self, part: str) -> None:
        elapsed_s = self._clock() - self._began_s
        kind = part.partition(" ")[0]
        if kind != self._kind or elapsed_s >= self._due_s:
            self._kind, self._due_s = kind, elapsed_s + PROGRESS_S
            print(f"{elapsed_s:.0f} s: {part}", file=sys.stderr, flush=True)


def _write_traces(report: Report, folder: Path) -> None:
    for row in report.rows:
        if row.trace is not None:
            name = re.sub(r"\W+", "-", row.name).strip("-")
            (folder / f"{name}.json").write_text(row.trace.to_json() + "\n", encoding="utf-8")
