"""PackML: the state of the machine as a number in one register, and the rows that change it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from controller.core.expr import FALSE, TRUE, Bit, Expr, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Mov, OnDelay, Out, Pulse, Rst, Rung, Set
from controller.program.tags import FIRST_SCAN, Tags

CLEAR_HOLD_MS = 3_000


class State(IntEnum):
    """PackML state numbers (FX.md 5)."""

    CLEARING = 1
    STOPPED = 2
    STARTING = 3
    IDLE = 4
    SUSPENDED = 5
    EXECUTE = 6
    STOPPING = 7
    ABORTING = 8
    ABORTED = 9
    HOLDING = 10
    HELD = 11
    SUSPENDING = 13
    UNSUSPENDING = 14
    RESETTING = 15
    COMPLETING = 16
    COMPLETE = 17


class Reason(IntEnum):
    """Why the machine is Suspended."""

    NONE = 0
    NO_TRAY = 1
    NO_CUPS_LEFT = 2
    NO_CUPS_RIGHT = 3
    NO_CUPS = 4


RUNNING = (State.STARTING, State.EXECUTE, State.SUSPENDING, State.SUSPENDED, State.UNSUSPENDING)
MOVING = (*RUNNING, State.RESETTING, State.STOPPING, State.HOLDING, State.COMPLETING)
"""States in which actuators may move."""
STOPPABLE = (*RUNNING, State.RESETTING, State.IDLE, State.HOLDING, State.HELD, State.COMPLETING,
             State.COMPLETE)  # fmt: skip


@dataclass(frozen=True, slots=True)
class StateChange:
    """One row of the state table: from any of these states to another. Later rows win over earlier ones."""

    sources: tuple[State, ...]
    target: State
    when: Expr
    reason: str


def state_table(tags: Tags) -> list[StateChange]:
    """Return the PackML table of this machine, in rising order of priority."""
    machine, arms, tray = tags.machine, tags.arms, tags.tray
    at_rest = all_of(*(arm.at_rest for arm in arms.values()))
    empty = all_of(*(~arm.loaded for arm in arms.values()))
    homed = all_of(*(arm.homed for arm in arms.values()))
    asking = any_of(tray.ask, *(arm.ask for arm in arms.values()))
    settled = all_of(*(arm.homed | arm.fault | arm.ask for arm in arms.values()))
    one_cycle = tags.sp.mode.equals(2) & all_of(*(arm.cycle_done for arm in arms.values()))
    s = State
    return [
        StateChange((s.STOPPED, s.HELD, s.COMPLETE), s.RESETTING, machine.home_requested, "reset and home"),
        StateChange((s.RESETTING,), s.IDLE, homed & tray.ready & ~asking, "homed"),
        StateChange((s.RESETTING,), s.HOLDING, (asking | machine.fault) & settled, "cannot go on: question or alarm"),
        StateChange((s.IDLE,), s.STARTING, machine.start_requested, "start"),
        StateChange((s.STARTING,), s.EXECUTE, TRUE, "started"),
        StateChange((s.EXECUTE,), s.SUSPENDING, machine.suspend, "no tray or no cups"),
        StateChange((s.SUSPENDING,), s.SUSPENDED, TRUE, "suspended"),
        StateChange((s.SUSPENDED,), s.UNSUSPENDING, ~machine.suspend, "tray and cups are there"),
        StateChange((s.UNSUSPENDING,), s.EXECUTE, TRUE, "goes on"),
        StateChange((s.EXECUTE,), s.COMPLETING, at_rest & empty & (machine.target_reached | one_cycle), "work done"),
        StateChange((s.COMPLETING,), s.COMPLETE, at_rest & tray.at_rest, "arms home"),
        StateChange((*RUNNING, s.COMPLETING), s.HOLDING, machine.fault, "alarm"),
        StateChange((s.HOLDING,), s.HELD, at_rest & tray.at_rest, "other arm at feed"),
        StateChange(STOPPABLE, s.STOPPING, machine.stop_pressed, "stop"),
        StateChange((s.STOPPING,), s.STOPPED, at_rest & tray.at_rest, "arms home or parked"),
        StateChange((s.CLEARING,), s.STOPPED, TRUE, "cleared"),
        StateChange((s.ABORTED,), s.CLEARING, machine.clear_requested, "clear"),
        StateChange((s.ABORTING,), s.ABORTED, TRUE, "outputs off"),
        StateChange(tuple(state for state in s if state not in {s.ABORTING, s.ABORTED}), s.ABORTING, machine.abort,
                    "emergency stop, link or scan fault"),
    ]  # fmt: skip


def conditioning(tags: Tags) -> list[Rung]:
    """Return the rungs that turn buttons and command bits into requests."""
    x, system, machine, commands = tags.x, tags.system, tags.machine, tags.commands
    state = machine.state
    rest = any_of(*(state.equals(s) for s in (State.STOPPED, State.HELD, State.COMPLETE)))
    ready = state.equals(State.IDLE) | state.equals(State.SUSPENDED)
    button = x.optional("reset")
    reset = FALSE if button is None else button
    return [
        # A button held while the power comes gives its edge in the first scan, where it counts for nothing.
        Pulse(machine.start_pressed, when=x.start),
        Pulse(machine.stop_pressed, when=x.stop | commands.stop),
        Pulse(machine.reset_pressed, when=reset),
        *(
            Rst(button, when=FIRST_SCAN)
            for button in (machine.start_pressed, machine.stop_pressed, machine.reset_pressed)
        ),
        Out(machine.abort, when=any_of(x.emergency_stop, system.link_lost, system.scan_fault, system.store_fault)),
        Set(machine.clear_armed, when=machine.stop_pressed & state.equals(State.ABORTED)),
        Rst(machine.clear_armed, when=~x.stop | machine.abort | state.differs(State.ABORTED)),
        OnDelay(machine.stop_held, CLEAR_HOLD_MS, when=machine.clear_armed),
        Out(
            machine.clear_requested,
            when=all_of(
                state.equals(State.ABORTED),
                ~machine.abort,
                machine.stop_held.done | commands.clear | machine.reset_pressed,
            ),
        ),
        Out(
            machine.home_requested,
            when=all_of(rest, ~x.stop, machine.start_pressed | commands.reset | machine.reset_pressed),
        ),
        Out(machine.start_requested, when=all_of(ready, ~x.stop, machine.start_pressed | commands.start)),
    ]


def _reason(tags: Tags) -> list[Rung]:
    """Say in one register why the machine cannot work on: no tray before no cups."""
    reason = tags.machine.reason
    left, right = tags.arms["left"].no_cups, tags.arms["right"].no_cups
    return [
        Mov(Reason.NONE, reason),
        Mov(Reason.NO_CUPS_LEFT, reason, when=left),
        Mov(Reason.NO_CUPS_RIGHT, reason, when=right),
        Mov(Reason.NO_CUPS, reason, when=left & right),
        Mov(Reason.NO_TRAY, reason, when=tags.tray.missing),
    ]


def mode_block(tags: Tags, table: list[StateChange]) -> Block:
    """Return the block that finds this scan's state and what follows from it."""
    machine, arms, tray = tags.machine, tags.arms, tags.tray
    state, before = machine.state, machine.state_before

    def entered(bit: Bit, target: State) -> Out:
        return Out(bit, when=state.equals(target) & before.differs(target))

    rungs: list[Rung] = [
        Out(machine.suspend, when=any_of(tray.missing, *(arm.no_cups for arm in arms.values()))),
        *_reason(tags),
        Mov(state, before),
        Mov(State.STOPPED, state, when=FIRST_SCAN),
    ]
    rungs += [Mov(row.target, state, when=any_of(*(before.equals(s) for s in row.sources)) & row.when) for row in table]
    rungs += [
        entered(machine.entered_resetting, State.RESETTING),
        entered(machine.entered_starting, State.STARTING),
        Set(machine.batch_complete, when=state.equals(State.COMPLETE) & machine.target_reached),
        Rst(machine.trays_done, when=machine.entered_resetting & machine.batch_complete),
        Rst(machine.batch_complete, when=machine.entered_resetting),
        Out(machine.resetting, when=state.equals(State.RESETTING)),
        Out(machine.executing, when=state.equals(State.EXECUTE)),
        Out(machine.stopping, when=state.equals(State.STOPPING)),
        Out(machine.holding, when=state.equals(State.HOLDING)),
        Out(machine.running, when=any_of(*(state.equals(s) for s in RUNNING))),
        Out(machine.motion, when=any_of(*(state.equals(s) for s in MOVING)) & ~machine.abort),
    ]
    return Block("modes", tuple(rungs))
