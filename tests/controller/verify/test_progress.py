"""Progress: steps that can be left, dead ends, ways out, and the report."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from itertools import count

import pytest

from controller.core.expr import FALSE, Bit, Expr, Timer
from controller.core.rungs import OnDelay, Out, Rst, Rung, Set, ZoneReset
from controller.core.sequence import Dwell, Sequence, Step, To
from controller.core.specification import Specification, WayOut
from controller.verify.cells import ModelError
from controller.verify.model import Model
from controller.verify.report import Result, prove
from tests.controller.core.core_rig import m, s, t, x, y
from tests.controller.verify.verify_rig import GOAL, report_of, row_of, specification_of


def chain(*ways: Expr | None) -> tuple[Set, Sequence]:
    """Return a sequence and the rung that starts it; a step leads to the next one unless its condition is None."""
    go = [[] if way is None else [To(str(n + 1), way)] for n, way in enumerate(ways)]
    steps = [Step(str(n), to, waits_for="anything") for n, to in enumerate([*go, []])]
    return Set(s(20), when=m(8002)), Sequence("chain", 20, steps)


def exit_of(bit: str, *items: Rung | Sequence, invariants: Mapping[str, Expr] | None = None) -> tuple[str, str]:
    row = row_of(specification_of(*items, invariants=invariants), bit)
    return row.result, row.lines[0]


# ---- steps ----------------------------------------------------------------------------------------------------


def test_step_is_left_by_a_transfer_or_without_transfers_by_a_reset() -> None:
    """A step with transfers must be left by one of them; a step without transfers may be reset."""
    clear = ZoneReset(s(20), s(21), when=x(5))
    assert exit_of("S20 chain: 0", *chain(x(0)), clear) == ("possible", "to S21 chain: 1")
    assert exit_of("S21 chain: 1", *chain(x(0)), clear) == ("possible", "reset in 'all'")
    assert exit_of("S20 chain: 0", *chain(FALSE), clear) == ("impossible", "none of its transfers can ever fire")


def test_step_without_an_exit_is_a_dead_end() -> None:
    """A final step that is never reset is reported as a dead end."""
    assert exit_of("S21 chain: 1", *chain(x(0))) == ("impossible", "it has no transfer and no block resets it")


def test_step_with_an_impossible_condition_is_a_dead_end() -> None:
    """A step cannot be left if its transfer requires two mutually exclusive bits."""
    items = (Out(m(1), when=x(1)), Out(m(2), when=~x(1)), *chain(m(1) & m(2)))
    assert exit_of("S20 chain: 0", *items)[0] == "impossible"
    assert exit_of("S20 chain: 0", *items[:1], Out(m(2), when=x(2)), *chain(m(1) & m(2)))[0] == "possible"


def test_step_set_again_in_every_scan_cannot_be_left() -> None:
    """A step whose only transfer leads back to the same step cannot be left."""
    steps = [Step("only", [To("only", x(0))], waits_for="anything")]
    assert exit_of("S20 loop: only", Set(s(20), when=m(8002)), Sequence("loop", 20, steps))[0] == "impossible"


def test_step_with_a_dwell_can_be_left() -> None:
    """A step whose only transfer fires at the end of its dwell can be left."""
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
def test_way_out_must_work_for_all_other_inputs(orders: Mapping[Bit, bool], result: Result) -> None:
    """If clearing a latch requires both a terminal and a command, neither alone is a way out."""
    assert row_of(latch(*LATCH, out=way(orders)), "clear it").result is result


def test_way_out_of_two_scans_requires_both_scans() -> None:
    """If a latch is cleared by pressing a button for two scans, one scan or an interrupted press is not a way out."""
    items = (Out(m(3), when=m(2) & x(1)), Out(m(2), when=x(1)), Set(STUCK, when=x(0) & ~x(1)), Rst(STUCK, when=m(3)))
    held, off = {x(1): True}, {x(1): False}
    results = [
        row_of(latch(*items, out=way(*scans)), "clear it").result for scans in ((held, held), (held,), (held, off))
    ]
    assert results == [Result.PROVED, Result.UNPROVED, Result.UNPROVED]


def test_failing_way_out_is_described_scan_by_scan() -> None:
    """If another input can block a way out, the counter-example names this input."""
    items = (Set(STUCK, when=x(0)), Rst(STUCK, when=x(1) & ~x(2)))
    row = row_of(latch(*items, out=way({x(1): True})), "clear it")
    assert row.lines == ("from: M1 on", "scan 1, external inputs: X1 on, X2 on", "after scan 1: M1 on, M8000 on")


@pytest.mark.parametrize(
    ("elapsed", "result"), [(True, Result.PROVED), (False, Result.UNPROVED), (None, Result.UNPROVED)]
)
def test_a_way_out_may_wait_for_a_timer(elapsed: bool | None, result: Result) -> None:
    """If a timer delays the clearing of a latch, the way out is proved only if it states that the timer has elapsed."""
    items = (OnDelay(Timer(0), 3_000, when=x(1)), Rst(STUCK, when=t(0)), Set(STUCK, when=x(0) & ~t(0)))
    orders = {x(1): True} if elapsed is None else {x(1): True, t(0): elapsed}
    assert row_of(latch(*items, out=way(orders)), "clear it").result is result
    # A timer that is not driven has not elapsed, even if the way out states that it has.
    assert row_of(latch(*items, out=way({t(0): True})), "clear it").result is Result.UNPROVED


def test_way_out_with_an_impossible_start_is_rejected() -> None:
    """A way out whose start condition can never be true is rejected because it proves nothing."""
    row = row_of(latch(*LATCH, out=way({x(1): True}, start=STUCK & ~STUCK)), "clear it")
    assert (row.result, row.lines) == (
        Result.UNPROVED,
        ("its start condition can never be true; correct it or the invariants",),
    )


def test_way_out_depends_on_its_invariants() -> None:
    """A way out that depends on an invariant is proved if the invariant is correct, and conditional otherwise."""
    blocked = (Set(STUCK, when=x(0)), Rst(STUCK, when=x(1) & ~m(4)))
    for rung, result in ((Out(m(4), when=m(4) & x(3)), Result.PROVED), (Out(m(4), when=x(3)), Result.CONDITIONAL)):
        specification = latch(*blocked, rung, out=way({x(1): True}), invariants={"not blocked": ~m(4)})
        assert row_of(specification, "clear it").result is result


def test_way_out_that_is_not_an_input_is_rejected() -> None:
    """A way out that specifies the level of a program relay is rejected with an error that names the relay."""
    with pytest.raises(ModelError, match="way out 'clear it': M1 is not an input, command or timer"):
        Model(latch(*LATCH, out=way({STUCK: False})))


# ---- report ---------------------------------------------------------------------------------------------------


def reported() -> Specification:
    return specification_of(
        *chain(x(0)), Out(y(0), when=s(21) & x(1)), never=y(0), invariants={"apart": ~(y(0) & m(9))}
    )


def test_report_is_a_table_followed_by_details() -> None:
    """The table and the details contain a broken goal and a dead end, and `good` is false."""
    report = report_of(reported())
    assert not report.good
    table, *details = report.text().split("\n\n")
    assert [line.split("  ")[0] for line in table.splitlines()] == [
        "bench: 5 goals, 0.0 s",
        "apart",
        GOAL,
        "all goals together",
        "S20 chain: 0",
        "S21 chain: 1",
    ]
    assert [text.splitlines()[0] for text in details] == [f"{GOAL}: violated", "S21 chain: 1: impossible"]
    assert "reason: it would hurt" in details[0]


def test_the_summary_has_the_verdict_a_line_for_each_group_and_what_is_not_proved() -> None:
    table, *details = report_of(reported()).summary().split("\n\n")
    assert [" ".join(line.split()) for line in table.splitlines()] == [
        "bench: not proved: 2 of 5 goals, 0.0 s",
        "invariant 1 proved",
        "requirement 1 violated",
        "consistent 1 possible",
        "step can be left 1 possible",
        "step can be left 1 impossible",
    ]
    assert [text.splitlines()[0] for text in details] == [f"{GOAL}: violated", "S21 chain: 1: impossible"]


def test_the_report_as_json_has_the_same_rows() -> None:
    """The JSON form of a report contains the rows and results of the report, and its traces."""
    report = report_of(reported())
    data = json.loads(report.to_json())
    assert [(row["name"], row["result"]) for row in data["rows"]] == [(row.name, row.result) for row in report.rows]
    assert data["good"] is False
    assert data["rows"][1]["trace"]["scans"][0]["inputs"] == ["X0", "X1"]


def test_the_short_form_is_induction_only() -> None:
    """The short form contains no traces and no progress rows, but it describes each failure."""
    rows = report_of(reported(), short=True).rows
    assert [(row.name, row.result, row.trace) for row in rows] == [
        ("apart", Result.PROVED, None),
        (GOAL, Result.UNPROVED, None),
    ]
    assert any("  cause, " in line for line in rows[1].lines)


def test_selected_goal_is_proved_with_its_dependencies() -> None:
    """Only the named goals and the goals that they depend on are proved."""
    items = (Out(m(0), when=m(1)), Out(m(1), when=m(1) & x(0)), Out(m(3), when=m(3) & x(0)))
    specification = specification_of(*items, never=m(0), invariants={"one": ~m(1), "other": ~m(3)})
    report = prove(specification, clock=lambda: 0.0, only=[GOAL])
    assert [(row.name, row.result) for row in report.rows] == [("one", Result.PROVED), (GOAL, Result.PROVED)]


def test_unknown_name_is_rejected_with_the_known_names() -> None:
    """A misspelt name is rejected, and the known names are listed."""
    with pytest.raises(ModelError, match="unknown goal 'the gol'; known: apart, the goal, all goals"):
        prove(reported(), clock=lambda: 0.0, only=["the gol"])


def test_times_are_measured_with_the_clock_argument() -> None:
    """If the clock advances by 1 s at each reading, each goal takes 1 s, and the total is the sum of all times."""
    ticks: Iterator[int] = count()
    report = prove(reported(), clock=lambda: float(next(ticks)), short=True)
    assert [row.seconds for row in report.rows] == [1.0, 1.0]
    assert report.seconds == float(next(ticks) - 1)


def test_search_ends_at_its_time_limit() -> None:
    """If the clock passes the time limit before the first search, there is no trace from power-up."""
    ticks: Iterator[int] = count(step=100)
    report = prove(reported(), clock=lambda: float(next(ticks)), search_s=60.0)
    assert [row.result for row in report.rows][:2] == [Result.PROVED, Result.UNPROVED]
