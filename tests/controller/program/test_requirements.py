"""Safety requirements: each is violated in a forbidden situation, but not if the decisive condition is inverted."""

from __future__ import annotations

from typing import NamedTuple

import pytest

from controller.core.devices import INITIAL_PULSE, Memory
from controller.core.expr import Bit, Expr, Not, evaluate
from controller.program.interlocks import BELT, CLAWS, LIFT, SLIDE
from controller.program.operator.commands import ARM_OUTPUTS, JOGGED
from controller.program.operator.next_press import NextPress
from controller.program.requirements.safety import Safety
from controller.program.states import State
from controller.program.tags import FULL, IN_PLACE, MOVING_OUT, ROWS, SIDES, TAKEN, Side
from tests.controller.verify.proof_rig import MACHINE, SOUND, TAGS

SAFETY = Safety(MACHINE)
APPROACH = next(step.watch for bit, step in MACHINE.cycles["left"] if step.title == "approach row" and step.watch)
REQUIREMENTS = {each.name: each.never for each in SOUND.requirements}
PLACE_OF = {
    "lift_down": "down",
    "lift_up": "up",
    "slide_at_feed": "feed",
    **{f"slide_at_pick_{row}": f"pick {row}" for row in ROWS},
    "claws_spread": "spread",
    "claws_converged": "converged",
}
"""Place of each switch of an arm."""
MOVES = "lift_extend"
"""Arbitrary motion coil."""


class Case(NamedTuple):
    """Situation that a requirement forbids, and the condition whose inversion makes the situation permissible."""

    requirement: str
    on: str
    turned: str


