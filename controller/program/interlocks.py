"""Interlocks: named rules, and the only rungs that write Y.

Sequences request; a coil is granted while every rule about it holds, in every state and from every source.
"""

from __future__ import annotations

from dataclasses import dataclass

from controller.core.devices import CLOCK_1_S
from controller.core.expr import Bit, Expr, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Out, Rung
from controller.core.sequence import Sequence
from controller.io_map import IoMap
from controller.program.modes import State
from controller.program.tags import ARM_OUTPUTS, IN_PLACE, Side, Tags

SLIDE = ("slide_inward", "slide_outward")
LIFT = ("lift_extend", "lift_retract")
BELT = ("spread", "converge")
CLAWS = ("claws_open", "claws_close")


@dataclass(frozen=True, slots=True)
class Rule:
    """One interlock.

    Attributes:
        name: What it is called in tables and refusals.
        reason: Why it is there.
        outputs: Outputs of one arm, or of the tray, that it governs.
        allow: They may be on only while this holds.
    """

    name: str
    reason: str
    outputs: tuple[str, ...]
    allow: Expr


def arm_rules(tags: Tags, side: Side, cycle: Sequence, home: Sequence) -> list[Rule]:
    """Return every rule about the outputs of one arm."""
    x, sp, machine, tray = tags.x, tags.sp, tags.machine, tags.tray
    a, other = tags.arms[side], tags.other(side)
    want = a.want
    opposite = [
        Rule(
            "one coil of a pair", "two coils of one valve or motor must not work against each other", (one,), ~want[two]
        )
        for pair in (SLIDE, LIFT, BELT, CLAWS)
        for one, two in (pair, pair[::-1])
    ]
    clamping_place = (a.at_wanted_row & a.down) | a.at_feed
    opening_place = any_of(
        all_of(a.at_feed, a.down, a.is_spread, cycle["open claws"]),
        all_of(home["put back"], a.down, ~a.at_feed),
        all_of(home["open at feed"], a.at_feed, a.down, a.is_spread),
    )
    return [
        *opposite,
        Rule("motion allowed", "nothing moves in an emergency stop or in a state of rest", ARM_OUTPUTS,
             machine.motion & ~x.emergency_stop),
        Rule("no fault of the arm", "a jammed actuator is not driven on", ARM_OUTPUTS, ~a.fault),
        Rule("belt at rest", "the slide and lift stand while the claws spread or converge", (*SLIDE, *LIFT),
             ~want["spread"] & ~want["converge"]),
        Rule("inward ready", "going in low with claws closed or spread tears the seedlings", ("slide_inward",),
             all_of(a.down, ~a.claws_closed, ~a.loaded, a.is_converged)),
        Rule("tray in place", "the arm goes in only over a tray at rest", ("slide_inward",),
             tray.phase.equals(IN_PLACE) & tray.edge & ~tray.want_run & ~tray.want_creep),
        Rule("stop at the row", "the wanted row is the inner end of the motion", ("slide_inward",), ~a.at_wanted_row),
        Rule("centre is free", "the arms' fingers overlap inward of pick 2", ("slide_inward",),
             ~a.row_is[3] | sp.arms_may_meet.differs(0) | (~other.in_centre & (other.at_feed | other.cycling))),
        Rule("outward clear", "a load goes out only up, an empty arm up or low with open claws", ("slide_outward",),
             a.up | all_of(a.down, ~a.loaded, ~a.claws_closed)),
        Rule("lift clear", "over the tray the lift goes up clamped or open, never half closed", ("lift_retract",),
             any_of(a.at_feed, ~a.claws_closed, a.clamped)),
        Rule("down at feed only", "elsewhere the arm would go down into the tray", ("lift_extend",), a.at_feed),
        Rule("spread up at feed", "spread claws fit only over the cups", ("spread",), all_of(a.up, a.at_feed)),
        Rule("converge empty at feed", "a load would be torn; the cups must be below", ("converge",),
             all_of(a.at_feed, ~a.loaded)),
        Rule("clamp at a place", "claws close only at a row or at feed", ("claws_close",), clamping_place),
        Rule("open at a place", "a load opens only over the cups or at the row it came from", ("claws_open",),
             ~a.loaded | opening_place),
    ]  # fmt: skip


def tray_rules(tags: Tags) -> list[Rule]:
    """Return every rule about the conveyor."""
    tray, arms, machine, x = tags.tray, tags.arms, tags.machine, tags.x
    at_feed = all_of(*(arm.at_feed for arm in arms.values()))
    inward = any_of(*(arm.want["slide_inward"] for arm in arms.values()))
    both = ("tray_run", "tray_forward")
    return [
        Rule("motion allowed", "nothing moves in an emergency stop or in a state of rest", both,
             machine.motion & ~x.emergency_stop),
        Rule("arms at feed", "a tray would shear an arm that is in it", both, at_feed & ~inward),
        Rule("no fault of the feeder", "a jammed tray is not driven on", both, ~tray.fault),
    ]  # fmt: skip


def granted(request: Expr, output: str, rules: list[Rule]) -> Expr:
    """Return the condition of a coil: the request and every rule about the output."""
    return all_of(request, *(rule.allow for rule in rules if output in rule.outputs))


def output_block(tags: Tags, io_map: IoMap, rules: dict[Side, list[Rule]], rules_tray: list[Rule]) -> Block:
    """Return the last block of the scan: every Y, once."""
    arms, tray, machine = tags.arms, tags.tray, tags.machine
    rungs: list[Rung] = []

    def coil(tag: str, when: Expr) -> None:
        point = io_map.get(tag)
        if point is not None:
            target = Bit("Y", point.number, tag, point.meaning)
            rungs.append(Out(target, ~when if point.inverted else when))

    for side, arm in arms.items():
        for output in ARM_OUTPUTS:
            coil(f"{side}.{output}", granted(arm.want[output], output, rules[side]))
    moving = tray.want_run | (tray.want_creep & ~tray.t_on.done)
    coil("tray_run", granted(moving, "tray_run", rules_tray))
    coil("tray_forward", granted(tray.want_run | tray.want_creep, "tray_forward", rules_tray))
    state = machine.state
    blink = Bit("M", CLOCK_1_S, "1 s clock", "on for the first half of every second")
    resting = any_of(*(state.equals(s) for s in (State.ABORTED, State.ABORTING, State.HELD, State.HOLDING)))
    coil("horn", machine.horn)
    coil("lamp_red", resting | machine.fault)
    coil("lamp_amber", any_of(*(state.equals(s) for s in (State.SUSPENDED, State.RESETTING, State.STOPPING))) & blink)
    coil("lamp_green", machine.executing)
    return Block("interlocks and outputs", tuple(rungs))
