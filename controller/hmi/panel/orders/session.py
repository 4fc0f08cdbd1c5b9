"""Browser sessions and refusals, common to all orders."""

from __future__ import annotations

from typing import Final, Literal, Self

from controller.core.devices import Memory
from controller.core.expr import evaluate
from controller.hmi.panel.modbus.mirror import R_FORCING_ALLOWED, Mirror
from controller.hmi.panel.orders.replies import reply_text
from controller.program.machine import Transplanter
from controller.program.operator.commands import Command
from controller.program.operator.refusals import refusal_text
from controller.program.states import Mode, State
from controller.program.tags import Tags
from controller.program.texts.operator import Text

Button = Literal["start", "stop", "emergency_stop", "reset"]
MOMENTARY: Final[tuple[Button, ...]] = ("start", "stop", "reset")
"""Spring-return buttons; the emergency stop latches."""


class BrowserSession:
    """Forced inputs and pressed buttons of one browser.

    Attributes:
        forced: Inputs forced by this browser, each as the numeric value of its octal label.
        pressed: Buttons of the operator box held by this browser.
        release_reason: Why a jog ended without a release, after which the button must be released; None otherwise.
        view_age_ms: Age of the view in which the last order was given, ms.
    """

    def __init__(self) -> None:
        """Initialise a session without forced inputs or pressed buttons."""
        self.forced: set[int] = set()
        self.pressed: set[Button] = set()
        self.release_reason: Text | None = None
        self.view_age_ms = 0


class OrderRefusedError(Exception):
    """Raised for a refused order.

    Attributes:
        text: Reason and remedy.
    """

    def __init__(self, text: Text) -> None:
        """Initialise the error with its reason."""
        super().__init__(text.en)
        self.text = text

    @classmethod
    def because(cls, key: str, **values: object) -> Self:
        """Return the error whose reason is stored under this key in `replies.REPLIES`."""
        return cls(reply_text(key, **values))


def force_obstacle(tags: Tags, mirror: Mirror) -> Text | None:
    """Return the reason why no input can be forced in the current state; None if inputs can be forced."""
    machine = tags.machine
    if not mirror.fresh:
        return reply_text("no controller")
    if not mirror.word(R_FORCING_ALLOWED):
        return reply_text("no forcing")
    state, mode = (mirror.memory.D[word.number] for word in (machine.state, machine.mode))
    return None if state == State.STOPPED and mode == Mode.MANUAL else reply_text("force only at rest")


def obstacle_text(machine: Transplanter, memory: Memory, command: Command) -> Text | None:
    """Return the reason why a command would be refused, or would do nothing, now; None if it is available."""
    if command.bit is machine.tags.commands.acknowledge and not evaluate(machine.tags.machine.horn, memory):
        return reply_text("horn is off")  # the program accepts the command
    for obstacle in machine.orders.obstacles(command.bit):
        if evaluate(obstacle.active, memory):
            return refusal_text(command, obstacle.reason)
    return None
