"""Conditions of all commands and the reasons for refusing them, in one table.

A refused command has no effect; its number and the reason are stored in two registers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum, auto

from controller.common.declarations import Declared
from controller.core.expr import FALSE, Bit, Expr, all_of, any_of
from controller.core.rungs import Inc, Mov, Out, Rst, Rung
from controller.program.operator.buttons import released
from controller.program.operator.commands import Command
from controller.program.states import HOMED_FROM, MODE_CHANGES, RUNNING, STOPPABLE, Mode, State
from controller.program.tags import FORGOTTEN, IN_PLACE, SIDES, Side, Tags
from controller.program.texts.operator import CANNOT, ORDERS, REFUSALS, Text


class Refusal(IntEnum):
    """Reasons for refusals by number; their texts are in `texts.operator.REFUSALS`."""

    NOT_AT_REST = auto()
    NOT_IDLE = auto()
    NOT_RUNNING = auto()
    NOT_HELD = auto()
    NOT_SUSPENDED = auto()
    NOT_ABORTED = auto()
    NO_MODE_CHANGE = auto()
    MANUAL_ONLY_AT_REST = auto()
    NOT_STEPPING = auto()
    NOT_JOGGING = auto()
    MODE_MANUAL = auto()
    MODE_ZERO_RETURN = auto()
    STOP_PRESSED = auto()
    EMERGENCY_STOP = auto()
    LINK_LOST = auto()
    SCAN_FAULT = auto()
    STORE_FAULT = auto()
    ALARM = auto()
    QUESTION = auto()
    NOT_ASKED = auto()
    NO_TRAY_SEEN = auto()
    MOVING = auto()
    LEFT_NOT_AT_FEED = auto()
    LEFT_NOT_DOWN = auto()
    LEFT_NOT_UP = auto()
    LEFT_NOT_CONVERGED = auto()
    LEFT_NOT_OPEN = auto()
    LEFT_NOT_LOADED = auto()
    RIGHT_NOT_AT_FEED = auto()
    RIGHT_NOT_DOWN = auto()
    RIGHT_NOT_UP = auto()
    RIGHT_NOT_CONVERGED = auto()
    RIGHT_NOT_OPEN = auto()
    RIGHT_NOT_LOADED = auto()
    OUTPUTS_TAKEN = auto()
    NOT_STOPPABLE = auto()
    RELEASED_EARLY = auto()
    TRAY_SEEN = auto()
    ROW_IN_PROGRESS = auto()
    NOT_STOPPED = auto()
    OTHER_ARM_OUT = auto()
    CONSTANTS = auto()
    TRAY_UNKNOWN = auto()
    GUARD_OPEN = auto()
    MEMORY_VALID = auto()


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Reason to refuse a command while a condition is true."""

    reason: Refusal
    active: Expr


