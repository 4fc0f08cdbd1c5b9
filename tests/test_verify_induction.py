"""Proofs by induction: what is proved, what is refused, and what is said of it."""

from __future__ import annotations

import pytest
from core_rig import d, m, s, t, x, y
from verify_rig import GOAL, report_of, row_of, specification_of

from controller.core.expr import Bit, Counter, Expr, Timer
from controller.core.rungs import Count, Mov, OnDelay, Out, Pulse, PulseFalling, Rst, Rung, Set
from controller.core.sequence import Sequence, Step, To
from controller.verify.cells import ModelError
from controller.verify.induction import Induction, Moment, account
from controller.verify.model import Model
from controller.verify.report import Result
from controller.verify.trace import Start

MOTORS_TOGETHER = y(0) & y(1)


def locked(*, one: Expr, two: Expr) -> tuple[Set, Rst, Set, Out, Out]:
    """Two motors that are started by X0 and X1 and stopped by X2, the second by a request that is held."""
    return (Set(m(1), when=x(0) & one), Rst(m(1), when=x(2)), Set(m(2), when=x(1) & two),
            Out(y(0), when=m(1)), Out(y(1), when=m(2)))  # fmt: skip


def failed_at(model: Model) -> list[Moment]:
    """The moments at which the goals of a model fail."""
    found = [Induction(model).prove(goal).failure for goal in model.goals]
    return [failure.moment for failure in found if failure is not None]


# ---- interlocks -----------------------------------------------------------------------------------------------


def test_an_interlock_is_proved() -> None:
    """Given two motors that lock each other out, then it is proved that they never run together."""
    apart = {"requests apart": ~(m(1) & m(2))}
    items = locked(one=~m(2), two=~m(1))
    assert row_of(specification_of(*items, never=MOTORS_TOGETHER, invariants=apart)).result is Result.PROVED


@pytest.mark.parametrize(("one", "two"), [(x(0), ~m(1)), (~m(2), x(1))])
def test_a_damaged_interlock_is_broken_and_shown(one: Expr, two: Expr) -> None:
    """Given an interlock of which one half is missing, then there is a trace from the first power-up."""
    row = row_of(specification_of(*locked(one=one, two=two), never=MOTORS_TOGETHER))
    assert row.result is Result.BROKEN
    assert row.trace is not None
    assert row.trace.start is Start.FACTORY


def test_a_requirement_may_need_an_invariant() -> None:
    """Given steps of which one is on, then without that as an invariant their outputs are not proved apart."""
    steps = [Step("a", [To("b", x(0))], waits_for="b"), Step("b", [To("a", x(1))], waits_for="a")]
    items = (Set(s(20), when=m(8002)), Sequence("two", 20, steps), Out(y(0), when=s(20)), Out(y(1), when=s(21)))
    # In the transfer scan the outputs see both steps on.
    outputs = (Out(y(0), when=s(20) & ~s(21)), Out(y(1), when=s(21) & ~s(20)))
    never = s(20) & s(21)
    one_step = {"one step": ~(s(20) & s(21))}
    assert row_of(specification_of(*items, never=MOTORS_TOGETHER)).result is Result.BROKEN
    assert row_of(specification_of(*items[:2], *outputs, never=MOTORS_TOGETHER)).result is Result.PROVED
    assert row_of(specification_of(*items[:2], *outputs, never=never, invariants=one_step)).result is Result.PROVED


def test_a_state_that_is_never_reached_is_not_called_broken() -> None:
    """Given a goal that only an invariant not stated would hold up, then it is not proved, and not called broken."""
    items = (Out(m(0), when=m(1)), Out(m(1), when=m(2)), Out(m(2), when=m(2) & x(0)))
    bare = row_of(specification_of(*items, never=m(0)))
    assert (bare.result, bare.trace is not None and bare.trace.start) == (Result.UNPROVED, Start.STATE)
    helped = specification_of(*items, never=m(0), invariants={"one": ~m(1), "two": ~m(2)})
    assert [row.result for row in report_of(helped).rows if row.kind != "not contradictory"] == [Result.PROVED] * 3


# ---- invariants -----------------------------------------------------------------------------------------------


def test_a_wrong_invariant_is_refused_with_whatever_rests_on_it() -> None:
    """Given a proof that rests on a proof that rests on a wrong invariant, then both say so, and others are proved."""
    items = (Out(m(0), when=m(1)), Out(m(1), when=m(2)), Out(m(2), when=x(0)), Out(m(3), when=m(3) & x(0)))
    wrong = {"own": ~m(3), "second": ~m(1), "third": ~m(2)}
    specification = specification_of(*items, never=m(0), invariants=wrong)
    rows = {row.name: row for row in report_of(specification, short=True).rows}
    assert (rows["own"].result, rows["third"].result) == (Result.PROVED, Result.UNPROVED)
    assert rows["second"].result is rows[GOAL].result is Result.CONDITIONAL
    assert rows["second"].lines == ("its proof rests on 'third'",)
    assert rows[GOAL].lines == ("it must not be: it would hurt", "its proof rests on 'second'")


