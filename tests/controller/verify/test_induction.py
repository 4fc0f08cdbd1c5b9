"""Proofs by induction: proved and unproved goals, and their explanations."""

from __future__ import annotations

import pytest

from controller.core.expr import Bit, Counter, Expr, Timer
from controller.core.rungs import Count, Mov, OnDelay, Out, Pulse, PulseFalling, Rst, Rung, Set
from controller.core.sequence import Sequence, Step, To
from controller.verify.cells import ModelError
from controller.verify.induction import Induction, Moment, describe_failure
from controller.verify.model import Model
from controller.verify.report import Result
from controller.verify.trace import Start
from tests.controller.core.core_rig import d, m, s, t, x, y
from tests.controller.verify.verify_rig import GOAL, report_of, row_of, specification_of

MOTORS_TOGETHER = y(0) & y(1)


def locked(*, one: Expr, two: Expr) -> tuple[Set, Rst, Set, Out, Out]:
    """Return rungs for two motors started by X0 and X1; X2 stops the first motor, and the second is never stopped."""
    return (
        Set(m(1), when=x(0) & one),
        Rst(m(1), when=x(2)),
        Set(m(2), when=x(1) & two),
        Out(y(0), when=m(1)),
        Out(y(1), when=m(2)),
    )


def equal(one: Bit, other: Bit) -> Expr:
    return (one & other) | (~one & ~other)


def failed_at(model: Model) -> list[Moment]:
    """Return the kinds of scan in which the goals of a model fail."""
    found = [Induction(model).prove(goal).failure for goal in model.goals]
    return [failure.moment for failure in found if failure is not None]


@pytest.mark.parametrize(
    ("items", "holds", "moments"),
    [
        ((Set(m(500), when=x(0)), Set(m(501), when=x(0))), equal(m(500), m(501)), []),
        ((Set(m(0), when=x(0)),), m(0), [Moment.FACTORY]),
        ((Set(m(500), when=x(0)), Set(m(0), when=x(0))), equal(m(500), m(0)), [Moment.POWER_UP]),
        ((Set(m(0), when=x(0) & ~m(8002)),), ~m(0), [Moment.RUNNING]),
    ],
)
def test_a_joint_proof_succeeds_if_every_separate_proof_does(
    items: tuple[Rung, ...], holds: Expr, moments: list[Moment]
) -> None:
    """A goal that fails in any of the three kinds of scan prevents the joint proof."""
    model = Model(specification_of(*items, invariants={"tested": holds, "unaffected": ~m(2)}))
    assert failed_at(model) == moments
    assert (Induction(model).prove_together(model.goals) is not None) == (not moments)


# ---- interlocks -----------------------------------------------------------------------------------------------


def test_an_interlock_is_proved() -> None:
    """Two motors with mutual interlocks are proved never to run together."""
    apart = {"requests apart": ~(m(1) & m(2))}
    items = locked(one=~m(2), two=~m(1))
    assert row_of(specification_of(*items, never=MOTORS_TOGETHER, invariants=apart)).result is Result.PROVED


@pytest.mark.parametrize(("one", "two"), [(x(0), ~m(1)), (~m(2), x(1))])
def test_incomplete_interlock_is_broken_with_a_trace(one: Expr, two: Expr) -> None:
    """If one half of an interlock is missing, the goal is violated, and the trace starts at the first power-up."""
    row = row_of(specification_of(*locked(one=one, two=two), never=MOTORS_TOGETHER))
    assert row.result is Result.BROKEN
    assert row.trace is not None
    assert row.trace.start is Start.FACTORY


