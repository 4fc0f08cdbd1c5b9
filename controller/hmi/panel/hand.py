"""What every order has in common: whose it is, and how it is refused."""

from __future__ import annotations

from typing import Final, Literal, Self

from controller.core.devices import Memory
from controller.core.expr import evaluate
from controller.hmi.own_registers import NAME_WORDS
from controller.hmi.panel.login import Level
from controller.hmi.panel.replies import reply_text
from controller.program.commands import Command
from controller.program.machine import Transplanter
from controller.program.refusals import Refusal, refusal_text
from controller.program.texts import Text

Button = Literal["start", "stop", "emergency_stop", "reset"]
MOMENTARY: Final[tuple[Button, ...]] = ("start", "stop", "reset")
"""Buttons that spring back; the emergency stop latches."""


class Hand:
    """One browser, as far as it can hold something.

    Attributes:
        forced: Inputs it has forced, by octal value.
        pressed: Buttons of the box it holds.
        spent: Its jog has ended without it: it must let go before it may begin another.
    """

    def __init__(self) -> None:
        """Hold nothing."""
        self.forced: set[int] = set()
        self.pressed: set[Button] = set()
        self.spent = False


class OrderRefusedError(Exception):
    """An order that is not carried out.

    Attributes:
        text: Why, and what to do instead.
    """

    def __init__(self, text: Text) -> None:
        """Take the reason."""
        super().__init__(text.en)
        self.text = text

    @classmethod
    def because(cls, key: str, **values: object) -> Self:
        """Return a refusal with a reason of `replies.REPLIES`."""
        return cls(reply_text(key, **values))


def name_words(level: Level) -> list[int]:
    """Return the operator's name for the audit: ASCII, two characters a register, padded with zeros."""
    text = level.name.lower().encode("ascii").ljust(2 * NAME_WORDS, b"\0")[: 2 * NAME_WORDS]
    return [int.from_bytes(text[index : index + 2]) for index in range(0, len(text), 2)]


def obstacle_text(machine: Transplanter, memory: Memory, command: Command) -> Text | None:
    """Return why a command would be refused, as the memory stands; None = it is free."""
    for obstacle in machine.orders.obstacles(command.bit):
        if evaluate(obstacle.stands, memory):
            return refused_text(command, obstacle.reason)
    return None


def refused_text(command: Command, reason: Refusal) -> Text:
    """Return a refusal in both languages."""
    return Text(refusal_text(command, reason, "en"), refusal_text(command, reason, "zh"))
