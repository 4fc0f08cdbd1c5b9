"""Homing of one arm from any position, by the first of seven rules that applies."""

from __future__ import annotations

from controller.core.expr import Expr, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Mov, Out, Rst, Rung, Set, ZoneReset
from controller.core.sequence import Dwell, Sequence, Step, To
from controller.program.alarms.limits import CLAW_LIMIT_MS, LIFT_LIMIT_MS, SLIDE_LIMIT_MS, SPREAD_LIMIT_MS, StepLimits
from controller.program.tags import FULL, IN_DOUBT, IN_PROGRESS, TAKEN, ArmTags, Side, Tags

FIRST_STEP_OFFSET = 40
PRESS_MS = 1_000
"""Time to fill the outer chamber of the slide through its valve and tube, ms. After low air pressure or a jam this
chamber may be empty; the first stroke inward would then have too little back pressure. With 600 ms it reaches row 1 at
0.3 m/s, and the switch there is not believed."""
LIFT_PRESS_MS = 500
"""Time to fill the upper chamber of the lift at its lower end, ms, so that its first upstroke has back pressure."""


def homing(tags: Tags, side: Side, limit: StepLimits) -> Sequence:
    """Return the homing sequence; its first step selects the first of these rules that applies.

    1. Claws in an unknown state count as closed and loaded (`arm.conditioning`); rule 3 or 5 then applies.
    2. A row in progress is put back and stays full if the lift has not left its lower limit, or if the arm rose
       without a command before the claws had gripped, because half-closed claws must not lift a row. A lift that has
       been driven is first lowered to verify its switch. Claws that are closed but empty are opened likewise.
    3. A loaded arm away from feed moves fully up, then out.
    4. An empty arm away from feed moves out without rising if it is down, otherwise up and then out.
    5. A loaded arm at feed moves up and stays there, ready to start.
    6. An empty arm at feed opens its claws, moves up, converges and moves down.
       An arm that is down at feed is pressed down first, so that its lift has back pressure when it moves up.
    7. If memory and sensors do not determine the rule, the step waits for an answer from the operator.
    """
    a = tags.arms[side]
    steps = [
        Step(
            "decide",
            waits_for="an answer from the operator",
            go=[
                To("put back", when=all_of(~a.ask, a.row_in_progress, a.down, ~a.sensed_at_feed)),
                To("put back", when=all_of(~a.ask, ~a.loaded, a.claws_closed, ~a.at_feed)),
                To("lower to put back", when=all_of(~a.ask, a.row_in_progress, _may_be_lowered(a))),
                To("raise loaded", when=~a.ask & a.loaded & ~a.at_feed),
                To("out low", when=~a.ask & ~a.at_feed & a.down),
                To("raise empty", when=~a.ask & ~a.at_feed),
                To("press down at feed", when=~a.ask & a.down),
                To("raise at feed", when=~a.ask & a.loaded),
                To("open at feed", when=~a.ask & ~a.loaded),
            ],
        ),
        *_to_feed(tags, side, limit),
        *_at_feed(tags, side, limit),
    ]
    return Sequence(f"{a.side} homing", a.first_step + FIRST_STEP_OFFSET, steps)


def _to_feed(tags: Tags, side: Side, limit: StepLimits) -> list[Step]:
    """Return the steps that move the arm to feed."""
    a = tags.arms[side]
    want = a.want
    return [
        Step(
            "lower to put back",
            hold=[want["lift_extend"]],
            go=[To("put back", when=a.down)],
            watch=limit("home: lower to put back", LIFT_LIMIT_MS),
        ),
        Step(
            "put back",
            hold=[want["claws_open"]],
            go=[To("out low", when=a.opened & a.down), To("raise empty", when=a.opened)],
            watch=limit("home: put back", CLAW_LIMIT_MS),
        ),
        Step(
            "raise loaded",
            hold=[want["lift_retract"]],
            go=[To("out", when=a.up)],
            watch=limit("home: raise loaded", LIFT_LIMIT_MS),
        ),
        Step(
            "raise empty",
            hold=[want["lift_retract"]],
            go=[To("out", when=a.up)],
            watch=limit("home: raise empty", LIFT_LIMIT_MS),
        ),
        Step(
            "out",
            hold=[want["slide_outward"], want["lift_retract"]],
            go=[To("raise at feed", when=a.at_feed & a.loaded), To("open at feed", when=a.at_feed)],
            watch=limit("home: out", SLIDE_LIMIT_MS),
        ),
        Step(
            "out low",
            hold=[want["slide_outward"]],
            go=[To("press down at feed", when=a.at_feed)],
            watch=limit("home: out low", SLIDE_LIMIT_MS),
        ),
    ]


