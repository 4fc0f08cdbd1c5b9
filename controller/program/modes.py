"""PackML state machine: a state number in one register, and the transition table."""

from __future__ import annotations

from dataclasses import dataclass

from controller.common.modbus.io_map import IoMap
from controller.core.expr import FALSE, TRUE, Expr, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Mov, OnDelay, Out, Pulse, Rst, Rung, Set, ZoneReset
from controller.program.operator.answers import answer_rungs
from controller.program.operator.buttons import disarm_rungs, edge_rungs
from controller.program.operator.commands import JOG_LEASE_MS
from controller.program.operator.constants import constant_rungs
from controller.program.operator.refusals import Orders
from controller.program.operator.start_warning import cancel_rungs, lapse_rungs, request_rungs
from controller.program.states import HOLDS, MOVING, RUNNING, STOPPABLE, Mode, Reason, State
from controller.program.tags import FIRST_SCAN, FORGOTTEN, IN_PLACE, MOVING_OUT, STEPPED, Tags

STEP_PRESS_MS = 2_000
"""Time after which an unused press in step mode expires, ms, so that motion does not start long after the press."""
NO_MOTION_MS = 300
"""Time without motion, and with inputs that are read, after which a place ends with its switch, ms; longer than input
filters and the stroke of an actuator that comes to rest."""


@dataclass(frozen=True, slots=True)
class StateChange:
    """One row of the state table: a transition from any of the source states. Later rows have priority."""

    sources: tuple[State, ...]
    target: State
    when: Expr
    reason: str


def state_table(tags: Tags) -> list[StateChange]:
    """Return the PackML table of this machine in ascending order of priority."""
    machine, arms, tray = tags.machine, tags.arms, tags.tray
    manual, at_once = machine.manual, machine.stops_at_once
    # an arm with a permit from the last scan has started since `at_rest` was evaluated
    at_rest = all_of(*(arm.at_rest & ~arm.permit for arm in arms.values()))
    empty = all_of(*(~arm.loaded | arm.out_of_service for arm in arms.values()))
    homed = all_of(*(arm.homed for arm in arms.values()))
    asking = any_of(tray.ask, *(arm.ask for arm in arms.values()))
    settled = all_of(*(arm.homed | arm.fault | arm.ask for arm in arms.values()))
    one_cycle = machine.mode.equals(Mode.ONE_CYCLE) & all_of(
        *(arm.cycle_done | arm.out_of_service for arm in arms.values())
    )
    tray_left = all_of(tray.phase.differs(IN_PLACE), tray.phase.differs(MOVING_OUT), tray.at_rest)
    done = machine.target_reached | one_cycle | (machine.complete_ordered & (~machine.emptying | tray_left))
    rest = at_rest & tray.at_rest
    s = State
    guard = [
        StateChange(
            (*RUNNING, s.RESETTING, s.HOLDING, s.COMPLETING), s.HELD, tags.x.guard_open, "guard opened during motion"
        ),
        StateChange((s.IDLE, s.STOPPING), s.STOPPED, tags.x.guard_open, "guard opened"),
    ]
    return [
        StateChange((s.STOPPED, s.HELD, s.COMPLETE), s.RESETTING, machine.home_requested, "reset and homing"),
        StateChange((s.RESETTING,), s.IDLE, manual | (homed & tray.ready & ~asking), "homed, or mode is manual"),
        StateChange(
            (s.RESETTING,),
            s.HOLDING,
            all_of(~manual, asking | machine.fault, settled),
            "blocked by a question or an alarm",
        ),
        StateChange((s.IDLE,), s.STARTING, machine.start_requested, "start"),
        StateChange((s.STARTING,), s.EXECUTE, TRUE, "started"),
        StateChange((s.HELD,), s.UNHOLDING, machine.unhold_requested, "resume after a hold"),
        StateChange((s.UNHOLDING,), s.EXECUTE, TRUE, "resumed"),
        StateChange((s.EXECUTE,), s.SUSPENDING, machine.suspend, "no tray, no cups, or suspend command"),
        StateChange((s.SUSPENDING,), s.SUSPENDED, TRUE, "suspended"),
        StateChange(
            (s.SUSPENDED,),
            s.UNSUSPENDING,
            ~machine.suspend & machine.t_warning.done if tags.warns else ~machine.suspend,
            "tray and cups available, and not suspended by the operator",
        ),
        StateChange((s.UNSUSPENDING,), s.EXECUTE, TRUE, "resumed"),
        StateChange((s.EXECUTE,), s.COMPLETING, all_of(~manual, at_rest, empty, done), "work complete"),
        StateChange((s.COMPLETING,), s.COMPLETE, rest, "arms home"),
        StateChange(
            (*RUNNING, s.COMPLETING),
            s.HOLDING,
            (machine.fault & ~manual) | machine.hold_requested,
            "alarm, hold command or panel timeout",
        ),
        StateChange((s.HOLDING,), s.HELD, at_once | rest, "arms at feed"),
        *(row for row in guard if row.when is not FALSE),
        StateChange(STOPPABLE, s.STOPPING, machine.stop_pressed, "stop"),
        StateChange((s.STOPPING,), s.STOPPED, at_once | rest, "arms home or parked"),
        StateChange((s.CLEARING,), s.STOPPED, TRUE, "cleared"),
        StateChange((s.ABORTED,), s.CLEARING, machine.clear_requested, "clear"),
        StateChange((s.ABORTING,), s.ABORTED, TRUE, "outputs off"),
        StateChange(
            tuple(state for state in s if state not in {s.ABORTING, s.ABORTED}),
            s.ABORTING,
            machine.abort,
            "emergency stop, abort command, fault of link, scan or store, or outputs taken over",
        ),
    ]


