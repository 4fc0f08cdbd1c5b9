"""Transplanting cycle and bookkeeping of one arm; the declaration is the same for both sides.

"Throw" is the term of the papers for the release of the seedlings over the cups.
"""

from __future__ import annotations

from typing import Final

from controller.core.expr import TRUE, Expr, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Add, Inc, Mov, OnDelay, Out, Pulse, Rst, Rung, Set
from controller.core.sequence import Dwell, Sequence, Step, To
from controller.program.alarms.limits import CLAW_LIMIT_MS, LIFT_LIMIT_MS, SLIDE_LIMIT_MS, SPREAD_LIMIT_MS, StepLimits
from controller.program.cups import cup_count
from controller.program.interlocks import in_the_way
from controller.program.places import leaving, places
from controller.program.set_points import CUPS
from controller.program.states import Mode, State
from controller.program.tags import FIRST_SCAN, FULL, IN_DOUBT, IN_PLACE, IN_PROGRESS, ROWS, TAKEN, ArmTags, Side, Tags

LEAVING_MS: Final = 500
"""Time after which a lift that is driven upwards has left its lower switch, ms: 6 mm of band and hysteresis take 0.03 s
at 0.2 m/s, and 339 cm3 vent from 6 to 4 bar before in up to 0.43 s."""


def cycle(tags: Tags, side: Side, limit: StepLimits) -> Sequence:
    """Return the cycle (section 1.2 of the paper): pick a row, lift, move out, spread, lower, throw, converge."""
    a, machine, sp = tags.arms[side], tags.machine, tags.sp
    want = a.want
    steps = [
        Step("wait at feed", waits_for="a full row", go=[To("approach row", when=a.permit)]),
        Step(
            "approach row",
            hold=[want["slide_inward"]],
            go=[To("settle at row", when=a.at_wanted_row)],
            watch=limit("approach row", SLIDE_LIMIT_MS),
        ),
        Step(
            "settle at row",
            dwell=Dwell(a.t_settle, sp.settle),
            go=[
                To("return to row", when=~a.at_wanted_row & ~a.retried),
                To("close claws", when=a.t_settle.done & a.at_wanted_row),
            ],
        ),
        Step(
            "return to row",
            hold=[want["slide_outward"]],
            go=[To("settle at row", when=a.at_wanted_row)],
            watch=limit("return to row", SLIDE_LIMIT_MS),
        ),
        Step(
            "close claws",
            hold=[want["claws_close"]],
            go=[To("lift from row", when=a.closed & a.at_wanted_row)],
            watch=limit("close claws", CLAW_LIMIT_MS),
        ),
        Step(
            "lift from row",
            hold=[want["lift_retract"]],
            go=[To("slide to feed", when=a.up)],
            watch=limit("lift from row", LIFT_LIMIT_MS),
        ),
        Step(
            "slide to feed",
            hold=[want["slide_outward"], want["lift_retract"]],
            go=[To("pause at feed", when=a.at_feed)],
            watch=limit("slide to feed", SLIDE_LIMIT_MS),
        ),
        Step(
            "pause at feed",
            dwell=Dwell(a.t_pause, sp.pause_at_feed),
            go=[To("spread", when=a.t_pause.done & ~machine.holding)],
        ),
        *_throw_steps(tags, side, limit),
    ]
    armed = machine.step_armed[f"{a.side} arm"]
    return Sequence(f"{a.side} arm", a.first_step, steps, enable=~machine.stepping | armed, consumes=armed)


