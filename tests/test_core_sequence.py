"""Sequences in the scan: the step ladder's semantics, by example and against a set of steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product

import pytest
from core_rig import THOROUGH, Bench, base_pulses, m, s, t, x
from hypothesis import given
from hypothesis import strategies as st

from controller.core.devices import Memory
from controller.core.expr import TRUE, Expr, Timer, all_of, evaluate
from controller.core.program import requests
from controller.core.rungs import Out, Rung, Set, ZoneReset
from controller.core.scan import StepMachine
from controller.core.sequence import Dwell, Sequence, Step, Timeout, To

FIRST = 20
STARTED = Set(s(FIRST), when=m(8002))


def step(title: str, *go: To, dwell: Dwell | None = None) -> Step:
    return Step(title, go=go, dwell=dwell, waits_for="a button")


def chain(*titles: str, last_to: str | None = None) -> Sequence:
    """Steps in a row; the n-th is left by button X<n>, the last one to `last_to`."""
    following = [*titles[1:], last_to]
    rows = [step(a, *([To(b, when=x(n))] if b else [])) for n, (a, b) in enumerate(zip(titles, following, strict=True))]
    return Sequence("chain", FIRST, rows)


def seen(sequence: Sequence) -> list[Out]:
    """Rungs after a sequence that show its steps in the middle of the scan, the first in M20."""
    return [Out(m(bit.number), when=bit) for bit, _ in sequence]


def shown(bench: Bench) -> set[int]:
    return {number for number in range(FIRST, 100) if bench.memory.M[number]}


# ---- transfers ------------------------------------------------------------------------------------------------


def test_source_and_destination_are_both_on_in_the_transfer_scan_only() -> None:
    sequence = chain("a", "b", "c")
    bench = Bench(STARTED, sequence, *seen(sequence))
    bench.scan()
    assert (shown(bench), bench.states()) == ({20}, {20})
    bench.scan(0)
    assert (shown(bench), bench.states()) == ({20, 21}, {21})
    bench.scan(0)
    assert (shown(bench), bench.states()) == ({21}, {21})


def test_a_destination_declared_later_acts_at_once_and_may_cascade() -> None:
    sequence = chain("a", "b", "c", "d")
    bench = Bench(STARTED, sequence, *seen(sequence))
    bench.scan(0, 1)
    assert (shown(bench), bench.states()) == ({20, 21, 22}, {22})
    bench.scan(2)
    assert (shown(bench), bench.states()) == ({22, 23}, {23})


def test_a_destination_declared_earlier_acts_in_the_next_scan() -> None:
    sequence = chain("a", "b", "c", last_to="a")
    bench = Bench(Set(s(22), when=m(8002)), sequence, *seen(sequence))
    bench.scan(0, 2)
    assert (shown(bench), bench.states()) == ({20, 22}, {20})
    bench.scan(0, 2)
    assert (shown(bench), bench.states()) == ({20, 21}, {21})


def test_a_step_left_and_entered_again_in_one_scan_stays_on() -> None:
    sequence = chain("a", "b", last_to="a")
    bench = Bench(STARTED, sequence, *seen(sequence))
    bench.scan(0, 1)
    assert (shown(bench), bench.states()) == ({20, 21}, {20})


def test_a_transfer_to_itself_keeps_the_step_on() -> None:
    bench = Bench(STARTED, Sequence("loop", FIRST, [step("a", To("a", when=x(0)), To("b", when=x(1))), step("b")]))
    bench.scan(0)
    assert bench.states() == {20}
    bench.scan(0, 1)
    assert bench.states() == {20}
    bench.scan(1)
    assert bench.states() == {21}


@pytest.mark.parametrize(
    ("buttons", "taken"), [((0, 1), 21), ((0,), 21), ((1,), 22), ((1, 2), 22), ((2,), 23), ((), 20)]
)
def test_the_first_true_transition_wins(buttons: tuple[int, ...], taken: int) -> None:
    go = [To(title, when=x(n)) for n, title in enumerate("bcd")]
    bench = Bench(STARTED, Sequence("choice", FIRST, [step("a", *go), step("b"), step("c"), step("d")]))
    bench.scan(*buttons)
    assert bench.states() == {taken}


def test_an_unconditional_transition_hides_those_below_it() -> None:
    go = [To("b", when=TRUE), To("c", when=x(0))]
    bench = Bench(STARTED, Sequence("choice", FIRST, [step("a", *go), step("b"), step("c")]))
    bench.scan(0)
    assert bench.states() == {21}


def test_the_first_true_transition_is_taken_even_if_it_makes_a_later_one_true() -> None:
    go = [To("b", when=~s(21)), To("c", when=s(21))]
    bench = Bench(STARTED, Sequence("choice", FIRST, [step("a", *go), step("b"), step("c")]))
    bench.scan()
    assert bench.states() == {21}


def test_conditions_of_transfers_exclude_each_other_by_themselves() -> None:
    """For every reader of the declaration that has no "else": an export, a proof, a drawing."""
    go = [To(title, when=x(n)) for n, title in enumerate("bcd")]
    sequence = Sequence("choice", FIRST, [step("a", *go), step("b"), step("c"), step("d")], enable=x(3))
    for buttons in product([False, True], repeat=4):
        memory = Memory()
        memory.X[:4] = buttons
        true = [transfer.target for transfer in sequence.transfers["a"] if evaluate(transfer.when, memory)]
        assert true == [s(21 + n) for n in range(3) if buttons[n] and buttons[3]][:1]


def test_without_enable_steps_go_on_driving_but_no_transfer_fires() -> None:
    request, enabled = m(0), m(1)
    row = Step("a", hold=[request], dwell=Dwell(Timer(200), 20), go=[To("b", when=t(200))])
    sequence = Sequence("gated", FIRST, [row, step("b")], enable=enabled)
    bench = Bench(STARTED, sequence, Out(request, when=s(20)), Out(m(2), when=t(200)))
    assert bench.track(s(21), [[]] * 5) == "....."
    assert bench.memory.M[:3] == [True, False, True]
    bench.plc.write(enabled, 1)
    assert bench.track(s(21), [[]]) == "1"
    assert bench.states() == {21}


def test_steps_are_found_by_title_and_in_order() -> None:
    sequence = chain("a", "b", "c")
    assert (sequence["b"], sequence.first, sequence.last) == (s(21), s(20), s(22))
    assert [(bit, row.title) for bit, row in sequence] == [(s(20), "a"), (s(21), "b"), (s(22), "c")]


# ---- dwell ----------------------------------------------------------------------------------------------------


def dwelling() -> list[Rung | Sequence]:
    """A step of 30 ms that goes back when it is over or on X0, between two that wait for X1."""
    rows = [
        step("before", To("dwell", when=x(1))),
        step("dwell", To("after", when=x(0) | t(200)), dwell=Dwell(Timer(200), 30)),
        step("after", To("dwell", when=x(1))),
    ]
    return [STARTED, Sequence("dwell", FIRST, rows)]


def test_a_dwell_takes_its_time_and_then_falls_back() -> None:
    bench = Bench(*dwelling())
    assert bench.track(s(22), [[1], [], [], []]) == "...1"  # entered at 0 ms, over at 30 ms
    assert bench.memory.T[200]
    bench.scan()
    assert (bench.memory.T[200], bench.memory.TV[200], bench.memory.TS[200]) == (False, 0, -1)


@pytest.mark.parametrize("way_out", [[0], []])
def test_a_dwell_does_not_carry_over_to_the_next_entry(way_out: list[int]) -> None:
    bench = Bench(*dwelling())
    bench.track(s(22), [[1], [], []])
    assert bench.track(s(22), [way_out, [], []]) == "111"
    assert bench.track(s(21), [[1], [], [], [], []]) == "1111."  # entered backwards: runs from the next scan


def test_a_dwell_never_seen_off_goes_on_as_the_fx_does_with_adjacent_steps() -> None:
    """Left and, through the steps around it, entered again before its next turn: its coil has not dropped."""
    rows = [
        step("ask", To("dwell", when=TRUE)),
        step("dwell", To("back", when=x(0) | t(200)), dwell=Dwell(Timer(200), 30)),
        step("back", To("ask", when=TRUE)),
    ]
    bench = Bench(STARTED, Sequence("adjacent", FIRST, rows))
    bench.track(s(21), [[], []])
    bench.scan(0)
    assert bench.states() == {20}
    assert bench.track(t(200), [[]]) == "1"


# ---- S bits are the truth -------------------------------------------------------------------------------------


@pytest.fixture
def fired(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Every call of a `transitions` machine: the step it was called for and the step it holds afterwards."""
    calls: list[tuple[str, str]] = []
    fire = StepMachine._fire

    def counted(machine: StepMachine, source: str, trigger: Callable[[], None]) -> None:
        fire(machine, source, trigger)
        calls.append((source, machine.state))

    monkeypatch.setattr(StepMachine, "_fire", counted)
    return calls


