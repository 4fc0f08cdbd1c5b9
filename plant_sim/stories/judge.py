"""Comparison of changed programs with the original program in all stories."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from controller.program.machine import Transplanter
from controller.program.tags import SIDES, Side
from plant_sim.machine.parameters import Machine
from plant_sim.stories.library import stories_of
from plant_sim.stories.story import Observation, Story, difference, observe

OTHER: dict[Side, Side] = {"left": "right", "right": "left"}


class Judge:
    """Comparison of changed programs with the original, which plays each story once."""

    def __init__(self, machine: Transplanter, parameters: Machine, stories: Iterable[Story] | None = None) -> None:
        """Prepare the comparison.

        Args:
            machine: Original program and its tags.
            parameters: Parameters of the plant.
            stories: Stories to play, in this order; None = all.
        """
        self._machine, self._parameters = machine, parameters
        self.stories = tuple(stories_of(machine) if stories is None else stories)
        self._originals: dict[Story, Observation] = {}

    def original(self, story: Story) -> Observation:
        """Return the observation of a story with the original program."""
        if story not in self._originals:
            self._originals[story] = observe(story, self._machine, self._parameters)
        return self._originals[story]

    def differences(self, machine: Transplanter, block: str = "", first: str = "") -> Iterator[tuple[Story, str]]:
        """Yield the stories in which a changed program differs from the original, each with the difference.

        Args:
            machine: Changed program.
            block: Title of the changed block. If it belongs to an arm, the stories that interrupt the steps or strike
                the parts of the other arm are omitted.
            first: Name of the story to play first.
        """
        for story in sorted(self.stories, key=lambda story: story.name != first):
            if any(block.startswith(side) and OTHER[side] in story.name for side in SIDES):
                continue
            text = difference(self.original(story), observe(story, machine, self._parameters))
            if text:
                yield story, text

    def killed(self, machine: Transplanter, block: str = "", first: str = "") -> str:
        """Return the first story in which a changed program differs, with the difference; empty if there is none."""
        found = next(self.differences(machine, block, first), None)
        return "" if found is None else f"{found[0].name}: {found[1]}"