def _at_feed(tags: Tags, side: Side, limit: StepLimits) -> list[Step]:
    """Return the steps at feed that lead to the initial state or leave the arm loaded and ready."""
    a = tags.arms[side]
    want = a.want
    return [
        Step(
            "raise at feed",
            hold=[want["lift_retract"]],
            go=[To("discard, spread", when=a.up & a.discard), To("pressurise at feed", when=a.up)],
            watch=limit("home: raise at feed", LIFT_LIMIT_MS),
        ),
        Step(
            "discard, spread",
            hold=[want["spread"]],
            go=[To("discard, lower", when=a.is_spread)],
            watch=limit("home: discard, spread", SPREAD_LIMIT_MS),
        ),
        Step(
            "discard, lower",
            hold=[want["lift_extend"]],
            go=[To("open at feed", when=a.down)],
            watch=limit("home: discard, lower", LIFT_LIMIT_MS),
        ),
        Step(
            "open at feed",
            hold=[want["claws_open"]],
            go=[To("raise to converge", when=a.opened)],
            watch=limit("home: open at feed", CLAW_LIMIT_MS),
        ),
        Step(
            "raise to converge",
            hold=[want["lift_retract"]],
            go=[To("converge", when=a.up)],
            watch=limit("home: raise to converge", LIFT_LIMIT_MS),
        ),
        Step(
            "converge",
            hold=[want["converge"]],
            go=[To("lower", when=a.is_converged)],
            watch=limit("home: converge", SPREAD_LIMIT_MS),
        ),
        Step(
            "lower",
            hold=[want["lift_extend"]],
            go=[To("pressurise at feed", when=a.down)],
            watch=limit("home: lower", LIFT_LIMIT_MS),
        ),
        Step(
            "pressurise at feed",
            hold=[want["slide_outward"]],
            dwell=Dwell(a.t_press, PRESS_MS),
            go=[To("homed", when=a.t_press.done)],
        ),
        Step(
            "press down at feed",
            hold=[want["lift_extend"]],
            dwell=Dwell(a.t_press_down, LIFT_PRESS_MS),
            go=[
                To("raise at feed", when=a.t_press_down.done & a.loaded),
                To("open at feed", when=a.t_press_down.done),
            ],
        ),
        Step("homed", waits_for="start", go=[]),
    ]


def questions(tags: Tags, side: Side, home: Sequence) -> list[Rung]:
    """Return the rungs of the question "does the arm hold seedlings?" and its answers.

    The question is asked if memory and sensors disagree: a row is in doubt after a power loss, a row is in progress
    although the arm is at feed, which is possible only if it was moved manually, or an arm away from feed is loaded
    with claws that have not gripped and cannot put the row back, so that no rule permits the lift to rise. Answers are
    accepted while the arm is at rest; of two that contradict each other in one scan, the one that counts the arm as
    loaded. If the arm holds nothing and the row cannot be put back, the row is full, and the claws are opened where
    they are.
    """
    a, commands, machine = tags.arms[side], tags.commands, tags.machine
    open_row = a.row_in_doubt | (a.row_in_progress & a.sensed_at_feed)
    discard = commands.discard[side]
    accepted = ~machine.motion | home["decide"]
    undecided = a.row_in_doubt | a.row_in_progress
    can_put_back = undecided & ((a.down & ~a.sensed_at_feed) | _may_be_lowered(a))
    not_gripped = all_of(a.loaded, ~a.clamped, ~a.at_feed, ~can_put_back)
    yes = accepted & (commands.loaded_yes[side] | discard)
    no = all_of(accepted, commands.loaded_no[side], ~commands.loaded_yes[side], ~discard)
    rows: list[Rung] = []
    for row in a.rows.values():
        rows += [
            Mov(TAKEN, row, when=yes & a.ask & (row >= IN_PROGRESS)),
            Mov(IN_PROGRESS, row, when=all_of(no, a.ask, can_put_back, row.equals(IN_DOUBT))),
            Mov(FULL, row, when=all_of(no, a.ask, ~can_put_back, row >= IN_PROGRESS)),
        ]
    return [
        Out(a.ask, when=open_row | (not_gripped & (accepted | machine.entered_resetting))),
        *(Set(bit, when=yes & a.ask) for bit in (a.loaded, a.claws_closed, a.clamped)),
        Set(a.discard, when=all_of(discard, a.loaded, accepted | (machine.jogging & ~a.ask))),
        Rst(a.loaded, when=all_of(no, a.ask, ~can_put_back)),
        *rows,
    ]


def _may_be_lowered(a: ArmTags) -> Expr:
    """Return the condition that an arm at the row that its claws closed at may be lowered to put the row back."""
    return all_of(a.on_row, a.at_wanted_row, ~a.clamped | (a.sensed_down & ~a.sensed_up))


def supervision(tags: Tags, side: Side, cycle: Sequence, home: Sequence) -> Block:
    """Return the block that starts and ends homing and reports the arm as active, at rest or homed."""
    a, machine = tags.arms[side], tags.machine
    resting = cycle["wait at feed"] | cycle["parked"]
    held = machine.holding & (cycle["pause at feed"] | cycle["wait to lower"])
    begins = all_of(machine.entered_starting, ~machine.manual, ~a.out_of_service)
    return Block(
        f"{a.side} supervision",
        (
            ZoneReset(home.first, home.last, when=~machine.resetting),
            ZoneReset(cycle.first, cycle.last, when=~machine.motion | machine.resetting),
            Set(home.first, when=machine.entered_resetting & ~machine.manual & ~a.out_of_service),
            Set(cycle["spread"], when=begins & a.loaded),
            Set(cycle.first, when=begins & ~a.loaded),
            Out(a.active, when=any_of(*(bit for bit, _ in cycle))),
            Out(a.cycling, when=a.active & ~resting),
            Out(a.at_rest, when=a.fault | ~a.cycling | held),
            Out(a.homed, when=home["homed"] | (a.out_of_service & a.at_feed)),
            Out(a.hears_answers, when=~machine.motion | home["decide"]),
            Out(
                a.off_home,
                when=(machine.executing & cycle["wait at feed"] & ~all_of(a.down, a.at_feed, a.is_converged))
                | ((home["homed"] | all_of(a.out_of_service, machine.motion, ~machine.manual)) & ~a.at_feed),
            ),
        ),
    )
