"""Choice of the next random story: by swarm testing, and by striking where few kinds of fault have acted so far."""

from __future__ import annotations

import random
from typing import Final

from controller.program.machine import Transplanter
from plant_sim.stories.drawn.action import RandomStory, StoryAction
from plant_sim.stories.drawn.coverage import Coverage, StepInState, Triple
from plant_sim.stories.drawn.draw import LASTS_MS, Menu, StoryDraw
from plant_sim.stories.drawn.play import PlayedStory

LEAD_MS: Final = 30
"""Time from a fault to the state and step at which it is aimed, ms: two scans, so that it changes little before."""
CANDIDATES: Final = 6
"""Number of states and steps of which the one with the fewest kinds of fault is chosen."""
AIMED_FAULTS: Final = 3


class StoryGuide:
    """Source of the stories of one run.

    Attributes:
        coverage: Coverage of the stories so far.
    """

    def __init__(self, machine: Transplanter, menu: Menu, seed: int, *, directed: bool = True) -> None:
        """Prepare a run.

        Args:
            machine: Program of the machine.
            menu: Everything that can be drawn.
            seed: Seed of all stories.
            directed: False to draw every action uniformly, without regard to the coverage.
        """
        self.coverage = Coverage(machine, menu.faults)
        self._menu, self._seed, self._directed = menu, seed, directed
        self._parents: dict[StepInState, tuple[RandomStory, int]] = {}
        self._kinds: dict[StepInState, set[str]] = {}

    def story(self, number: int) -> RandomStory:
        """Return the story with a number; every second one is aimed as soon as there is something to aim at."""
        name = f"seed {self._seed}, story {number}"
        draw = StoryDraw(self._menu, name, swarm=self._directed)
        if self._directed and number % 2 and self._parents:
            return self._aimed(draw, random.Random(f"{name}, aimed"))
        return draw.story()

    def add(self, played: PlayedStory) -> int:
        """Add the coverage of a story; return the number of new triples."""
        new = self.coverage.add(played.triples, played.places, played.acted)
        for place, at_ms in played.times.items():
            if LEAD_MS <= at_ms <= LASTS_MS and place not in self._parents:
                self._parents[place] = played.story, at_ms
        for place, kind in played.triples:
            self._kinds.setdefault(place, set()).add(kind)
        return new

    def _aimed(self, draw: StoryDraw, draws: random.Random) -> RandomStory:
        """Return an earlier story up to a state and step, with faults there that have not acted in them yet."""
        places = sorted(self._parents)
        chosen = [draws.choice(places) for _ in range(CANDIDATES)]
        place = min(chosen, key=lambda each: len(self._kinds.get(each, ())))
        parent, at_ms = self._parents[place]
        open_kinds = [kind for kind in self.coverage.kinds if Triple(place, kind) not in self.coverage.triples]
        draws.shuffle(open_kinds)
        strikes_ms = (at_ms - LEAD_MS) // 10 * 10
        faults = [draw.fault(strikes_ms, kind) for kind in open_kinds[:AIMED_FAULTS]]
        before = [action for action in parent.actions if action.at_ms <= at_ms]
        after: list[StoryAction] = draw.tending(LASTS_MS, from_ms=at_ms + draws.randrange(500, 8_000, 10))
        return parent.with_actions((*before, *faults, *after))