def test_the_state_machine_is_called_for_transfers_only(fired: list[tuple[str, str]]) -> None:
    bench = Bench(STARTED, chain("a", "b", "c", last_to="a"))
    for buttons in ([], [1], [2], [1, 2], []):
        bench.scan(*buttons)
    assert fired == []
    bench.scan(0, 1)
    assert fired == [("a", "b"), ("b", "c")]
    bench.scan()
    bench.scan(2)
    assert fired[2:] == [("c", "a")]


def test_a_step_set_by_a_rung_starts_and_the_state_machine_follows(fired: list[tuple[str, str]]) -> None:
    sequence = chain("a", "b", "c", "d")
    bench = Bench(STARTED, ZoneReset(s(20), s(23), when=x(8)), Set(s(22), when=x(9)), sequence)
    bench.scan()
    bench.scan(8, 9)
    assert bench.states() == {22}
    bench.scan(0, 1)
    assert (bench.states(), fired) == ({22}, [])
    bench.scan(2)
    assert (bench.states(), fired) == ({23}, [("c", "d")])


def test_every_step_that_is_on_acts_whoever_set_it(fired: list[tuple[str, str]]) -> None:
    bench = Bench(STARTED, Set(s(22), when=m(8002)), chain("a", "b", "c", "d"))
    bench.scan(0, 2)
    assert bench.states() == {21, 23}
    assert fired == [("a", "b"), ("c", "d")]


