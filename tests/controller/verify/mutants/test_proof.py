"""Proof of mutants: violated goals, ways out, equivalence, differences in time, display and blocking rules."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from controller.core.rungs import Out, Rst, Rung, Set
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.verify.cells import Cell
from controller.verify.model import Model
from controller.verify.mutants.blocking import Blocking
from controller.verify.mutants.change import Kind
from controller.verify.mutants.influence import influences_outputs
from controller.verify.mutants.judgement import Judgement
from controller.verify.mutants.proof import MutantProof
from controller.verify.mutants.result import Fate, MutantResult
from controller.verify.mutants.sample import Mutant, mutants_of, sample
from controller.verify.mutants.shared_run import SharedRun
from controller.verify.report import Result as ProofResult
from controller.verify.report import prove
from controller.verify.symbolic import execute
from controller.verify.timing import ExactTimers
from tests.controller.core.core_rig import m, x, y
from tests.controller.verify.proof_rig import MACHINE, SOUND
from tests.controller.verify.verify_rig import GOAL, specification_of
from tests.sampling import first_of


@cache
def mutants() -> dict[str, Mutant]:
    return {str(mutant): mutant for mutant in mutants_of(MACHINE.program)}


@cache
def proof() -> MutantProof:
    return MutantProof(SOUND)


def judged(*items: Rung, never: object = None) -> dict[str, MutantResult]:
    """Return the results of all mutants of a small program, which has no stories."""
    specification = specification_of(*items, never=never)  # type: ignore[arg-type]
    judgement = Judgement(specification, {})
    return {each.name: each for each in judgement.results(mutants_of(specification.program), None)}


LOCKED = (Out(y(0), x(0) & ~x(1)), Out(y(1), x(1) & x(2)), Out(m(5), x(2)))
"""Two outputs that exclude each other, and a relay that nothing reads."""


def test_a_missing_interlock_is_killed_by_proof() -> None:
    """The interlock is needed; another contact of the second output is not needed for safety."""
    results = judged(*LOCKED, never=y(0) & y(1))
    assert results["all: OUT Y0: ~X1 dropped"].fate is Fate.PROOF
    assert results["all: OUT Y0: ~X1 dropped"].evidence == GOAL
    assert results["all: OUT Y1: X2 dropped"].fate is Fate.OPEN


def test_a_change_without_effect_on_any_device_is_equivalent() -> None:
    """A latch whose inputs exclude each other has no priority."""
    results = judged(Set(m(0), x(0) & ~x(1)), Rst(m(0), x(1)), Out(y(0), m(0)))
    assert results["all: SET M0 and RST M0: exchanged (M0)"].fate is Fate.EQUIVALENT
    assert results["all: SET M0: ~X1 dropped"].fate is Fate.EQUIVALENT
    assert results["all: SET M0: X0 inverted"].fate is not Fate.EQUIVALENT


def test_a_change_of_a_relay_that_no_output_depends_on_is_named() -> None:
    results = judged(*LOCKED)
    assert results["all: OUT M5: X2 inverted"].fate is Fate.DISPLAY
    assert results["all: OUT Y0: X0 inverted"].fate is Fate.OPEN


def test_influence_passes_through_rungs_and_steps() -> None:
    """A terminal influences the outputs; the registers that a panel displays do not."""
    found = influences_outputs(MACHINE.program)
    assert {Cell("X", point.number) for point in MACHINE.io_map.inputs} <= found
    tags = MACHINE.tags
    displays = (tags.machine.refused, tags.machine.reason, tags.arms["left"].blocked_by, tags.tray.blocked_by)
    assert not {Cell("D", word.number) for word in displays} & found
    assert {Cell("T", tags.arms["left"].t_opening.number), Cell("D", tags.machine.state.number)} <= found


@pytest.mark.nightly
@pytest.mark.parametrize("first", first_of([True, False]))
def test_shared_execution_equals_a_complete_one(*, first: bool) -> None:
    """For mutants of every kind, the terms of all devices are identical."""
    model = Model(SOUND)
    before, _ = model.unknown("before")
    start = model.start(before, "scan", first=first, timing=ExactTimers.aged("scan"))
    shared = SharedRun(model.program, start, lambda: ExactTimers.aged("scan"))
    for mutant in sample([*mutants().values()], 7, 5):
        watched = replace(SOUND, program=mutant.program).watched
        one, other = shared.executed(watched), execute(watched, start, ExactTimers.aged("scan")).after
        assert one.keys() == other.keys()
        assert [str(cell) for cell in one if not one[cell].eq(other[cell])] == [], str(mutant)


KNOWN = {
    "buttons and commands: OUT clear requested: stop (n.c.) dropped": (
        "clearing without the end of a press or a command"
    ),
    "interlocks and outputs: OUT left.lift_extend: ~left.loaded | ~left.at feed | left.is spread dropped": (
        "left: down over the cups with a load, not spread"
    ),
}
"""Mutants that once survived, with the requirements that now kill them."""


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "goal"), first_of(KNOWN.items()))
def test_mutants_that_survived_are_killed(name: str, goal: str) -> None:
    """A stuck X24 no longer clears an emergency stop, and a load is no longer lowered half spread, unnoticed."""
    assert goal in proof().violated(mutants()[name].program)


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "goal"), first_of(KNOWN.items()))
def test_the_shared_proof_agrees_with_the_proof(name: str, goal: str) -> None:
    """A mutant with a violated goal is reported by ``prove``."""
    changed = replace(SOUND, program=mutants()[name].program)
    report = prove(changed, clock=lambda: 0.0, only=[goal], short=True)
    assert [row.result for row in report.rows if row.name == goal] == [ProofResult.UNPROVED]


@pytest.mark.nightly
def test_the_shared_proof_of_the_original_program_has_no_violation() -> None:
    assert proof().violated(MACHINE.program) == []
    assert proof().blocked_way_out(MACHINE.program) == ""


@pytest.mark.nightly
def test_a_preset_changes_durations_only() -> None:
    name = "buttons and commands: OUT jog lease: 600 ms instead of 300 ms"
    assert proof().differs_in_time_only(mutants()[name].program)
    other = "buttons and commands: OUT clear requested: stop (n.c.) dropped"
    assert not proof().differs_in_time_only(mutants()[other].program)


@pytest.mark.nightly
def test_the_rule_that_blocks_a_mutant_is_named() -> None:
    """Without one of the two rules of a pair, the other one prevents both coils from being on."""
    rules = {
        f"left: {rule}": (lambda rule=rule: build(load_io_map(DEFAULT_IO_MAP), without=[f"left: {rule}"]).program)
        for rule in ("not with lift retract", "not with lift extend")
    }
    name = "interlocks and outputs: OUT left.lift_extend: ~left.want lift_retract dropped"
    found = Blocking(SOUND, rules).rule_that_blocks(mutants()[name])
    assert found is not None
    assert (found.rule, found.goal) == ("left: not with lift extend", "left: lift_extend with lift_retract")


@pytest.mark.nightly
def test_no_preset_of_a_timer_violates_a_goal() -> None:
    """The proof covers all durations, so that a changed time, in contrast to a changed count, is never killed by it."""
    changed = [each for each in sample([*mutants().values()], 140, 1) if each.kind is Kind.PRESET]
    times = [each for each in changed if each.text.endswith(" ms")]
    assert len(times) > 10
    assert [str(each) for each in times[:5] if proof().violated(each.program)] == []
