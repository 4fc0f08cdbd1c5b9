"""Command ``stories``: play the stories with mutants of the program, or random stories whose harm is judged.

Without options, mutants are read as lines of JSON from standard input, as ``controller prove --mutants`` sends them.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from controller.common.errors import InputError
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.verify.mutants.sample import mutants_of
from plant_sim.cli.reproduce.origin import provenance_of
from plant_sim.cli.reproduce.result_folder import result_folder
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.fault_matrix.cases import Subject, part_of
from plant_sim.fault_matrix.judge import expectation
from plant_sim.faults import FAULTS
from plant_sim.machine.parameters import load_machine
from plant_sim.stories.drawn.action import Deed, StoryAction, parse_story
from plant_sim.stories.drawn.report import StoryRun, sighting_lines
from plant_sim.stories.drawn.verdict import FINDINGS, AcceptedHarm
from plant_sim.stories.judge import Judge

FREED = {("jammed", "lift"): ("dropping_arm", "lift"), ("jammed", "slide"): ("stuck_valve", "slide")}
"""Faults with whose harm a jam may end that is freed under pressure: the device jumps (docs/stored-air.md)."""
JUMP_INWARD = frozenset({"arm_through_tray", "one_in_the_centre", "arms_collide"})
"""Harm of a slide that loses its air while it is driven inward: nothing throttles it, and it jumps past its row."""


def run(options: argparse.Namespace) -> int:
    """Read mutants and print, for each, the story that kills it; or play random stories and print a report.

    Returns:
        1 if a random story has a finding: a violated requirement, an exception, a machine that does not work again, or
        silent harm without a known cause. Else 0.

    Raises:
        IoMapError: The I/O map is invalid.
        MachineError: The machine parameters are invalid.
        InputError: A line does not name a mutant of the program, or an option is invalid.
    """
    if options.out is not None and options.random is None and options.replay is None:
        raise InputError("--out: only with --random and --replay; omit it")
    if options.undirected and options.random is None:
        raise InputError("--undirected: applies only with --random N")
    if options.replay is not None and options.random is not None:
        raise InputError("--replay: plays one story; omit --random")
    if options.replay is not None:
        return _replay(options)
    if options.random is not None:
        return _play_random(options)
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


def _replay(options: argparse.Namespace) -> int:
    provenance, story = provenance_of(options), parse_story(options.replay)
    sighting = story_run(options).replay(story)
    _tell(options, provenance, list(sighting_lines(sighting)))
    return int(sighting.of_story in FINDINGS)


def _play_random(options: argparse.Namespace) -> int:
    provenance, stories = provenance_of(options), story_run(options)
    columns = (MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task("", total=options.random)
        for number in range(options.random):
            stories.play(number)
            progress.update(task, advance=1)
        stories.minimise_findings(tell=lambda name: progress.update(task, description=f"minimising {name}"))
    _tell(options, provenance, list(stories.report.lines()))
    return int(bool(stories.report.findings))


def _tell(options: argparse.Namespace, provenance: Provenance, lines: list[str]) -> None:
    """Print the lines of a report and write them to the folder of the result, if there is one."""
    with result_folder(options, provenance) as files:
        if files is not None:
            files.json("stories.json", {"report": lines})
    for line in lines:
        print(line)


def story_run(options: argparse.Namespace) -> StoryRun:
    """Return a run of random stories with the program and the plant of the options.

    Raises:
        IoMapError: The I/O map is invalid.
        MachineError: The machine parameters are invalid.
    """
    machine, parameters = build(load_io_map(options.io_map)), load_machine(options.machine)
    run = StoryRun(machine, parameters, accepted_harm, seed=options.seed, directed=not options.undirected)
    defaults = {"io_map": DEFAULT_IO_MAP, "machine": DEFAULT_MACHINE}
    others = {name: getattr(options, name) for name, path in defaults.items() if getattr(options, name) != path}
    run.report.files = tuple(
        word for name, path in others.items() for word in (f"--{name.replace('_', '-')}", str(path))
    )
    return run


def accepted_harm(action: StoryAction) -> AcceptedHarm:
    """Return the harm after an action that no program can prevent, as the tables of the fault matrix expect it."""
    if action.deed is Deed.SPEED:
        return _expected("jammed", "cups")
    if action.deed is Deed.AIR:
        low = _expected("low_supply", "supply")
        return AcceptedHarm(low.kinds | JUMP_INWARD, low.loses)
    if action.deed is not Deed.FAULT:
        return AcceptedHarm(frozenset(), loses=False)
    kind = action.kind
    part = FAULTS[kind].target if FAULTS[kind].permanent else part_of(action.target.partition(":")[2])
    own, freed = _expected(kind, part, action.size), FREED.get((kind, part))
    if freed is None:
        return own
    jump = _expected(*freed)
    return AcceptedHarm(own.kinds | jump.kinds, own.loses or jump.loses)


def _expected(kind: str, part: str, size: float | None = None) -> AcceptedHarm:
    expected = expectation(Subject(kind, part, size, ()))
    return AcceptedHarm(expected.harm, expected.loses)
