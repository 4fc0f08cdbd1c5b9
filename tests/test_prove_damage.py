"""What the proof notices: every interlock rule left out, and the program damaged where it matters."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import pytest
from proof_rig import MACHINE, TAGS, Change, damaged, is_breakable, put, seconds, without

from controller.core.expr import FALSE, TRUE, Bit, Expr, Not, Timer, Word
from controller.core.rungs import Mov, OnDelay, Out, Rst, Rung, Set, ZoneReset
from controller.program.interlocks import BELT, CLAWS, LIFT, SLIDE
from controller.program.tags import FIRST_SCAN, SIDES, Side
from controller.verify.model import Model
from controller.verify.report import Result, prove
from controller.verify.trace import Trace, breaks

Target = TypeVar("Target", Bit, Word, Timer)
ARM, CYCLE, HOME = TAGS.arms["left"], MACHINE.cycles["left"], MACHINE.homings["left"]
CONTROL = TAGS.machine


def pair(one: str, two: str) -> tuple[str, str]:
    """The two rules that keep two coils apart."""
    return f"not with {one.replace('_', ' ')}", f"not with {two.replace('_', ' ')}"


# ---- interlock rules ----------------------------------------------------------------------------------------------

UPHOLDS: dict[tuple[str, ...], tuple[str, ...]] = {
    pair(*LIFT): ("lift_extend with lift_retract",),
    ("motion allowed",): ("close nowhere",),
    ("no fault of the arm",): ("coil with a fault",),
    ("belt at rest",): ("belt with slide or lift",),
    ("inward ready",): ("inward, not down", "inward, claws not open", "inward, not converged"),
    ("tray in place",): ("inward, no tray at rest", "inward, which tray?"),
    ("stop at the row",): ("inward, past the row",),
    ("spread as far as it goes",): ("belt against its stop",),
    ("converge as far as it goes",): ("belt against its stop",),
    ("centre is free",): ("inward, into the other arm",),
    ("outward clear",): ("outward with a load, not up", "outward low, claws not open"),
    ("lift clear",): ("up, half closed",),
    ("down at feed only",): ("down away from feed",),
    ("spread up at feed",): ("spread, not up at feed",),
    ("converge empty at feed",): ("converge with a load", "converge away from feed"),
    ("clamp at a place",): ("close nowhere",),
    ("open at a place",): ("open a load elsewhere",),
}
"""Rules of an arm and what can happen without them, by the requirement that is broken then."""
UPHOLDS_OF_TRAY = {"arms at feed": "tray, arm away from feed", "no fault of the feeder": "tray with a fault"}
PAIRS = tuple(pair(*coils) for coils in (SLIDE, LIFT, BELT, CLAWS))
REDUNDANT: dict[tuple[str, ...], str] = {
    pair(*SLIDE): "no step asks for both coils, and hands hold one output at a time",
    pair(*BELT): "likewise",
    pair(*CLAWS): "likewise",
    **{(name,): "the other rule of the pair stands" for names in PAIRS for name in names},
}
"""Rules of an arm without which every requirement still holds, and why."""
TELLING = ("belt at rest", "lift clear")


def broken_without(rules: tuple[str, ...], requirements: tuple[str, ...]) -> None:
    """Prove without rules: every requirement fails, and what breaks it does so on a real PLC."""
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


def test_every_rule_upholds_a_requirement_or_is_known_not_to() -> None:
    """Given the interlock table, then each rule of it is in one of the two lists."""
    listed = {name for rules in (*UPHOLDS, *REDUNDANT) for name in rules}
    for side in SIDES:
        assert listed == {rule.name for rule in MACHINE.rules[side]}
    assert {*UPHOLDS_OF_TRAY, "motion allowed"} == {rule.name for rule in MACHINE.tray_rules}


@pytest.mark.parametrize("rule", TELLING)
@pytest.mark.timeout(300)
def test_a_rule_left_out_breaks_what_it_is_for(rule: str) -> None:
    """Given a rule of the left arm left out, then the trace of the requirement that it upholds replays."""
    broken_without((f"left: {rule}",), tuple(f"left: {name}" for name in UPHOLDS[rule,]))


@pytest.mark.nightly
@pytest.mark.timeout(900)
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("rules", "requirements"), UPHOLDS.items(), ids=lambda names: names[0])
def test_every_rule_left_out_breaks_what_it_is_for(
    side: Side, rules: tuple[str, ...], requirements: tuple[str, ...]
) -> None:
    """Given any rule that is not redundant left out, then the traces of what it upholds replay."""
    broken_without(tuple(f"{side}: {name}" for name in rules), tuple(f"{side}: {name}" for name in requirements))


@pytest.mark.nightly
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("rule", "requirement"), UPHOLDS_OF_TRAY.items())
def test_every_rule_of_the_tray_left_out_breaks_what_it_is_for(rule: str, requirement: str) -> None:
    """Given a rule of the tray left out, then the trace of the requirement that it upholds replays."""
    broken_without((f"tray: {rule}",), (requirement,))


@pytest.mark.nightly
@pytest.mark.timeout(600)
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("rules", REDUNDANT, ids=" and ".join)
def test_a_redundant_rule_left_out_breaks_nothing(side: Side, rules: tuple[str, ...]) -> None:
    """Given a rule that is known as redundant left out, then every goal is still proved."""
    assert not is_breakable(without(*(f"{side}: {name}" for name in rules)))


@pytest.mark.nightly
@pytest.mark.timeout(600)
@pytest.mark.parametrize("coils", [SLIDE, LIFT, BELT, CLAWS], ids=" and ".join)
def test_a_pair_of_rules_keeps_coils_apart_that_are_wanted_together(coils: tuple[str, str]) -> None:
    """Given requests in error that ask for both coils of a valve, then its two rules, and they alone, keep them off."""
    one, two = coils
    asked = next(
        rung.when for rung in MACHINE.program.rungs() if isinstance(rung, Out) and rung.target == ARM.want[two]
    )
    both = driven(Out, ARM.want[one], asked)
    goal = f"left: {' with '.join(coils)}"
    assert not is_breakable(damaged(both), goal)
    assert is_breakable(damaged(both, *(f"left: {name}" for name in pair(*coils))), goal)


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
    """The rungs of this kind and target are not there."""
    return lambda title, rung: None if _is(rung, kind, target) and title.startswith(block) else rung


def driven(kind: type[Rung], target: Target, by: Expr, instead_of: Expr | None = None, block: str = "") -> Change:
    """The rungs of this kind and target have another condition, or another one instead of a part of theirs."""

    def change(title: str, rung: Rung) -> Rung:
        if not _is(rung, kind, target) or not title.startswith(block):
            return rung
        return replace(rung, when=by if instead_of is None else put(rung.when, instead_of, by))

    return change


def hurried(timer: Timer) -> Change:
    """A timer is over after one count."""
    return lambda _, rung: (
        replace(rung, preset=timer.base_ms) if isinstance(rung, OnDelay) and rung.timer == timer else rung
    )


def everywhere(part: Expr, by: Expr) -> Change:
    """A part of conditions is another one wherever it occurs."""
    return lambda _, rung: replace(rung, when=put(rung.when, part, by))


def _is(rung: Rung, kind: type[Rung], target: Bit | Word | Timer) -> bool:
    found = target_of(rung)
    return isinstance(rung, kind) and type(found) is type(target) and found == target


def terminal(condition: Expr) -> tuple[Bit, Expr]:
    """The terminal of a condition, and what its contact is while the condition is not so."""
    if isinstance(condition, Not):
        assert isinstance(condition.operand, Bit)
        return condition.operand, TRUE
    assert isinstance(condition, Bit)
    return condition, FALSE


OPENING, CLOSING = ARM.t_opening.done, ARM.t_closing.done
OPENS, MEMORY, CONDITIONS = ARM.coils["claws_open"], "left arm memory", "left arm conditions"
DAMAGES: dict[str, tuple[Change, str]] = {
    "closing is not remembered": (
        dropped(Set, ARM.claws_closed, MEMORY),
        "left: claws that are not closed are open",
    ),
    "claws count as open before their dwell": (
        driven(Rst, ARM.claws_closed, OPENS, OPENING),
        "left: inward, claws not open",
    ),
    "a load is forgotten before the dwell": (
        driven(Rst, ARM.loaded, OPENS, OPENING),
        "left: open a load elsewhere",
    ),
    "claws count as clamped before their dwell": (
        driven(Set, ARM.clamped, TRUE, CLOSING),
        "left: up, half closed",
    ),
    "unknown claws count as empty": (
        driven(Set, ARM.loaded, FALSE, FIRST_SCAN, CONDITIONS),
        "left: what the claws may hold counts as a load",
    ),
    "steps stay on at rest": (dropped(ZoneReset, CYCLE.first), "left arm: no step without motion"),
    "nobody looks at the emergency stop": (
        everywhere(*terminal(TAGS.x.emergency_stop)),
        "moves in an emergency stop",
    ),
    "nobody looks at the field link": (everywhere(TAGS.system.link_lost, FALSE), "moves without its field"),
    "homing is requested by nobody": (driven(Out, CONTROL.home_requested, TRUE), "restarts by itself"),
    "a jog that is not renewed goes on": (
        driven(Mov, CONTROL.jog, FALSE, CONTROL.t_jog_lease.done),
        "jog not renewed",
    ),
    "answers are heard while the arm works": (
        everywhere(~CONTROL.motion | HOME["decide"], TRUE),
        "left: discarding was ordered",
    ),
    "nobody takes the centre": (dropped(Set, ARM.in_centre), "right: inward, into the other arm"),
    "claws count as open without their coil": (
        driven(OnDelay, ARM.t_opening, TRUE),
        "left: up, half closed",
    ),
    "alarms stop no arm": (dropped(Out, ARM.fault), "left: coil with a fault"),
    "the lift is believed down": (driven(Out, ARM.down, TRUE, ARM.sensed_down), "left: inward, not down"),
}
"""Rungs damaged, and a goal that is broken then."""
TELLING_DAMAGES = (
    "closing is not remembered",
    "claws count as open before their dwell",
    "nobody looks at the emergency stop",
    "a jog that is not renewed goes on",
    "answers are heard while the arm works",
    "homing is requested by nobody",
)
UNNOTICED: dict[str, Change] = {
    "the jog lease does not run": dropped(OnDelay, CONTROL.t_jog_lease),
    "the claws' dwell is over at once": hurried(ARM.t_opening),
}
"""Durations: the monitors take the program's own timers. Tests of the functions notice what happens to them."""


