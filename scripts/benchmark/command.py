"""Command behind ``scripts/bench``: measure the speeds that the documentation states."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from controller.common.arguments.number_type import integer
from controller.common.command_line import HelpFormatter, Parser, run_command, version
from controller.common.errors import InputError
from controller.common.stop_request import StopRequest
from scripts.benchmark import catalogue
from scripts.benchmark.host import commit, host_record
from scripts.benchmark.results.record import BenchmarkRecord, PartRecord, read_record
from scripts.benchmark.results.text import failure_text, part_text, run_text
from scripts.benchmark.runner import MOST_REPETITIONS, run_parts


class _PartsFormatter(HelpFormatter, argparse.RawDescriptionHelpFormatter):
    """Help formatter that keeps the list of the parts."""


def main(arguments: Sequence[str] | None = None, stop: StopRequest | None = None) -> int:
    """Run the benchmark; return its exit code.

    Args:
        arguments: Command-line arguments; None = those of the process.
        stop: Request to stop the process; None leaves the signal handlers unchanged.
    """
    return run_command("bench", lambda _: _run(bench_parser().parse_args(arguments)), stop)


def bench_parser() -> Parser:
    """Return the parser of the options."""
    listed = [f"  {part.name:16s} {part.title}{_note(part.by_default)}" for part in catalogue.PARTS]
    parser = Parser(prog="scripts/bench", formatter_class=_PartsFormatter, epilog="\n".join(["parts:", *listed]))
    parser.add_argument(
        "parts",
        nargs="*",
        metavar="PART",
        help="part to measure, from the list below; without names, all that need not be named",
    )
    parser.add_argument("--seed", type=integer(0), default=1, help="seed of all random numbers")
    parser.add_argument(
        "--repetitions",
        type=integer(1, MOST_REPETITIONS),
        default=None,
        metavar="N",
        help="measurements of each part instead of its own number",
    )
    parser.add_argument(
        "--json",
        type=Path,
        default=None,
        metavar="FILE",
        help="write the results to this file at the end; the duration of scripts/test that it states is kept",
    )
    return parser


def _note(by_default: bool) -> str:
    return "" if by_default else " (only if named)"


def _run(options: argparse.Namespace) -> int:
    """Measure the parts, print their results, and write the file."""
    count: int | None = options.repetitions
    parts = catalogue.chosen_parts(options.parts)
    record = BenchmarkRecord(
        version=version(),
        commit=commit(),
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
        seed=options.seed,
        load_average=[round(load, 2) for load in os.getloadavg()],
        host=host_record(),
        test_duration_s=None if options.json is None else _test_duration_s(options.json),
        parts={},
    )
    print(run_text(record), flush=True)
    measured = run_parts(parts, seed=options.seed, repetitions=count, report=_print)
    if options.json is not None:
        record.model_copy(update={"parts": measured}).write(options.json)
    return 1 if any(part.failed for part in measured.values()) else 0


def _print(name: str, part: PartRecord) -> None:
    """Print the result of a part, or the reason of its failure to standard error."""
    if part.failed is None:
        print(part_text(name, part), flush=True)
    else:
        print(failure_text(name, part), file=sys.stderr, flush=True)


def _test_duration_s(path: Path) -> int | None:
    """Return the duration of ``scripts/test`` that an earlier result states; None if there is no such file.

    Raises:
        InputError: The file is not a result, or cannot be written.
    """
    if path.exists():
        return read_record(path).test_duration_s
    if not path.parent.is_dir():
        raise InputError(f"--json {path}: there is no folder {path.parent}; create it")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"--json {path}: the folder cannot be written; specify another path")
    return None