def _throw_steps(tags: Tags, side: Side, limit: StepLimits) -> list[Step]:
    """Return the steps of the second half of the cycle, at the feed position: from spreading to waiting for a row."""
    a, machine, sp = tags.arms[side], tags.machine, tags.sp
    want = a.want
    return [
        Step(
            "spread",
            hold=[want["spread"]],
            go=[To("wait to lower", when=a.is_spread)],
            watch=limit("spread", SPREAD_LIMIT_MS),
        ),
        Step(
            "wait to lower",
            waits_for="cups",
            go=[
                To("parked", when=a.park & machine.stopping),
                To(
                    "lower over cups",
                    when=all_of(
                        (a.cup_counter.value >= sp.descend_at_count) | a.count_good, ~machine.holding, ~tags.stands
                    ),
                ),
            ],
        ),
        Step(
            "lower over cups",
            hold=[want["lift_extend"]],
            go=[To("wait for cups", when=a.down)],
            watch=limit("lower over cups", LIFT_LIMIT_MS),
        ),
        Step(
            "wait for cups",
            waits_for="twelve empty cups",
            go=[To("release delay", when=a.release_edge), To("park", when=a.park)],
        ),
        Step(
            "release delay",
            dwell=Dwell(a.t_release_delay, sp.release_delay),
            go=[To("open claws", when=a.release_due), To("wait for cups", when=a.release_missed)],
            ignores_enable=True,  # the awaited cup is already passing
        ),
        Step(
            "open claws",
            hold=[want["claws_open"]],
            go=[
                To("raise empty", when=a.opened & sp.converge_at.differs(0)),
                To("converge", when=a.opened),
            ],
            watch=limit("open claws", CLAW_LIMIT_MS),
        ),
        Step(
            "raise empty",
            hold=[want["lift_retract"]],
            go=[To("converge", when=a.up)],
            watch=limit("raise empty", LIFT_LIMIT_MS),
        ),
        Step(
            "converge",
            hold=[want["converge"]],
            go=[To("wait at feed", when=a.is_converged & a.down), To("lower empty", when=a.is_converged)],
            watch=limit("converge", SPREAD_LIMIT_MS),
        ),
        Step(
            "lower empty",
            hold=[want["lift_extend"]],
            go=[To("wait at feed", when=a.down)],
            watch=limit("lower empty", LIFT_LIMIT_MS),
        ),
        Step("park", hold=[want["lift_retract"]], go=[To("parked", when=a.up)], watch=limit("park", LIFT_LIMIT_MS)),
        Step("parked", waits_for="reset and start", go=[]),
    ]


def conditioning(tags: Tags, side: Side, steps: Sequence, home: Sequence) -> list[Rung]:
    """Return the rungs that evaluate the sensors and the memory before the sequences use the results.

    While the field link is lost, the X image contains assumed levels; no state is derived from them.
    """
    a = tags.arms[side]
    real = ~tags.system.link_lost
    return [
        *places(tags, a),
        *_claws(tags, a),
        *_power_up(a, real),
        *cup_count(tags, a, steps),
        *_carried(tags, a, steps),
        *_rows(tags, a, steps, home),
        *_permit(tags, a, steps),
    ]


def _claws(tags: Tags, a: ArmTags) -> list[Rung]:
    """Return the rungs of the claw dwell timers, which run only while the coil is actually on.

    No sensor detects whether the claws are open or closed; a wired pressure switch detects the air that closes them.
    """
    out = ~tags.system.outputs_held
    return [
        OnDelay(a.t_closing, tags.sp.clamp, when=a.coils["claws_close"] & out),
        OnDelay(a.t_opening, tags.sp.release, when=a.coils["claws_open"] & out),
    ]


def _power_up(a: ArmTags, real: Expr) -> list[Rung]:
    """Return the power-up rungs: claws in an unknown state count as closed and loaded.

    A row in progress that has not been lifted is in doubt.
    """
    unknown = FIRST_SCAN & ~a.claws_known
    lifted = all_of(FIRST_SCAN, real, ~a.sensed_down, ~a.reached["down"], ~a.at_feed)
    rows: list[Rung] = []
    for row in a.rows.values():
        rows += [
            Mov(TAKEN, row, when=lifted & row.equals(IN_PROGRESS)),
            Mov(IN_DOUBT, row, when=FIRST_SCAN & row.equals(IN_PROGRESS)),
        ]
    return [Set(a.loaded, unknown), Set(a.claws_closed, unknown), Set(a.clamped, unknown), *rows]