def test_a_requirement_may_need_an_invariant() -> None:
    """Outputs of two steps overlap in the scan of a transfer unless each also requires the other step to be off.

    That the two steps are never both on after a scan is proved with an invariant.
    """
    steps = [Step("a", [To("b", x(0))], waits_for="b"), Step("b", [To("a", x(1))], waits_for="a")]
    items = (Set(s(20), when=m(8002)), Sequence("two", 20, steps), Out(y(0), when=s(20)), Out(y(1), when=s(21)))
    # In the scan of a transfer both steps are on when the outputs are evaluated.
    outputs = (Out(y(0), when=s(20) & ~s(21)), Out(y(1), when=s(21) & ~s(20)))
    never = s(20) & s(21)
    one_step = {"one step": ~(s(20) & s(21))}
    assert row_of(specification_of(*items, never=MOTORS_TOGETHER)).result is Result.BROKEN
    assert row_of(specification_of(*items[:2], *outputs, never=MOTORS_TOGETHER)).result is Result.PROVED
    assert row_of(specification_of(*items[:2], *outputs, never=never, invariants=one_step)).result is Result.PROVED


def test_unreachable_violation_is_not_reported_as_broken() -> None:
    """A goal that requires a missing invariant is reported as not proved, not as broken."""
    items = (Out(m(0), when=m(1)), Out(m(1), when=m(2)), Out(m(2), when=m(2) & x(0)))
    bare = row_of(specification_of(*items, never=m(0)))
    assert (bare.result, bare.trace is not None and bare.trace.start) == (Result.UNPROVED, Start.STATE)
    helped = specification_of(*items, never=m(0), invariants={"one": ~m(1), "two": ~m(2)})
    assert [row.result for row in report_of(helped).rows if row.kind != "consistent"] == [Result.PROVED] * 3


# ---- invariants -----------------------------------------------------------------------------------------------


def test_wrong_invariant_invalidates_dependent_proofs() -> None:
    """Goals that depend directly or indirectly on a wrong invariant are reported as conditional; others are proved."""
    items = (Out(m(0), when=m(1)), Out(m(1), when=m(2)), Out(m(2), when=x(0)), Out(m(3), when=m(3) & x(0)))
    wrong = {"own": ~m(3), "second": ~m(1), "third": ~m(2)}
    specification = specification_of(*items, never=m(0), invariants=wrong)
    rows = {row.name: row for row in report_of(specification, short=True).rows}
    assert (rows["own"].result, rows["third"].result) == (Result.PROVED, Result.UNPROVED)
    assert rows["second"].result is rows[GOAL].result is Result.CONDITIONAL
    assert rows["second"].lines == ("its proof depends on 'third'",)
    assert rows[GOAL].lines == ("reason: it would hurt", "its proof depends on 'second'")


def test_goal_with_a_wrong_invariant_is_broken_if_it_has_a_trace() -> None:
    """A requirement that depends on a wrong invariant is reported as broken only if a trace violates it."""
    wrong = {"wrong": ~m(1)}
    open_, fenced = Out(m(2), when=x(1)), Out(m(2), when=m(2) & x(1))
    for gate, result in ((open_, Result.BROKEN), (fenced, Result.CONDITIONAL)):
        items = (Out(m(0), when=m(1) & m(2)), gate, Out(m(1), when=x(0)))
        row = row_of(specification_of(*items, never=m(0), invariants=wrong))
        assert (row.result, row.trace is None) == (result, result is Result.CONDITIONAL)
        assert "its proof depends on 'wrong'" in row.lines


def test_mutually_dependent_goals_are_proved_together() -> None:
    """Registers that are copied to each other are proved to stay 0 if they are 0 initially."""
    items = (Mov(d(1), d(2)), Mov(d(0), d(1)), Mov(d(2), d(0)))
    zero = {"one": d(0).equals(0), "two": d(1).equals(0)}
    rows = report_of(specification_of(*items, never=d(2).differs(0), invariants=zero)).rows
    assert {row.result for row in rows} == {Result.PROVED, Result.POSSIBLE}


def test_invariant_that_is_false_initially_is_rejected() -> None:
    """The proof of an invariant that persists but is false initially fails at the first power-up."""
    model = Model(specification_of(Set(m(0), when=x(0)), invariants={"on": m(0)}))
    assert failed_at(model) == [Moment.FACTORY]