OF_AN_ARM: dict[str, list[Case]] = {
    "never both coils of one valve or motor": [
        Case(f"{one} with {two}", f"{one} {two}", one) for one, two in (SLIDE, LIFT, BELT, CLAWS)
    ],
    "inward only down, open, converged, over a tray in place": [
        Case("inward, not down", "slide_inward lift_up", "lift_down"),
        Case("inward, claws not open", "slide_inward", "open"),
        Case("inward, not converged", "slide_inward claws_spread", "claws_converged"),
        Case("inward, no tray at rest", "slide_inward tray_in_place", "tray_front_edge"),
        Case("inward, no tray at rest", "slide_inward tray_front_edge", "tray_in_place"),
        Case("inward, tray unknown", "slide_inward tray_asked", "tray_asked"),
    ],
    "inward no further than the next row": [
        Case("inward, past the row", "slide_inward arrived", "arrived"),
        Case("inward, past the row", "slide_inward arrived", "slide_inward"),
    ],
    "claws close only at a valid row or at feed": [
        Case("close away from row and feed", "claws_close lift_down", "slide_at_feed"),
        Case("close away from row and feed", "claws_close lift_down", "slide_at_pick_1"),
        Case("close away from row and feed", "claws_close slide_at_pick_1", "lift_down"),
        Case("close away from row and feed", "claws_close lift_down slide_at_pick_2", "row_1_taken"),
        Case("close away from row and feed", "claws_close lift_down slide_at_pick_1 row_1_taken", "row_1_taken"),
    ],
    "the lift goes up over the tray only clamped for its dwell, or open": [
        Case("up, claws neither open nor clamped", "lift_retract", "gripped"),
        Case("up, claws neither open nor clamped", "lift_retract", "open"),
        Case("up, claws neither open nor clamped", "lift_retract", "slide_at_feed"),
    ],
    "a load goes out only up; an empty arm up, or low and open": [
        Case("outward with a load, not up", "slide_outward holds", "lift_up"),
        Case("outward with a load, not up", "slide_outward holds", "holds"),
        Case("outward, not up, claws not open", "slide_outward lift_down", "open"),
        Case("outward, not up, claws not open", "slide_outward open", "lift_down"),
        Case("outward, not up, claws not open", "slide_outward", "lift_up"),
    ],
    "down only at feed": [Case("down away from feed", "lift_extend", "slide_at_feed")],
    "a load goes down over the cups only when spread": [
        Case("down over the cups with a load, not spread", f"{MOVES} holds slide_at_feed", turned)
        for turned in (MOVES, "holds", "slide_at_feed", "claws_spread")
    ],
    "spread only up at feed": [
        Case("spread, not up at feed", "spread lift_up", "slide_at_feed"),
        Case("spread, not up at feed", "spread slide_at_feed", "lift_up"),
    ],
    "slide and lift are at rest while the belt runs": [
        Case("belt with slide or lift", f"{belt} {other}", turned)
        for belt, other, turned in (
            ("spread", "slide_inward", "slide_inward"),
            ("spread", "lift_retract", "spread"),
            ("converge", "slide_outward", "converge"),
            ("converge", "lift_extend", "lift_extend"),
        )
    ],
    "the belt stops at its ends": [
        Case("belt against its end stop", "spread claws_spread", "claws_spread"),
        Case("belt against its end stop", "converge claws_converged", "claws_converged"),
    ],
    "converge only empty, at feed": [
        Case("converge with a load", "converge holds slide_at_feed", "holds"),
        Case("converge away from feed", "converge", "slide_at_feed"),
    ],
    "a load opens only over its cups, at its row, or by a discard command": [
        *(
            Case(
                "load released away from its cups and row",
                " ".join(["claws_open holds", *(name for name in over_cups if name != missing)]),
                missing,
            )
            for over_cups in (
                ("slide_at_feed", "lift_down", "claws_spread", "released"),
                ("slide_at_feed", "lift_down", "claws_spread", "discarded"),
            )
            for missing in over_cups
        ),
        Case("load released away from its cups and row", "claws_open holds lift_down", "unmoved"),
        Case("load released away from its cups and row", "claws_open holds unmoved", "lift_down"),
        Case("load released away from its cups and row", "claws_open holds", "holds"),
    ],
    "never both arms in one space": [
        Case("inward, other arm in the centre", "slide_inward rows_1_and_2_taken other_in_centre", "other_in_centre"),
        Case("inward, other arm in the centre", "slide_inward rows_1_and_2_taken other_in_centre", "arms_may_meet"),
    ],
    "a jammed actuator is driven only in manual mode": [
        Case("coil on during a fault", "fault claws_open", "fault"),
        Case("coil on during a fault", "fault claws_open", "manual"),
    ],
    "each release is one cycle, and no row changes without a reason": [
        Case("a release not counted once", "miscounted", "miscounted"),
        Case("a row changed without its reason", "row_changed", "row_changed"),
    ],
    "an arm out of service is never driven, in no mode": [
        *(
            Case("coil on while out of service", f"out_of_service manual {coil}", "out_of_service")
            for coil in ARM_OUTPUTS
        ),
        Case("coil on while out of service", "out_of_service claws_close", "claws_close"),
    ],
}
OF_THE_MACHINE: dict[str, list[Case]] = {
    "the tray moves only with both arms at feed, and none goes in over it": [
        *(
            Case("tray moves with an arm away from feed", f"{coil} {at_feed}.slide_at_feed", f"{away}.slide_at_feed")
            for coil in ("tray_run", "tray_forward")
            for at_feed, away in (SIDES, SIDES[::-1])
        ),
        *(Case("tray moves while an arm moves in", f"tray_run {side}.slide_inward", "tray_run") for side in SIDES),
        Case("tray moves in the wrong direction", "tray_run", "tray_forward"),
        Case("tray moves during a fault", "tray_forward tray_fault", "tray_fault"),
        Case("tray moves during a fault", "tray_forward tray_fault", "manual"),
    ],
    "no arm goes in over a tray that may have been moved by hand": [
        *(
            Case("inward, tray perhaps moved", f"{side}.slide_inward", turned)
            for side in SIDES
            for turned in ("tray_fed", "manual", f"{side}.slide_inward")
        ),
    ],
    "nothing moves in an emergency stop": [
        Case("motion during an emergency stop", f"emergency_stop motion left.{MOVES}", "emergency_stop"),
        Case("motion during an emergency stop", "emergency_stop motion tray_run", "tray_run"),
    ],
    "no motion without inputs or after a fault": [
        Case("motion without inputs", f"link_lost motion right.{MOVES}", "link_lost"),
        Case("motion after a scan or store fault", f"scan_fault motion left.{MOVES}", "scan_fault"),
        Case("motion without outputs", f"outputs_taken motion left.{MOVES}", "outputs_taken"),
        Case("motion after a scan or store fault", f"store_fault motion left.{MOVES}", "store_fault"),
    ],
    "nothing restarts by itself: after reset, power or link return": [
        Case("motion in a state that does not allow it", f"left.{MOVES}", "motion"),
        Case("motion in the first scan", f"first_scan motion left.{MOVES}", "first_scan"),
        Case("restart without a command", "restarted", "restarted"),
    ],
    "an emergency stop is ended only by a person": [
        Case("clearing without the end of a press or a command", "cleared_unbidden", "cleared_unbidden"),
    ],
    "constants that differ are confirmed before the first homing": [
        *(
            Case("homing before the constants are confirmed", f"{mode} unconfirmed entered_resetting", "unconfirmed")
            for mode in ("", "manual")
        ),
        Case("homing before the constants are confirmed", "unconfirmed entered_resetting", "entered_resetting"),
    ],
    "no line names a key that is refused": [
        Case("a refused key named", "stopped names_home stop", "stop"),
        Case("a refused key named", "stopped names_home constants_open", "constants_open"),
        Case("a refused key named", "stopped names_home stop", "names_home"),
        Case("a refused key named", "stopped names_home stop", "refused_now"),
        *(
            Case("a refused key named", "stopped names_full_tray tray_asked tray_front_edge motion", turned)
            for turned in ("tray_asked", "motion", "stopped")
        ),
    ],
    "one arm at least is in service": [
        Case("both arms out of service", "left.out_of_service right.out_of_service", f"{side}.out_of_service")
        for side in SIDES
    ],
    "jogging only while the command is renewed": [
        Case("jog without renewal", f"manual motion left.{MOVES}", "jog"),
        Case("jog without renewal", f"manual motion left.{MOVES} jog jog_lease_over", "jog_lease_over"),
        Case("jog without command", "jog_unbidden", "jog_unbidden"),
    ],
    "in manual mode, only the output of the last jog command": [
        Case("another output than the jogged one", f"manual {JOGGED[0]}", "jog"),
        Case("another output than the jogged one", f"manual {JOGGED[0]}", "manual"),
        Case("another output than the jogged one", f"manual jog {JOGGED[0]} {JOGGED[1]}", JOGGED[1]),
        Case("another output than the jogged one", "manual jog tray_forward", "tray_forward"),
    ],
    "no tray leaves with full rows unless a person orders it, or an arm is out of service": [
        *(
            Case("full rows leave without an order", "tray_leaves tray_moving_out", turned)
            for turned in ("tray_leaves", "tray_moving_out", "answers_none", "empties_the_line")
        ),
        Case(
            "full rows leave without an order",
            "tray_leaves tray_moving_out left.out_of_service",
            "right.out_of_service",
        ),
    ],
    "an elapsed time limit has its alarm": [
        Case("a time limit elapsed without its alarm", "approaches limit_elapsed", turned)
        for turned in ("approaches", "limit_elapsed", "limit_alarm")
    ],
}


