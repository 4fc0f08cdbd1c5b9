"""Safety requirements: each is violated in a forbidden situation, but not if the decisive condition is inverted."""

from __future__ import annotations

import pytest

from controller.core.devices import INITIAL_PULSE, Memory
from controller.core.expr import Bit, Expr, Not, evaluate
from controller.program.operator.next_press import NextPress
from controller.program.requirements.safety import Safety
from controller.program.states import State
from controller.program.tags import FULL, IN_PLACE, MOVING_OUT, ROWS, SIDES, TAKEN, Side
from tests.controller.program.requirement_cases import OF_AN_ARM, OF_THE_MACHINE, PLACE_OF, Case
from tests.controller.verify.proof_rig import MACHINE, SOUND, TAGS

SAFETY = Safety(MACHINE)
APPROACH = next(step.watch for bit, step in MACHINE.cycles["left"] if step.title == "approach row" and step.watch)
REQUIREMENTS = {each.name: each.never for each in SOUND.requirements}


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
        "declared_with_memory": SAFETY.declaration.with_memory,
        "declared_in_motion": SAFETY.declaration.in_motion,
        "declared_in_use": SAFETY.declaration.in_use,
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
