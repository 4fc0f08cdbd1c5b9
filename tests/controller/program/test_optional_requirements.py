"""Requirements of optional points: each is violated in a forbidden situation, but not if one condition is inverted."""

from __future__ import annotations

from typing import NamedTuple

import pytest

from controller.core.devices import Memory
from controller.core.expr import Bit, Expr, Not, evaluate
from controller.program.machine import build
from controller.program.requirements.safety import Safety
from controller.program.states import State
from tests.controller.verify.proof_rig import SOUND
from tests.wiring import wired

MACHINE = build(wired("guard", "horn"))
SAFETY = Safety(MACHINE)


class Case(NamedTuple):
    """Situation that a requirement forbids, and the condition whose inversion makes the situation permissible."""

    requirement: str
    on: tuple[str, ...]
    turned: str


CASES = [
    *(
        Case("motion with the guard open", ("left.lift_extend", "guard open"), turned)
        for turned in ("left.lift_extend", "guard open")
    ),
    *(
        Case("motion after the guard without an order", ("tray_run", "after guard"), turned)
        for turned in ("tray_run", "after guard")
    ),
    *(
        Case("an answer by a press with the guard open", ("X0 lasts", "X0 opened"), turned)
        for turned in ("X0 lasts", "X0 opened", "X0")
    ),
    *(
        Case("an answer by a press with the guard open", ("X24 lasts", "X24 opened"), turned)
        for turned in ("X24 lasts", "X24 opened", "X24")
    ),
    *(
        Case("a coil on from rest without a warning", ("tray_run", "unwarned"), turned)
        for turned in ("tray_run", "unwarned", "manual", "stopping", "holding")
    ),
]


STATES = {"stopping": State.STOPPING, "holding": State.HOLDING}


def facts() -> dict[str, Expr]:
    tags, monitor = MACHINE.tags, SAFETY.machine
    return {
        **tags.moving,
        "guard open": tags.x.guard_open,
        "after guard": monitor.after_guard,
        "unwarned": monitor.unwarned,
        "manual": tags.machine.manual,
        "X0": tags.x.start,
        "X0 lasts": tags.machine.yes_due,
        "X0 opened": SAFETY.guarded_presses.start_opened,
        "X24": tags.x.stop,
        "X24 lasts": tags.machine.no_due,
        "X24 opened": SAFETY.guarded_presses.stop_opened,
    }


def breaks(requirement: str, on: set[str]) -> bool:
    """Return True if a machine at rest in which these facts hold breaks the requirement."""
    memory = Memory()
    for point in (*MACHINE.io_map.inputs, *MACHINE.io_map.outputs):
        memory.bits(point.device)[point.number] = point.level(False)
    for name in on:
        if name in STATES:
            memory.D[MACHINE.tags.machine.state.number] = STATES[name]
            continue
        condition = facts()[name]
        bit = condition.operand if isinstance(condition, Not) else condition
        assert isinstance(bit, Bit)
        memory.bits(bit.kind)[bit.number] = not isinstance(condition, Not)
    (never,) = (each.never for each in SAFETY.requirements if each.name == requirement)
    return evaluate(never, memory)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_requirement_forbids_the_situation_only(case: Case) -> None:
    assert breaks(case.requirement, {*case.on})
    assert not breaks(case.requirement, {*case.on} ^ {case.turned})


def test_every_requirement_of_an_optional_point_states_a_demand() -> None:
    added = {each.name for each in SAFETY.requirements} - {each.name for each in SOUND.requirements}
    assert added == {case.requirement for case in CASES}