def test_contradictory_invariants_are_detected() -> None:
    """The report names contradictory invariants because anything could be proved from them."""
    specification = specification_of(Set(m(0), when=x(0)), invariants={"on": m(0), "off": ~m(0)}, never=m(1))
    row = row_of(specification, "all goals together")
    assert (row.result, row.lines) == (Result.IMPOSSIBLE, ("these contradict each other: off, on",))


def test_duplicate_goal_names_are_rejected() -> None:
    """An invariant with the same name as the requirement is rejected with an error that states the name."""
    with pytest.raises(ModelError, match="two goals are named 'the goal'"):
        Model(specification_of(never=m(0), invariants={GOAL: ~m(0)}))


# ---- loss of power --------------------------------------------------------------------------------------------


def test_non_retentive_devices_are_lost_with_power() -> None:
    """A retentive bit and a plain bit that are set together are equal until the power is lost."""
    for other, expected in ((m(0), [Moment.POWER_UP]), (m(501), [])):
        items = (Set(m(500), when=x(0)), Set(other, when=x(0)))
        assert failed_at(Model(specification_of(*items, invariants={"same": equal(m(500), other)}))) == expected


@pytest.mark.parametrize(
    ("rung", "in_first_scan", "moments"),
    [
        (Set(s(500), when=x(0)), s(500), []),
        (OnDelay(Timer(0), 100, when=x(0)), t(0), []),
        (OnDelay(Timer(246), 100, when=x(0)), t(246), [Moment.POWER_UP]),
        (Count(Counter(0), 1, when=x(0)), Bit("C", 0), []),
        (Count(Counter(100), 1, when=x(0)), Bit("C", 100), [Moment.POWER_UP]),
        (Mov(1, d(199), when=x(0)), d(199) > 0, []),
        (Mov(1, d(200), when=x(0)), d(200) > 0, [Moment.POWER_UP]),
    ],
)
def test_devices_are_lost_or_retained_as_in_the_plc(rung: Rung, in_first_scan: Expr, moments: list[Moment]) -> None:
    """A device that X0 turns on is still on after a loss of power only if it is battery-backed."""
    items = (Out(m(1), when=m(8002) & in_first_scan), rung)
    assert failed_at(Model(specification_of(*items, invariants={"lost": ~m(1)}))) == moments


def test_edge_memories_are_lost_with_power() -> None:
    """After a power loss, a terminal that has turned off causes no falling edge; one that is on causes a rising one."""
    for edge, moments in ((PulseFalling(m(0), when=x(0)), []), (Pulse(m(0), when=x(0)), [Moment.FACTORY])):
        quiet = {"no edge in the first scan": ~(m(8002) & m(0))}
        assert failed_at(Model(specification_of(edge, invariants=quiet))) == moments


def test_monitor_state_survives_a_loss_of_power_and_is_unknown_initially() -> None:
    """A remembered monitor bit survives a loss of power and is unknown initially; other monitor bits are off."""
    items, monitors = (Set(m(500), when=x(0)),), (Set(m(10), when=x(0)),)
    forgotten, unknown = m(500) & ~m(10), m(10) & ~m(500)

    def result(never: Expr, *, remembered: bool) -> Result:
        bits = (m(10),) if remembered else ()
        return row_of(specification_of(*items, never=never, monitors=monitors, remembered=bits)).result

    assert result(forgotten, remembered=True) is Result.PROVED
    assert result(forgotten, remembered=False) is Result.BROKEN
    assert result(unknown, remembered=True) is Result.BROKEN
    assert result(unknown, remembered=False) is Result.PROVED


def test_invariant_about_monitor_state_must_be_established_by_the_program() -> None:
    """An invariant about a remembered bit fails at the first power-up unless a rung of the monitor establishes it."""
    for monitor, expected in ((Out(m(11), when=m(10)), [Moment.FACTORY]), (Rst(m(10)), [])):
        specification = specification_of(monitors=(monitor,), remembered=(m(10),), invariants={"off": ~m(10)})
        assert failed_at(Model(specification)) == expected


