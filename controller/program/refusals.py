"""Conditions of all commands and the reasons for refusing them, in one table.

A refused command has no effect; its number and the reason are stored in two registers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum, auto

from controller.core.expr import Bit, Expr, all_of, any_of
from controller.core.rungs import Inc, Mov, Out, Rst, Rung
from controller.program.commands import Command
from controller.program.states import HOMED_FROM, MODE_CHANGES, RUNNING, Mode, State
from controller.program.tags import IN_PLACE, SIDES, Side, Tags
from controller.program.texts.operator import CANNOT, ORDERS, REFUSALS, Language


class Refusal(IntEnum):
    """Reasons for refusals by number; their texts are in `texts.REFUSALS`."""

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
        self.pressed: dict[Bit, Expr] = {
            commands.reset: any_of(
                commands.reset, machine.reset_pressed & ~state.equals(State.ABORTED), machine.start_pressed & at_rest
            ),
            commands.start: commands.start | all_of(machine.start_pressed, ~at_rest, ~steps_by_button),
            commands.clear: any_of(
                commands.clear, machine.stop_held.done, machine.reset_pressed & state.equals(State.ABORTED)
            ),
            commands.step: commands.step | steps_by_button,
        }
        self._obstacles = dict(self._table())

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
        rungs: list[Rung] = [Out(machine.ordered, when=any_of(*presses.values()))]
        refused: dict[Bit, Expr] = {}
        for command in self._tags.commands:
            obstacles = self.obstacles(command.bit)
            if not obstacles:
                continue
            pressed = all_of(machine.ordered, presses[command.bit])
            refused[command.bit] = pressed & any_of(*(each.active for each in obstacles))
            rungs.append(Mov(command.number, machine.refused, when=refused[command.bit]))
            rungs += [Mov(each.reason, machine.refusal, when=pressed & each.active) for each in reversed(obstacles)]
        rungs.append(Inc(machine.refusals, when=all_of(machine.ordered, any_of(*refused.values()))))
        return [*rungs, *(Rst(bit, when=when) for bit, when in refused.items())]

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
        yield commands.reset, [_only_in(Refusal.NOT_AT_REST, tags, *HOMED_FROM), stop]
        yield (
            commands.start,
            [_only_in(Refusal.NOT_IDLE, tags, State.IDLE, State.SUSPENDED), stop, zero_return, *from_idle],
        )
        yield commands.hold, [running]
        yield (
            commands.unhold,
            [_only_in(Refusal.NOT_HELD, tags, State.HELD), stop, zero_return, alarm, questions, *arms],
        )
        yield commands.suspend, [running, manual]
        yield commands.unsuspend, [Obstacle(Refusal.NOT_SUSPENDED, ~machine.suspended_by_operator)]
        yield commands.clear, self._clear()
        yield commands.complete, [running, manual]
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
        yield commands.tray_none, [tray_asked, moving]
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
                    Obstacle(not_loaded, ~arm.loaded & ~arm.ask),
                ],
            )

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
        return [Obstacle(Refusal[f"{side.upper()}_{name}"], automatic & active) for name, active in obstacles.items()]


def _only_in(reason: Refusal, tags: Tags, *states: State) -> Obstacle:
    return Obstacle(reason, all_of(*(tags.machine.state.differs(state) for state in states)))


def refusal_text(command: Command, reason: Refusal, language: Language) -> str:
    """Return the message for the operator, for example 'cannot start: left lift not down'."""
    order, why, form = (getattr(text, language) for text in (ORDERS[command.group], REFUSALS[reason.name], CANNOT))
    return str(form.format(order=order, reason=why))
