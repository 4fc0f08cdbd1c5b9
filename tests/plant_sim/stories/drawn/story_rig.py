"""Program, plant and player of random stories, shared by the tests."""

from __future__ import annotations

from functools import cache

from plant_sim.cli.stories import accepted_harm
from plant_sim.machine.parameters import load_machine
from plant_sim.stories.drawn.action import parse_story
from plant_sim.stories.drawn.draw import TRAYS, Menu, menu_of
from plant_sim.stories.drawn.known import KNOWN
from plant_sim.stories.drawn.play import PlayedStory, StoryPlayer
from plant_sim.stories.drawn.verdict import StoryJudge
from plant_sim.twin.commissioning import default_io_map, program_of
from plant_sim.twin.lock_step import Twin

MACHINE = program_of(default_io_map())
PARAMETERS = load_machine()


@cache
def menu() -> Menu:
    """Return everything that can be drawn for the delivered machine."""
    return menu_of(MACHINE, Twin(trays=TRAYS).plant)


@cache
def player() -> StoryPlayer:
    """Return the player of the delivered program."""
    return StoryPlayer(MACHINE, PARAMETERS)


@cache
def judge() -> StoryJudge:
    """Return the judge of the command."""
    return StoryJudge(player(), accepted_harm, KNOWN)


def played(text: str) -> PlayedStory:
    """Play a story with the delivered program."""
    return player().play(parse_story(text))
