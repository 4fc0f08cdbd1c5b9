"""Sequences in the scan: semantics of the step ladder, by example and against a reference model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.core.devices import Memory
from controller.core.expr import TRUE, Expr, Timer, all_of, evaluate
from controller.core.program import requests
from controller.core.rungs import Out, Rung, Set, ZoneReset
from controller.core.scan import StepMachine
from controller.core.sequence import Dwell, Sequence, Step, Timeout, To
from tests.controller.core.core_rig import THOROUGH, Rig, base_pulses, m, s, t, x

FIRST = 20
STARTED = Set(s(FIRST), when=m(8002))


def step(title: str, *go: To, dwell: Dwell | None = None) -> Step:
    return Step(title, go=go, dwell=dwell, waits_for="a button")


def chain(*titles: str, last_to: str | None = None) -> Sequence:
    """Return a sequence of steps; X<n> ends the n-th step, and the last step leads to `last_to`."""
    following = [*titles[1:], last_to]
    rows = [step(a, *([To(b, when=x(n))] if b else [])) for n, (a, b) in enumerate(zip(titles, following, strict=True))]
    return Sequence("chain", FIRST, rows)


def seen(sequence: Sequence) -> list[Out]:
    """Return rungs that copy S<n> to M<n>; placed after the sequence, they show which steps are on during the scan."""
    return [Out(m(bit.number), when=bit) for bit, _ in sequence]


def shown(rig: Rig) -> set[int]:
    return {number for number in range(FIRST, 100) if rig.memory.M[number]}


# ---- transfers ------------------------------------------------------------------------------------------------


def test_source_and_destination_are_both_on_in_the_transfer_scan_only() -> None:
    sequence = chain("a", "b", "c")
    rig = Rig(STARTED, sequence, *seen(sequence))
    rig.scan()
    assert (shown(rig), rig.states()) == ({20}, {20})
    rig.scan(0)
    assert (shown(rig), rig.states()) == ({20, 21}, {21})
    rig.scan(0)
    assert (shown(rig), rig.states()) == ({21}, {21})


def test_a_destination_declared_later_acts_in_the_same_scan_and_may_cascade() -> None:
    sequence = chain("a", "b", "c", "d")
    rig = Rig(STARTED, sequence, *seen(sequence))
    rig.scan(0, 1)
    assert (shown(rig), rig.states()) == ({20, 21, 22}, {22})
    rig.scan(2)
    assert (shown(rig), rig.states()) == ({22, 23}, {23})


def test_a_destination_declared_earlier_acts_in_the_next_scan() -> None:
    sequence = chain("a", "b", "c", last_to="a")
    rig = Rig(Set(s(22), when=m(8002)), sequence, *seen(sequence))
    rig.scan(0, 2)
    assert (shown(rig), rig.states()) == ({20, 22}, {20})
    rig.scan(0, 2)
    assert (shown(rig), rig.states()) == ({20, 21}, {21})


def test_a_step_left_and_re_entered_in_one_scan_stays_on() -> None:
    sequence = chain("a", "b", last_to="a")
    rig = Rig(STARTED, sequence, *seen(sequence))
    rig.scan(0, 1)
    assert (shown(rig), rig.states()) == ({20, 21}, {20})


def test_a_transfer_to_itself_keeps_the_step_on() -> None:
    rig = Rig(STARTED, Sequence("loop", FIRST, [step("a", To("a", when=x(0)), To("b", when=x(1))), step("b")]))
    rig.scan(0)
    assert rig.states() == {20}
    rig.scan(0, 1)
    assert rig.states() == {20}
    rig.scan(1)
    assert rig.states() == {21}


@pytest.mark.parametrize(
    ("buttons", "taken"), [((0, 1), 21), ((0,), 21), ((1,), 22), ((1, 2), 22), ((2,), 23), ((), 20)]
)
def test_the_first_true_transition_wins(buttons: tuple[int, ...], taken: int) -> None:
    go = [To(title, when=x(n)) for n, title in enumerate("bcd")]
    rig = Rig(STARTED, Sequence("choice", FIRST, [step("a", *go), step("b"), step("c"), step("d")]))
    rig.scan(*buttons)
    assert rig.states() == {taken}


def test_an_unconditional_transition_masks_those_below_it() -> None:
    go = [To("b", when=TRUE), To("c", when=x(0))]
    rig = Rig(STARTED, Sequence("choice", FIRST, [step("a", *go), step("b"), step("c")]))
    rig.scan(0)
    assert rig.states() == {21}


def test_the_first_true_transition_is_taken_even_if_it_makes_a_later_one_true() -> None:
    go = [To("b", when=~s(21)), To("c", when=s(21))]
    rig = Rig(STARTED, Sequence("choice", FIRST, [step("a", *go), step("b"), step("c")]))
    rig.scan()
    assert rig.states() == {21}


def test_conditions_of_transfers_are_mutually_exclusive() -> None:
    """At most one transition of a step is true, because exports, proofs and drawings have no "else" branches."""
    go = [To(title, when=x(n)) for n, title in enumerate("bcd")]
    sequence = Sequence("choice", FIRST, [step("a", *go), step("b"), step("c"), step("d")], enable=x(3))
    for buttons in product([False, True], repeat=4):
        memory = Memory()
        memory.X[:4] = buttons
        true = [transfer.target for transfer in sequence.transfers["a"] if evaluate(transfer.when, memory)]
        assert true == [s(21 + n) for n in range(3) if buttons[n] and buttons[3]][:1]


def test_if_not_enabled_steps_keep_driving_their_requests_but_no_transfer_fires() -> None:
    request, enabled = m(0), m(1)
    row = Step("a", hold=[request], dwell=Dwell(Timer(200), 20), go=[To("b", when=t(200))])
    sequence = Sequence("gated", FIRST, [row, step("b")], enable=enabled)
    rig = Rig(STARTED, sequence, Out(request, when=s(20)), Out(m(2), when=t(200)))
    assert rig.track(s(21), [[]] * 5) == "....."
    assert rig.memory.M[:3] == [True, False, True]
    rig.plc.write(enabled, 1)
    assert rig.track(s(21), [[]]) == "1"
    assert rig.states() == {21}


def test_steps_are_accessible_by_title_and_in_order() -> None:
    sequence = chain("a", "b", "c")
    assert (sequence["b"], sequence.first, sequence.last) == (s(21), s(20), s(22))
    assert [(bit, row.title) for bit, row in sequence] == [(s(20), "a"), (s(21), "b"), (s(22), "c")]


# ---- dwell ----------------------------------------------------------------------------------------------------


def dwelling() -> list[Rung | Sequence]:
    """Return a step that is left after 30 ms or when X0 turns on, between two steps that wait for X1."""
    rows = [
        step("before", To("dwell", when=x(1))),
        step("dwell", To("after", when=x(0) | t(200)), dwell=Dwell(Timer(200), 30)),
        step("after", To("dwell", when=x(1))),
    ]
    return [STARTED, Sequence("dwell", FIRST, rows)]


def test_a_dwell_lasts_its_time_and_its_timer_is_then_reset() -> None:
    rig = Rig(*dwelling())
    assert rig.track(s(22), [[1], [], [], []]) == "...1"  # entered at 0 ms, elapsed at 30 ms
    assert rig.memory.T[200]
    rig.scan()
    assert (rig.memory.T[200], rig.memory.TV[200], rig.memory.TS[200]) == (False, 0, -1)


@pytest.mark.parametrize("exit_buttons", [[0], []])
def test_a_dwell_does_not_carry_over_to_the_next_entry(exit_buttons: list[int]) -> None:
    rig = Rig(*dwelling())
    rig.track(s(22), [[1], [], []])
    assert rig.track(s(22), [exit_buttons, [], []]) == "111"
    assert (
        rig.track(s(21), [[1], [], [], [], []]) == "1111."
    )  # entered from a later step: the dwell starts in the next scan


def test_a_dwell_whose_timer_is_never_executed_undriven_continues_as_on_the_fx() -> None:
    """The step is left and re-entered through its neighbours before it is executed again, so its timer is not reset."""
    rows = [
        step("ask", To("dwell", when=TRUE)),
        step("dwell", To("back", when=x(0) | t(200)), dwell=Dwell(Timer(200), 30)),
        step("back", To("ask", when=TRUE)),
    ]
    rig = Rig(STARTED, Sequence("adjacent", FIRST, rows))
    rig.track(s(21), [[], []])
    rig.scan(0)
    assert rig.states() == {20}
    assert rig.track(t(200), [[]]) == "1"


# ---- S bits are authoritative ---------------------------------------------------------------------------------


@pytest.fixture
def fired(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Record every call of a `transitions` machine as its source step and its resulting state."""
    calls: list[tuple[str, str]] = []
    fire = StepMachine._fire

    def recorded(machine: StepMachine, source: str, trigger: Callable[[], None]) -> None:
        fire(machine, source, trigger)
        calls.append((source, machine.state))

    monkeypatch.setattr(StepMachine, "_fire", recorded)
    return calls