def test_what_rests_on_a_wrong_invariant_is_called_broken_where_there_is_a_trace() -> None:
    """Given a requirement that follows from a wrong invariant, then it depends on whether that can break it too."""
    wrong = {"wrong": ~m(1)}
    open_, fenced = Out(m(2), when=x(1)), Out(m(2), when=m(2) & x(1))
    for gate, result in ((open_, Result.BROKEN), (fenced, Result.CONDITIONAL)):
        items = (Out(m(0), when=m(1) & m(2)), gate, Out(m(1), when=x(0)))
        row = row_of(specification_of(*items, never=m(0), invariants=wrong))
        assert (row.result, row.trace is None) == (result, result is Result.CONDITIONAL)
        assert "its proof rests on 'wrong'" in row.lines


def test_goals_that_hold_up_each_other_are_proved_together() -> None:
    """Given two bits that feed each other and start off, then it is proved that both stay off."""
    items = (Mov(d(1), d(2)), Mov(d(0), d(1)), Mov(d(2), d(0)))
    zero = {"one": d(0).equals(0), "two": d(1).equals(0)}
    rows = report_of(specification_of(*items, never=d(2).differs(0), invariants=zero)).rows
    assert {row.result for row in rows} == {Result.PROVED, Result.POSSIBLE}


def test_an_invariant_that_does_not_hold_at_first_is_refused() -> None:
    """Given something that stays once it is so, when it is not so at first, then it is no invariant."""
    model = Model(specification_of(Set(m(0), when=x(0)), invariants={"on": m(0)}))
    assert failed_at(model) == [Moment.FACTORY]


def test_invariants_that_contradict_each_other_are_found() -> None:
    """Given invariants that cannot hold together, then they are named: from them anything could be proved."""
    specification = specification_of(Set(m(0), when=x(0)), invariants={"on": m(0), "off": ~m(0)}, never=m(1))
    row = row_of(specification, "all goals together")
    assert (row.result, row.lines) == (Result.IMPOSSIBLE, ("these contradict each other: off, on",))


def test_two_goals_of_one_name_are_refused() -> None:
    """Given an invariant with the name of the requirement, then it is refused by name."""
    with pytest.raises(ModelError, match="two goals are called 'the goal'"):
        Model(specification_of(never=m(0), invariants={GOAL: ~m(0)}))


# ---- loss of power --------------------------------------------------------------------------------------------


def test_what_is_not_retained_is_gone_after_a_loss_of_power() -> None:
    """Given a retained and a plain bit set together, then they are alike until the power is lost."""
    for other, expected in ((m(0), [Moment.POWER_UP]), (m(501), [])):
        items = (Set(m(500), when=x(0)), Set(other, when=x(0)))
        same = {"same": (m(500) & other) | (~m(500) & ~other)}
        assert failed_at(Model(specification_of(*items, invariants=same))) == expected


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
def test_steps_timers_counters_and_registers_are_lost_or_kept_as_in_the_plc(
    rung: Rung, in_first_scan: Expr, moments: list[Moment]
) -> None:
    """Given a device that X0 turns on, when power returns, then it is still on only if the battery keeps it."""
    items = (Out(m(1), when=m(8002) & in_first_scan), rung)
    assert failed_at(Model(specification_of(*items, invariants={"lost": ~m(1)}))) == moments


def test_edge_memories_are_gone_after_a_loss_of_power() -> None:
    """Given a terminal that goes off while there is no power, then no falling edge is seen, and a rising one is."""
    for edge, moments in ((PulseFalling(m(0), when=x(0)), []), (Pulse(m(0), when=x(0)), [Moment.FACTORY])):
        quiet = {"no edge in the first scan": ~(m(8002) & m(0))}
        assert failed_at(Model(specification_of(edge, invariants=quiet))) == moments


def test_what_monitors_remember_outlives_a_loss_of_power_and_is_unknown_at_first() -> None:
    """Given a bit the program retains and one the monitors remember, both set by X0."""
    items, monitors = (Set(m(500), when=x(0)),), (Set(m(10), when=x(0)),)
    forgotten, unknown = m(500) & ~m(10), m(10) & ~m(500)

    def result(never: Expr, *, remembered: bool) -> Result:
        bits = (m(10),) if remembered else ()
        return row_of(specification_of(*items, never=never, monitors=monitors, remembered=bits)).result

    assert result(forgotten, remembered=True) is Result.PROVED
    assert result(forgotten, remembered=False) is Result.BROKEN
    assert result(unknown, remembered=True) is Result.BROKEN
    assert result(unknown, remembered=False) is Result.PROVED


