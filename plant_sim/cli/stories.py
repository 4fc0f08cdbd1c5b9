"""Command ``stories``: play the stories with mutants of the program, read as lines of JSON from standard input."""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from controller.common.errors import InputError
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.verify.mutants.sample import mutants_of
from plant_sim.machine.parameters import DEFAULT_MACHINE, load_machine
from plant_sim.stories.judge import Judge


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``stories``."""
    parser.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="I/O map of the machine")
    parser.add_argument("--machine", type=Path, default=DEFAULT_MACHINE, help="parameters of the machine")


def run(options: argparse.Namespace) -> int:
    """Read mutants and print, for each, the story that kills it.

    Raises:
        IoMapError: The I/O map is invalid.
        MachineError: The machine parameters are invalid.
        InputError: A line does not name a mutant of the program.
    """
    logging.disable(logging.CRITICAL)  # a mutant may make an observer of its events fail in every story
    for line in killers(options, sys.stdin):
        print(line, flush=True)
    return 0


def killers(options: argparse.Namespace, lines: Iterable[str]) -> Iterator[str]:
    """Yield a line of JSON with the killing story, or an empty text, for each line that names a mutant."""
    machine = build(load_io_map(options.io_map))
    mutants = mutants_of(machine.program)
    judge = Judge(machine, load_machine(options.machine))
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line)
            mutant = mutants[row["number"]]
            named = str(mutant) == row["name"]
        except (ValueError, LookupError, TypeError):
            named = False
        if not named:
            raise InputError(f"standard input, line {number}: not a mutant of this program; send its number and name")
        killed = judge.killed(replace(machine, program=mutant.program), mutant.block)
        yield json.dumps({"number": mutant.number, "killed": killed})