class RestingMachine:
    """Memory after a scan of a machine at rest, with a full tray that is not in place; conditions can be made true."""

    def __init__(self) -> None:
        self.memory = Memory()
        for point in (*MACHINE.io_map.inputs, *MACHINE.io_map.outputs):
            self.memory.bits(point.device)[point.number] = point.level(False)
        for arm in TAGS.arms.values():
            for row in ROWS:
                self.memory.D[arm.rows[row].number] = FULL
            for bit in (*arm.reached.values(), *SAFETY.arms[arm.side].positions.verified.values()):
                self.set_true(bit)

    def set_true(self, condition: Expr) -> None:
        """Set the terminal or relay in a condition such that the condition is true."""
        bit = condition.operand if isinstance(condition, Not) else condition
        assert isinstance(bit, Bit)
        self.memory.bits(bit.kind)[bit.number] = not isinstance(condition, Not)


def machine_facts() -> dict[str, Expr]:
    machine, system, tray = TAGS.machine, TAGS.system, TAGS.tray
    facts: dict[str, Expr] = {
        "motion": machine.motion,
        "manual": machine.manual,
        "jog_lease_over": machine.t_jog_lease.done,
        "first_scan": Bit("M", INITIAL_PULSE),
        "emergency_stop": TAGS.x.emergency_stop,
        "stop": TAGS.x.stop,
        "refused_now": TAGS.machine.refused_now,
        "constants_open": TAGS.machine.constants_open,
        "link_lost": system.link_lost,
        "scan_fault": system.scan_fault,
        "outputs_taken": system.outputs_taken,
        "store_fault": system.store_fault,
        "restarted": SAFETY.machine.restarted,
        "jog_unbidden": SAFETY.machine.jog_unbidden,
        "cleared_unbidden": SAFETY.machine.cleared_unbidden,
        "unconfirmed": SAFETY.machine.unconfirmed,
        "entered_resetting": TAGS.machine.entered_resetting,
        "tray_front_edge": tray.edge,
        "tray_fault": MACHINE.alarms.tray_jam,
        "tray_asked": tray.ask,
        "tray_leaves": tray.leaves,
        "answers_none": TAGS.commands.tray_none,
        "empties_the_line": machine.emptying,
        "approaches": MACHINE.cycles["left"]["approach row"],
        "limit_elapsed": APPROACH.timer.done,
        "limit_alarm": APPROACH.alarm,
        "tray_fed": SAFETY.machine.tray_fed,
        **tray.driven,
    }
    return facts | {f"{side}.{name}": fact for side in SIDES for name, fact in arm_facts(side).items()}