class Orders:
    """Requests for all commands, from buttons or bits, and their obstacles; the first active obstacle is reported."""

    def __init__(self, tags: Tags) -> None:
        self._tags = tags
        commands, machine, state = tags.commands, tags.machine, tags.machine.state
        at_rest = any_of(*(state.equals(s) for s in HOMED_FROM))
        steps_by_button = machine.start_pressed & machine.stepping & machine.running
        aborted = state.equals(State.ABORTED)
        start = machine.start_pressed & ~machine.yes_armed
        self.pressed: dict[Bit, Expr] = {
            commands.reset: any_of(
                commands.reset,
                machine.reset_released & ~aborted,
                start & at_rest,
            ),
            commands.start: commands.start | all_of(start, ~at_rest, ~steps_by_button),
            commands.stop: machine.stop_pressed,
            commands.clear: any_of(
                commands.clear,
                released(machine.clear_due, tags.x.stop),
                machine.reset_released & aborted,
            ),
            commands.step: commands.step | steps_by_button,
        }
        self._in_vain: dict[Bit, Expr] = {commands.clear: all_of(aborted, machine.stop_pressed, machine.abort)}
        """Presses of buttons that are always refused."""
        self._early: dict[Bit, Expr] = {
            commands.reset: machine.released_early & ~aborted,
            commands.clear: machine.released_early & aborted,
        }
        """Presses that end before the button has been held long enough."""
        self._obstacles = Declared("Orders._table", __name__, dict(self._table()))

    def accepted(self, command: Bit) -> Expr:
        """Return the condition that a command is requested and has no active obstacle."""
        return self.pressed.get(command, command) & self.free(command)

    def free(self, command: Bit) -> Expr:
        """Return the condition that a command has no active obstacle."""
        return all_of(*(~obstacle.active for obstacle in self._obstacles[command]))

    def obstacles(self, command: Bit) -> list[Obstacle]:
        """Return the obstacles of a command in the order in which they are reported."""
        return self._obstacles.get(command, [])

    def rungs(self) -> list[Rung]:
        """Return the rungs that report a refused command with its reason and reset its bit before it takes effect."""
        machine = self._tags.machine
        presses = {bit: self.pressed.get(bit, bit) for bit in self._obstacles}
        rungs: list[Rung] = [
            Out(machine.ordered, when=any_of(*presses.values(), *self._in_vain.values(), machine.released_early))
        ]
        refused: dict[Bit, Expr] = {}
        ineffective: dict[Bit, Expr] = {}
        for command in self._tags.commands:
            obstacles = self.obstacles(command.bit)
            if not obstacles:
                continue
            blocked = any_of(*(each.active for each in obstacles))
            ineffective[command.bit] = all_of(machine.ordered, presses[command.bit]) & blocked
            vain = self._in_vain.get(command.bit, FALSE)
            early = self._early.get(command.bit, FALSE)
            pressed = all_of(machine.ordered, presses[command.bit] | vain)
            refused[command.bit] = (pressed & blocked) | early
            rungs.append(Mov(command.number, machine.refused, when=refused[command.bit]))
            rungs += [Mov(each.reason, machine.refusal, when=pressed & each.active) for each in reversed(obstacles)]
            if early is not FALSE:
                rungs.append(Mov(Refusal.RELEASED_EARLY, machine.refusal, when=early))
        rungs += [
            Out(machine.refused_now, when=all_of(machine.ordered, any_of(*refused.values()))),
            Inc(machine.refusals, when=machine.refused_now),
        ]
        rungs += [Rst(bit, when=when) for bit, when in ineffective.items()]
        return [*rungs, Rst(machine.stop_pressed, when=ineffective[self._tags.commands.stop])]

    def _table(self) -> Iterator[tuple[Bit, list[Obstacle]]]:
        tags = self._tags
        commands, machine, state, x = tags.commands, tags.machine, tags.machine.state, tags.x
        stop = Obstacle(Refusal.STOP_PRESSED, x.stop)
        zero_return = Obstacle(Refusal.MODE_ZERO_RETURN, machine.mode.equals(Mode.ZERO_RETURN))
        manual = Obstacle(Refusal.MODE_MANUAL, machine.manual)
        asking = any_of(tags.tray.ask, *(arm.ask for arm in tags.arms.values()))
        questions = Obstacle(Refusal.QUESTION, asking & ~machine.manual)
        alarm = Obstacle(Refusal.ALARM, machine.fault & ~machine.manual)
        running = _only_in(Refusal.NOT_RUNNING, tags, *RUNNING)
        arms = [obstacle for side in SIDES for obstacle in self._arm_not_ready(side)]
        from_idle = [Obstacle(o.reason, all_of(state.equals(State.IDLE), o.active)) for o in (alarm, questions, *arms)]
        unconfirmed = Obstacle(Refusal.CONSTANTS, machine.constants_open)
        guard = [] if x.guard_open is FALSE else [Obstacle(Refusal.GUARD_OPEN, x.guard_open)]
        yield commands.reset, [_only_in(Refusal.NOT_AT_REST, tags, *HOMED_FROM), stop, *guard, unconfirmed]
        yield (
            commands.start,
            [_only_in(Refusal.NOT_IDLE, tags, State.IDLE, State.SUSPENDED), stop, *guard, zero_return, *from_idle],
        )
        answers_or_clears = machine.no_armed | (state.equals(State.ABORTED) & x.stop)
        if tags.warns:  # a stop ends the warning
            answers_or_clears = answers_or_clears | machine.warning
        ended = _only_in(Refusal.NOT_STOPPABLE, tags, *STOPPABLE).active
        yield commands.stop, [Obstacle(Refusal.NOT_STOPPABLE, ended & ~answers_or_clears)]
        yield commands.hold, [running]
        yield (
            commands.unhold,
            [
                _only_in(Refusal.NOT_HELD, tags, State.HELD),
                stop,
                *guard,
                zero_return,
                alarm,
                questions,
                *arms,
                self._tray(),
            ],
        )
        yield commands.suspend, [running, manual]
        yield commands.unsuspend, [Obstacle(Refusal.NOT_SUSPENDED, ~machine.suspended_by_operator)]
        yield commands.clear, self._clear()
        yield commands.complete, [running, manual]
        yield commands.empty_line, [running, manual]
        yield commands.new_machine, self._new_machine()
        begins = any_of(machine.home_requested, machine.start_requested, machine.unhold_requested)
        for mode, bit in commands.modes.items():
            leaves_home = machine.manual if mode is not Mode.MANUAL else ~machine.manual
            yield (
                bit,
                [
                    _only_in(Refusal.NO_MODE_CHANGE, tags, *MODE_CHANGES),
                    Obstacle(Refusal.MOVING, begins),
                    Obstacle(Refusal.MANUAL_ONLY_AT_REST, state.equals(State.IDLE) & leaves_home),
                ],
            )
        yield commands.step, [Obstacle(Refusal.NOT_STEPPING, ~(machine.stepping & machine.running))]
        yield from self._answers()
        yield from self._of_rows()
        for side in SIDES:
            yield from self._of_service(side)
        for bit in commands.jog.values():
            yield bit, [Obstacle(Refusal.NOT_JOGGING, ~machine.jogging)]

    def _clear(self) -> list[Obstacle]:
        system, x, commands = self._tags.system, self._tags.x, self._tags.commands
        return [
            _only_in(Refusal.NOT_ABORTED, self._tags, State.ABORTED),
            Obstacle(Refusal.EMERGENCY_STOP, (x.emergency_stop & ~system.link_lost) | commands.abort),
            Obstacle(Refusal.LINK_LOST, system.link_lost),
            Obstacle(Refusal.SCAN_FAULT, system.scan_fault),
            Obstacle(Refusal.STORE_FAULT, system.store_fault),
            Obstacle(Refusal.OUTPUTS_TAKEN, system.outputs_taken),
        ]

    def _answers(self) -> Iterator[tuple[Bit, list[Obstacle]]]:
        tags = self._tags
        commands, machine, tray, arms = tags.commands, tags.machine, tags.tray, tags.arms
        works = machine.motion & ~machine.resetting
        tray_asked = Obstacle(Refusal.NOT_ASKED, ~tray.ask)
        moving = Obstacle(Refusal.MOVING, works)
        seen = Obstacle(Refusal.NO_TRAY_SEEN, ~tray.edge)
        other_tray = Obstacle(Refusal.NO_TRAY_SEEN, tray.phase.differs(IN_PLACE))
        yield commands.cups_empty, [Obstacle(Refusal.NOT_ASKED, all_of(*(arm.count_valid for arm in arms.values())))]
        yield commands.tray_same, [tray_asked, moving, seen, other_tray]
        yield commands.tray_full, [tray_asked, moving, seen]
        # X24 and a lost memory cannot tell an empty tray from a full one
        unknown = tray.phase.equals(FORGOTTEN) | machine.no_armed
        yield commands.tray_none, [tray_asked, moving, Obstacle(Refusal.TRAY_SEEN, tray.edge & unknown)]
        for side, arm in arms.items():
            not_loaded = Refusal[f"{side.upper()}_NOT_LOADED"]
            asked = Obstacle(Refusal.NOT_ASKED, ~arm.ask)
            busy = Obstacle(Refusal.MOVING, ~arm.hears_answers)
            yield commands.loaded_yes[side], [asked, busy]
            yield commands.loaded_no[side], [asked, busy]
            yield (
                commands.discard[side],
                [
                    Obstacle(Refusal.MOVING, ~arm.hears_answers & ~machine.jogging),
                    Obstacle(Refusal.QUESTION, ~arm.hears_answers & arm.ask),
                    Obstacle(not_loaded, ~arm.loaded & ~arm.ask),
                ],
            )

    def _tray(self) -> Obstacle:
        """Return the obstacle of a tray that may have been moved in manual mode."""
        tray, automatic = self._tags.tray, ~self._tags.machine.manual
        return Obstacle(Refusal.TRAY_UNKNOWN, all_of(automatic, ~tray.place_known, tray.phase.equals(IN_PLACE)))

    def _of_rows(self) -> Iterator[tuple[Bit, list[Obstacle]]]:
        """Yield the obstacles of the commands that state which rows of the tray in place are empty or full."""
        tags = self._tags
        obstacles = [
            Obstacle(Refusal.MOVING, tags.machine.motion),
            Obstacle(Refusal.QUESTION, any_of(tags.tray.ask, *(arm.ask for arm in tags.arms.values()))),
            Obstacle(Refusal.NO_TRAY_SEEN, tags.tray.phase.differs(IN_PLACE) | ~tags.tray.edge),
            Obstacle(Refusal.ROW_IN_PROGRESS, any_of(*(arm.row_in_progress for arm in tags.arms.values()))),
        ]
        for rows in tags.commands.row_empty.values():
            yield from ((bit, obstacles) for bit in rows.values())
        yield tags.commands.rows_full, obstacles

    def _new_machine(self) -> list[Obstacle]:
        """Return the obstacles of the command that declares unknown memory as never written."""
        tags = self._tags
        return [
            Obstacle(Refusal.MEMORY_VALID, tags.tray.phase.differs(FORGOTTEN)),
            Obstacle(Refusal.MOVING, tags.machine.motion),
        ]

    def _of_service(self, side: Side) -> Iterator[tuple[Bit, list[Obstacle]]]:
        """Yield the obstacles of the commands that take an arm out of service and return it."""
        tags, commands = self._tags, self._tags.commands
        stopped = [
            _only_in(Refusal.NOT_STOPPED, tags, State.STOPPED),
            Obstacle(Refusal.MOVING, tags.machine.home_requested),
        ]
        yield (
            commands.out_of_service[side],
            [
                *stopped,
                Obstacle(Refusal.OTHER_ARM_OUT, tags.other(side).out_of_service),
                Obstacle(Refusal[f"{side.upper()}_NOT_AT_FEED"], ~tags.arms[side].at_feed),
            ],
        )
        yield commands.in_service[side], stopped

    def _arm_not_ready(self, side: Side) -> list[Obstacle]:
        """Return the obstacles of an arm that is not ready; a ready arm is empty at home, or loaded and up at feed."""
        arm, automatic = self._tags.arms[side], ~self._tags.machine.manual
        obstacles = {
            "NOT_AT_FEED": ~arm.at_feed,
            "NOT_DOWN": ~arm.loaded & ~arm.down,
            "NOT_UP": arm.loaded & ~arm.up,
            "NOT_CONVERGED": ~arm.loaded & ~arm.is_converged,
            "NOT_OPEN": ~arm.loaded & arm.claws_closed,
        }
        works = automatic & ~arm.out_of_service
        return [
            Obstacle(Refusal[f"{side.upper()}_{name}"], (automatic if name == "NOT_AT_FEED" else works) & active)
            for name, active in obstacles.items()
        ]


def _only_in(reason: Refusal, tags: Tags, *states: State) -> Obstacle:
    return Obstacle(reason, all_of(*(tags.machine.state.differs(state) for state in states)))


def refusal_text(command: Command, reason: Refusal) -> Text:
    """Return the message for the operator, for example 'cannot start: left lift not down'."""
    return CANNOT.filled(order=ORDERS[command.group], reason=REFUSALS[reason.name])
