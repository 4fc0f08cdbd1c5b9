"""Traces: search, text, JSON, and replay on a soft PLC."""

from __future__ import annotations

import pytest

from controller.core.expr import Timer, evaluate
from controller.core.rungs import Inc, OnDelay, Out, Pulse, Rst, Set
from controller.core.sequence import Dwell, Sequence, Step, To
from controller.core.specification import Specification
from controller.verify.cells import ModelError
from controller.verify.report import GoalResult, Result
from controller.verify.trace import Start, Trace, TracedScan, replay
from tests.controller.core.core_rig import d, m, s, t, x, y
from tests.controller.verify.verify_rig import GOAL, row_of, specification_of


def found(row: GoalResult) -> Trace:
    assert row.trace is not None
    return row.trace


def broken_scans(specification: Specification, trace: Trace) -> list[bool]:
    """Return, for each scan of a replay, whether the requirement is violated after the scan."""
    never = specification.requirements[0].never
    return [evaluate(never, memory) for memory in replay(specification.watched, trace)]


DWELLING = (
    Set(s(20), when=m(8002)),
    Sequence(
        "arm",
        20,
        [
            Step("wait", [To("move", x(0))], waits_for="start"),
            Step("move", [To("dwell", x(1))], hold=[m(0)], dwell=Dwell(Timer(201), 10)),
            Step("dwell", [To("jam", t(200) & ~x(1))], dwell=Dwell(Timer(200), 500)),
            Step("jam", [], waits_for="nothing"),
        ],
    ),
    Out(y(0), when=s(23)),
)


def test_trace_from_power_up_through_steps_and_dwells() -> None:
    """If the fourth step violates the goal, the trace waits exactly for the dwell time of the third step."""
    specification = specification_of(*DWELLING, never=y(0))
    row = row_of(specification)
    trace = found(row)
    assert (row.result, trace.start) == (Result.BROKEN, Start.FACTORY)
    assert broken_scans(specification, trace) == [False, True]
    assert [scan.at_ms for scan in trace.scans] == [0, 500]


def test_replay_verifies_a_trace() -> None:
    """If the wait for a dwell is shortened by 100 ms, the replay of the trace does not violate the goal."""
    specification = specification_of(*DWELLING, never=y(0))
    trace = found(row_of(specification))
    first, last = trace.scans
    short = TracedScan(last.at_ms - 100, last.inputs, last.written)
    hurried = Trace(GOAL, trace.start, trace.retained, trace.forced, (first, short))
    assert broken_scans(specification, hurried) == [False, False]


def test_trace_may_begin_with_retained_values() -> None:
    """A trace starts with a retained count if counting from the first power-up would take too many scans."""
    items = (Pulse(m(0), when=x(0)), Inc(d(200), when=m(0)), Out(y(0), when=(d(200) > 100) & x(1)))
    specification = specification_of(*items, never=y(0))
    trace = found(row_of(specification))
    assert trace.start is Start.RETAINED
    assert trace.retained["D200"] >= 100
    assert broken_scans(specification, trace)[-1]


def test_fallback_trace_is_one_scan_from_a_state() -> None:
    """If a goal is violated only in the third scan but the limit is two, the trace has one scan from some state."""
    items = (
        Out(y(0), when=m(2) & t(0) & ~m(8002)),
        Out(m(2), when=m(1)),
        Out(m(1), when=x(0)),
        OnDelay(Timer(0), 300, when=x(0)),
    )
    specification = specification_of(*items, never=y(0))
    row = row_of(specification, scans=2)
    trace = found(row)
    assert (row.result, trace.start, len(trace.scans)) == (Result.UNPROVED, Start.STATE, 1)
    assert broken_scans(specification, trace) == [True]
    assert any("whether it can be reached is open" in line for line in row.lines)
    assert row_of(specification, scans=3).result is Result.BROKEN


def test_a_running_timer_of_a_state_replays() -> None:
    """A fallback trace whose state contains running timers of each base, all about to elapse, can be replayed."""
    timers = [Timer(0), Timer(200), Timer(246), Timer(250)]
    items = [OnDelay(timer, 300, when=m(1)) for timer in timers]
    elapsed = t(0) & t(200) & t(246) & t(250)
    for clock in (m(8013), ~m(8013)):
        late = Out(y(0), when=elapsed & ~m(2) & clock)
        specification = specification_of(
            *items,
            late,
            Out(m(2), when=~x(0)),
            Out(m(1), when=m(3)),
            Out(m(3), when=m(4)),
            Set(m(4), when=x(0)),
            never=y(0),
        )
        trace = found(row_of(specification, scans=1))
        assert trace.start is Start.STATE
        assert broken_scans(specification, trace) == [True]


def test_json_round_trip_of_a_trace() -> None:
    """A trace is unchanged after a JSON round trip, whatever its initial state."""
    scan = TracedScan(300, ("X1", "X10"), {"M8": 1, "D512": -3})
    for start in Start:
        trace = Trace("some goal", start, {"TN246": 5, "D200": 7}, {"M10": 1}, (scan,))
        assert Trace.from_json(trace.to_json()) == trace


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"goal": "a", "start": "elsewhere", "scans": []}', "3"])
def test_invalid_trace_is_rejected(text: str) -> None:
    """A text that is not a trace is rejected with a one-line error."""
    with pytest.raises(ModelError, match=r"^not a trace: [^\n]*$"):
        Trace.from_json(text)


def test_text_of_a_trace() -> None:
    """The text lists the step, terminal and command that violate the goal, each in the scan in which it changes."""
    steps = [Step("wait", [To("go", x(0))], waits_for="X0"), Step("go", [], waits_for="nothing")]
    items = (
        Set(s(20), when=m(8002)),
        Sequence("arm", 20, steps),
        Out(y(1), when=s(21)),
        Out(y(0), when=m(1) & m(8)),
        Out(m(1), when=s(21)),
        Rst(m(8)),
    )
    specification = specification_of(*items, never=y(0) & y(1), system=(m(8),))
    lines = row_of(specification).lines
    first = lines.index("trace to 'the goal' from the first power-up")
    assert lines[first:] == (
        "trace to 'the goal' from the first power-up",
        "scan 1 at 0 ms (first scan, M8002)",
        "  inputs: X0 on",
        "  steps: S21 arm: go on",
        "  outputs: Y1 on",
        "scan 2 at 100 ms",
        "  written: M8 on",
        "  steps: S21 arm: go on",
        "  outputs: Y0 on",
        "result: Y0 & Y1",
    )


def test_trace_uses_the_1_s_clock_of_the_plc() -> None:
    """If a goal is violated when the 1 s clock turns off, the trace waits for the second half of the period."""
    items = (Out(y(0), when=m(1) & ~m(8013)), Set(m(1), when=m(8013)))
    trace = found(row_of(specification_of(*items, never=y(0))))
    assert [scan.at_ms % 1000 < 500 for scan in trace.scans] == [True, False]
    assert trace.scans[1].at_ms - trace.scans[0].at_ms <= 500


def test_trace_writes_only_values_that_the_runtime_accepts() -> None:
    """If only the maximum of a set-point turns an output on, the trace writes that value."""
    ranges, points = {d(512): (0, 11)}, ((d(512), 3),)
    specification = specification_of(Out(y(0), when=d(512) >= 11), never=y(0), set_points=points, ranges=ranges)
    assert found(row_of(specification)).scans == (TracedScan(0, (), {"D512": 11}),)