def arm_facts(side: Side) -> dict[str, Expr]:
    arm, own = TAGS.arms[side], SAFETY.arms[side]
    return {
        **arm.coils,
        **{f"slide_at_pick_{row}": arm.sensed_at_pick[row] for row in ROWS},
        "slide_at_feed": arm.sensed_at_feed,
        "lift_down": arm.sensed_down,
        "lift_up": arm.sensed_up,
        "claws_spread": arm.sensed_spread,
        "claws_converged": arm.sensed_converged,
        "out_of_service": arm.out_of_service,
        "fault": next(iter(MACHINE.alarms.of_side(side))),
        **{name: getattr(own.counts, name) for name in ("miscounted", "row_changed")},
        **{
            name: getattr(own, name)
            for name in ("open", "gripped", "holds", "unmoved", "released", "discarded", "arrived")
        },
    }


def situation(on: set[str], side: Side) -> Memory:
    """Return a memory with these conditions true; conditions of an arm refer to the given side."""
    here, facts = RestingMachine(), machine_facts()
    words = here.memory.D
    arm, other = TAGS.arms[side], SAFETY.arms["right" if side == "left" else "left"]
    for name in on:
        match name:
            case "tray_in_place":
                words[TAGS.tray.phase.number] = IN_PLACE
            case "tray_moving_out":
                words[TAGS.tray.phase.number] = MOVING_OUT
            case "row_1_taken":
                words[arm.rows[1].number] = TAKEN
            case "rows_1_and_2_taken":
                words[arm.rows[1].number] = words[arm.rows[2].number] = TAKEN
                here.set_true(arm.row_is[3])
            case "arms_may_meet":
                words[TAGS.sp.arms_may_meet.number] = 1
            case "stopped":
                words[TAGS.machine.state.number] = State.STOPPED
            case "names_home":
                words[TAGS.machine.next_press.number] = NextPress.HOME
            case "names_full_tray":
                words[TAGS.machine.next_press.number] = NextPress.ANSWER_FULL_TRAY
            case "jog":
                words[TAGS.machine.jog.number] = 1
            case "other_in_centre":
                here.set_true(other.in_centre)
            case _:
                here.set_true(facts[name] if name in facts else facts[f"{side}.{name}"])
    return here.memory


