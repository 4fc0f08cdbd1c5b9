"""Random story as data: timed actions and faults, written as one line of text that replays them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from plant_sim.faults import FAULTS, Fault, parse_fault

MOST_TRAYS: Final = 9
MOST_MS: Final = 600_000
"""Latest time of an action, and longest time of work before the first one, ms."""


class Deed(StrEnum):
    """Kinds of action in a random story."""

    TEND = "tend"
    """The operator does the next thing that is right: clear, answer truthfully, home, start."""
    ANSWER_FALSELY = "answer_falsely"
    """The operator gives the wrong answer to every open question."""
    PRESS = "press"
    """A button, or several joined by '+', is pressed for some time."""
    COMMAND = "command"
    """A command of the command table is given."""
    JOG = "jog"
    """A jog command is given and renewed for some time."""
    FAULT = "fault"
    """A fault strikes and lasts for some time."""
    MEND = "mend"
    """The fault that has lasted longest ends."""
    AIR = "air"
    """The air in slides and lifts takes a share of the main pressure."""
    SPEED = "speed"
    """The speed of the tractor changes, cups per minute."""
    POWER = "power"
    """The controller is off for some time; its memory is kept, lost, old or damaged."""
    PUSH = "push"
    """A person pushes the trays with the belt, mm forward."""
    OVERRIDE = "override"
    """A person moves a drive by the manual override of its valve for some time."""
    TAKE_OFF = "take_off"
    """A person takes the tray in the beam off the belt."""
    STATUS = "status"
    """The runtime reports a lost link, a late scan, a fault of the store or a silent panel for some time."""


BUTTONS: Final = ("start", "stop", "emergency_stop")
MEMORIES: Final = ("kept", "lost", "old", "damaged")
STATUSES: Final = ("link_lost", "scan_fault", "store_fault", "panel_silent")
_WITH_TARGET: Final = (Deed.PRESS, Deed.COMMAND, Deed.JOG, Deed.FAULT, Deed.POWER, Deed.OVERRIDE, Deed.STATUS)
_WITH_SIZE: Final = (Deed.AIR, Deed.SPEED, Deed.PUSH)


@dataclass(frozen=True, slots=True, order=True)
class StoryAction:
    """Action of a random story.

    Attributes:
        at_ms: Earliest time, ms after the work before the first action.
        deed: Kind of action.
        target: Button, command, output, fault as KIND:TARGET, kind of memory or of status; empty if there is none.
        size: Size of the fault, share of the air, cups per minute, way in mm, or a draw from 0 to 1 for the memory.
        for_ms: Duration, ms; 0 = until the end for a fault, none for an action without a duration.
    """

    at_ms: int
    deed: Deed
    target: str = ""
    size: float | None = None
    for_ms: int = 0

    def __post_init__(self) -> None:
        """Validate times, target and size.

        Raises:
            InputError: The action is impossible.
        """
        if not (0 <= self.at_ms <= MOST_MS and 0 <= self.for_ms <= MOST_MS):
            raise InputError(f"{self}: times must be 0 to {MOST_MS} ms")
        if bool(self.target) != (self.deed in _WITH_TARGET):
            raise InputError(f"{self}: {self.deed} takes {'a' if self.deed in _WITH_TARGET else 'no'} target")
        if self.size is not None and not math.isfinite(self.size):
            raise InputError(f"{self}: the size must be finite")
        if self.deed in _WITH_SIZE and self.size is None:
            raise InputError(f"{self}: {self.deed} requires a size; write it as =SIZE")
        self._check_target()

    def _check_target(self) -> None:
        known: dict[Deed, tuple[str, ...]] = {Deed.POWER: MEMORIES, Deed.STATUS: STATUSES}
        for each in self.target.split("+") if self.deed is Deed.PRESS else ():
            if each not in BUTTONS:
                raise InputError(f"{self}: {each}: unknown button; {suggestion(each, BUTTONS)}")
        if self.deed in known and self.target not in known[self.deed]:
            raise InputError(f"{self}: {self.target}: unknown; {suggestion(self.target, known[self.deed])}")
        if self.deed is Deed.FAULT:
            self.fault(0)

    @property
    def kind(self) -> str:
        """Kind of fault; for other actions the kind of action."""
        return self.target.partition(":")[0] if self.deed is Deed.FAULT else self.deed.value

    def fault(self, now_ms: int) -> Fault:
        """Return the fault of a fault action.

        Args:
            now_ms: Plant time of its start, ms.

        Raises:
            FaultError: The fault is invalid.
        """
        kind, _, part = self.target.partition(":")
        if kind in FAULTS and FAULTS[kind].permanent:
            return Fault(kind, part, size=self.size)
        return Fault(kind, part, now_ms, now_ms + self.for_ms if self.for_ms else None, self.size)

    def __str__(self) -> str:
        """Return the text that `parse_story` reads."""
        size = "" if self.size is None else f"={self.size!r}"
        lasts = f"for={self.for_ms}" if self.for_ms else ""
        return " ".join(filter(None, (str(self.at_ms), self.deed.value, self.target, size, lasts)))


@dataclass(frozen=True, slots=True)
class RandomStory:
    """Random story; equal stories give equal results.

    Attributes:
        seed: Seed of the plant.
        trays: Trays in the magazine.
        work_ms: Work before the first action, ms; 0 = the machine has only been powered up.
        actions: Actions in the order of their times.
    """

    seed: int
    trays: int
    work_ms: int
    actions: tuple[StoryAction, ...] = ()

    def __post_init__(self) -> None:
        """Validate the numbers.

        Raises:
            InputError: A number is out of range.
        """
        if self.seed < 0 or not 1 <= self.trays <= MOST_TRAYS or not 0 <= self.work_ms <= MOST_MS:
            raise InputError(
                f"{self.head}: the seed must be 0 or more, trays 1 to {MOST_TRAYS}, work 0 to {MOST_MS} ms"
            )

    @property
    def head(self) -> str:
        """Text before the actions."""
        return f"seed={self.seed} trays={self.trays} work={self.work_ms}"

    def with_actions(self, actions: tuple[StoryAction, ...]) -> RandomStory:
        """Return the story with other actions, in the order of their times."""
        return replace(self, actions=tuple(sorted(actions, key=lambda action: action.at_ms)))

    def __str__(self) -> str:
        """Return the text that `parse_story` reads."""
        return "; ".join((self.head, *map(str, self.actions)))


def parse_story(text: str) -> RandomStory:
    """Return the story of a text.

    Args:
        text: ``seed=N trays=N work=MS``, then for each action ``; AT_MS ACTION [TARGET] [=SIZE] [for=MS]``.

    Raises:
        InputError: The text is not a story.

    >>> story = parse_story("seed=1 trays=2 work=9000; 500 fault jammed:left.slide for=2000; 900 push =12.5")
    >>> str(story.actions[1])
    '900 push =12.5'
    """
    head, *rest = (part.strip() for part in text.split(";"))
    try:
        values = {name: int(number) for name, number in (word.split("=") for word in head.split())}
        seed, trays, work_ms = (values.pop(name) for name in ("seed", "trays", "work"))
    except (ValueError, KeyError):
        raise InputError(f"{head!r}: not a story; begin with seed=N trays=N work=MS") from None
    if values:
        raise InputError(f"{head!r}: {', '.join(values)}: unknown; begin with seed=N trays=N work=MS")
    return RandomStory(seed, trays, work_ms).with_actions(tuple(_parse_action(part) for part in rest if part))


def _parse_action(text: str) -> StoryAction:
    words = text.split()
    try:
        at_ms, deed = int(words[0]), Deed(words[1])
        sizes = [float(word[1:]) for word in words[2:] if word.startswith("=")]
        times = [int(word[4:]) for word in words[2:] if word.startswith("for=")]
        targets = [word for word in words[2:] if not word.startswith(("=", "for="))]
        if max(len(sizes), len(times), len(targets)) > 1:
            raise ValueError
    except (ValueError, IndexError):
        raise InputError(f"{text!r}: not an action; write AT_MS ACTION [TARGET] [=SIZE] [for=MS]") from None
    size, for_ms, target = sizes[0] if sizes else None, times[0] if times else 0, targets[0] if targets else ""
    if deed is Deed.FAULT:
        size = size if size is not None or not target else parse_fault(target).size
    return StoryAction(at_ms, deed, target, size, for_ms)
