"""Coverage: the triples of a story written by hand, the denominators, and stories aimed at what is missing."""

from __future__ import annotations

import pytest

from controller.program.states import State
from plant_sim.stories.drawn.coverage import NO_STEP, Coverage, StepInState, Triple, steps_of
from plant_sim.stories.drawn.guide import StoryGuide
from tests.plant_sim.stories.drawn.story_rig import MACHINE, menu, played, player


def step(sequence: str, title: str) -> int:
    [found] = [each for each in MACHINE.program.sequences() if each.name == sequence]
    return found[title].number


def test_a_fault_covers_the_states_and_steps_in_which_it_is_active() -> None:
    """A harmless fault during 15 s of work covers steps in Execute, and none in Stopped or in homing."""
    story = played("seed=1 trays=2 work=5000; 1000 fault leak:left.claws.plus =1e-16 for=15000")
    kinds = {triple.kind for triple in story.triples}
    states = {State(triple.place.state) for triple in story.triples}
    assert kinds == {"leak"}
    assert states == {State.EXECUTE}
    assert Triple(StepInState(State.EXECUTE, step("left arm", "lift from row")), "leak") in story.triples
    assert {State.STOPPED, State.RESETTING, State.IDLE} <= {State(place.state) for place in story.places}
    assert story.acted == {"leak": 1}
    assert story.harms == []


def test_a_fault_at_rest_covers_the_state_without_a_step() -> None:
    """Before homing no step is active."""
    story = played("seed=1 trays=1 work=0; 500 fault leak:left.claws.plus =1e-16 for=1000")
    assert story.triples == {Triple(StepInState(State.STOPPED, NO_STEP), "leak")}


def test_shares_and_kinds_that_never_acted() -> None:
    coverage = Coverage(MACHINE, menu().faults)
    assert coverage.possible == len(State) * (1 + len(steps_of(MACHINE))) * len(menu().faults)
    assert coverage.share == coverage.share_of_reached == 0.0
    place, other = StepInState(State.EXECUTE, 20), StepInState(State.HOLDING, 20)
    assert coverage.add([Triple(place, "leak"), Triple(place, "jammed")], [place, other], {"leak": 1, "push": 0}) == 2
    assert coverage.add([Triple(place, "leak")], [place], {"tend": 3}) == 0
    assert coverage.share == 2 / coverage.possible
    assert coverage.share_of_reached == 2 / (2 * len(menu().faults))
    assert "push" in coverage.never
    assert not {"leak", "tend"} & {*coverage.never}


def test_an_aimed_story_strikes_in_the_state_and_step_with_kinds_that_are_missing_there() -> None:
    guide = StoryGuide(MACHINE, menu(), seed=3)
    assert guide.story(1).actions != ()
    guide.add(played("seed=1 trays=2 work=5000; 30000 fault leak:left.claws.plus =1e-16"))
    new = [guide.add(player().play(guide.story(number))) for number in (3, 5, 7)]
    assert sum(new) > 40
    assert guide.coverage.share_of_reached > 0.02


@pytest.mark.nightly
def test_directed_stories_cover_more_than_uniform_ones() -> None:
    """With as many stories; the documentation contains the figures of more of them."""
    reached = {}
    for directed in (True, False):
        guide = StoryGuide(MACHINE, menu(), seed=5, directed=directed)
        for number in range(6):
            guide.add(player().play(guide.story(number)))
        reached[directed] = len(guide.coverage.triples)
    assert reached[True] > 1.5 * reached[False]