def conditioning(tags: Tags, orders: Orders, io_map: IoMap) -> list[Rung]:
    """Return the rungs that turn buttons and command bits into requests; see `refusals` for their conditions."""
    x, system, machine, commands = tags.x, tags.system, tags.machine, tags.commands
    faults = any_of(system.link_lost, system.scan_fault, system.store_fault, system.outputs_taken)
    accepted = orders.accepted
    return [
        Mov(FORGOTTEN, tags.tray.phase, when=FIRST_SCAN & system.memory_lost),  # before questions and refusals
        *edge_rungs(tags),
        Out(machine.abort, when=any_of(x.emergency_stop, commands.abort, faults)),
        *constant_rungs(tags),
        *answer_rungs(tags, io_map),
        Out(machine.clear_requested, when=accepted(commands.clear)),
        *request_rungs(tags, orders),
        *orders.rungs(),  # before an accepted command changes the conditions of another
        *disarm_rungs(tags),
        *_holds(tags, orders),
        *cancel_rungs(tags),
        *_service(tags, orders),
        *_jog(tags, orders),
        *_step_presses(tags, orders),
        *(Mov(mode, machine.mode, when=accepted(bit)) for mode, bit in commands.modes.items()),
        Mov(Mode.CONTINUOUS, machine.mode, when=FIRST_SCAN & machine.mode.equals(0)),
    ]


def _holds(tags: Tags, orders: Orders) -> list[Rung]:
    """Return the hold and suspend rungs, triggered by a command or by a panel that no longer responds."""
    system, machine, commands, state = tags.system, tags.machine, tags.commands, tags.machine.state
    lapsed = machine.t_lapse.done if tags.warns else FALSE
    ends = any_of(*(state.equals(s) for s in (State.STOPPED, State.RESETTING, State.COMPLETE, State.ABORTED)))
    return [
        Pulse(machine.panel_lost, when=system.panel_silent),
        Set(machine.held_by_panel, when=machine.panel_lost & machine.running),
        Set(machine.held_by_operator, when=orders.accepted(commands.hold)),
        Out(machine.hold_requested, when=any_of(orders.accepted(commands.hold), machine.panel_lost, lapsed)),
        Rst(machine.suspended_by_operator, when=ends | orders.accepted(commands.unsuspend)),
        Set(machine.suspended_by_operator, when=orders.accepted(commands.suspend)),
        Rst(machine.complete_ordered, when=ends),
        Set(machine.complete_ordered, when=orders.accepted(commands.complete) | orders.accepted(commands.empty_line)),
        Rst(machine.emptying, when=ends),
        Set(machine.emptying, when=orders.accepted(commands.empty_line)),
    ]


def _service(tags: Tags, orders: Orders) -> list[Rung]:
    """Return the rungs that take an arm out of service and return it."""
    commands = tags.commands
    return [
        rung
        for side, arm in tags.arms.items()
        for rung in (
            Set(arm.out_of_service, when=orders.accepted(commands.out_of_service[side])),
            Rst(arm.out_of_service, when=orders.accepted(commands.in_service[side])),
        )
    ]


def _jog(tags: Tags, orders: Orders) -> list[Rung]:
    """Return the jog rungs: one output at a time is on while its command is renewed."""
    machine, commands = tags.machine, tags.commands
    return [
        Out(machine.jog_renewed, when=any_of(*(orders.accepted(bit) for bit in commands.jog.values()))),
        *(Mov(1 + n, machine.jog, when=machine.jog_renewed & bit) for n, bit in enumerate(commands.jog.values())),
        OnDelay(machine.t_jog_lease, JOG_LEASE_MS, when=machine.jog.differs(0) & ~machine.jog_renewed),
        Mov(0, machine.jog, when=any_of(machine.t_jog_lease.done, commands.jog_release, ~machine.jogging)),
    ]


def _step_presses(tags: Tags, orders: Orders) -> list[Rung]:
    """Return the rungs of step mode: a press arms the next transfer of the selected sequence for a limited time."""
    machine, armed = tags.machine, tags.machine.step_armed
    press = orders.accepted(tags.commands.step)
    first, *_, last = armed.values()
    return [
        OnDelay(machine.t_step_press, STEP_PRESS_MS, when=any_of(*armed.values()) & ~press),
        ZoneReset(first, last, when=any_of(press, machine.t_step_press.done, ~machine.stepping)),
        *(Set(armed[name], when=press & tags.sp.step_sequence.equals(1 + n)) for n, name in enumerate(STEPPED)),
    ]