def test_the_state_machine_is_called_for_transfers_only(fired: list[tuple[str, str]]) -> None:
    rig = Rig(STARTED, chain("a", "b", "c", last_to="a"))
    for buttons in ([], [1], [2], [1, 2], []):
        rig.scan(*buttons)
    assert fired == []
    rig.scan(0, 1)
    assert fired == [("a", "b"), ("b", "c")]
    rig.scan()
    rig.scan(2)
    assert fired[2:] == [("c", "a")]


def test_a_step_set_by_a_rung_starts_and_the_state_machine_follows(fired: list[tuple[str, str]]) -> None:
    sequence = chain("a", "b", "c", "d")
    rig = Rig(STARTED, ZoneReset(s(20), s(23), when=x(8)), Set(s(22), when=x(9)), sequence)
    rig.scan()
    rig.scan(8, 9)
    assert rig.states() == {22}
    rig.scan(0, 1)
    assert (rig.states(), fired) == ({22}, [])
    rig.scan(2)
    assert (rig.states(), fired) == ({23}, [("c", "d")])


def test_every_step_that_is_on_is_executed_even_if_set_by_a_rung(fired: list[tuple[str, str]]) -> None:
    rig = Rig(STARTED, Set(s(22), when=m(8002)), chain("a", "b", "c", "d"))
    rig.scan(0, 2)
    assert rig.states() == {21, 23}
    assert fired == [("a", "b"), ("c", "d")]