# ---- external inputs ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("greatest", "default", "result"),
    [
        (10, 3, Result.PROVED),
        (11, 3, Result.BROKEN),
        (10, 11, Result.BROKEN),
        (None, 3, Result.BROKEN),
    ],
)
def test_set_point_is_in_its_range_or_has_its_default(greatest: int | None, default: int, result: Result) -> None:
    """An output that requires a set-point of at least 11 is reachable only if the range or the default permits it."""
    ranges = {} if greatest is None else {d(512): (0, greatest)}
    never, points = y(0), ((d(512), default),)
    row = row_of(specification_of(Out(y(0), when=d(512) >= 11), never=never, set_points=points, ranges=ranges))
    assert row.result is result


def test_set_point_that_the_program_also_writes_has_no_range() -> None:
    """A violation is found if the program itself writes a value outside the set-point range."""
    items = (Out(y(0), when=d(512) >= 11), Mov(11, d(512), when=x(0)))
    ranges, points = {d(512): (0, 10)}, ((d(512), 3),)
    assert row_of(specification_of(*items, never=y(0), set_points=points, ranges=ranges)).result is Result.BROKEN


def test_range_of_another_register_is_rejected() -> None:
    """A range for a register that is not written externally is rejected with an error that names the register."""
    with pytest.raises(ModelError, match="range of D7: not a set-point"):
        Model(specification_of(Mov(1, d(7)), ranges={d(7): (0, 1)}))


def test_system_bits_and_terminals_are_arbitrary_in_every_scan() -> None:
    """A command that is reset after its scan may be on in any scan; a device that is never written is always off."""
    assert row_of(specification_of(Out(y(0), when=m(8)), never=y(0), system=(m(8),))).result is Result.BROKEN
    assert row_of(specification_of(Out(y(0), when=m(8)), never=y(0))).result is Result.PROVED
    assert row_of(specification_of(Out(y(0), when=x(7)), never=y(0))).result is Result.BROKEN


# ---- explanations ---------------------------------------------------------------------------------------------


def test_description_of_a_failure_separates_causes_from_other_values() -> None:
    """Two bits and an edge that violate a goal are causes, whereas a bit that is on because of an invariant is not."""
    items = (
        Pulse(m(5), when=x(3)),
        Out(y(0), when=m(1) & m(2) & m(5)),
        Set(m(1), when=x(0)),
        Set(m(2), when=x(1)),
        Set(m(3), when=x(0) | x(2)),
        Set(m(4), when=x(2)),
    )
    model = Model(specification_of(*items, never=y(0), invariants={"third follows first": ~m(1) | m(3)}))
    failure = Induction(model).prove(model.goals[1]).failure
    assert failure is not None
    assert describe_failure(model, failure) == [
        "'the goal' is violated by a running scan:",
        "  cause, before the scan: E0 edge memory of M5 off, M1 on, M2 on",
        "  cause, external inputs: X3 on",
        "  other values before the scan: M3 on",
        "  after the scan: Y0 on",
    ]


def test_running_timer_is_described_by_its_time() -> None:
    """If the contact of a timer violates a goal, the description of the failure states how long the timer has run."""
    model = Model(specification_of(OnDelay(Timer(200), 30, when=m(0)), Out(m(0), when=x(0)), never=t(200)))
    failure = Induction(model).prove(model.goals[0]).failure
    assert failure is not None
    assert failure.moment is Moment.RUNNING
    before = next(line for line in describe_failure(model, failure) if "before the scan: " in line)
    assert "T200 running for" in before
    assert int(before.split("T200 running for ")[1].split()[0]) >= 3


@pytest.mark.parametrize("timer", [0, 200])
def test_a_timer_that_is_not_driven_is_off(timer: int) -> None:
    """No invariant is needed to prove that the contact of a timer is on only while its coil is on."""
    items = (OnDelay(Timer(timer), 300, when=x(0)), Out(m(0), when=x(0)))
    assert row_of(specification_of(*items, never=t(timer) & ~m(0))).result is Result.PROVED