def breaks(requirement: str, on: set[str], side: Side, *, unverified: str | None = None) -> bool:
    memory = situation(on, side)
    if unverified is not None:
        named, _, place = unverified.rpartition(".")
        arm: Side = "right" if named == "right" else "left" if named == "left" else side
        memory.M[SAFETY.arms[arm].positions.verified[PLACE_OF[place]].number] = False
    return evaluate(REQUIREMENTS[requirement], memory)


def _named(value: Side | Case) -> str:
    return value if isinstance(value, str) else f"{value.requirement}, {value.turned}"


CASES_OF_AN_ARM = [(side, case) for side in SIDES for cases in OF_AN_ARM.values() for case in cases]
CASES_OF_THE_MACHINE = [case for cases in OF_THE_MACHINE.values() for case in cases]


@pytest.mark.parametrize(("side", "case"), CASES_OF_AN_ARM, ids=_named)
def test_a_requirement_of_an_arm_forbids_exactly_what_is_demanded(side: Side, case: Case) -> None:
    """A forbidden situation becomes permissible if its decisive condition is inverted."""
    on = set(case.on.split())
    assert breaks(f"{side}: {case.requirement}", on, side)
    assert not breaks(f"{side}: {case.requirement}", on ^ {case.turned}, side)


@pytest.mark.parametrize("case", CASES_OF_THE_MACHINE, ids=_named)
def test_a_requirement_of_the_machine_forbids_exactly_what_is_demanded(case: Case) -> None:
    """A forbidden situation becomes permissible if its decisive condition is inverted."""
    on = set(case.on.split())
    assert breaks(case.requirement, on, "left")
    assert not breaks(case.requirement, on ^ {case.turned}, "left")


BY_SWITCH = {
    ("belt against its end stop", "claws_spread"),
    ("belt against its end stop", "claws_converged"),
    ("down over the cups with a load, not spread", "slide_at_feed"),
}
"""Requirements that forbid a motion if the switch is on, verified or not."""


@pytest.mark.parametrize(
    ("side", "case"),
    [
        *(
            (side, case)
            for side, case in CASES_OF_AN_ARM
            if case.turned in PLACE_OF and (case.requirement, case.turned) not in BY_SWITCH
        ),
        *(("left", case) for case in CASES_OF_THE_MACHINE if case.turned.partition(".")[2] in PLACE_OF),
    ],
    ids=_named,
)
def test_a_switch_that_is_not_verified_permits_nothing(side: Side, case: Case) -> None:
    """A switch that is on permits a motion only if it was verified since its device was last driven away."""
    requirement = case.requirement if case in CASES_OF_THE_MACHINE else f"{side}: {case.requirement}"
    on = set(case.on.split()) ^ {case.turned}
    assert not breaks(requirement, on, side)
    assert breaks(requirement, on, side, unverified=case.turned)


def test_every_requirement_states_a_demand() -> None:
    """The cases cover every requirement of the program and name no others."""
    stated = {f"{side}: {case.requirement}" for side, case in CASES_OF_AN_ARM}
    assert stated | {case.requirement for case in CASES_OF_THE_MACHINE} == set(REQUIREMENTS)
