"""Mutation score of the fixed sample: every mutant is killed or classified, as in the generated table."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import pytest

from controller.cli.mutants import LISTED, judged, story_command, without_rule
from controller.iomap.loader import DEFAULT_IO_MAP
from controller.program.machine import build
from controller.verify.mutants.judgement import Judgement
from controller.verify.mutants.result import KILLED, Fate, listed_survivors, with_listed
from controller.verify.mutants.sample import Mutant, mutants_of, sample
from plant_sim.machine.parameters import load_machine
from plant_sim.stories.judge import Judge
from tests.controller.verify.proof_rig import MACHINE, SOUND
from tests.sampling import first_of

TABLE = Path(__file__).parents[3] / "docs" / "reference" / "mutants.csv"
SAMPLE = 300
DEFAULT, NIGHTLY_SAMPLE = 1, 20
SEED = 1
REMEDY = "run 'python -m controller prove --mutants 300 --seed 1 --out docs/reference'"


@cache
def mutants() -> list[Mutant]:
    return mutants_of(MACHINE.program)


@cache
def chosen(count: int) -> list[Mutant]:
    return sample(mutants(), count, SEED)


@cache
def judgement() -> Judgement:
    return Judgement(SOUND, without_rule(MACHINE, partial(build, MACHINE.io_map)))


@cache
def recorded() -> Mapping[str, Mapping[str, str]]:
    with TABLE.open(encoding="utf-8", newline="") as file:
        return {row["mutant"]: row for row in csv.DictReader(file)}


@cache
def judge() -> Judge:
    return Judge(MACHINE, load_machine())


def fate_of(mutant: Mutant) -> Fate:
    """Return the result of a mutant; a recorded survivor of the stories is not played again."""
    before = recorded().get(str(mutant))
    result = judgement().by_proof(mutant)
    if result is not None:
        return result.fate
    if before is not None and before["result"] not in KILLED:
        return Fate(before["result"])
    first = "" if before is None else before["evidence"].partition(": ")[0]
    if judge().killed(replace(MACHINE, program=mutant.program), mutant.block, first):
        return Fate.STORY
    [result] = with_listed([judgement().of_survivor(mutant)], listed_survivors(LISTED))
    return result.fate


@pytest.mark.parametrize("number", first_of(range(NIGHTLY_SAMPLE), DEFAULT))
def test_every_mutant_is_killed_or_classified(number: int) -> None:
    """A mutant is killed, or it survives in the class of the generated table.

    A new requirement kills by proof what a story has killed before; the weekly test compares the ways as well.
    """
    mutant = chosen(NIGHTLY_SAMPLE)[number]
    fate = fate_of(mutant)
    assert fate not in {Fate.OPEN, Fate.GAP}, f"{mutant}: {REMEDY}"
    before = recorded().get(str(mutant))
    assert fate in KILLED or before is None or before["result"] == fate, f"{mutant}: {REMEDY}"


def test_the_list_contains_only_mutants_of_the_program() -> None:
    """A changed program may leave reasons behind that belong to no mutant."""
    names = {str(mutant) for mutant in mutants()}
    assert [name for name in listed_survivors(LISTED) if name not in names] == []


@pytest.mark.weekly
@pytest.mark.timeout(7_200)
def test_the_table_of_the_fixed_sample_is_current() -> None:
    """All 300 mutants are judged, with every story: the results are those of the table, and none is a gap."""
    results = judged(judgement(), chosen(SAMPLE), story_command(DEFAULT_IO_MAP))
    assert [each.name for each in results if each.fate in {Fate.OPEN, Fate.GAP}] == []
    assert {each.name: each.fate for each in results} == {
        name: Fate(row["result"]) for name, row in recorded().items()
    }, REMEDY