def test_a_sequence_with_no_step_on_does_nothing(fired: list[tuple[str, str]]) -> None:
    rig = Rig(chain("a", "b", last_to="a"))
    for _ in range(3):
        rig.scan(0, 1)
    assert (rig.states(), fired) == (set(), [])


def test_steps_reset_in_the_scan_of_a_transfer_stay_off() -> None:
    rig = Rig(STARTED, chain("a", "b", "c"), ZoneReset(s(20), s(22), when=x(8)))
    rig.scan(0, 8)
    assert rig.states() == set()
    rig.scan(0, 1)
    assert rig.states() == set()


def test_a_source_set_again_after_its_transfer_is_still_reset_at_end() -> None:
    rig = Rig(STARTED, chain("a", "b"), Set(s(20), when=x(8)))
    rig.scan(0, 8)
    assert rig.states() == {21}
    rig.scan(8)
    assert rig.states() == {20, 21}


def test_two_sequences_are_independent() -> None:
    other = Sequence("other", 40, [step("a", To("b", when=x(5))), step("b", To("a", when=x(6)))])
    rig = Rig(STARTED, Set(s(40), when=m(8002)), chain("a", "b", last_to="a"), other)
    expected = {(0,): {21, 40}, (5,): {21, 41}, (1, 6): {20, 40}, (0, 5): {21, 41}, (1,): {20, 41}}
    for buttons, states in expected.items():
        rig.scan(*buttons)
        assert rig.states() == states


