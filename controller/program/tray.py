"""Tray feeder: convey the empty tray out, index into the gap behind it, creep to the front edge of the next tray.

A front edge is accepted only while the belt creeps, because a tray that arrives at full speed stops out of reach of the
claws. The feeder therefore indexes only after it has detected the rear edge, and otherwise creeps the entire distance.
"""

from __future__ import annotations

from typing import Final

from controller.core.expr import Expr, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Inc, Mov, OnDelay, Out, Rst, Rung, Set, ZoneReset
from controller.core.sequence import Dwell, Sequence, Step, Timeout, To
from controller.program.alarms.limits import TRAY_OUT_LIMIT_MS
from controller.program.alarms.table import Annunciators
from controller.program.states import State
from controller.program.tags import (
    COMING,
    FORGOTTEN,
    FULL,
    IN_PLACE,
    MOVING_OUT,
    NO_TRAY,
    ROWS,
    TAKEN,
    Tags,
)

MET_MS: Final = 200
"""Delay of the alarm for a tray detected during the index, ms; longer than sensor bounce. The gap behind a tray is
longer than the index, so either the tray has not left or the next one has arrived too early."""
CREEP_RUN_MS: Final = 20
CREEP_PAUSE_MS: Final = 30
"""Pause after each creep pulse, ms, in which the belt stops. With a 10 ms scan, one pulse moves the simulated belt by
3.6 mm. Neither an extra pulse nor a loss of drive current during a pulse moves the tray out of reach of the claws."""


def feeder(tags: Tags, alarms: Annunciators) -> Sequence:
    """Return the feeder sequence. The tray phase is retentive, so feeding resumes correctly after a power loss."""
    t, machine, sp = tags.tray, tags.machine, tags.sp
    begun = machine.start_requested | machine.entered_starting
    steps = [
        Step(
            "wait for an empty tray",
            waits_for="an empty tray and both arms at feed",
            go=[
                To("move tray out", when=t.permit & t.edge & t.phase.equals(MOVING_OUT)),
                To("settle", when=t.permit & t.edge & t.phase.equals(COMING)),
                To("creep", when=t.permit & ~t.edge),
            ],
        ),
        Step(
            "move tray out",
            hold=[t.want_run],
            go=[To("wait for an empty tray", when=~t.edge & machine.emptying), To("index", when=~t.edge)],
            watch=Timeout(TRAY_OUT_LIMIT_MS, alarms.tray_jam, t.t_jam),
        ),
        Step(
            "index",
            hold=[t.want_run],
            dwell=Dwell(t.t_index, sp.tray_index),
            go=[To("tray in the gap", when=t.edge), To("creep", when=t.t_index.done)],
        ),
        Step(
            "tray in the gap",
            dwell=Dwell(t.t_met, MET_MS),
            go=[To("creep", when=~t.edge), To("wait for an empty tray", when=t.t_met.done)],
        ),
        Step(
            "creep",
            hold=[t.want_creep],
            dwell=Dwell(t.t_no_tray, sp.no_tray),
            go=[To("settle", when=t.edge), To("no tray", when=t.t_no_tray.done)],
        ),
        Step(
            "no tray",
            waits_for="a tray in the magazine, then start",
            go=[To("creep", when=t.permit & begun & ~t.edge)],
        ),
        Step(
            "settle",
            dwell=Dwell(t.t_settle, 200),
            go=[
                To("creep", when=~t.edge & t.phase.differs(IN_PLACE)),
                To("wait for an empty tray", when=t.t_settle.done),
            ],
        ),
    ]
    armed = machine.step_armed["tray feeder"]
    return Sequence(
        "tray feeder",
        t.first_step,
        steps,
        enable=~machine.stepping | armed,
        consumes=armed,
        drops_requests_when_blocked=True,
    )