def test_without_any_step_on_nothing_happens(fired: list[tuple[str, str]]) -> None:
    bench = Bench(chain("a", "b", last_to="a"))
    for _ in range(3):
        bench.scan(0, 1)
    assert (bench.states(), fired) == (set(), [])


def test_steps_taken_away_while_a_transfer_is_under_way_stay_away() -> None:
    bench = Bench(STARTED, chain("a", "b", "c"), ZoneReset(s(20), s(22), when=x(8)))
    bench.scan(0, 8)
    assert bench.states() == set()
    bench.scan(0, 1)
    assert bench.states() == set()


def test_a_source_set_again_after_its_transfer_goes_off_at_end_all_the_same() -> None:
    bench = Bench(STARTED, chain("a", "b"), Set(s(20), when=x(8)))
    bench.scan(0, 8)
    assert bench.states() == {21}
    bench.scan(8)
    assert bench.states() == {20, 21}


def test_two_sequences_go_their_own_ways() -> None:
    other = Sequence("other", 40, [step("a", To("b", when=x(5))), step("b", To("a", when=x(6)))])
    bench = Bench(STARTED, Set(s(40), when=m(8002)), chain("a", "b", last_to="a"), other)
    expected = {(0,): {21, 40}, (5,): {21, 41}, (1, 6): {20, 40}, (0, 5): {21, 41}, (1,): {20, 41}}
    for buttons, states in expected.items():
        bench.scan(*buttons)
        assert bench.states() == states


# ---- requests and limits --------------------------------------------------------------------------------------