def test_an_invariant_about_what_is_remembered_must_come_true_by_itself() -> None:
    """Given a bit the monitors remember, then no invariant can say how it is at the first power-up."""
    for monitor, expected in ((Out(m(11), when=m(10)), [Moment.FACTORY]), (Rst(m(10)), [])):
        specification = specification_of(monitors=(monitor,), remembered=(m(10),), invariants={"off": ~m(10)})
        assert failed_at(Model(specification)) == expected


# ---- what comes from outside ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("greatest", "default", "result"), [
    (10, 3, Result.PROVED), (11, 3, Result.BROKEN), (10, 11, Result.BROKEN), (None, 3, Result.BROKEN),
])  # fmt: skip
def test_a_set_point_keeps_to_its_range_or_its_default(greatest: int | None, default: int, result: Result) -> None:
    """Given an output that 11 in a set-point turns on, then it depends on the range and the default."""
    ranges = {} if greatest is None else {d(512): (0, greatest)}
    never, points = y(0), ((d(512), default),)
    row = row_of(specification_of(Out(y(0), when=d(512) >= 11), never=never, set_points=points, ranges=ranges))
    assert row.result is result


def test_a_set_point_that_the_program_writes_too_has_no_range() -> None:
    """Given a set-point that the program moves beyond its range, then the range does not hide it."""
    items = (Out(y(0), when=d(512) >= 11), Mov(11, d(512), when=x(0)))
    ranges, points = {d(512): (0, 10)}, ((d(512), 3),)
    assert row_of(specification_of(*items, never=y(0), set_points=points, ranges=ranges)).result is Result.BROKEN


def test_a_range_of_something_else_is_refused() -> None:
    """Given a range of a register that nothing outside writes, then it is refused by name."""
    with pytest.raises(ModelError, match="range of D7: it is no set-point"):
        Model(specification_of(Mov(1, d(7)), ranges={d(7): (0, 1)}))


def test_system_bits_and_terminals_are_anything_in_every_scan() -> None:
    """Given a command that ends with its scan, then it may be on in any scan; what nobody writes is always off."""
    assert row_of(specification_of(Out(y(0), when=m(8)), never=y(0), system=(m(8),))).result is Result.BROKEN
    assert row_of(specification_of(Out(y(0), when=m(8)), never=y(0))).result is Result.PROVED
    assert row_of(specification_of(Out(y(0), when=x(7)), never=y(0))).result is Result.BROKEN


# ---- what is said ---------------------------------------------------------------------------------------------


def test_the_account_of_a_failed_step_tells_what_is_enough_from_what_goes_with_it() -> None:
    """Given a goal that two bits and an edge break, then just these are enough; an invariant turns on another bit."""
    items = (Pulse(m(5), when=x(3)), Out(y(0), when=m(1) & m(2) & m(5)), Set(m(1), when=x(0)), Set(m(2), when=x(1)),
             Set(m(3), when=x(0) | x(2)), Set(m(4), when=x(2)))  # fmt: skip
    model = Model(specification_of(*items, never=y(0), invariants={"third follows first": ~m(1) | m(3)}))
    failure = Induction(model).prove(model.goals[1]).failure
    assert failure is not None
    assert account(model, failure) == [
        "'the goal' is broken by a running scan:",
        "  enough for that, before the scan: E0 edge memory of M5 off, M1 on, M2 on",
        "  enough for that, from outside: X3 on",
        "  not empty either before the scan: M3 on",
        "  after the scan: Y0 on",
    ]


def test_a_running_timer_is_told_by_how_long_it_has_run() -> None:
    """Given a goal that a timer's time breaks, then the account says that it has run for its preset."""
    model = Model(specification_of(OnDelay(Timer(200), 30, when=m(0)), Out(m(0), when=x(0)), never=t(200)))
    failure = Induction(model).prove(model.goals[0]).failure
    assert failure is not None
    assert failure.moment is Moment.RUNNING
    before = next(line for line in account(model, failure) if "before the scan: " in line)
    assert "T200 running for" in before
    assert int(before.split("T200 running for ")[1].split()[0]) >= 3


@pytest.mark.parametrize("timer", [0, 200])
def test_a_timer_that_is_not_driven_is_off(timer: int) -> None:
    """Given a timer, then it is proved without an invariant that its contact is on only with its coil."""
    items = (OnDelay(Timer(timer), 300, when=x(0)), Out(m(0), when=x(0)))
    assert row_of(specification_of(*items, never=t(timer) & ~m(0))).result is Result.PROVED
