"""Progress: steps that can be left, dead ends, ways out, and the report of it all."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from itertools import count

import pytest
from core_rig import m, s, t, x, y
from verify_rig import GOAL, report_of, row_of, specification_of

from controller.core.expr import FALSE, Bit, Expr, Timer
from controller.core.rungs import OnDelay, Out, Rst, Rung, Set, ZoneReset
from controller.core.sequence import Dwell, Sequence, Step, To
from controller.core.specification import Specification, WayOut
from controller.verify.cells import ModelError
from controller.verify.model import Model
from controller.verify.report import Result, prove


def chain(*ways: Expr | None) -> tuple[Set, Sequence]:
    """Steps in a row, each left by its condition if it has one."""
    go = [[] if way is None else [To(str(n + 1), way)] for n, way in enumerate(ways)]
    steps = [Step(str(n), to, waits_for="anything") for n, to in enumerate([*go, []])]
    return Set(s(20), when=m(8002)), Sequence("chain", 20, steps)


def exit_of(bit: str, *items: Rung | Sequence, invariants: Mapping[str, Expr] | None = None) -> tuple[str, str]:
    row = row_of(specification_of(*items, invariants=invariants), bit)
    return row.result, row.lines[0]


# ---- steps ----------------------------------------------------------------------------------------------------


def test_a_step_is_left_by_a_transfer_of_its_own_if_one_can_fire() -> None:
    """Given a step with a transfer and a reset, then the transfer must fire; a step that declares none may be reset."""
    clear = ZoneReset(s(20), s(21), when=x(5))
    assert exit_of("S20 chain: 0", *chain(x(0)), clear) == ("possible", "to S21 chain: 1")
    assert exit_of("S21 chain: 1", *chain(x(0)), clear) == ("possible", "reset in 'all'")
    assert exit_of("S20 chain: 0", *chain(FALSE), clear) == ("impossible", "none of its transfers can ever fire")


def test_a_step_with_nowhere_to_go_is_a_dead_end() -> None:
    """Given a last step that nothing resets, then it is found."""
    assert exit_of("S21 chain: 1", *chain(x(0))) == ("impossible", "it has no transfer and no block resets it")


def test_a_step_whose_condition_never_comes_is_a_dead_end() -> None:
    """Given a transfer that needs two bits which an invariant keeps apart, then its step cannot be left."""
    items = (Out(m(1), when=x(1)), Out(m(2), when=~x(1)), *chain(m(1) & m(2)))
    assert exit_of("S20 chain: 0", *items)[0] == "impossible"
    assert exit_of("S20 chain: 0", *items[:1], Out(m(2), when=x(2)), *chain(m(1) & m(2)))[0] == "possible"


def test_a_step_that_is_set_again_in_every_scan_cannot_be_left() -> None:
    """Given a step whose transfer can fire, when a rung before it sets it and it goes to itself, it stays."""
    steps = [Step("only", [To("only", x(0))], waits_for="anything")]
    assert exit_of("S20 loop: only", Set(s(20), when=m(8002)), Sequence("loop", 20, steps))[0] == "impossible"


def test_a_dwell_can_be_waited_for() -> None:
    """Given a step that only its time ends, then it can be left."""
    steps = [Step("dwell", [To("after", t(200))], dwell=Dwell(Timer(200), 500)), Step("after", [], waits_for="nothing")]
    assert exit_of("S20 dwell: dwell", Sequence("dwell", 20, steps)) == ("possible", "to S21 dwell: after")


# ---- ways out -------------------------------------------------------------------------------------------------

STUCK = m(1)
LATCH = (Set(STUCK, when=x(0)), Rst(STUCK, when=x(1) & m(8)), Rst(m(8)))


def way(*scans: Mapping[Bit, bool], start: Expr = STUCK, goal: Expr = ~STUCK) -> WayOut:
    return WayOut("clear it", start, scans, goal)


def latch(*items: Rung, out: WayOut, invariants: Mapping[str, Expr] | None = None) -> Specification:
    return specification_of(*items, ways_out=(out,), invariants=invariants, system=(m(8),))


@pytest.mark.parametrize(
    ("orders", "result"),
    [
        ({x(1): True, m(8): True}, Result.PROVED),
        ({x(1): True}, Result.UNPROVED),
        ({x(1): True, m(8): False}, Result.UNPROVED),
        ({x(1): False, m(8): True}, Result.UNPROVED),
    ],
)
def test_a_way_out_leads_out_whatever_else_happens_or_is_refused(orders: Mapping[Bit, bool], result: Result) -> None:
    """Given a latch that a terminal and a command clear, then only both together are a way out."""
    assert row_of(latch(*LATCH, out=way(orders)), "clear it").result is result


def test_a_way_out_of_two_scans_needs_both() -> None:
    """Given a latch that is cleared by a button held for two scans, then one scan or a break is no way out."""
    items = (Out(m(3), when=m(2) & x(1)), Out(m(2), when=x(1)), Set(STUCK, when=x(0) & ~x(1)), Rst(STUCK, when=m(3)))
    held, off = {x(1): True}, {x(1): False}
    results = [
        row_of(latch(*items, out=way(*scans)), "clear it").result for scans in ((held, held), (held,), (held, off))
    ]
    assert results == [Result.PROVED, Result.UNPROVED, Result.UNPROVED]


def test_a_way_out_that_fails_is_told_scan_by_scan() -> None:
    """Given a way out that another input blocks, then the story names that input."""
    items = (Set(STUCK, when=x(0)), Rst(STUCK, when=x(1) & ~x(2)))
    row = row_of(latch(*items, out=way({x(1): True})), "clear it")
    assert row.lines == ("from: M1 on", "scan 1, from outside: X1 on, X2 on", "after scan 1: M1 on, M8000 on")


@pytest.mark.parametrize(("over", "result"), [(True, Result.PROVED), (False, Result.UNPROVED), (None, Result.UNPROVED)])
def test_a_way_out_may_wait_for_a_timer(over: bool | None, result: Result) -> None:
    """Given a latch that a button held for a time clears, then it is a way out only with the time over."""
    items = (OnDelay(Timer(0), 3_000, when=x(1)), Rst(STUCK, when=t(0)), Set(STUCK, when=x(0) & ~t(0)))
    orders = {x(1): True} if over is None else {x(1): True, t(0): over}
    assert row_of(latch(*items, out=way(orders)), "clear it").result is result
    # A timer that is not driven is not over, whatever is said of it.
    assert row_of(latch(*items, out=way({t(0): True})), "clear it").result is Result.UNPROVED


def test_a_way_out_of_nowhere_is_refused() -> None:
    """Given a start that can never be, then the way out proves nothing and is refused."""
    row = row_of(latch(*LATCH, out=way({x(1): True}, start=STUCK & ~STUCK)), "clear it")
    assert (row.result, row.lines) == (
        Result.UNPROVED, ("its start can never be: correct the start or the invariants",)
    )  # fmt: skip


def test_a_way_out_rests_on_its_invariants() -> None:
    """Given a way out that needs an invariant, then it is proved with a right one and conditional with a wrong one."""
    blocked = (Set(STUCK, when=x(0)), Rst(STUCK, when=x(1) & ~m(4)))
    for rung, result in ((Out(m(4), when=m(4) & x(3)), Result.PROVED), (Out(m(4), when=x(3)), Result.CONDITIONAL)):
        specification = latch(*blocked, rung, out=way({x(1): True}), invariants={"not blocked": ~m(4)})
        assert row_of(specification, "clear it").result is result


def test_a_way_out_that_presses_no_input_is_refused() -> None:
    """Given a way out that turns on a coil of the program, then it is refused by name."""
    with pytest.raises(ModelError, match="way out 'clear it': M1 is no input, command or timer"):
        Model(latch(*LATCH, out=way({STUCK: False})))


# ---- report ---------------------------------------------------------------------------------------------------


def reported() -> Specification:
    return specification_of(
        *chain(x(0)), Out(y(0), when=s(21) & x(1)), never=y(0), invariants={"apart": ~(y(0) & m(9))}
    )


def test_the_report_is_a_table_and_what_is_wrong_below_it() -> None:
    """Given a broken goal and a dead end, then both are in the table and told below, and the report is not good."""
    report = report_of(reported())
    assert not report.good
    table, *told = report.text().split("\n\n")
    assert [line.split("  ")[0] for line in table.splitlines()] == [
        "bench: 5 goals, 0.0 s", "apart", GOAL, "all goals together", "S20 chain: 0", "S21 chain: 1"
    ]  # fmt: skip
    assert [text.splitlines()[0] for text in told] == [f"{GOAL}: broken", "S21 chain: 1: impossible"]
    assert "it must not be: it would hurt" in told[0]


def test_the_report_as_json_has_the_same_rows() -> None:
    """Given a report, when it is read as JSON, then rows, results and traces are there."""
    report = report_of(reported())
    data = json.loads(report.to_json())
    assert [(row["name"], row["result"]) for row in data["rows"]] == [(row.name, row.result) for row in report.rows]
    assert data["good"] is False
    assert data["rows"][1]["trace"]["scans"][0]["inputs"] == ["X0", "X1"]


def test_the_short_form_is_induction_only() -> None:
    """Given the short form, then there is no trace and no row about progress, and the failure is told all the same."""
    rows = report_of(reported(), short=True).rows
    assert [(row.name, row.result, row.trace) for row in rows] == [
        ("apart", Result.PROVED, None), (GOAL, Result.UNPROVED, None)
    ]  # fmt: skip
    assert any("enough for that" in line for line in rows[1].lines)


def test_one_goal_is_proved_with_whatever_it_rests_on() -> None:
    """Given names, then those goals are proved and those they rest on, and no others."""
    items = (Out(m(0), when=m(1)), Out(m(1), when=m(1) & x(0)), Out(m(3), when=m(3) & x(0)))
    specification = specification_of(*items, never=m(0), invariants={"one": ~m(1), "other": ~m(3)})
    report = prove(specification, clock=lambda: 0.0, only=[GOAL])
    assert [(row.name, row.result) for row in report.rows] == [("one", Result.PROVED), (GOAL, Result.PROVED)]


def test_a_name_that_nothing_has_is_refused_with_the_names_there_are() -> None:
    """Given a name with a letter missing, then it is refused and the known names are told."""
    with pytest.raises(ModelError, match="nothing to prove is called 'the gol'; known: apart, the goal, all goals"):
        prove(reported(), clock=lambda: 0.0, only=["the gol"])


def test_seconds_are_taken_from_the_clock_that_is_given() -> None:
    """Given a clock that goes on by a second at every look, then a goal takes one and the whole takes them all."""
    ticks: Iterator[int] = count()
    report = prove(reported(), clock=lambda: float(next(ticks)), short=True)
    assert [row.seconds for row in report.rows] == [1.0, 1.0]
    assert report.seconds == float(next(ticks) - 1)


def test_the_search_ends_with_its_time() -> None:
    """Given a clock past the end of the search at its first look, then there is no trace from power-up."""
    ticks: Iterator[int] = count(step=100)
    report = prove(reported(), clock=lambda: float(next(ticks)), search_s=60.0)
    assert [row.result for row in report.rows][:2] == [Result.PROVED, Result.UNPROVED]