def conditioning(tags: Tags, feeder: Sequence) -> list[Rung]:
    """Return the rungs that set the phase of the tray and the request and permit for the next tray."""
    t, arms, machine, sp, commands = tags.tray, tags.arms, tags.machine, tags.sp, tags.commands
    rows = [arm.rows[row] for arm in arms.values() for row in ROWS]
    all_taken = all_of(
        *(arm.out_of_service | all_of(*(row.equals(TAKEN) for row in arm.rows.values())) for arm in arms.values())
    )
    at_feed = all_of(*(arm.at_feed for arm in arms.values()))
    homed = all_of(*(arm.homed for arm in arms.values()))
    unloading = any_of(*(arm.row_in_progress for arm in arms.values()))
    # a tray that is under the sensor but has not settled may have overrun
    unsettled = t.edge & (t.phase.equals(NO_TRAY) | t.phase.equals(COMING))
    doubt = any_of(unsettled, t.phase.equals(FORGOTTEN), t.phase.equals(IN_PLACE) & ~t.edge)
    perhaps_moved = t.phase.equals(IN_PLACE) & ~t.place_known
    # with the arms at home, the tray can be compared with its mark, and no row changes any more
    asks = any_of(machine.entered_resetting & doubt, all_of(machine.resetting, homed, perhaps_moved))
    accepted = t.ask & (~machine.motion | machine.resetting)  # rows must not change under an active arm
    full = (accepted & commands.tray_full & t.edge) | commands.rows_full
    none = (accepted & commands.tray_none) | commands.new_machine
    same = all_of(accepted, commands.tray_same, t.edge, t.phase.equals(IN_PLACE))
    real = ~tags.system.link_lost
    jogged = machine.jogs["tray_run"] & t.driven["tray_run"]
    return [
        *_stated_rows(tags),
        Out(t.emptied, when=all_taken & t.phase.equals(IN_PLACE)),
        Inc(machine.trays_done, when=t.emptied),
        Out(t.leaves, when=any_of(t.emptied, none, machine.line_clear & t.phase.equals(IN_PLACE))),
        *(Inc(machine.rows_left, when=t.leaves & row.equals(FULL)) for row in rows),
        Rst(machine.rows_left, when=commands.count_reset),
        Mov(MOVING_OUT, t.phase, when=t.leaves),
        Mov(0, t.exit_time, when=t.phase.differs(MOVING_OUT)),
        OnDelay(t.t_exit, 100, when=all_of(t.driven["tray_run"], t.phase.equals(MOVING_OUT), ~t.t_exit.done)),
        Inc(t.exit_time, when=t.t_exit.done),
        Out(t.overdue, when=t.exit_time >= TRAY_OUT_LIMIT_MS // 100),
        # the tray is unknown; the operator must check it
        Mov(NO_TRAY, t.phase, when=t.t_jam.done | t.overdue | t.met),
        Rst(machine.trays_done, when=commands.count_reset),
        *(Mov(FULL, row, when=full & (row <= FULL)) for row in rows),  # not a row in progress
        *(Mov(TAKEN, row, when=none) for row in rows),
        Mov(IN_PLACE, t.phase, when=full),
        Set(t.place_known, when=all_of(accepted, t.edge, commands.tray_full | same)),
        Rst(t.ask, when=any_of(full, none, same)),
        Rst(
            t.place_known,
            when=any_of(
                t.phase.equals(MOVING_OUT),
                t.t_lost.done & ~machine.running,
                machine.manual,
                machine.state.equals(State.ABORTED),
                tags.x.guard_open,
            ),
        ),
        Mov(COMING, t.phase, when=real & ~t.edge & (t.phase.equals(MOVING_OUT) | t.phase.equals(NO_TRAY))),
        Set(t.ask, when=jogged | (~machine.manual & asks)),
        Out(machine.target_reached, when=sp.trays_target.differs(0) & (machine.trays_done >= sp.trays_target)),
        Out(t.needed, when=t.phase.differs(IN_PLACE) & _wanted(tags)),
        Out(
            t.permit,
            when=all_of(t.needed, at_feed, ~t.ask, ~unloading, machine.running | (machine.resetting & homed))
            & (~tags.stands | machine.start_requested),
        ),
        Out(t.missing, when=feeder["no tray"] & ~machine.complete_ordered),
        Out(t.at_rest, when=t.fault | feeder["no tray"] | ~any_of(*(bit for bit, _ in feeder if bit != feeder.first))),
        Out(t.ready, when=any_of(t.missing, machine.target_reached, t.phase.equals(IN_PLACE)) & ~perhaps_moved),
    ]


def _stated_rows(tags: Tags) -> list[Rung]:
    """Return the rungs with which the operator states which rows of the tray in place are empty."""
    commands = tags.commands
    return [
        Mov(TAKEN, arm.rows[row], when=commands.row_empty[side][row]) for side, arm in tags.arms.items() for row in ROWS
    ]


def _wanted(tags: Tags) -> Expr:
    """Return the condition that the feeder may move: another tray is wanted, or the last one is conveyed out."""
    machine = tags.machine
    return any_of(
        ~machine.target_reached & ~machine.complete_ordered, machine.emptying & tags.tray.phase.equals(MOVING_OUT)
    )


def bookkeeping(tags: Tags, feeder: Sequence) -> Block:
    """Return the block that follows the sequences: phase, rows of a new tray, creep pulses."""
    t, arms = tags.tray, tags.arms
    settled = all_of(feeder["settle"], t.t_settle.done, t.edge, t.phase.differs(IN_PLACE))
    arrived = settled & t.place_known
    in_the_gap = feeder["tray in the gap"] & t.t_met.done
    unawaited = feeder["no tray"] & (tags.machine.start_requested | tags.machine.entered_starting)
    rows = [arm.rows[row] for arm in arms.values() for row in ROWS]
    return Block(
        "tray memory",
        (
            Set(t.place_known, when=all_of(feeder["creep"], t.edge, t.driven["tray_forward"])),
            *(Mov(FULL, row, when=arrived) for row in rows),
            Mov(IN_PLACE, t.phase, when=arrived),
            Out(t.met, when=t.edge & any_of(in_the_gap, unawaited, settled & ~t.place_known)),
            OnDelay(t.t_on, CREEP_RUN_MS, when=feeder["creep"] & ~t.t_off.done),
            OnDelay(t.t_off, CREEP_PAUSE_MS, when=t.t_on.done),
        ),
    )


def supervision(tags: Tags, feeder: Sequence) -> Block:
    """Return the block that starts the feeder and resets its steps when the state does not allow motion."""
    machine = tags.machine
    return Block(
        "tray supervision",
        (
            ZoneReset(feeder.first, feeder.last, when=~machine.motion),
            Set(feeder.first, when=(machine.entered_resetting | machine.entered_starting) & ~machine.manual),
        ),
    )
