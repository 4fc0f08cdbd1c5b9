"""Part of the command ``prove``: mutation score, with stories played by the plant in a process of its own."""

from __future__ import annotations

import argparse
import importlib.util
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from controller.cli.machine import machine_of, read_constants
from controller.common.document.rendering import write_texts
from controller.common.errors import InputError
from controller.common.supervision.parent import Lifeline
from controller.core.program import Program
from controller.program.machine import Transplanter
from controller.program.requirements.proof import specification as specification_of
from controller.verify.mutants.change import Kind
from controller.verify.mutants.judgement import Judgement
from controller.verify.mutants.result import (
    Fate,
    MutantResult,
    as_csv,
    as_markdown,
    as_text,
    listed_survivors,
    with_listed,
)
from controller.verify.mutants.sample import Mutant, mutants_of, sample

PLANT = "plant_sim"
"""Package that plays the stories, in a process of its own; the controller does not import it."""

LISTED = Path(__file__).parent / "surviving_mutants.csv"
"""Survivors that no proof classifies, each with its class and the reason; judged by a person."""


def run_mutants(options: argparse.Namespace, clock: Callable[[], float]) -> int:
    """Judge a sample of mutants and print the result.

    Returns:
        0 if every survivor is classified and none is a gap, otherwise 1.

    Raises:
        InputError: An option is invalid.
    """
    began_s = clock()
    machine = machine_of(options)
    every = mutants_of(machine.program)
    chosen = sample(every, options.mutants, options.seed)
    data = read_constants(machine.tags.sp, options.constants)
    judgement = Judgement(specification_of(machine, data), without_rule(machine, partial(machine_of, options)))
    results = judged(judgement, chosen, story_command(options.io_map))
    if options.out is not None:
        population = Counter(mutant.kind for mutant in every)
        _write(results, population, options)
    print(as_text(results, clock() - began_s))
    return 1 if any(each.fate in {Fate.OPEN, Fate.GAP} for each in results) else 0


def judged(judgement: Judgement, chosen: Sequence[Mutant], command: Sequence[str]) -> list[MutantResult]:
    """Return the results of mutants; stories are played by a command, if it is not empty."""
    if not command:
        print("the plant is not installed: no stories are played", file=sys.stderr)
        return with_listed(judgement.results(chosen, None), listed_survivors(LISTED))
    with StoryProcess(command) as stories:
        return with_listed(judgement.results(chosen, stories), listed_survivors(LISTED))


def without_rule(machine: Transplanter, build: Callable[..., Transplanter]) -> dict[str, Callable[[], Program]]:
    """Return functions that return the program without one interlock rule, by name of the rule."""
    names = [f"{group}: {rule.name}" for group, rules in machine.rule_groups.items() for rule in rules]
    return {name: partial(_program_without, build, name) for name in names}


def _program_without(build: Callable[..., Transplanter], rule: str) -> Program:
    return build(without=[rule]).program


def story_command(io_map: Path) -> list[str]:
    """Return the command that plays stories with mutants; empty if the plant is not installed."""
    if importlib.util.find_spec(PLANT) is None:
        return []
    return [sys.executable, "-m", PLANT, "stories", "--io-map", str(io_map)]


class StoryProcess:
    """Process that reads mutants as lines of JSON and writes the story that kills each of them."""

    def __init__(self, command: Sequence[str]) -> None:
        """Set the command; the process starts at `__enter__`."""
        self._command = list(command)
        self._lifeline: Lifeline
        self._output: IO[str]
        self._process: subprocess.Popen[str]

    def __enter__(self) -> Self:
        self._lifeline = Lifeline()
        # the results go to a file, so that the process never waits for this one
        self._output = tempfile.TemporaryFile("w+", encoding="utf-8")
        self._process = subprocess.Popen(  # noqa: S603 - own command
            self._command,
            stdin=subprocess.PIPE,
            stdout=self._output,
            text=True,
            env=self._lifeline.environment(),
            pass_fds=self._lifeline.descriptors,
        )
        self._lifeline.started()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self._lifeline.close()
        self._output.close()

    def begin(self, mutant: Mutant) -> None:
        """Send a mutant to the process."""
        assert self._process.stdin is not None  # noqa: S101 - narrows the union for the type checker
        self._process.stdin.write(json.dumps({"number": mutant.number, "name": str(mutant)}) + "\n")
        self._process.stdin.flush()

    def results(self) -> Iterator[tuple[int, str]]:
        """Wait for the end of the process and yield its results.

        Raises:
            InputError: The process failed.
        """
        assert self._process.stdin is not None  # noqa: S101 - narrows the union for the type checker
        self._process.stdin.close()
        if self._process.wait() != 0:
            raise InputError(f"{' '.join(self._command)}: ended with exit code {self._process.returncode}")
        self._output.seek(0)
        for line in self._output:
            row = json.loads(line)
            yield int(row["number"]), str(row["killed"])


def _write(results: list[MutantResult], population: Counter[Kind], options: argparse.Namespace) -> None:
    command = f"python -m controller prove --mutants {options.mutants} --seed {options.seed} --out docs/reference"
    try:
        texts = {"mutants.md": as_markdown(results, population, command), "mutants.csv": as_csv(results)}
        write_texts(options.out, texts)
    except OSError as error:
        raise InputError(f"--out {options.out}: {error.strerror}; choose a writable folder") from error
