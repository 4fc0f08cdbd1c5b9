"""Line that says what to do now: the next useful press of the operator, shared by panel, console and tag list."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import IntEnum
from typing import Final

from controller.core.expr import FALSE, TRUE, Bit, Expr, Word, all_of, any_of
from controller.core.rungs import Add, Mov, Rung
from controller.program.alarms.table import Alarm
from controller.program.operator.answers import Question, asked
from controller.program.operator.buttons import due
from controller.program.operator.commands import Command
from controller.program.operator.refusals import Orders, Refusal, refusal_text
from controller.program.states import HOMED_FROM, Mode, State
from controller.program.tags import Tags
from controller.program.texts.next_press import IN_MODE, NEXT, NEXT_PRESSES, OF_ALARM
from controller.program.texts.operator import MODES, Text


class NextPress(IntEnum):
    """Presses by number; their texts are in `texts.next_press.NEXT_PRESSES`."""

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
    STOP_AND_HOME = 23
    CLOSE_GUARD = 24
    STAND_CLEAR = 25


_BEFORE_ANSWERS: Final = NextPress.ANSWER_LEFT_LOADED - Question.LEFT_LOADED
"""Difference between the number of a press that answers and the number of its question."""
_OF_MODE: Final = frozenset({NextPress.HOME, NextPress.START, NextPress.STEP})
"""Presses whose effect depends on the mode."""


def answering(question: Question) -> NextPress:
    """Return the press that answers a question."""
    return NextPress(question + _BEFORE_ANSWERS)


def _table(tags: Tags, orders: Orders) -> Iterator[tuple[NextPress, Expr]]:
    """Yield the presses with their conditions, the most urgent last."""
    machine, system, x, tray = tags.machine, tags.system, tags.x, tags.tray
    state = machine.state
    asking = any_of(tray.ask, *(arm.ask for arm in tags.arms.values()))
    at_rest = any_of(*(state.equals(each) for each in HOMED_FROM))
    answering_no = machine.no_armed & _any_question(tags)
    held, idle, aborted, suspended = (
        state.equals(each) for each in (State.HELD, State.IDLE, State.ABORTED, State.SUSPENDED)
    )
    faults = any_of(system.link_lost, system.scan_fault, system.store_fault, system.outputs_taken)
    yield NextPress.NONE, TRUE
    yield NextPress.HOME, at_rest
    by_hand = any_of(machine.held_by_operator, machine.held_by_panel, *([machine.lapsed] if tags.warns else []))
    yield NextPress.RESUME, all_of(held, by_hand, orders.free(tags.commands.unhold))
    yield NextPress.REPAIR_AND_HOME, at_rest & machine.fault
    yield NextPress.CONFIRM_CONSTANTS, at_rest & machine.constants_open
    yield NextPress.ANSWER_COMMAND, held & asking
    if x.guard_open is not FALSE:
        yield NextPress.CLOSE_GUARD, at_rest & x.guard_open
    yield NextPress.START, idle
    yield NextPress.STOP_AND_HOME, idle & ~orders.free(tags.commands.start)
    yield NextPress.LEAVE_ZERO_RETURN, idle & machine.mode.equals(Mode.ZERO_RETURN)
    yield NextPress.STEP, machine.running & machine.stepping
    yield NextPress.JOG, machine.jogging
    yield NextPress.SEARCH_TRAY, suspended & tray.missing
    yield NextPress.UNSUSPEND, machine.running & machine.suspended_by_operator
    if tags.warns:
        yield NextPress.STAND_CLEAR, machine.warning
    tried = machine.start_pressed | ~machine.refused_now  # a refused press of X24 itself shows what else to press
    yield NextPress.RELEASE_STOP, all_of(any_of(at_rest, idle, suspended), x.stop, ~answering_no, tried)
    yield NextPress.CLEAR, aborted
    yield NextPress.REMOVE_FAULT, aborted & faults
    yield NextPress.RELEASE_EMERGENCY_STOP, all_of(aborted, x.emergency_stop, ~system.link_lost)


def next_press_rungs(tags: Tags, orders: Orders) -> list[Rung]:
    """Return the rungs of the register with the next useful press; they follow the alarms of the scan."""
    machine = tags.machine
    answerable = ~machine.motion | machine.question.equals(Question.CUPS_EMPTY)  # others are refused until it ends
    asking = machine.question.differs(0) & _any_question(tags)  # the register of the question is older
    return [
        *(Mov(press, machine.next_press, when=when) for press, when in _table(tags, orders)),
        Add(machine.question, _BEFORE_ANSWERS, machine.next_press, when=all_of(asking, answerable, ~tags.x.guard_open)),
        Mov(NextPress.RELEASE_NOW, machine.next_press, when=any_of(*due(tags))),
    ]


def _any_question(tags: Tags) -> Expr:
    return any_of(*asked(tags).values())


def named_commands(tags: Tags) -> Mapping[NextPress, tuple[Bit, ...]]:
    """Return the commands that the buttons named in the text of a press give, or that the text names itself."""
    commands = tags.commands
    return {
        NextPress.HOME: (commands.reset,),
        NextPress.START: (commands.start,),
        NextPress.SEARCH_TRAY: (commands.start,),
        NextPress.STEP: (commands.step,),
        NextPress.CLEAR: (commands.clear,),
        NextPress.ANSWER_LEFT_LOADED: (commands.loaded_yes["left"], commands.loaded_no["left"]),
        NextPress.ANSWER_RIGHT_LOADED: (commands.loaded_yes["right"], commands.loaded_no["right"]),
        NextPress.ANSWER_SAME_TRAY: (commands.tray_same,),
        NextPress.ANSWER_FULL_TRAY: (commands.tray_full,),
        NextPress.ANSWER_NO_TRAY: (commands.tray_none,),
        NextPress.ANSWER_CUPS_EMPTY: (commands.cups_empty,),
        NextPress.REPAIR_AND_HOME: (commands.reset,),
        NextPress.RESUME: (commands.unhold, commands.reset),
        NextPress.UNSUSPEND: (commands.unsuspend, commands.stop),
        NextPress.JOG: (commands.stop,),
        NextPress.STOP_AND_HOME: (commands.stop,),
    }


def what_to_do(tags: Tags, alarms: Iterable[Alarm], read: Callable[[Bit | Word], int]) -> Text | None:
    """Return the line that says what to do now, from the next press, the mode and the alarm that stopped work.

    Args:
        tags: Tags of the program.
        alarms: Alarms of the program.
        read: Function that returns the value of a device.

    Returns:
        The line; None if no press is required.
    """
    machine = tags.machine
    press, mode, first_out = read(machine.next_press), read(machine.mode), read(machine.first_out)
    text = NEXT_PRESSES.get(press)
    if text is None or press == NextPress.NONE:
        return None
    alarm = next((each for each in alarms if each.bit.number == first_out), None)
    if press == NextPress.REPAIR_AND_HOME and alarm is not None:
        return OF_ALARM.filled(text=text, alarm=alarm.text.message)
    if press in _OF_MODE and mode in MODES and mode != Mode.CONTINUOUS:
        return IN_MODE.filled(text=text, mode=MODES[mode])
    return text


def refused_text(command: Command, reason: Refusal, line: Text | None) -> Text:
    """Return the message of a refused command: the reason, and the line that says what to do now, if there is one."""
    text = refusal_text(command, reason)
    return text if line is None else NEXT.filled(text=text, press=line)


def press_meanings() -> str:
    """Return the numbers of all presses with their English texts, for the tag list."""
    return "; ".join(f"{press.value} {NEXT_PRESSES[press].en}" for press in NextPress)


def question_meanings() -> str:
    """Return the numbers of the questions that the buttons answer, for the tag list."""
    names = (f"{number.value} {number.name.lower().replace('_', ' ')}" for number in Question)
    return f"question that X0 and X24 answer, also the number of flashes of the amber lamp: 0 none, {', '.join(names)}"
