"""Minimising of a random story: the actions without which it no longer shows its finding (delta debugging)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from plant_sim.stories.drawn.action import RandomStory, StoryAction

MOST_PLAYS: Final = 60
"""Default number of stories played to minimise one."""


def minimise(
    story: RandomStory, shows: Callable[[RandomStory], bool], *, most_plays: int = MOST_PLAYS
) -> tuple[RandomStory, int]:
    """Return a story with as few actions as possible that still shows a finding, and the number of stories played.

    Groups of actions are left out, first large ones, then single ones, until no single action can be left out or the
    permitted number of stories has been played.

    Args:
        story: Story that shows the finding.
        shows: Function that plays a story and returns True if it shows the finding.
        most_plays: Largest number of stories to play.
    """
    actions: Sequence[StoryAction] = story.actions
    plays, parts = 0, 2
    while len(actions) >= 1 and plays < most_plays:
        size = -(-len(actions) // parts)
        for first in range(0, len(actions), size):
            if plays >= most_plays:
                break
            rest = (*actions[:first], *actions[first + size :])
            plays += 1
            if shows(story.with_actions(rest)):
                actions, parts = rest, max(parts - 1, 2)
                break
        else:
            if size == 1:
                break
            parts = min(2 * parts, len(actions))
    return story.with_actions(tuple(actions)), plays
