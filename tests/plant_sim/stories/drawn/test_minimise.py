"""Minimising: what a finding needs remains, the rest goes, within the permitted number of stories."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant_sim.stories.drawn.action import Deed, RandomStory, StoryAction
from plant_sim.stories.drawn.minimise import minimise
from tests.sampling import examples

STORY = RandomStory(1, 1, 0, tuple(StoryAction(at_ms, Deed.TEND) for at_ms in range(40)))


@examples(30, nightly=500)
@given(needed=st.sets(st.integers(0, 39), max_size=4))
def test_only_the_actions_that_the_finding_needs_remain(needed: set[int]) -> None:
    least, plays = minimise(STORY, lambda story: needed <= {each.at_ms for each in story.actions}, most_plays=1_000)
    assert {each.at_ms for each in least.actions} == needed
    assert plays < 250


@pytest.mark.parametrize("most", [0, 1, 7])
def test_no_more_stories_are_played_than_permitted(most: int) -> None:
    shown: list[RandomStory] = []

    def shows(story: RandomStory) -> bool:
        shown.append(story)
        return any(each.at_ms == 0 for each in story.actions)

    least, plays = minimise(STORY, shows, most_plays=most)
    assert plays == len(shown) == most
    assert least.actions[0].at_ms == 0


def test_a_finding_of_the_machine_alone_needs_no_action() -> None:
    assert minimise(STORY, lambda _: True)[0].actions == ()
