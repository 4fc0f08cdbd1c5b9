"""Next useful press of the operator, as a number that screen, console, lamp and tag list share."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import Final

from controller.core.expr import TRUE, Expr, all_of, any_of
from controller.core.rungs import Add, Mov, Rung
from controller.program.operator.answers import Question
from controller.program.operator.buttons import due
from controller.program.operator.commands import Command
from controller.program.operator.refusals import Refusal, refusal_text
from controller.program.states import HOMED_FROM, Mode, State
from controller.program.tags import Tags
from controller.program.texts.operator import IN_MODE, MODES, NEXT, NEXT_PRESSES, Text


class NextPress(IntEnum):
    """Presses by number; their texts are in `texts.operator.NEXT_PRESSES`."""

    NONE = 0
    HOME = 1
    START = 2
    SEARCH_TRAY = 3
    STEP = 4
    CLEAR = 5
    RELEASE_EMERGENCY_STOP = 6
    REMOVE_FAULT = 7
    RELEASE_STOP = 8
    ANSWER_LEFT_LOADED = 9
    ANSWER_RIGHT_LOADED = 10
    ANSWER_SAME_TRAY = 11
    ANSWER_FULL_TRAY = 12
    ANSWER_NO_TRAY = 13
    ANSWER_CUPS_EMPTY = 14
    ANSWER_COMMAND = 15
    REPAIR_AND_HOME = 16
    RESUME = 17
    LEAVE_ZERO_RETURN = 18
    UNSUSPEND = 19
    JOG = 20
    RELEASE_NOW = 21
    CONFIRM_CONSTANTS = 22


_BEFORE_ANSWERS: Final = NextPress.ANSWER_LEFT_LOADED - Question.LEFT_LOADED
"""Difference between the number of a press that answers and the number of its question."""


def _table(tags: Tags) -> Iterator[tuple[NextPress, Expr]]:
    """Yield the presses with their conditions, the most urgent last."""
    machine, system, x, tray = tags.machine, tags.system, tags.x, tags.tray
    state = machine.state
    asking = any_of(tray.ask, *(arm.ask for arm in tags.arms.values()))
    at_rest = any_of(*(state.equals(each) for each in HOMED_FROM))
    held, idle, aborted = (state.equals(each) for each in (State.HELD, State.IDLE, State.ABORTED))
    faults = any_of(system.link_lost, system.scan_fault, system.store_fault, system.outputs_taken)
    yield NextPress.NONE, TRUE
    yield NextPress.HOME, at_rest
    yield NextPress.RESUME, held & (machine.held_by_operator | machine.held_by_panel)
    yield NextPress.REPAIR_AND_HOME, at_rest & machine.fault
    yield NextPress.CONFIRM_CONSTANTS, at_rest & machine.constants_open
    yield NextPress.ANSWER_COMMAND, held & asking
    yield NextPress.START, idle
    yield NextPress.LEAVE_ZERO_RETURN, idle & machine.mode.equals(Mode.ZERO_RETURN)
    yield NextPress.STEP, machine.running & machine.stepping
    yield NextPress.JOG, machine.jogging
    yield NextPress.SEARCH_TRAY, state.equals(State.SUSPENDED) & tray.missing
    yield NextPress.UNSUSPEND, machine.running & machine.suspended_by_operator
    tried = machine.start_pressed | ~machine.refused_now  # a refused press of X24 itself shows what else to press
    yield NextPress.RELEASE_STOP, all_of(at_rest | idle, x.stop, ~machine.no_armed, tried)
    yield NextPress.CLEAR, aborted
    yield NextPress.REMOVE_FAULT, aborted & faults
    yield NextPress.RELEASE_EMERGENCY_STOP, all_of(aborted, x.emergency_stop, ~system.link_lost)


def next_press_rungs(tags: Tags) -> list[Rung]:
    """Return the rungs of the register with the next useful press; they follow the state of this scan."""
    machine = tags.machine
    return [
        *(Mov(press, machine.next_press, when=when) for press, when in _table(tags)),
        Add(machine.question, _BEFORE_ANSWERS, machine.next_press, when=machine.question.differs(0)),
        Mov(NextPress.RELEASE_NOW, machine.next_press, when=any_of(*due(tags))),
    ]


def press_text(press: int, mode: int) -> Text:
    """Return the next useful press for the operator, with the mode if it is not continuous."""
    text = NEXT_PRESSES.get(press, NEXT_PRESSES[NextPress.NONE])
    if press not in {NextPress.HOME, NextPress.START, NextPress.STEP} or mode not in MODES or mode == Mode.CONTINUOUS:
        return text
    name = MODES[mode]
    return Text(IN_MODE.en.format(text=text.en, mode=name.en), IN_MODE.zh.format(text=text.zh, mode=name.zh))


def refused_press_text(command: Command, reason: Refusal, press: int, mode: int) -> Text:
    """Return the message of a refused press: the reason and the next useful press, if there is one."""
    text = Text(refusal_text(command, reason, "en"), refusal_text(command, reason, "zh"))
    if press == NextPress.NONE:
        return text
    following = press_text(press, mode)
    return Text(NEXT.en.format(text=text.en, press=following.en), NEXT.zh.format(text=text.zh, press=following.zh))


def press_meanings() -> str:
    """Return the numbers of all presses with their English texts, for the tag list."""
    return "; ".join(f"{press.value} {NEXT_PRESSES[press].en}" for press in NextPress)


def question_meanings() -> str:
    """Return the numbers of the questions that the buttons answer, for the tag list."""
    names = (f"{number.value} {number.name.lower().replace('_', ' ')}" for number in Question)
    return f"question that X0 and X24 answer, also the number of flashes of the amber lamp: 0 none, {', '.join(names)}"