def _rows(tags: Tags, a: ArmTags, steps: Sequence, home: Sequence) -> list[Rung]:
    """Return the rungs of the row states: the next row is the first row not taken; lifting a row marks it as taken."""
    real = ~tags.system.link_lost
    jogged = tags.machine.jogs[f"{a.side}.lift_retract"] & a.claws_closed & ~a.at_feed
    driven = a.loaded & (a.coils["slide_inward"] | a.coils["slide_outward"])
    raising = any_of(steps["lift from row"], home["raise loaded"], jogged)
    already_up = all_of(a.loaded, a.up, ~a.at_feed, ~steps["close claws"])
    left_switch = ~a.sensed_down | a.t_raising.done  # also if the lower switch has failed on
    # an arm that was stopped while it rose may sink back before homing begins
    sank = all_of(a.loaded, a.clamped, a.on_row, ~a.sensed_down, ~steps["close claws"])
    lifted = driven | (real & any_of(raising & left_switch, already_up, sank))
    left_row = [Mov(TAKEN, a.rows[row], when=lifted & (a.rows[row] >= IN_PROGRESS)) for row in ROWS]
    next_is: list[Rung] = []
    earlier: Expr = TRUE
    for row in ROWS:
        next_is.append(Out(a.row_is[row], when=earlier & a.rows[row].differs(TAKEN)))
        earlier = earlier & a.rows[row].equals(TAKEN)
    return [
        OnDelay(a.t_raising, LEAVING_MS, when=a.coils["lift_retract"] & ~tags.system.outputs_held),
        *left_row,
        *next_is,
        Out(a.row_full, when=any_of(*(a.row_is[row] & a.rows[row].equals(FULL) for row in ROWS))),
        Out(a.row_in_progress, when=any_of(*(a.rows[row].equals(IN_PROGRESS) for row in ROWS))),
        Out(a.row_in_doubt, when=any_of(*(a.rows[row].equals(IN_DOUBT) for row in ROWS))),
        Out(a.at_wanted_row, when=any_of(*(a.row_is[row] & a.at_pick[row] for row in ROWS))),
        Set(a.passed, when=any_of(FIRST_SCAN, *(a.row_is[row] & _at_or_beyond(a, row) for row in ROWS))),
        Rst(a.passed, when=a.at_feed),
    ]


def _at_or_beyond(a: ArmTags, row: int) -> Expr:
    """Return the condition that a switch at or beyond a row is on; even an implausible switch stops the slide."""
    return any_of(*(a.sensed_at_pick[pick] for pick in ROWS if pick >= row))


def _permit(tags: Tags, a: ArmTags, steps: Sequence) -> list[Rung]:
    """Return the rungs of the cycle permit: the arm is home, its row is full, the tray at rest and the centre free.

    Only one arm at a time may be in the centre (inward of pick 2); the left arm has priority. An arm on its way to row
    2 counts as in the centre until it arrives, because it would pass a row whose switch is dead; both arms may
    approach row 2 together.
    """
    other, machine, tray = tags.other(a.side), tags.machine, tags.tray
    may_meet = tags.sp.arms_may_meet.differs(0)
    other_goes = in_the_way(a, other)
    if a.side == "right":
        other_goes |= other.permit & (other.row_is[3] | (other.row_is[2] & a.row_is[3]))
    other_known = other.at_feed | other.cycling
    home = all_of(steps["wait at feed"], a.down, a.at_feed, a.is_converged, ~a.claws_closed, ~a.loaded)
    return [
        Out(
            a.permit,
            when=all_of(machine.executing, home, a.row_full, tray.phase.equals(IN_PLACE), tray.edge, ~a.cycle_done)
            & ~machine.complete_ordered
            & (a.row_is[1] | may_meet | (other_known & ~other_goes)),
        )
    ]


def bookkeeping(tags: Tags, side: Side, steps: Sequence, home: Sequence) -> Block:
    """Return the block that follows the sequences and updates the stored states of claws, rows and cups."""
    a, machine = tags.arms[side], tags.machine
    released = steps["release delay"] & a.release_edge
    jog_open = machine.jogs[f"{side}.claws_open"]
    # no switch is read, because one that sticks in this scan must not prevent the count
    thrown = all_of(a.opened, a.loaded, ~a.row_in_progress, ~a.discard, ~jog_open)
    over_cups = ("wait to lower", "lower over cups", "wait for cups")
    settling_again = steps["settle at row"] & a.retried & ~steps["return to row"]
    off_row = ~a.at_wanted_row & (steps["close claws"] | settling_again)
    going_in = steps["approach row"] | machine.jogs[f"{side}.slide_inward"]
    rungs: list[Rung] = [
        Out(a.thrown, when=thrown),
        Inc(a.cycles, when=a.thrown & a.claws_known),  # a load that is only assumed is no row
        Rst(a.cycles, when=tags.commands.count_reset),
        *_claws_memory(tags, a, steps, home, released),
        Set(a.count_valid, when=released),
        Set(a.row_running, when=released),
        *_row_to_look_at(a, released),
        Rst(a.row_running, when=~(machine.running | machine.stopping) | (machine.target_reached & ~a.loaded)),
        Set(a.cycle_done, when=a.thrown & machine.mode.equals(Mode.ONE_CYCLE)),
        Rst(a.cycle_done, when=machine.state.equals(State.STARTING) | machine.mode.differs(Mode.ONE_CYCLE)),
        Set(a.retried, when=steps["return to row"]),
        Rst(a.retried, when=steps["wait at feed"] | steps["lift from row"]),
        Out(a.over_row, when=off_row),
        Set(a.in_centre, when=(going_in & ~a.row_is[1]) | a.sensed_at_pick[3]),
        Rst(
            a.in_centre,
            when=(a.at_feed & ~going_in) | (a.at_pick[2] & (steps["slide to feed"] | (a.row_is[2] & ~going_in))),
        ),
        Out(
            a.ask_cups,
            when=~a.count_valid & ~a.cups_confirmed & a.loaded & any_of(*(steps[title] for title in over_cups)),
        ),
    ]
    return Block(f"{a.side} arm memory", tuple(rungs))


