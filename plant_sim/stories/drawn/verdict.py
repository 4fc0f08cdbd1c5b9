"""Class of each harm of a random story: ordered, told, hidden from every input, known, or a finding."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import IntEnum
from typing import Final, NamedTuple

from plant_sim.stories.drawn.action import Deed, RandomStory, StoryAction
from plant_sim.stories.drawn.harm import LOST, NOT_RECOVERED, Harm
from plant_sim.stories.drawn.play import PlayedStory, StoryPlayer


class HarmClass(IntEnum):
    """Class of a story by its worst harm; the last three are findings."""

    NONE = 0
    """No harm."""
    ORDERED = 1
    """An action of the operator that can do this harm precedes it."""
    TOLD = 2
    """An alarm, or the reason for the Suspended state, tells it."""
    HIDDEN = 3
    """Silent, after a fault for which the fault matrix expects harm that no program can prevent."""
    KNOWN = 4
    """Silent harm, or a machine that does not work again, of a known cause that has not been mended."""
    SILENT = 5
    """Silent: nothing tells it, and nothing excuses it."""
    STUCK = 6
    """An operator who mends everything does not get the machine to work again."""
    VIOLATION = 7
    """A requirement of the program was violated."""
    CRASH = 8
    """Program or plant raised an exception."""


FINDINGS: Final = (HarmClass.SILENT, HarmClass.STUCK, HarmClass.VIOLATION, HarmClass.CRASH)


class AcceptedHarm(NamedTuple):
    """Harm after a fault or another action that no program can prevent.

    Attributes:
        kinds: Kinds of incident or names of monitors.
        loses: True if seedlings may be lost.
    """

    kinds: frozenset[str]
    loses: bool


Accepts = Callable[[StoryAction], AcceptedHarm]
"""Function that returns the harm after an action that no program can prevent, as the fault matrix expects it."""


class Sighting(NamedTuple):
    """Class of a story, and the harm that decides it.

    Attributes:
        of_story: Class.
        played: Observation of the story.
        harm: The harm; None if there is none, or for an exception.
        known: Name of the known cause; empty if there is none.
    """

    of_story: HarmClass
    played: PlayedStory
    harm: Harm | None = None
    known: str = ""

    @property
    def signature(self) -> tuple[str, ...]:
        """Class and kinds of harm, by which findings are grouped and kept while a story is minimised."""
        if self.of_story is HarmClass.CRASH:
            return self.of_story.name, self.played.crash.partition(":")[0]
        return self.of_story.name, *(sorted(self.harm.kinds) if self.harm is not None else ())


class KnownHarm(NamedTuple):
    """Silent harm, or a machine that does not work again, of a known cause.

    Attributes:
        name: Name of the cause.
        cause: Kind of action, or kind of fault, that precedes the harm.
        part: End of the target of this action; empty for any.
        kinds: Kinds of harm that it explains.
        reason: Reason why nothing tells it, and what would.
        replay: Text of a story that shows it.
    """

    name: str
    cause: str
    part: str
    kinds: frozenset[str]
    reason: str
    replay: str


class StoryJudge:
    """Judge of played stories."""

    def __init__(self, player: StoryPlayer, accepts: Accepts, known: Iterable[KnownHarm] = ()) -> None:
        """Prepare the judging.

        Args:
            player: Player of the stories.
            accepts: Harm that no program can prevent, by action.
            known: Known causes that have not been mended.
        """
        self._player, self._accepts, self._known = player, accepts, (*known,)

    def sighting(self, played: PlayedStory) -> Sighting:
        """Return the class of a played story.

        What the operator ordered, and actions whose harm no input shows or which is known, may hide other harm: the
        story is played again without them, and a finding there is a finding of the story.
        """
        first = self.of_played(played)
        if first.of_story not in {HarmClass.ORDERED, HarmClass.HIDDEN, HarmClass.KNOWN}:
            return first
        rest = self._without_excuses(played)
        second = first if rest is None else self.of_played(self._player.play(rest))
        return second if second.of_story in FINDINGS else first

    def of_played(self, played: PlayedStory) -> Sighting:
        """Return the class of a played story as it is."""
        if played.crash:
            return Sighting(HarmClass.CRASH, played)
        sightings = [self._of_harm(played, harm) for harm in played.harms]
        return max(sightings, key=lambda each: each.of_story, default=Sighting(HarmClass.NONE, played))

    def shows(self, story: RandomStory, signature: tuple[str, ...]) -> bool:
        """Play a story; return True if it has this signature."""
        return self.of_played(self._player.play(story)).signature == signature

    def _of_harm(self, played: PlayedStory, harm: Harm) -> Sighting:
        known = next((each.name for each in self._known if _explains(each, harm)), "")
        if harm.is_violation and not (harm.blind and harm.is_of_requirement):
            of_harm = HarmClass.VIOLATION
        elif NOT_RECOVERED in harm.kinds:
            of_harm = HarmClass.KNOWN if known else HarmClass.STUCK
        elif harm.ordered:
            of_harm = HarmClass.ORDERED
        elif harm.alarms:
            of_harm = HarmClass.TOLD
        elif harm.blind or self._is_accepted(harm):
            of_harm = HarmClass.HIDDEN
        else:
            of_harm = HarmClass.KNOWN if known else HarmClass.SILENT
        return Sighting(of_harm, played, harm, known if of_harm is HarmClass.KNOWN else "")

    def _is_accepted(self, harm: Harm) -> bool:
        """Return True if the actions before a harm may do all of it."""
        accepted = [self._accepts(action) for action in harm.acted]
        kinds = {kind for each in accepted for kind in each.kinds}
        loses = any(each.loses for each in accepted) or bool(kinds & harm.kinds.keys())
        return all(kind in kinds or (kind == LOST and loses) for kind in harm.kinds)

    def _without_excuses(self, played: PlayedStory) -> RandomStory | None:
        """Return the story without the actions that excuse its harm; None if nothing would remain of it."""
        excuses = {action for harm in played.harms for action in (*harm.ordered, *harm.blind)}
        excuses |= {action for harm in played.harms for action in harm.acted if self._excuses(action)}
        rest = tuple(action for action in played.story.actions if action not in excuses)
        acts = any(action.deed is not Deed.TEND for action in rest)
        return played.story.with_actions(rest) if acts else None

    def _excuses(self, action: StoryAction) -> bool:
        accepted = self._accepts(action)
        known = any(_is_cause(each, action) for each in self._known)
        return bool(accepted.kinds) or accepted.loses or known


def _explains(known: KnownHarm, harm: Harm) -> bool:
    return harm.kinds.keys() <= known.kinds and any(_is_cause(known, action) for action in harm.acted)


def _is_cause(known: KnownHarm, action: StoryAction) -> bool:
    return action.kind == known.cause and action.target.endswith(known.part)