@pytest.mark.parametrize("damage", TELLING_DAMAGES)
def test_a_damage_breaks_a_goal(damage: str) -> None:
    """Given a damaged program, then a goal that the sound one keeps is broken."""
    change, goal = DAMAGES[damage]
    assert is_breakable(damaged(change), goal)


@pytest.mark.nightly
@pytest.mark.timeout(600)
@pytest.mark.parametrize(("change", "goal"), DAMAGES.values(), ids=DAMAGES)
def test_a_damage_is_told(change: Change, goal: str) -> None:
    """Given a damaged program, then the report says of the goal that it is not proved, and why."""
    report = prove(damaged(change), clock=seconds, only=[goal], short=True)
    [row] = [row for row in report.rows if row.name == goal]
    assert row.result is Result.UNPROVED
    assert any("is broken by" in line for line in row.lines)


def test_a_damage_that_hits_nothing_is_an_error() -> None:
    """Given a change of a rung that is not there, then it is refused: a test of it would show nothing."""
    with pytest.raises(ValueError, match="hits no rung"):
        damaged(dropped(Set, CONTROL.jog))


@pytest.mark.nightly
@pytest.mark.timeout(600)
@pytest.mark.parametrize("change", UNNOTICED.values(), ids=UNNOTICED)
def test_what_monitors_rely_on_is_known(change: Change) -> None:
    """Given a timer damaged that the monitors themselves look at, then the proof does not notice."""
    assert not is_breakable(damaged(change))


# ---- every coil -------------------------------------------------------------------------------------------------

MOVING = {coil for arm in TAGS.arms.values() for coil in arm.coils.values()} | {*TAGS.tray.driven.values()}
RUNGS = [(block.title, rung) for block in MACHINE.program.blocks for rung in block.rungs()]


def only(this: Rung, by: Rung) -> Change:
    """One rung is another one."""
    return lambda _, rung: by if rung is this else rung


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_a_coil_that_is_always_driven_is_noticed() -> None:
    """Given any coil that moves something, when nothing switches it off, then a goal is broken."""
    coils = [rung for _, rung in RUNGS if isinstance(rung, Out) and rung.target in MOVING]
    assert {rung.target for rung in coils} == MOVING
    assert [rung.target for rung in coils if not is_breakable(damaged(only(rung, replace(rung, when=TRUE))))] == []