def _carried(tags: Tags, a: ArmTags, steps: Sequence) -> list[Rung]:
    """Return the rungs that count the stems that cross the beam on the way to feed; none without the beam.

    The count begins when the arm lifts the row: a lowered arm interrupts the beam on its way to the row.
    """
    carried, most = a.yields.carried, tags.sp.missing_most
    if carried is None or most is None:
        return []
    missing = carried.missing
    short = all_of(steps["slide to feed"], a.at_feed, missing > most)
    return [
        Pulse(carried.edge, when=carried.stem),
        Add(missing, -1, missing, when=carried.edge),
        Out(carried.short, when=short),
        Set(carried.told, when=carried.short),
        Mov(CUPS, missing, when=steps["lift from row"]),
        Rst(carried.told, when=steps["lift from row"]),
    ]


def _row_to_look_at(a: ArmTags, released: Expr) -> list[Rung]:
    """Return the rungs that begin to look at the cups of a released row.

    They do not look at a row whose load is only assumed, or of which too few seedlings have been told already.
    """
    planted, carried = a.yields.planted, a.yields.carried
    if planted is None:
        return []
    looks = all_of(released, a.claws_known, ~carried.told if carried is not None else TRUE)
    return [Rst(planted.empty, when=released), Set(planted.looks, when=looks)]


def _claws_memory(tags: Tags, a: ArmTags, steps: Sequence, home: Sequence, released: Expr) -> list[Rung]:
    """Return the rungs that store the state of the claws and of the row they take or put back, in all modes.

    Claws count as closed from the closing request until the end of the opening dwell.
    """
    jogs = tags.machine.jogs
    jog_close, jog_open = jogs[f"{a.side}.claws_close"], jogs[f"{a.side}.claws_open"]
    gripping = steps["close claws"] | all_of(jog_close, a.at_wanted_row, a.down, ~tags.system.link_lost)
    takes = gripping & ~a.loaded
    closing = steps["close claws"] | (jog_close & (a.at_feed | all_of(a.at_wanted_row, a.down)))
    opening = any_of(steps["open claws"], home["put back"], home["open at feed"], jog_open)
    opened = a.opened
    discarded = a.loaded & a.at_feed & (home["open at feed"] | jog_open)
    return [
        # put back: over the cups, no row is in progress any more
        *(Mov(FULL, a.rows[row], when=opened & a.rows[row].equals(IN_PROGRESS)) for row in ROWS),
        Rst(a.cup_counter, when=released | discarded),
        Rst(a.cups_confirmed, when=released | discarded),
        Rst(a.loaded, when=opened),
        Rst(a.claws_closed, when=opened),
        Rst(a.clamped, when=opened),
        Set(a.claws_known, when=opened),
        *(Mov(IN_PROGRESS, a.rows[row], when=takes & a.row_is[row] & a.rows[row].equals(FULL)) for row in ROWS),
        Set(a.loaded, when=gripping),
        Set(a.claws_closed, when=closing),
        Set(a.claws_known, when=closing),
        Set(a.clamped, when=a.closed & a.claws_closed),
        Rst(a.clamped, when=opening),
        Rst(a.discard, when=opened | ~a.loaded),
    ]


def coils_memory(a: ArmTags) -> list[Rung]:
    """Return the rungs that record the effect of the coils; they follow the outputs in the scan."""
    return [
        *leaving(a),
        Rst(a.on_row, when=a.coils["slide_inward"] | a.coils["slide_outward"]),
        Set(a.on_row, when=a.coils["claws_close"] & ~a.sensed_at_feed),
    ]
