"""Interlocks: named rules, and the only rungs that write outputs (Y).

Sequences request outputs. A coil is on only while all of its rules allow it, in every state and regardless of the
source of the request.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from controller.common.declarations import Declared
from controller.common.modbus.io_map import IoMap
from controller.core.devices import CLOCK_1_S, MS_100
from controller.core.expr import FALSE, Bit, Expr, Timer, Word, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Mov, OnDelay, Out, Rst, Rung, Set
from controller.core.sequence import Sequence
from controller.program.operator.answers import Question
from controller.program.operator.buttons import due
from controller.program.operator.commands import ARM_OUTPUTS
from controller.program.operator.start_warning import horn
from controller.program.states import State
from controller.program.tags import IN_PLACE, ArmTags, MachineTags, Side, Tags

SLIDE = ("slide_inward", "slide_outward")
LIFT = ("lift_extend", "lift_retract")
BELT = ("spread", "converge")
CLAWS = ("claws_open", "claws_close")


_MOTION_ALLOWED: Final = (
    "motion allowed",
    "no motion during an emergency stop or in a state that does not allow it",
)
SHORT_FLASH_MS: Final = 200
"""Duration of a flash for a refused press, and of the pause after it, ms."""
REFUSED_LAMP_MS: Final = 1_200
"""Time for which the lamp shows a refused press, ms: three short flashes."""
FLASH_MS: Final = 800
"""Duration of a flash of a question with its pause, ms."""
QUESTION_CYCLE_MS: Final = 7_000
"""Cycle of the flashes of a question, ms: six flashes and a pause of at least 2 s."""


@dataclass(frozen=True, slots=True)
class Rule:
    """One interlock.

    Attributes:
        number: Value of the register "blocked by", the same for both arms.
        name: Name in tables and refusals.
        reason: Rationale.
        outputs: Outputs of one arm, or of the tray, to which the rule applies.
        allow: Condition under which the outputs may be on.
    """

    number: int
    name: str
    reason: str
    outputs: tuple[str, ...]
    allow: Expr


def arm_rules(tags: Tags, side: Side, cycle: Sequence, home: Sequence) -> list[Rule]:
    """Return all rules for the outputs of one arm."""
    sp, machine, tray = tags.sp, tags.machine, tags.tray
    a, other = tags.arms[side], tags.other(side)
    want = a.want
    clamping_place = (a.at_wanted_row & a.down) | a.at_feed
    jogged = machine.jogs[f"{side}.claws_open"]
    throws = cycle["open claws"] & (cycle["release delay"] | a.coils["claws_open"])
    opening_place = any_of(
        all_of(a.at_feed, a.down, a.is_spread, throws),
        all_of(home["put back"], a.row_in_progress, a.down, ~a.at_feed, ~a.sensed_at_feed),
        all_of(home["open at feed"], a.at_feed, a.down, a.is_spread),
        all_of(jogged, a.row_in_progress, a.at_wanted_row, a.down),
        all_of(jogged, a.discard, a.at_feed, a.down, a.is_spread),
    )
    table = [
        *_one_of_a_pair(want),
        (*_MOTION_ALLOWED, ARM_OUTPUTS, _motion_allowed(tags)),
        ("no arm fault", "a jammed actuator is no longer driven", ARM_OUTPUTS, ~a.fault | machine.jogging),
        (
            "belt at rest",
            "slide and lift must be at rest while the claws spread or converge",
            (*SLIDE, *LIFT),
            ~want["spread"] & ~want["converge"],
        ),
        (
            "inward ready",
            "moving in with the claws closed or spread would tear the seedlings",
            ("slide_inward",),
            all_of(a.down, ~a.claws_closed, ~a.loaded, a.is_converged),
        ),
        (
            "tray in place",
            "the arm moves in only over a tray at rest whose place is known",
            ("slide_inward",),
            all_of(tray.phase.equals(IN_PLACE), tray.edge, ~tray.ask, ~tray.want_run, ~tray.want_creep)
            & (tray.place_known | machine.jogging),
        ),
        (
            "stop at the row",
            "the motion inward ends at the next row; there are seedlings beyond it",
            ("slide_inward",),
            ~a.passed & any_of(*a.row_is.values()),
        ),
        (
            "centre is free",
            "the fingers of both arms overlap inward of pick 2, which an arm on its way to row 2 may pass",
            ("slide_inward",),
            any_of(a.row_is[1], sp.arms_may_meet.differs(0), ~in_the_way(a, other) & (other.at_feed | other.cycling)),
        ),
        (
            "outward clear",
            "a loaded arm moves out only when up; an empty arm when up, or when down with open claws",
            ("slide_outward",),
            a.up | all_of(a.down, ~a.loaded, ~a.claws_closed),
        ),
        (
            "lift clear",
            "over the tray the lift moves up only with the claws clamped or open",
            ("lift_retract",),
            any_of(a.at_feed, ~a.claws_closed, a.clamped),
        ),
        (
            "down at feed only",
            "elsewhere the arm would move down into the tray, except at the row it has just gripped",
            ("lift_extend",),
            a.at_feed | all_of(home["lower to put back"], a.on_row, a.at_wanted_row, ~a.down),
        ),
        (
            "spread only when up at feed",
            "there is room for spread claws only over the cups",
            ("spread",),
            all_of(a.up, a.at_feed),
        ),
        (
            "converge only when empty at feed",
            "converging would tear a load, and the cups must be below the claws",
            ("converge",),
            all_of(a.at_feed, ~a.loaded),
        ),
        (
            "not yet spread",
            "the motor would run against its end stop",
            ("spread",),
            ~(a.sensed_spread & a.reached["spread"]),
        ),
        (
            "not yet converged",
            "the motor would run against its end stop",
            ("converge",),
            ~(a.sensed_converged & a.reached["converged"]),
        ),
        (
            "close only at row or feed",
            "claws may close only at the next row or at feed",
            ("claws_close",),
            clamping_place,
        ),
        (
            "release load only at cups or row",
            "a load is released only at its own row, or over the cups from the scan in which they are under it",
            ("claws_open",),
            ~a.loaded | opening_place,
        ),
        (
            "load down only when spread",
            "converged or half spread claws would press the load onto the rims of the cups",
            ("lift_extend",),
            any_of(~a.loaded, ~a.at_feed, a.is_spread),
        ),
        ("in service", "an arm that is out of service stays at feed", ARM_OUTPUTS, ~a.out_of_service),
        *_guard_closed(tags, ARM_OUTPUTS),
    ]
    return [Rule(number, *row) for number, row in enumerate(table, 1)]


def _guard_closed(tags: Tags, outputs: tuple[str, ...]) -> list[tuple[str, str, tuple[str, ...], Expr]]:
    """Return the rule of the guard; none without its input."""
    opened = tags.x.guard_open
    reason = "with the guard open a person can reach in; the safety relay has taken the coil power"
    return [] if opened is FALSE else [("guard closed", reason, outputs, ~opened)]


def in_the_way(a: ArmTags, other: ArmTags) -> Expr:
    """Return the condition that the other arm is or may be in the centre; arms on their way to row 2 do not collide."""
    return other.in_centre & ~(a.row_is[2] & other.row_is[2])


def _one_of_a_pair(want: Mapping[str, Bit]) -> list[tuple[str, str, tuple[str, ...], Expr]]:
    reason = "two opposing coils of a valve or motor must not be on together"
    pairs = [order for pair in (SLIDE, LIFT, BELT, CLAWS) for order in (pair, pair[::-1])]
    return [(f"not with {two.replace('_', ' ')}", reason, (one,), ~want[two]) for one, two in pairs]


def tray_rules(tags: Tags) -> list[Rule]:
    """Return all rules for the conveyor."""
    tray, arms, machine = tags.tray, tags.arms, tags.machine
    at_feed = all_of(*(arm.at_feed for arm in arms.values()))
    inward = any_of(*(arm.want["slide_inward"] for arm in arms.values()))
    both = ("tray_run", "tray_forward")
    return [
        Rule(1, *_MOTION_ALLOWED, both, _motion_allowed(tags)),
        Rule(2, "arms at feed", "a moving tray would damage an arm in it", both, at_feed & ~inward),
        Rule(3, "no feeder fault", "a jammed tray is no longer driven", both, ~tray.fault | machine.jogging),
        *(Rule(4, *row) for row in _guard_closed(tags, both)),
    ]


def other_rules(tags: Tags) -> list[Rule]:
    """Return the rules for all other outputs of the I/O map that move something."""
    known = {*tray_requests(tags), *(f"{side}.{output}" for side in tags.arms for output in ARM_OUTPUTS)}
    others = tuple(tag for tag in tags.moving if tag not in known)
    guard = [Rule(2, *row) for row in _guard_closed(tags, others)]
    return [Rule(1, *_MOTION_ALLOWED, others, _motion_allowed(tags)), *guard]


def _motion_allowed(tags: Tags) -> Expr:
    return tags.machine.motion & ~tags.x.emergency_stop


def granted(request: Expr, output: str, rules: list[Rule]) -> Expr:
    """Return the condition of a coil: the output is requested, and all rules for it allow it."""
    return all_of(request, *(rule.allow for rule in rules if output in rule.outputs))


def tray_requests(tags: Tags) -> dict[str, Expr]:
    """Return the requests for the outputs of the conveyor."""
    tray = tags.tray
    return {
        "tray_run": tray.want_run | (tray.want_creep & ~tray.t_on.done),
        "tray_forward": tray.want_run | tray.want_creep,
    }


def other_requests(tags: Tags) -> dict[str, Expr]:  # noqa: ARG001 - an added output reads them
    """Return the requests for other outputs that move something, by tag; the delivered machine has none."""
    return {}


def output_block(
    tags: Tags, io_map: IoMap, rules: dict[Side, list[Rule]], rules_tray: list[Rule], rules_others: list[Rule]
) -> Block:
    """Return the block that writes every Y exactly once."""
    arms, machine = tags.arms, tags.machine
    rungs: list[Rung] = []

    def coil(tag: str, when: Expr) -> None:
        point = io_map.get(tag)
        if point is not None:
            target = Bit("Y", point.number, tag, point.meaning)
            rungs.append(Out(target, ~when if point.inverted else when))

    for side, arm in arms.items():
        for output in ARM_OUTPUTS:
            coil(f"{side}.{output}", granted(arm.want[output], output, rules[side]))
    for output, request in tray_requests(tags).items():
        coil(output, granted(request, output, rules_tray))
    for output, request in other_requests(tags).items():
        coil(output, granted(request, output, rules_others))
    state = machine.state
    blink = Bit("M", CLOCK_1_S, "1 s clock", "on for the first half of every second")
    amber = any_of(*(state.equals(s) for s in (State.SUSPENDED, State.RESETTING, State.STOPPING))) & blink
    rungs += _signal_timers(machine)
    resting = any_of(*(state.equals(s) for s in (State.ABORTED, State.ABORTING, State.HELD, State.HOLDING)))
    coil("horn", horn(machine, warns=tags.warns))
    coil("lamp_red", resting | machine.fault)
    coil("lamp_amber", _signals(machine, amber, due(tags)))
    coil("lamp_green", machine.executing)
    return Block("interlocks and outputs", tuple(rungs))


def _signal_timers(machine: MachineTags) -> list[Rung]:
    """Return the rungs that time the flashes of the amber lamp for a question and for a refused press."""
    asks, lamp = machine.question.differs(0), machine.t_question_lamp
    return [
        OnDelay(lamp, QUESTION_CYCLE_MS, when=asks & ~lamp.done),
        Set(machine.refused_shown, when=machine.refused_now),
        OnDelay(machine.t_refused_lamp, REFUSED_LAMP_MS, when=machine.refused_shown & ~machine.refused_now),
        Rst(machine.refused_shown, when=machine.t_refused_lamp.done),
    ]


def _signals(machine: MachineTags, amber: Expr, due: tuple[Bit, ...]) -> Expr:
    """Return the amber lamp.

    It is on while a press has lasted long enough to act on release, gives three short flashes for a refused press, and
    else as many flashes as the question's number.
    """

    def on(timer: Timer, first_ms: int, for_ms: int) -> Expr:
        ends = timer.value < (first_ms + for_ms) // MS_100
        return ends if first_ms == 0 else (timer.value >= first_ms // MS_100) & ends

    question, lamp, refused = machine.question, machine.t_question_lamp, machine.t_refused_lamp
    flashes = (
        on(lamp, FLASH_MS * (number - 1), FLASH_MS // 2) & (question >= number.value)
        if number > 1
        else on(lamp, 0, FLASH_MS // 2)
        for number in Question
    )
    short = any_of(*(on(refused, start, SHORT_FLASH_MS) for start in range(0, REFUSED_LAMP_MS, 2 * SHORT_FLASH_MS)))
    asks = question.differs(0)
    calm = (asks & any_of(*flashes)) | (~asks & amber)
    return any_of(machine.refused_shown & short, ~machine.refused_shown & calm, *due)


def block_register(tags: Tags, rules: dict[Side, list[Rule]], rules_tray: list[Rule]) -> Block:
    """Return the block that writes the number of the blocking rule for each arm and the tray; 0 = none."""
    rungs: list[Rung] = []
    for side, arm in tags.arms.items():
        ungranted = any_of(*(arm.want[output] & ~arm.coils[output] for output in ARM_OUTPUTS))
        rungs += _blocked_by(arm.ungranted, ungranted, arm.blocked_by, rules[side], arm.want)
    moves = tags.tray.want_run | tags.tray.want_creep
    belt = Declared("tray_requests", __name__, dict.fromkeys(tray_requests(tags), moves))
    forward = tags.tray.driven["tray_forward"]
    rungs += _blocked_by(tags.tray.ungranted, belt["tray_forward"] & ~forward, tags.tray.blocked_by, rules_tray, belt)
    return Block("refused requests", tuple(rungs))


def _blocked_by(
    bit: Bit, ungranted: Expr, register: Word, rules: list[Rule], wanted: Mapping[str, Expr]
) -> Iterator[Rung]:
    """Yield the rungs of one register; if several rules block, the first one in the table is reported."""
    yield Out(bit, when=ungranted)
    yield Mov(0, register, when=~bit)
    for rule in reversed(rules):
        wants = any_of(*dict.fromkeys(wanted[output] for output in rule.outputs))
        yield Mov(rule.number, register, when=all_of(bit, wants, ~rule.allow))
