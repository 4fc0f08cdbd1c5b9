"""Command ``prove``: prove the machine's program, print a report as text or JSON, and write traces."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Collection
from pathlib import Path

from controller.cli.machine import add_io_map, machine_of
from controller.cli.mutants import add_mutant_arguments, run_mutants
from controller.common.errors import InputError
from controller.core.clock import MonotonicClock
from controller.core.specification import Specification
from controller.program.requirements.proof import specification as specification_of
from controller.verify.cells import ModelError
from controller.verify.report import Report, prove


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``prove``."""
    add_io_map(parser)
    parser.add_argument(
        "--goal", action="append", default=None, metavar="NAME", help="prove only this goal; may be repeated"
    )
    parser.add_argument("--short", action="store_true", help="omit traces, steps and ways out")
    parser.add_argument(
        "--without",
        action="append",
        default=[],
        metavar="RULE",
        help="omit an interlock rule to show what it prevents, e.g. 'left: down at feed only'; may be repeated",
    )
    parser.add_argument("--json", action="store_true", help="print the report as JSON, including traces")
    parser.add_argument("--traces", type=Path, default=None, help="folder for the traces of violated requirements")
    add_mutant_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Print the report; return 0 if all goals are proved, or every surviving mutant is classified, otherwise 1."""
    clock = MonotonicClock()
    if options.mutants is not None:
        return run_mutants(options, lambda: clock.now_ms() / 1000)
    try:
        text, good = prove_command(
            specification_of(machine_of(options, without=options.without)),
            clock=lambda: clock.now_ms() / 1000,
            goals=options.goal,
            short=options.short,
            as_json=options.json,
            traces=options.traces,
        )
    except ModelError as error:
        raise InputError(f"--goal: {error}") from error
    except OSError as error:
        raise InputError(f"--traces {options.traces}: {error.strerror}; choose a writable folder") from error
    print(text)
    return 0 if good else 1


def prove_command(
    specification: Specification,
    *,
    clock: Callable[[], float],
    goals: Collection[str] | None,
    short: bool,
    as_json: bool,
    traces: Path | None,
) -> tuple[str, bool]:
    """Prove a specification.

    Args:
        specification: Requirements, invariants and program.
        clock: Monotonic time, s.
        goals: Names of the goals to prove; None = all.
        short: True to omit traces, steps and ways out.
        as_json: True to report as JSON.
        traces: Folder for the traces of violated goals.

    Returns:
        The text to print, and True if all goals are proved.

    Raises:
        ModelError: A goal is unknown.
        OSError: The folder is not writable.
    """
    if traces is not None:
        traces.mkdir(parents=True, exist_ok=True)  # an invalid folder is reported before the proof, not after it
    report = prove(specification, clock=clock, only=goals, short=short)
    if traces is not None:
        _write_traces(report, traces)
    return report.to_json() if as_json else report.text(), report.good


def _write_traces(report: Report, folder: Path) -> None:
    for row in report.rows:
        if row.trace is not None:
            name = re.sub(r"\W+", "-", row.name).strip("-")
            (folder / f"{name}.json").write_text(row.trace.to_json() + "\n", encoding="utf-8")
