"""Requirement of the line that says what to do now: it names no key that is refused."""

from __future__ import annotations

from collections.abc import Iterator

from controller.core.expr import TRUE, all_of, any_of
from controller.core.specification import Requirement
from controller.program.machine import Transplanter
from controller.program.operator.answers import Question, asked
from controller.program.operator.next_press import answering, named_commands
from controller.program.states import HOMED_FROM


def of_presses(machine: Transplanter) -> Iterator[Requirement]:
    """Yield the requirement that no command is refused that the key in the line of this scan gives.

    For one scan, the line may name an answer to a question that this scan has ended, or whose state it has left; and a
    refused press of X24 shows what else to press, although X24 is still on.
    """
    tags, control = machine.tags, machine.tags.machine
    at_rest = any_of(*(control.state.equals(state) for state in HOMED_FROM))
    still_asked = {
        answering(question): when & (control.running if question is Question.CUPS_EMPTY else at_rest)
        for question, when in asked(tags).items()
    }
    refused = any_of(
        *(
            all_of(control.next_press.equals(press), still_asked.get(press, TRUE), ~machine.orders.free(command))
            for press, commands in named_commands(tags).items()
            for command in commands
        )
    )
    yield Requirement(
        "a refused key named",
        "whoever follows the line that says what to do now must get on",
        all_of(refused, ~(control.refused_now & tags.x.stop)),
    )
