"""Command behind ``scripts/test``: static checks, then the tests of the selected part of the suite."""

from __future__ import annotations

import argparse
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.paths import ROOT
from tests.sampling import NIGHTLY, WEEKLY
from tests.suite.parts import Part, PartError, parts
from tests.suite.selection import Selection, SelectionError, changed_since, select

USAGE: Final = "scripts/test [--nightly [PART] | --weekly [PART] | --changed [REV]] [options of pytest]"
ALL: Final = "all"
CHECKS: Final = (("ruff", "check", "."), ("ruff", "format", "--check", "."), ("mypy",), ("lint-imports",))
TOOLS: Final = Path(sys.executable).parent
WORKERS: Final = ("-n", "2", "--dist", "worksteal")
ENDING_S: Final = 30.0
"""Time in which an interrupted tool must end by itself, s."""
INTERRUPTED: Final = 128 + signal.SIGINT
INVALID: Final = 2


@dataclass(frozen=True)
class Run:
    """One run of pytest.

    Attributes:
        title: Line printed before the run; empty for none.
        options: Options and paths for pytest.
    """

    title: str
    options: tuple[str, ...]


def main(arguments: Sequence[str]) -> int:
    """Run the checks and the selected tests; return the exit code of the first step that fails, 0 if none fails."""
    try:
        runs = _runs(*_parser().parse_known_args(arguments))
    except (PartError, SelectionError) as error:
        print(f"scripts/test: {error}", file=sys.stderr)
        return INVALID
    for check in CHECKS:
        if _code(check):
            print(f"scripts/test: {shlex.join(check)} failed", file=sys.stderr)
            return 1
    for run in runs:
        if run.title:
            print(f"scripts/test: {run.title}", flush=True)
        if code := _code(("pytest", *WORKERS, *run.options)):
            return code
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="scripts/test",
        usage=USAGE,
        description="Check style, types and import rules, then run tests: those of the default run, or the following.",
        allow_abbrev=False,
    )
    which = parser.add_mutually_exclusive_group()
    for mark, period in ((NIGHTLY, "night"), (WEEKLY, "week")):
        names = ", ".join(part.name for part in parts(mark))
        text = f"tests of a {period}, or one part of them: {names}"
        which.add_argument(f"--{mark}", nargs="?", const=ALL, metavar="PART", help=text)
    text = "tests that the changes since a revision (default: HEAD, so the uncommitted ones) can affect"
    which.add_argument("--changed", nargs="?", const="HEAD", metavar="REV", help=text)
    return parser


def _runs(options: argparse.Namespace, rest: list[str]) -> list[Run]:
    for mark, name in ((NIGHTLY, options.nightly), (WEEKLY, options.weekly)):
        if name is not None:
            return [_part_run(part, rest) for part in parts(mark, None if name == ALL else name)]
    if options.changed is not None:
        return _changed_runs(options.changed, rest)
    complete = ("-p", "tests.suite.parts") if not rest else ()
    return [Run("", ("-p", "tests.suite.budgets", *complete, *rest))]


def _part_run(part: Part, rest: list[str]) -> Run:
    return Run(f"{part.mark} part {part.name}", (*part.selection(), *rest))


def _changed_runs(revision: str, rest: list[str]) -> list[Run]:
    selection = select(ROOT, changed_since(ROOT, revision))
    if selection.all is not None:
        return [Run(f"all tests, because of {selection.all}", tuple(rest))]
    files = [str(file) for file in selection.files]
    return [Run(f"{len(files)} test files can be affected", (*files, *rest))] if files else []


def _code(command: Sequence[str]) -> int:
    """Run a tool of the environment to its end; return its exit code.

    The tool has a process group of its own, so that it receives one signal for each one that this process receives,
    from a terminal or from another process.

    Raises:
        KeyboardInterrupt: This process was interrupted or terminated; the tool and its children have ended.
    """
    with subprocess.Popen([TOOLS / command[0], *command[1:]], cwd=ROOT, process_group=0) as process:
        try:
            return process.wait()
        except KeyboardInterrupt:
            os.killpg(process.pid, signal.SIGINT)
            try:
                process.wait(ENDING_S)
            except (KeyboardInterrupt, subprocess.TimeoutExpired):
                pass
            os.killpg(process.pid, signal.SIGKILL)
            raise


def _interrupted(number: int, frame: object) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, _interrupted)
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
