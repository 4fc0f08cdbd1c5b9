"""Mutation tests of the proof: removed interlock rules and mutated rungs are detected."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import pytest

from controller.core.expr import FALSE, TRUE, Bit, Expr, Not, Timer, Word
from controller.core.rungs import Mov, OnDelay, Out, Rst, Rung, Set, ZoneReset
from controller.program.interlocks import BELT, CLAWS, LIFT, SLIDE
from controller.program.tags import FIRST_SCAN, SIDES, Side
from controller.verify.model import Model
from controller.verify.report import Result, prove
from controller.verify.trace import Trace, breaks
from tests.controller.verify.proof_rig import MACHINE, TAGS, Change, is_breakable, mutated, put, seconds, without
from tests.sampling import first_of

Target = TypeVar("Target", Bit, Word, Timer)
ARM, CYCLE, HOME = TAGS.arms["left"], MACHINE.cycles["left"], MACHINE.homings["left"]
CONTROL = TAGS.machine


def pair(one: str, two: str) -> tuple[str, str]:
    """Return the names of the two rules that prevent two coils from being on together."""
    return f"not with {one.replace('_', ' ')}", f"not with {two.replace('_', ' ')}"


# ---- interlock rules ----------------------------------------------------------------------------------------------

UPHELD_BY_RULES: dict[tuple[str, ...], tuple[str, ...]] = {
    pair(*LIFT): ("lift_extend with lift_retract",),
    ("motion allowed",): ("close away from row and feed",),
    ("no arm fault",): ("coil on during a fault",),
    ("belt at rest",): ("belt with slide or lift",),
    ("inward ready",): ("inward, not down", "inward, claws not open", "inward, not converged"),
    ("tray in place",): ("inward, no tray at rest", "inward, tray unknown"),
    ("stop at the row",): ("inward, past the row",),
    ("not yet spread",): ("belt against its end stop",),
    ("not yet converged",): ("belt against its end stop",),
    ("centre is free",): ("inward, other arm in the centre",),
    ("outward clear",): ("outward with a load, not up", "outward, not up, claws not open"),
    ("lift clear",): ("up, claws neither open nor clamped",),
    ("down at feed only",): ("down away from feed",),
    ("spread only when up at feed",): ("spread, not up at feed",),
    ("converge only when empty at feed",): ("converge with a load", "converge away from feed"),
    ("close only at row or feed",): ("close away from row and feed",),
    ("release load only at cups or row",): ("load released away from its cups and row",),
    ("load down only when spread",): ("down over the cups with a load, not spread",),
    ("in service",): ("coil on while out of service",),
}
"""Arm rules and pairs of rules, each with the requirements that are violated if the rule or pair is removed."""
UPHELD_BY_TRAY_RULES = {
    "arms at feed": "tray moves with an arm away from feed",
    "no feeder fault": "tray moves during a fault",
}
PAIRS = tuple(pair(*coils) for coils in (SLIDE, LIFT, BELT, CLAWS))
REDUNDANT: dict[tuple[str, ...], str] = {
    pair(*SLIDE): "no step requests both coils, and manual control drives one output at a time",
    pair(*BELT): "as for the slide coils",
    pair(*CLAWS): "as for the slide coils",
    **{(name,): "the other rule of the pair remains" for names in PAIRS for name in names},
}
"""Arm rules and pairs of rules that can be removed without violating any requirement, each with the reason."""
SELECTED_RULES = ("lift clear", "centre is free", "down at feed only")


def assert_violated_without(rules: tuple[str, ...], requirements: tuple[str, ...]) -> None:
    """Check that removing these rules violates every requirement, and that a soft PLC can replay each trace."""
    of = without(*rules)
    report = prove(of, clock=seconds, only=requirements)
    rows = {row.name: row for row in report.rows if row.name in requirements}
    model = Model(of)
    goals = {goal.name: goal for goal in model.goals}
    for name in requirements:
        row = rows[name]
        assert row.result in {Result.BROKEN, Result.UNPROVED}, name
        assert row.trace is not None, name
        assert breaks(model.program, Trace.from_json(row.trace.to_json()), goals[name])
    assert {row.result for row in rows.values()} <= {Result.BROKEN, Result.UNPROVED}


def test_every_rule_upholds_a_requirement_or_is_listed_as_redundant() -> None:
    """Together, the two tables of arm rules are complete; the table of tray rules omits only "motion allowed"."""
    listed = {name for rules in (*UPHELD_BY_RULES, *REDUNDANT) for name in rules}
    for side in SIDES:
        assert listed == {rule.name for rule in MACHINE.rules[side]}
    assert {*UPHELD_BY_TRAY_RULES, "motion allowed"} == {rule.name for rule in MACHINE.tray_rules}


@pytest.mark.parametrize("rule", first_of(SELECTED_RULES))
def test_without_a_rule_a_scan_can_violate_its_requirements(rule: str) -> None:
    """If a rule of the left arm is removed, a scan from a state without violations can violate its requirements."""
    for name in UPHELD_BY_RULES[rule,]:
        assert is_breakable(without(f"left: {rule}"), f"left: {name}"), name


@pytest.mark.nightly
@pytest.mark.timeout(900)
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("rules", "requirements"), UPHELD_BY_RULES.items(), ids=lambda names: names[0])
def test_every_removed_rule_violates_its_requirements(
    side: Side, rules: tuple[str, ...], requirements: tuple[str, ...]
) -> None:
    """If any non-redundant rule is removed, its requirements are violated, and the traces can be replayed."""
    assert_violated_without(
        tuple(f"{side}: {name}" for name in rules), tuple(f"{side}: {name}" for name in requirements)
    )


@pytest.mark.nightly
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("rule", "requirement"), UPHELD_BY_TRAY_RULES.items())
def test_every_removed_rule_of_the_tray_violates_its_requirement(rule: str, requirement: str) -> None:
    """If a tray rule is removed, its requirement is violated, and the trace of the violation can be replayed."""
    assert_violated_without((f"tray: {rule}",), (requirement,))


@pytest.mark.nightly
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("rules", REDUNDANT, ids=" and ".join)
def test_removed_redundant_rule_violates_nothing(side: Side, rules: tuple[str, ...]) -> None:
    """If a rule listed as redundant is removed, every goal is still proved."""
    assert not is_breakable(without(*(f"{side}: {name}" for name in rules)))


@pytest.mark.nightly
@pytest.mark.parametrize("coils", [SLIDE, LIFT, BELT, CLAWS], ids=" and ".join)
def test_pair_of_rules_separates_coils_that_are_requested_together(coils: tuple[str, str]) -> None:
    """If both coils of a valve or motor are requested by mistake, only their two rules prevent both from being on."""
    one, two = coils
    request = next(
        rung.when for rung in MACHINE.program.rungs() if isinstance(rung, Out) and rung.target == ARM.want[two]
    )
    both = driven(Out, ARM.want[one], request)
    goal = f"left: {' with '.join(coils)}"
    assert not is_breakable(mutated(both), goal)
    assert is_breakable(mutated(both, *(f"left: {name}" for name in pair(*coils))), goal)


# ---- rungs ------------------------------------------------------------------------------------------------------


def target_of(rung: Rung) -> object:
    match rung:
        case OnDelay(timer):
            return timer
        case ZoneReset(first):
            return first
        case Set(target) | Rst(target) | Out(target) | Mov(_, target):
            return target
    return None


def dropped(kind: type[Rung], target: Target, block: str = "") -> Change:
    """Return a change that removes the rungs of this kind and target."""
    return lambda title, rung: None if _is(rung, kind, target) and title.startswith(block) else rung


def driven(kind: type[Rung], target: Target, by: Expr, instead_of: Expr | None = None, block: str = "") -> Change:
    """Return a change that replaces the condition, or part of it, of the rungs of this kind and target."""

    def change(title: str, rung: Rung) -> Rung:
        if not _is(rung, kind, target) or not title.startswith(block):
            return rung
        return replace(rung, when=by if instead_of is None else put(rung.when, instead_of, by))

    return change


def shortened(timer: Timer) -> Change:
    """Return a change that makes a timer elapse after one count."""
    return lambda _, rung: (
        replace(rung, preset=timer.base_ms) if isinstance(rung, OnDelay) and rung.timer == timer else rung
    )


def everywhere(part: Expr, by: Expr) -> Change:
    """Return a change that replaces all occurrences of a part of a condition."""
    return lambda _, rung: replace(rung, when=put(rung.when, part, by))


def _is(rung: Rung, kind: type[Rung], target: Bit | Word | Timer) -> bool:
    found = target_of(rung)
    return isinstance(rung, kind) and type(found) is type(target) and found == target


def terminal(condition: Expr) -> tuple[Bit, Expr]:
    """Return the terminal of a condition, and the constant whose substitution for it makes the condition false."""
    if isinstance(condition, Not):
        assert isinstance(condition.operand, Bit)
        return condition.operand, TRUE
    assert isinstance(condition, Bit)
    return condition, FALSE


OPENING, CLOSING = ARM.t_opening.done, ARM.t_closing.done
OPENS, MEMORY, CONDITIONS = ARM.coils["claws_open"], "left arm memory", "left arm conditions"
MUTATIONS: dict[str, tuple[Change, str]] = {
    "closing is not stored": (
        dropped(Set, ARM.claws_closed, MEMORY),
        "left: claws that are not closed are open",
    ),
    "claws count as open before their dwell": (
        driven(Rst, ARM.claws_closed, OPENS, OPENING),
        "left: inward, claws not open",
    ),
    "a load is cleared before the dwell": (
        driven(Rst, ARM.loaded, OPENS, OPENING),
        "left: load released away from its cups and row",
    ),
    "claws count as clamped before their dwell": (
        driven(Set, ARM.clamped, TRUE, CLOSING),
        "left: up, claws neither open nor clamped",
    ),
    "unknown claws count as empty": (
        driven(Set, ARM.loaded, FALSE, FIRST_SCAN, CONDITIONS),
        "left: claws that may hold seedlings count as loaded",
    ),
    "steps stay on at rest": (
        dropped(ZoneReset, CYCLE.first),
        "left arm: steps are active only in moving states except Resetting",
    ),
    "the emergency stop is ignored": (
        everywhere(*terminal(TAGS.x.emergency_stop)),
        "motion during an emergency stop",
    ),
    "the field link is ignored": (everywhere(TAGS.system.link_lost, FALSE), "motion without inputs"),
    "a closed X24 clears an emergency stop": (
        driven(Out, CONTROL.clear_requested, TRUE, ~TAGS.x.stop),
        "clearing without the end of a press or a command",
    ),
    "homing starts without a request": (driven(Out, CONTROL.home_requested, TRUE), "restart without a command"),
    "a jog without renewal continues": (
        driven(Mov, CONTROL.jog, FALSE, CONTROL.t_jog_lease.done),
        "jog without renewal",
    ),
    "confirmations are accepted while the arm moves": (
        everywhere(~CONTROL.motion | HOME["decide"], TRUE),
        "left: discard steps with a load follow a discard command",
    ),
    "the centre is not reserved": (dropped(Set, ARM.in_centre), "right: inward, other arm in the centre"),
    "claws count as open without their coil": (
        driven(OnDelay, ARM.t_opening, TRUE),
        "left: up, claws neither open nor clamped",
    ),
    "alarms stop no arm": (dropped(Out, ARM.fault), "left: coil on during a fault"),
    "a row is released without a cup edge": (
        driven(Out, ARM.release_edge, TRUE, ARM.cup),
        "left: the release delay of a load starts only after a cup",
    ),
    "claws that were blocked as the cups came open later": (
        everywhere(CYCLE["release delay"] | ARM.coils["claws_open"], TRUE),
        "left: load released away from its cups and row",
    ),
    "a row that is put back is counted": (
        driven(Out, ARM.thrown, TRUE, ~ARM.row_in_progress),
        "left: a release not counted once",
    ),
    "no row is counted": (driven(Out, ARM.thrown, FALSE), "left: a release not counted once"),
    "the rows of a tray are full before it has arrived": (
        driven(Mov, ARM.rows[1], MACHINE.feeder["creep"], block="tray memory"),
        "left: a row changed without its reason",
    ),
    "another order states that a row is empty": (
        driven(Mov, ARM.rows[1], TAGS.commands.count_reset, TAGS.commands.row_empty["left"][1], "tray conditions"),
        "left: a row changed without its reason",
    ),
    "a machine with valid memory is declared new": (
        dropped(Rst, TAGS.commands.new_machine),
        "declared new with memory",
    ),
    "a machine that moves is declared new": (
        driven(Rst, TAGS.commands.new_machine, FALSE, CONTROL.motion),
        "declared new in motion",
    ),
    "a new machine picks from the tray that was in it": (
        driven(Mov, ARM.rows[1], FALSE, TAGS.commands.new_machine, "tray conditions"),
        "declared new, and a tray in use",
    ),
    "the lift always counts as down": (driven(Out, ARM.down, TRUE, ARM.sensed_down), "left: inward, not down"),
}
"""Rung mutations, each with a goal that it violates."""
SELECTED_MUTATIONS = (
    "closing is not stored",
    "claws count as open before their dwell",
    "the emergency stop is ignored",
    "a jog without renewal continues",
    "confirmations are accepted while the arm moves",
    "homing starts without a request",
    "a closed X24 clears an emergency stop",
    "a row is released without a cup edge",
    "a row that is put back is counted",
    "another order states that a row is empty",
    "a machine with valid memory is declared new",
    "a machine that moves is declared new",
    "a new machine picks from the tray that was in it",
)
UNDETECTED: dict[str, Change] = {
    "the jog lease does not run": dropped(OnDelay, CONTROL.t_jog_lease),
    "the claws' dwell elapses at once": shortened(ARM.t_opening),
}
"""Mutated durations that the proof cannot detect because the monitors use the timers of the program. Functional tests
detect them."""


@pytest.mark.parametrize("mutation", first_of(SELECTED_MUTATIONS))
def test_mutation_violates_a_goal(mutation: str) -> None:
    """Each mutation violates a goal that the unmodified program satisfies."""
    change, goal = MUTATIONS[mutation]
    assert is_breakable(mutated(change), goal)


@pytest.mark.nightly
@pytest.mark.parametrize(("change", "goal"), MUTATIONS.values(), ids=MUTATIONS)
def test_mutation_is_reported(change: Change, goal: str) -> None:
    """The report on a mutated program states that the goal is not proved, and gives the cause."""
    report = prove(mutated(change), clock=seconds, only=[goal], short=True)
    [row] = [row for row in report.rows if row.name == goal]
    assert row.result is Result.UNPROVED
    assert any("is violated by" in line for line in row.lines)


def test_mutation_without_a_matching_rung_is_an_error() -> None:
    """A mutation that matches no rung is rejected because a test with it would prove nothing."""
    with pytest.raises(ValueError, match="matches no rung"):
        mutated(dropped(Set, CONTROL.jog))


@pytest.mark.nightly
@pytest.mark.parametrize("change", UNDETECTED.values(), ids=UNDETECTED)
def test_mutated_timers_used_by_monitors_are_undetected(change: Change) -> None:
    """The proof does not detect a mutation of a timer that the monitors themselves use."""
    assert not is_breakable(mutated(change))


# ---- every coil -------------------------------------------------------------------------------------------------

MOVING = {coil for arm in TAGS.arms.values() for coil in arm.coils.values()} | {*TAGS.tray.driven.values()}
RUNGS = [(block.title, rung) for block in MACHINE.program.blocks for rung in block.rungs()]


def only(this: Rung, by: Rung) -> Change:
    """Return a change that replaces one rung."""
    return lambda _, rung: by if rung is this else rung


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_permanently_driven_coil_is_detected() -> None:
    """A motion coil that is always on violates a goal."""
    coils = [rung for _, rung in RUNGS if isinstance(rung, Out) and rung.target in MOVING]
    assert {rung.target for rung in coils} == MOVING
    assert [rung.target for rung in coils if not is_breakable(mutated(only(rung, replace(rung, when=TRUE))))] == []
