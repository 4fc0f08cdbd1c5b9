"""Stories: observations, their comparison, and the comparison of changed programs with the original."""

from __future__ import annotations

import copy
import io
import json
from argparse import Namespace
from dataclasses import replace
from functools import cache

import pytest

from controller.common.errors import InputError
from controller.iomap.loader import DEFAULT_IO_MAP
from controller.verify.mutants.sample import Mutant, mutants_of
from plant_sim.cli.stories import killers
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.machine.parameters import load_machine
from plant_sim.stories import work
from plant_sim.stories.judge import Judge
from plant_sim.stories.library import stories_of
from plant_sim.stories.story import Observation, Part, difference, observe
from tests.controller.verify.proof_rig import MACHINE
from tests.sampling import first_of, one_in

PARAMETERS = load_machine()
STORIES = {story.name: story for story in stories_of(MACHINE)}


@cache
def mutants() -> dict[str, Mutant]:
    return {str(mutant): mutant for mutant in mutants_of(MACHINE.program)}


def judge(*names: str) -> Judge:
    """Return a judge that plays these stories only."""
    return Judge(MACHINE, PARAMETERS, [STORIES[name] for name in names])


@cache
def two_trays() -> Observation:
    return observe(STORIES["two trays"], MACHINE, PARAMETERS)


def test_names_of_stories_are_unique() -> None:
    assert len(STORIES) == len(stories_of(MACHINE))


@pytest.mark.parametrize("name", one_in(80, STORIES))
def test_every_story_ends_with_the_original_program(name: str) -> None:
    """No time limit expires, so that a time limit that expires with a changed program is an effect of the change."""
    assert observe(STORIES[name], MACHINE, PARAMETERS).stalled == ""


def test_the_same_program_gives_the_same_observation() -> None:
    again = observe(STORIES["two trays"], MACHINE, PARAMETERS)
    assert again == two_trays()
    assert difference(two_trays(), again) == ""


def test_differences_are_ordered_by_severity() -> None:
    """A violation is reported before a time limit, then counts, events, displays and durations."""
    other = copy.deepcopy(two_trays())
    last = other.parts[-1]
    longer = [*other.parts[:-1], replace(last, ends_ms=last.ends_ms + 5_000)]
    other.parts = longer
    assert difference(two_trays(), other).startswith("duration: ")
    other.parts = [*longer[:-1], replace(longer[-1], shown={**last.shown, "reason": 9})]
    assert difference(two_trays(), other).startswith("display: ")
    other.events = other.events[:-1]
    assert difference(two_trays(), other).startswith("events: none instead of")
    assert other.counts is not None
    other.counts = replace(other.counts, in_cups=0)
    assert difference(two_trays(), other).startswith("counts: ")
    other.stalled = "waiting"
    assert difference(two_trays(), other).startswith("time limit: ")
    other.violations = {"torn": "a seedling was torn"}
    assert difference(two_trays(), other).startswith("monitor: torn")


def test_small_differences_in_time_and_measured_registers_are_tolerated() -> None:
    """A part may take 10 % or 0.2 s more, and a measured register may differ by 5 % or 2."""
    one = Observation([Part("work", 10_000, {}, {"frequency x0.1/min": 450})])
    assert difference(one, Observation([Part("work", 10_990, {}, {"frequency x0.1/min": 470})])) == ""
    assert "duration" in difference(one, Observation([Part("work", 11_010, {}, {"frequency x0.1/min": 450})]))
    assert "display" in difference(one, Observation([Part("work", 10_000, {}, {"frequency x0.1/min": 474})]))


KILLED = {
    "buttons and commands: OUT clear due: stop closed >= 30 dropped": "emergency stop, tray feeder",
    "modes: MOV 4 state: 10 instead of 4": "two trays",
    "buttons and commands: OUT jog lease: 600 ms instead of 300 ms": "jogs",
    "alarms: ANS stop closed: 20000 ms instead of 10000 ms": "stuck stop button",
}
"""Mutants and stories that kill them."""


@pytest.mark.parametrize(("name", "story"), one_in(4, reversed(KILLED.items())))
def test_a_story_kills_a_mutant(name: str, story: str) -> None:
    """The story ends differently with the mutant; with the original program it does not."""
    player = judge(story)
    assert player.killed(MACHINE) == ""
    assert player.killed(replace(MACHINE, program=mutants()[name].program)).startswith(f"{story}: ")


def test_stories_of_the_other_arm_are_omitted_for_a_block_of_an_arm() -> None:
    player = judge("jams, left arm", "jams, right arm")
    changed = replace(MACHINE, program=mutants()["modes: MOV 4 state: 10 instead of 4"].program)
    assert [story.name for story, _ in player.differences(changed, "right arm")] == ["jams, right arm"]
    assert len(list(player.differences(changed))) == 2


@pytest.mark.nightly
def test_the_command_names_the_killing_story(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each line names a mutant by number and description; the answer has the same number."""
    monkeypatch.setattr("plant_sim.stories.judge.stories_of", lambda machine: list(work.STORIES[:1]))
    mutant = mutants()["modes: MOV 4 state: 10 instead of 4"]
    lines = io.StringIO(json.dumps({"number": mutant.number, "name": str(mutant)}) + "\n")
    [answer] = killers(Namespace(io_map=DEFAULT_IO_MAP, machine=DEFAULT_MACHINE), lines)
    assert json.loads(answer)["number"] == mutant.number
    assert json.loads(answer)["killed"].startswith("two trays: ")


@pytest.mark.parametrize(
    "line", first_of(["nonsense", '{"number": 3, "name": "another program: OUT"}', '{"number": -1e9}', "[]"])
)
def test_a_line_that_names_no_mutant_is_rejected(line: str) -> None:
    with pytest.raises(InputError, match="line 1: not a mutant"):
        list(killers(Namespace(io_map=DEFAULT_IO_MAP, machine=DEFAULT_MACHINE), [line]))