# ---- requests and limits --------------------------------------------------------------------------------------


def test_a_request_lists_every_step_that_holds_it_and_a_limit_lists_its_step() -> None:
    up, down = m(0), m(1)
    limit = Timeout(300, s(900), Timer(0))
    one = Sequence(
        "one",
        20,
        [
            Step("a", [To("b", when=x(0))], hold=[up], watch=limit),
            Step("b", [], hold=[up, down], dwell=Dwell(Timer(200), 10)),
        ],
    )
    two = Sequence("two", 40, [Step("a", [], hold=[down], dwell=Dwell(Timer(201), 10))])
    assert requests([one, two]) == {up: [s(20), s(21)], down: [s(21), s(40)]}
    assert (one.holding(up), one.holding(down), two.holding(up)) == ([s(20), s(21)], [s(21)], [])
    assert two.limits() == []
    rig = Rig(STARTED, one, two, *one.limits(), scan_ms=100)
    assert rig.track(s(900), [[], [], [], []]) == "...1"


# ---- comparison with a reference model ------------------------------------------------------------------------


@dataclass(frozen=True)
class Way:
    """Transition taken if all `on` buttons are on, all `off` buttons are off and any required dwell is over."""

    to: int
    on: frozenset[int]
    off: frozenset[int]
    after_dwell: bool

    def open(self, buttons: set[int], dwell_over: bool) -> bool:
        return self.on <= buttons and not self.off & buttons and (dwell_over or not self.after_dwell)


@dataclass(frozen=True)
class Row:
    """Step with its transitions and its dwell in units of 10 ms (None if it has no dwell)."""

    ways: tuple[Way, ...]
    counts: int | None


@dataclass
class StepSet:
    """Reference model of controller.core.sequence: the set of steps that are on."""

    rows: tuple[Row, ...]
    on: set[int] = field(default_factory=set)
    counted: dict[int, int] = field(default_factory=dict)
    leaving: set[int] = field(default_factory=set)

    def turn(self, buttons: set[int], pulses: int) -> None:
        for n, row in enumerate(self.rows):
            if n not in self.on:
                self.counted.pop(n, None)
                continue
            self.counted[n] = self.counted[n] + pulses if n in self.counted else 0
            over = row.counts is not None and self.counted[n] >= row.counts
            way = next((way for way in row.ways if GATE in buttons and way.open(buttons, over)), None)
            if way is not None:
                self.on.add(way.to)
                self.leaving = self.leaving - {way.to} | ({n} - {way.to})

    def end(self) -> None:
        self.on -= self.leaving
        self.leaving = set()


GATE, START, AWAY_BEFORE, AWAY_AFTER = 4, 5, 6, 7
BUTTON_SETS = st.sets(st.integers(0, 3)).flatmap(
    lambda some: st.sampled_from(
        [{GATE}, {GATE}, {GATE}, {GATE, START}, {START}, set(), {AWAY_BEFORE, GATE}, {AWAY_AFTER, GATE}]
    ).map(lambda more: some | more)
)


@st.composite
def plans(draw: st.DrawFn) -> tuple[Row, ...]:
    """Draw one to four steps with arbitrary transitions between them."""
    size = draw(st.integers(1, 4))
    few = st.frozensets(st.integers(0, 3), max_size=2)
    rows = []
    for _ in range(size):
        counts = draw(st.none() | st.integers(1, 4))
        after = st.just(value=False) if counts is None else st.booleans()
        ways = st.lists(st.builds(Way, st.integers(0, size - 1), few, few, after), max_size=3)
        rows.append(Row(tuple(draw(ways)), counts))
    return tuple(rows)


