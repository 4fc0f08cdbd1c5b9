"""Answers with the buttons: a long press of X0 means yes, of X24 no, for one question at a time.

The buttons answer only while a lamp or a panel shows the question. A press that answers sets the bit of the command
that gives the same answer, so that its conditions and refusals apply. X0 does not home while it may answer; X24 always
stops as well. X25 never answers.
"""

from __future__ import annotations

from enum import IntEnum, auto

from controller.common.modbus.io_map import IoMap
from controller.core.expr import TRUE, Bit, Expr, all_of, any_of
from controller.core.rungs import Mov, Rung, Set
from controller.program.operator.buttons import release_rungs, released
from controller.program.states import HOMED_FROM, State
from controller.program.tags import IN_PLACE, Tags


class Question(IntEnum):
    """Questions by the number of flashes of the amber lamp, the most urgent first."""

    LEFT_LOADED = auto()
    RIGHT_LOADED = auto()
    SAME_TRAY = auto()
    FULL_TRAY = auto()
    NO_TRAY = auto()
    CUPS_EMPTY = auto()


def asked(tags: Tags) -> dict[Question, Expr]:
    """Return the condition of each question."""
    tray, arms = tags.tray, tags.arms
    same = tray.ask & tray.edge & tray.phase.equals(IN_PLACE)
    return {
        Question.LEFT_LOADED: arms["left"].ask,
        Question.RIGHT_LOADED: arms["right"].ask,
        Question.SAME_TRAY: same,
        Question.FULL_TRAY: tray.ask & tray.edge,
        Question.NO_TRAY: tray.ask,
        Question.CUPS_EMPTY: any_of(*(arm.ask_cups for arm in arms.values())),
    }


def answers(tags: Tags) -> dict[Question, tuple[Bit, Bit | None]]:
    """Return the commands that X0 (yes) and X24 (no) give for each question.

    X24 never sends a tray away that is seen: the command is then refused (`refusals.Orders`).
    """
    commands = tags.commands
    return {
        Question.LEFT_LOADED: (commands.loaded_yes["left"], commands.loaded_no["left"]),
        Question.RIGHT_LOADED: (commands.loaded_yes["right"], commands.loaded_no["right"]),
        Question.SAME_TRAY: (commands.tray_same, commands.tray_none),
        Question.FULL_TRAY: (commands.tray_full, commands.tray_none),
        Question.NO_TRAY: (commands.tray_full, commands.tray_none),
        Question.CUPS_EMPTY: (commands.cups_empty, None),
    }


def shown(tags: Tags, io_map: IoMap) -> Expr:
    """Return the condition that a lamp or a panel shows the question."""
    return tags.system.panel_shown if io_map.get("lamp_amber") is None else TRUE


def answer_rungs(tags: Tags, io_map: IoMap) -> list[Rung]:
    """Return the rungs of the question register and of the buttons that answer it; they precede the refusals."""
    machine, x = tags.machine, tags.x
    state, question = machine.state, machine.question
    none = question.equals(0)
    at_rest = any_of(*(state.equals(each) for each in (*HOMED_FROM, State.STOPPING)))  # X24 stops while it answers
    cups = question.equals(Question.CUPS_EMPTY)
    changed = none | question.differs(machine.question_before)
    yes, no = released(machine.yes_due, x.start), released(machine.no_due, x.stop)
    rungs: list[Rung] = [
        Mov(question, machine.question_before),
        Mov(0, question),
        *(
            Mov(number, question, when=all_of(shown(tags, io_map), when, _answerable(tags, number, at_rest)))
            for number, when in reversed(asked(tags).items())
        ),
        Set(machine.yes_armed, when=machine.start_pressed & ~none),
        Set(machine.no_armed, when=all_of(machine.stop_button, ~none, ~cups)),
        *release_rungs(tags, changed),
    ]
    given: dict[Bit, list[Expr]] = {}
    for number, (positive, negative) in answers(tags).items():
        given.setdefault(positive, []).append(yes & question.equals(number))
        if negative is not None:
            given.setdefault(negative, []).append(no & question.equals(number))
    return [*rungs, *(Set(command, when=any_of(*presses)) for command, presses in given.items())]


def _answerable(tags: Tags, number: Question, at_rest: Expr) -> Expr:
    """Return the condition that the machine is in a state in which the buttons may answer."""
    machine = tags.machine
    return machine.running & ~machine.stepping if number is Question.CUPS_EMPTY else at_rest
