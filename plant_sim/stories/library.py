"""All stories, in the order in which they are played: those that find most changes first."""

from __future__ import annotations

from controller.program.machine import Transplanter
from plant_sim.stories import disturbances, stops, work
from plant_sim.stories.story import Story


def stories_of(machine: Transplanter) -> list[Story]:
    """Return all stories for a program."""
    return [*work.stories(), *disturbances.stories(), *stops.stories(machine)]
