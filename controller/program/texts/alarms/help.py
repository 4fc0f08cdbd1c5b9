"""Types of the alarm texts: message, meaning and causes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from controller.common.declarations import DeclarationError
from controller.program.texts.isolation import ISOLATE_FIRST
from controller.program.texts.operator import Text


@dataclass(frozen=True, slots=True)
class Cause:
    """Likely cause of an alarm, and how to confirm it.

    Attributes:
        name: Name of the cause.
        look: Check that needs no hand in the machine: displays, lamps, sounds.
        location: Key in `LOCATIONS` of the part concerned.
        reach: Check with a hand in the machine, after the isolation; None if there is none.
        points: Tags of the points concerned; tags of an arm without the side.
        set_points: Names of the set-points concerned.
        both_sides: True if the part of the other arm may be the cause, too.
    """

    name: Text
    look: Text
    location: str
    reach: Text | None = None
    points: tuple[str, ...] = ()
    set_points: tuple[str, ...] = ()
    both_sides: bool = False

    def __post_init__(self) -> None:
        """Check that a text which sends a hand into the machine begins with the isolation.

        Raises:
            DeclarationError: It does not.
        """
        if self.reach is None:
            return
        for text, beginning in zip(self.reach, ISOLATE_FIRST, strict=True):
            if not text.startswith(beginning):
                raise DeclarationError(f"cause {self.name.en!r}: begin the text with {beginning!r}: {text!r}")


class AlarmText(NamedTuple):
    """Texts of an alarm.

    Attributes:
        message: Description of the event for the operator.
        meaning: What the program has found, and how the machine has reacted.
        causes: Likely causes in the order in which to look: keys in `CAUSES`, or causes of this alarm alone.
        comment: Device comment of the annunciator in exports; empty = the English message.
    """

    message: Text
    meaning: Text
    causes: tuple[str | Cause, ...]
    comment: str = ""

    @property
    def en(self) -> str:
        """Message in English."""
        return self.message.en

    @property
    def zh(self) -> str:
        """Message in Chinese."""
        return self.message.zh

    def of(self, side: Text | None) -> AlarmText:
        """Return the texts with the side name filled in."""
        comment = Text(self.comment or self.message.en, "").of(side).en
        return AlarmText(self.message.of(side), self.meaning.of(side), self.causes, comment)