def _reason(tags: Tags) -> list[Rung]:
    """Return the rungs of the reason register; if several reasons apply, it contains the one to resolve first."""
    machine, reason, guard = tags.machine, tags.machine.reason, tags.x.guard_open
    held = any_of(*(machine.state.equals(s) for s in HOLDS))
    left, right = tags.arms["left"].no_cups, tags.arms["right"].no_cups
    asking = any_of(tags.tray.ask, *(arm.ask for arm in tags.arms.values()))
    return [
        Mov(Reason.NONE, reason),
        Mov(Reason.NO_CUPS_LEFT, reason, when=left),
        Mov(Reason.NO_CUPS_RIGHT, reason, when=right),
        Mov(Reason.NO_CUPS, reason, when=left & right),
        Mov(Reason.NO_TRAY, reason, when=tags.tray.missing),
        Mov(Reason.SUSPENDED_BY_OPERATOR, reason, when=machine.suspended_by_operator),
        Mov(Reason.HELD_BY_OPERATOR, reason, when=held & machine.held_by_operator),
        Mov(Reason.PANEL_SILENT, reason, when=held & machine.held_by_panel),
        *([Mov(Reason.ORDER_LAPSED, reason, when=held & machine.lapsed)] if tags.warns else []),
        Mov(Reason.QUESTION, reason, when=held & asking),
        Mov(Reason.ALARM, reason, when=held & machine.fault),
        *([] if guard is FALSE else [Mov(Reason.GUARD_OPEN, reason, when=held & guard)]),
        ZoneReset(machine.held_by_operator, machine.held_by_panel, when=~held),
    ]


def _guard(tags: Tags) -> list[Rung]:
    """Return the rungs of the guard, which precede the relay of motion; none without its input."""
    machine, opened = tags.machine, tags.x.guard_open
    if opened is FALSE:
        return []
    return [Out(machine.guard_open, when=opened), Out(machine.guard_stops, when=opened & machine.motion)]


def _line_clear(tags: Tags) -> Expr:
    """Return the condition that the tray may be conveyed out to empty the line: no arm is over it, loaded or starting.

    An arm with a permit from the last scan has started since `cycling` was evaluated.
    """
    machine = tags.machine
    clear = (
        all_of(arm.at_feed, ~arm.cycling, ~arm.permit, ~arm.loaded | arm.out_of_service) for arm in tags.arms.values()
    )
    return all_of(machine.emptying, machine.complete_ordered, machine.executing, *clear)


def mode_block(tags: Tags, table: list[StateChange]) -> Block:
    """Return the block that determines the state of this scan and the bits derived from it."""
    machine, arms, tray = tags.machine, tags.arms, tags.tray
    state, before, mode = machine.state, machine.state_before, machine.mode
    no_cups = any_of(*(arm.no_cups for arm in arms.values())) & ~machine.stepping

    def entered(target: State) -> Expr:
        return state.equals(target) & before.differs(target)

    rungs: list[Rung] = [
        Out(machine.manual, when=mode.equals(Mode.MANUAL)),
        Out(machine.stops_at_once, when=machine.manual | mode.equals(Mode.STEP)),
        Out(machine.suspend, when=any_of(tray.missing, no_cups, machine.suspended_by_operator)),
        Mov(state, before),
        Mov(State.STOPPED, state, when=FIRST_SCAN),
    ]
    rungs += [Mov(row.target, state, when=row.when & any_of(*(before.equals(s) for s in row.sources))) for row in table]
    rungs += [
        *_reason(tags),
        *_guard(tags),
        Out(machine.entered_resetting, when=entered(State.RESETTING)),
        Out(machine.places_anew, when=FIRST_SCAN | machine.entered_resetting),
        Out(machine.entered_starting, when=entered(State.STARTING) | entered(State.UNHOLDING)),
        Set(machine.batch_complete, when=state.equals(State.COMPLETE) & machine.target_reached),
        Rst(machine.trays_done, when=machine.entered_resetting & machine.batch_complete),
        Rst(machine.batch_complete, when=machine.entered_resetting),
        Out(machine.resetting, when=state.equals(State.RESETTING)),
        Out(machine.executing, when=state.equals(State.EXECUTE)),
        Out(machine.stopping, when=state.equals(State.STOPPING)),
        Out(machine.holding, when=state.equals(State.HOLDING)),
        Out(machine.running, when=any_of(*(state.equals(s) for s in RUNNING))),
        Out(machine.stepping, when=mode.equals(Mode.STEP) & state.differs(State.RESETTING)),
        Out(machine.jogging, when=all_of(machine.manual, state.equals(State.EXECUTE), ~machine.abort)),
        Out(
            machine.motion, when=all_of(any_of(*(state.equals(s) for s in MOVING)), ~machine.abort, ~tags.x.guard_open)
        ),
        *lapse_rungs(tags),
        Out(machine.line_clear, when=_line_clear(tags)),
        OnDelay(machine.t_no_motion, NO_MOTION_MS, when=~machine.motion & ~tags.system.link_lost),
        Out(machine.places_checked, when=machine.t_no_motion.done | machine.entered_resetting),
    ]
    return Block("modes", tuple(rungs))
