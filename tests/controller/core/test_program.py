"""Checks of sequences and programs before the first scan."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from controller.core.devices import DeviceError
from controller.core.expr import Bit, Counter, Timer
from controller.core.program import Block, Program, ProgramError
from controller.core.rungs import (
    Annunciate,
    Count,
    Inc,
    Mov,
    OnDelay,
    Out,
    Pulse,
    PulseFalling,
    Rst,
    Rung,
    RungError,
    Set,
    ZoneReset,
)
from controller.core.sequence import Dwell, Sequence, SequenceError, Step, Timeout, To
from tests.controller.core.core_rig import d, m, program_of, s, x, y

OUT = Out(y(0), when=m(0))


def wait(title: str, *targets: str) -> Step:
    return Step(title, [To(target, when=x(0)) for target in targets], waits_for="X0")


def dwell(title: str, timer: int) -> Step:
    return Step(title, [], dwell=Dwell(Timer(timer), 300))


def program(*inner: Rung | Sequence, outputs: tuple[Rung, ...] = (OUT,)) -> Program:
    return Program("two blocks", (Block("logic", inner), Block("outputs", outputs)), outputs="outputs")


# ---- sequences ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("declare", "message"),
    [
        (
            lambda: Sequence("arm", 20, [wait("a", "b"), wait("b", "c")]),
            "arm: step 'b' goes to unknown step 'c'; use one of a, b",
        ),
        (lambda: Sequence("arm", 20, [wait("a"), wait("b"), wait("a")]), "arm: two steps have the same title"),
        (lambda: Step("lift", [], hold=[m(0)]), "step 'lift' causes motion without a time limit; add watch or"),
        (lambda: Step("lift", [], hold=[m(0)], waits_for="the sensor"), "step 'lift' causes motion without"),
        (lambda: Step("rest", []), "step 'rest' holds no request; state what it waits for"),
        (lambda: Dwell(Timer(246), 100), "dwell T246: a retentive timer"),
        (lambda: Dwell(Timer(250), d(512)), "dwell T250: a retentive timer"),
    ],
)
def test_an_invalid_sequence_is_rejected(declare: Callable[[], object], message: str) -> None:
    with pytest.raises(SequenceError, match=message):
        declare()


def test_a_moving_step_needs_a_time_limit_or_a_fixed_time_and_a_waiting_step_a_reason_or_a_fixed_time() -> None:
    limit = Timeout(300, s(900), Timer(0))
    for step in (
        Step("limited", [], hold=[m(0)], watch=limit),
        Step("timed", [], hold=[m(0)], dwell=Dwell(Timer(1), 100)),
        Step("waiting", [], waits_for="start"),
        Step("resting", [], dwell=Dwell(Timer(2), 100)),
    ):
        assert Sequence("fine", 20, [step]).first == s(20)


def test_steps_beyond_the_last_state_are_rejected() -> None:
    assert Sequence("end", 998, [wait("a"), wait("b")]).last == s(999)
    with pytest.raises(DeviceError, match="S1000"):
        Sequence("end", 999, [wait("a"), wait("b")])


def test_step_times_are_checked_when_the_program_is_constructed() -> None:
    with pytest.raises(RungError, match="T0: 50 ms is out of range or not a multiple of 100 ms"):
        program(Sequence("arm", 20, [Step("a", [], dwell=Dwell(Timer(0), 50))]))
    with pytest.raises(RungError, match="S900: T200 300 ms"):
        Sequence("arm", 20, [Step("a", [], hold=[m(0)], watch=Timeout(300, s(900), Timer(200)))]).limits()


# ---- programs -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bit", [m(5), s(5), y(0)])
def test_two_coils_of_one_device_are_rejected(bit: Bit) -> None:
    named = Bit(bit.kind, bit.number, "horn")
    with pytest.raises(ProgramError, match=f"{bit} horn: driven by two OUT coils"):
        program_of(Out(bit, when=x(0)), Set(m(9)), Out(named, when=x(1)))


def test_two_coils_in_different_blocks_are_detected() -> None:
    with pytest.raises(ProgramError, match="M5 : driven by two OUT coils"):
        program(Out(m(5), when=x(0)), outputs=(OUT, Out(m(5), when=x(1))))


def test_one_coil_may_also_be_set_and_reset() -> None:
    program_of(Out(m(5), when=x(0)), Set(m(5), when=x(1)), Rst(m(5), when=x(2)))


@pytest.mark.parametrize(
    "rung",
    [
        Out(y(3)),
        Set(y(3)),
        Rst(y(3)),
        Pulse(y(3), when=x(0)),
        PulseFalling(y(3), when=x(0)),
        ZoneReset(y(2), y(5)),
    ],
    ids=str,
)
def test_outputs_are_written_only_in_the_output_block(rung: Rung) -> None:
    with pytest.raises(ProgramError, match="block 'logic' writes Y; only block 'outputs' may write Y"):
        program(rung)
    assert rung in list(program(outputs=(rung,)).rungs())


@pytest.mark.parametrize(
    "again",
    [
        OnDelay(Timer(7), 300),
        OnDelay(Timer(7), d(512)),
        Annunciate(Timer(7), 300, s(900), when=x(0)),
        Sequence("arm", 40, [dwell("a", 7)]),
    ],
    ids=["on-delay", "on-delay by register", "limit", "dwell"],
)
def test_a_timer_used_twice_is_rejected(again: Rung | Sequence) -> None:
    first = Sequence("first", 20, [dwell("a", 7)])
    for items in ((first, again), (again, first)):
        with pytest.raises(ProgramError, match="T7: already used by an unnamed device; next free number: T0"):
            program(*items)
    program(again)


def test_a_program_lists_its_rungs_and_sequences_in_scan_order() -> None:
    arm = Sequence("arm", 20, [wait("a", "b"), dwell("b", 7)])
    first, last = Out(m(1)), Out(m(2))
    combined = program(first, arm, last)
    assert list(combined.rungs()) == [first, OnDelay(Timer(7), 300), last, OUT]
    assert list(combined.sequences()) == [arm]
    assert list(combined.block("logic").rungs()) == [first, last]
    assert list(combined.block("outputs").sequences()) == []


def test_a_program_lists_every_device_that_it_reads_or_writes() -> None:
    arm = Sequence("arm", 20, [Step("a", [To("a", when=x(1) | (d(7) >= d(8)))], waits_for="X1")])
    rungs = (
        arm,
        Mov(d(1), d(2), when=x(2)),
        OnDelay(Timer(3), d(3), when=m(3)),
        Count(Counter(4), d(4), when=m(4)),
        Inc(d(5), when=m(5)),
        ZoneReset(m(10), m(12)),
        Annunciate(Timer(6), 100, s(906), when=m(6)),
        Rst(Timer(3)),
        Rst(d(9)),
    )
    combined = Program("all", (Block("b", rungs),), outputs="b", system=(m(100),), set_points=((d(512), 5),))
    assert {str(device) for device in combined.devices()} == {
        *("X1", "D7", "D8", "X2", "D1", "D2", "T3", "M3", "D3", "C4", "M4", "D4", "D5", "M5", "M10", "M11", "M12"),
        *("T6", "S906", "M6", "D9", "M100", "D512", "S20"),
    }
