"""Text of random stories: it contains the complete story, and a wrong one is reported in one line."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.common.errors import InputError
from plant_sim.stories.drawn.action import Deed, RandomStory, StoryAction, parse_story
from plant_sim.stories.drawn.draw import StoryDraw
from tests.plant_sim.stories.drawn.story_rig import menu
from tests.sampling import examples, first_of


@examples(20, nightly=300)
@given(name=st.integers(0, 10_000), swarm=st.booleans())
def test_the_text_of_a_story_contains_all_of_it(name: int, *, swarm: bool) -> None:
    story = StoryDraw(menu(), str(name), swarm=swarm).story()
    assert parse_story(str(story)) == story


def test_the_same_name_gives_the_same_story_and_another_name_another_one() -> None:
    one, again, other = (StoryDraw(menu(), name).story() for name in ("1", "1", "2"))
    assert one == again != other


@pytest.mark.parametrize("swarm", [True, False])
def test_every_kind_of_fault_and_action_is_drawn(*, swarm: bool) -> None:
    """Sizes reach both ends of their range."""
    stories = [StoryDraw(menu(), str(number), swarm=swarm).story() for number in range(1_000)]
    actions = [action for story in stories for action in story.actions]
    assert {action.deed for action in actions} == {*Deed}
    assert {action.kind for action in actions if action.deed is Deed.FAULT} == {*menu().faults}
    sizes = {action.size for action in actions if action.kind == "late_sensor"}
    assert {0.001, 10.0} <= sizes
    assert {action.target for action in actions if action.deed is Deed.COMMAND} >= {*menu().commands}


WRONG = {
    "nonsense": "begin with seed=N",
    "seed=1 trays=2": "begin with seed=N",
    "seed=1 trays=2 work=0 speed=3": "speed: unknown",
    "seed=1 trays=0 work=0": "trays 1 to 9",
    "seed=1 trays=2 work=0; 5 dance": "not an action",
    "seed=1 trays=2 work=0; soon tend": "not an action",
    "seed=1 trays=2 work=0; -1 tend": "times must be",
    "seed=1 trays=2 work=0; 5 press": "takes a target",
    "seed=1 trays=2 work=0; 5 tend start": "takes no target",
    "seed=1 trays=2 work=0; 5 press strat": "unknown button; did you mean start",
    "seed=1 trays=2 work=0; 5 power found": "power found",
    "seed=1 trays=2 work=0; 5 push": "requires a size",
    "seed=1 trays=2 work=0; 5 speed =nan": "must be finite",
    "seed=1 trays=2 work=0; 5 fault jamed:left.slide": "unknown fault",
    "seed=1 trays=2 work=0; 5 fault late_sensor:stop": "requires a size",
}


@pytest.mark.parametrize(("text", "message"), first_of(WRONG.items(), 15))
def test_a_wrong_text_is_reported(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        parse_story(text)
    assert len(str(error.value).splitlines()) == 1


def test_actions_are_sorted_by_time() -> None:
    late, early = StoryAction(900, Deed.TEND), StoryAction(100, Deed.MEND)
    assert RandomStory(1, 1, 0).with_actions((late, early)).actions == (early, late)