def declared(name: str, rows: tuple[Row, ...], first_state: int, first_timer: int) -> Sequence:
    def condition(way: Way, n: int) -> Expr:
        buttons = [*map(x, sorted(way.on)), *(~x(b) for b in sorted(way.off))]
        return all_of(*buttons, *[t(first_timer + n)] * way.after_dwell)

    steps = [
        step(
            str(n),
            *(To(str(way.to), when=condition(way, n)) for way in row.ways),
            dwell=None if row.counts is None else Dwell(Timer(first_timer + n), 10 * row.counts),
        )
        for n, row in enumerate(rows)
    ]
    return Sequence(name, first_state, steps, enable=x(GATE))


@THOROUGH
@given(plans(), plans(), st.lists(st.tuples(BUTTON_SETS, st.integers(1, 25)), min_size=1, max_size=20))
def test_any_two_sequences_follow_the_rules_of_the_step_ladder(
    one: tuple[Row, ...], two: tuple[Row, ...], scans: list[tuple[set[int], int]]
) -> None:
    sequences = [declared("one", one, 20, 200), declared("two", two, 40, 210)]
    rungs_before: list[Rung] = [ZoneReset(s(20), s(49), when=x(AWAY_BEFORE))]
    rungs_before += [Set(bit, when=x(START) | m(8002)) for bit in (s(20), s(40))]
    show = [out for sequence in sequences for out in seen(sequence)]
    rig = Rig(*rungs_before, *sequences, *show, ZoneReset(s(20), s(49), when=x(AWAY_AFTER)))
    oracles = {20: StepSet(one), 40: StepSet(two)}
    for n, (buttons, interval_ms) in enumerate(scans):
        before_ms = rig.now_ms
        rig.scan(*buttons, after_ms=interval_ms)
        pulses = base_pulses(before_ms, rig.now_ms, 10)
        for oracle in oracles.values():
            oracle.on -= oracle.on if AWAY_BEFORE in buttons else set()
            oracle.on |= {0} if START in buttons or n == 0 else set()
            oracle.turn(buttons, pulses)
        assert shown(rig) == {first + n for first, oracle in oracles.items() for n in oracle.on}
        for oracle in oracles.values():
            oracle.on -= oracle.on if AWAY_AFTER in buttons else set()
            oracle.end()
        assert rig.states() == {first + n for first, oracle in oracles.items() for n in oracle.on}


def test_a_press_is_consumed_by_the_first_transfer() -> None:
    """If all transitions are true and each transfer consumes the press, one press advances the sequence by one step."""
    armed = m(1)
    rows = [step("a", To("b", x(0))), step("b", To("c", x(0))), step("c", To("a", x(0)))]
    rig = Rig(STARTED, Sequence("stepped", FIRST, rows, enable=armed, consumes=armed))
    rig.scan(0)
    assert rig.states() == {FIRST}
    for expected in (FIRST + 1, FIRST + 2, FIRST):
        rig.plc.write(armed, 1)
        for _ in range(2):
            rig.scan(0)
        assert rig.states() == {expected}
        assert not rig.plc.read(armed)


def test_the_limit_of_a_blocked_step_stops_when_a_transition_is_true() -> None:
    """The time limit of a step that is not enabled raises its alarm only if none of its transitions is true."""
    armed, alarm = m(1), s(900)
    row = Step("a", hold=[m(0)], go=[To("b", when=x(0))], watch=Timeout(200, alarm, Timer(0)))
    sequence = Sequence("gated", FIRST, [row, step("b")], enable=armed)
    for reached in (True, False):
        rig = Rig(STARTED, sequence, *sequence.limits())
        for _ in range(40):
            rig.scan(*([0] if reached else []))
        assert (900 in rig.states()) is not reached