def test_a_request_names_every_step_that_holds_it_and_a_limit_its_own_step() -> None:
    up, down = m(0), m(1)
    limit = Timeout(300, s(900), Timer(0))
    one = Sequence("one", 20, [Step("a", [To("b", when=x(0))], hold=[up], watch=limit),
                               Step("b", [], hold=[up, down], dwell=Dwell(Timer(200), 10))])  # fmt: skip
    two = Sequence("two", 40, [Step("a", [], hold=[down], dwell=Dwell(Timer(201), 10))])
    assert requests([one, two]) == {up: [s(20), s(21)], down: [s(21), s(40)]}
    assert (one.holding(up), one.holding(down), two.holding(up)) == ([s(20), s(21)], [s(21)], [])
    assert two.limits() == []
    bench = Bench(STARTED, one, two, *one.limits(), scan_ms=100)
    assert bench.track(s(900), [[], [], [], []]) == "...1"


# ---- against a set of steps -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Way:
    """A transition: taken with all of these buttons on and none of those, and the dwell over if it asks for it."""

    to: int
    on: frozenset[int]
    off: frozenset[int]
    after_dwell: bool

    def open(self, buttons: set[int], dwell_over: bool) -> bool:
        return self.on <= buttons and not self.off & buttons and (dwell_over or not self.after_dwell)


@dataclass(frozen=True)
class Row:
    """A step: its ways out and how many 10 ms counts it dwells, if at all."""

    ways: tuple[Way, ...]
    counts: int | None


@dataclass
class StepSet:
    """The rules of controller.core.sequence, as a set of the steps that are on."""

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
    lambda some: st.sampled_from([{GATE}, {GATE}, {GATE}, {GATE, START}, {START}, set(), {AWAY_BEFORE, GATE},
                                  {AWAY_AFTER, GATE}]).map(lambda more: some | more))  # fmt: skip


@st.composite
def plans(draw: st.DrawFn) -> tuple[Row, ...]:
    """One to four steps with any ways between them."""
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
    bench = Bench(*rungs_before, *sequences, *show, ZoneReset(s(20), s(49), when=x(AWAY_AFTER)))
    oracles = {20: StepSet(one), 40: StepSet(two)}
    for n, (buttons, interval_ms) in enumerate(scans):
        before_ms = bench.now_ms
        bench.scan(*buttons, after_ms=interval_ms)
        pulses = base_pulses(before_ms, bench.now_ms, 10)
        for oracle in oracles.values():
            oracle.on -= oracle.on if AWAY_BEFORE in buttons else set()
            oracle.on |= {0} if START in buttons or n == 0 else set()
            oracle.turn(buttons, pulses)
        assert shown(bench) == {first + n for first, oracle in oracles.items() for n in oracle.on}
        for oracle in oracles.values():
            oracle.on -= oracle.on if AWAY_AFTER in buttons else set()
            oracle.end()
        assert bench.states() == {first + n for first, oracle in oracles.items() for n in oracle.on}


def test_a_press_is_spent_by_the_first_transfer() -> None:
    """Given steps whose exits are all true, when transfers are spent, a press moves the sequence on by one step."""
    armed = m(1)
    rows = [step("a", To("b", x(0))), step("b", To("c", x(0))), step("c", To("a", x(0)))]
    bench = Bench(STARTED, Sequence("stepped", FIRST, rows, enable=armed, spends=armed))
    bench.scan(0)
    assert bench.states() == {FIRST}
    for expected in (FIRST + 1, FIRST + 2, FIRST):
        bench.plc.write(armed, 1)
        bench.scan(0)
        bench.scan(0)
        assert bench.states() == {expected}
        assert not bench.plc.read(armed)


def test_a_limit_runs_only_while_a_gated_step_has_not_reached_its_end() -> None:
    """Given a step that has reached its end and is withheld, it is not late; one that is on its way is."""
    armed, alarm = m(1), s(900)
    row = Step("a", hold=[m(0)], go=[To("b", when=x(0))], watch=Timeout(200, alarm, Timer(0)))
    sequence = Sequence("gated", FIRST, [row, step("b")], enable=armed)
    for reached in (True, False):
        bench = Bench(STARTED, sequence, *sequence.limits())
        for _ in range(40):
            bench.scan(*([0] if reached else []))
        assert (900 in bench.states()) is not reached
