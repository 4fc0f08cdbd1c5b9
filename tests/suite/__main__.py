"""Command behind ``scripts/test``: static checks, then the tests of the selected part of the suite."""

from __future__ import annotations

import argparse
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.paths import ROOT
from tests.sampling import NIGHTLY, WEEKLY
from tests.suite.dependencies import own_dependencies
from tests.suite.parts import Part, PartError, parts
from tests.suite.selection import changed_since, selected

USAGE: Final = "scripts/test [--nightly [PART] | --weekly [PART] | --changed [REV]] [options of pytest]"
ALL: Final = "all"
TOOLS: Final = Path(sys.executable).parent
SETTINGS: Final = ("-c", "pyproject.toml")
"""Named because pytest looks for its settings at a file that exists among its arguments, such as that of an option."""
TYPES: Final = ("mypy",)
"""Check that takes most of the time, on one processor."""
CHECKS: Final = (("ruff", "check", "."), ("ruff", "format", "--check", "."), TYPES, ("lint-imports",))
WARM_UP: Final = ("python", "-m", "tests.suite.warm_up")
SLOW_S: Final = 5.0
"""Duration of the type check, s, above which the caches of the tests are probably cold or outdated as its own are."""
WORKERS: Final = ("-n", "3", "--dist", "worksteal")
"""Three workers for two cores: tests wait for processes and browsers during a fifth of the time."""
ENDING_S: Final = 30
"""Time in which an interrupted tool must end by itself, s."""
INTERRUPTED: Final = 128 + signal.SIGINT
INVALID: Final = 2


@dataclass(frozen=True)
class Run:
    """One run of pytest.

    Attributes:
        title: Line printed before the run; empty for none.
        options: Options and paths for pytest.
        is_complete: True if all tests of the default run are selected.
    """

    title: str
    options: tuple[str, ...]
    is_complete: bool = False


def main(arguments: Sequence[str], tools: Tools) -> int:
    """Run the checks and the selected tests; return the exit code of the first step that fails, 0 if none fails."""
    try:
        runs = _runs(*_parser().parse_known_args(arguments))
    except (PartError, ValueError) as error:
        _say(str(error))
        return INVALID
    is_complete = any(run.is_complete for run in runs)
    for check in CHECKS:
        if tools.code(check, beside=WARM_UP if is_complete and check == TYPES else None):
            _say(f"{shlex.join(check)} failed")
            return 1
    for run in runs:
        if run.title:
            _say(run.title)
        if code := tools.code(("pytest", *SETTINGS, *WORKERS, *run.options)):
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
    complete = ("-p", "tests.suite.parts", "--enforce-budgets") if not rest else ()
    return [Run("", ("-p", "tests.suite.budgets", *complete, *rest), is_complete=not rest)]


def _part_run(part: Part, rest: list[str]) -> Run:
    return Run(f"{part.mark} part {part.name}", (*part.selection(), *rest))


def _changed_runs(revision: str, rest: list[str]) -> list[Run]:
    selection = selected(own_dependencies(), changed_since(ROOT, revision))
    if selection.all is not None:
        return [Run(f"all tests, because of {selection.all}", tuple(rest))]
    files = [str(file) for file in selection.files]
    return [Run(f"{len(files)} test files can be affected", (*files, *rest))] if files else []


class Tools:
    """Runs one tool of the environment after another, each in a process group of its own.

    A tool therefore receives one interrupt for each signal that this process receives, from a terminal or from another
    process. When the interrupted tool has ended, or after `ENDING_S`, its remaining children are killed.
    """

    def __init__(self) -> None:
        self._interrupted = False
        self._group: int | None = None

    def catch_signals(self) -> None:
        """Interrupt the running tool on SIGINT and SIGTERM."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._interrupt)
        signal.signal(signal.SIGALRM, lambda *_: self._send(signal.SIGKILL))

    def code(self, command: Sequence[str], beside: Sequence[str] | None = None) -> int:
        """Run a tool to its end; return its exit code.

        Args:
            command: The tool and its arguments.
            beside: Another tool, whose result is ignored; it is started when the first has taken `SLOW_S`, and awaited
                if the first succeeds.

        Raises:
            KeyboardInterrupt: This process was interrupted or terminated; the tool and its children have ended.
        """
        with subprocess.Popen([TOOLS / command[0], *command[1:]], cwd=ROOT, process_group=0) as process:
            self._group = process.pid
            if self._interrupted:  # while the tool was started
                self._send(signal.SIGINT)
            helper = None if beside is None else self._started_beside(process, beside)
            code = process.wait()
            if helper is not None:
                if code:
                    helper.kill()
                helper.wait()
            if self._interrupted:
                self._send(signal.SIGKILL)
                raise KeyboardInterrupt
            self._group = None
        return code

    def _started_beside(
        self, process: subprocess.Popen[bytes], command: Sequence[str]
    ) -> subprocess.Popen[bytes] | None:
        """Start a tool in the process group of another, once that has taken `SLOW_S`; None if it ends before."""
        try:
            process.wait(SLOW_S)
        except subprocess.TimeoutExpired:
            helper = subprocess.Popen(
                [TOOLS / command[0], *command[1:]],
                cwd=ROOT,
                process_group=process.pid,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            if self._interrupted:  # while it was started
                self._send(signal.SIGINT)
            return helper
        return None

    def _interrupt(self, number: int, frame: object) -> None:
        self._interrupted = True
        signal.alarm(ENDING_S)
        self._send(signal.SIGINT)

    def _send(self, number: signal.Signals) -> None:
        if self._group is not None:
            with suppress(ProcessLookupError):
                os.killpg(self._group, number)


def _say(text: str) -> None:
    sys.stderr.write(f"scripts/test: {text}\n")


def run(arguments: Sequence[str]) -> int:
    """Run the command; an interrupt or SIGTERM ends it with exit code 130 after its tools have ended."""
    tools = Tools()
    tools.catch_signals()
    try:
        return main(arguments, tools)
    except KeyboardInterrupt:
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
