"""Comparison of the symbolic scan with the real scan: all devices of arbitrary programs, after every scan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest
import z3
from hypothesis import given
from hypothesis import strategies as st

from controller.core.devices import (
    ANNUNCIATOR_ON,
    CLOCK_1_S,
    INITIAL_PULSE,
    LOWEST_ANNUNCIATOR,
    MS_1,
    MS_10,
    MS_100,
    RUN_MONITOR,
)
from controller.core.expr import FALSE, TRUE, Bit, Compare, Counter, Expr, Timer, Word, all_of, any_of
from controller.core.rungs import (
    Add,
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
    Scale,
    Set,
    Subtract,
    ZoneReset,
)
from controller.core.scan import Plc
from controller.core.sequence import Dwell, Sequence, Step, To
from controller.verify.cells import Cell, ModelError, SymbolicMemory, cell_of
from controller.verify.model import Model
from controller.verify.timing import LONG, ExactTimers, FreeTimers, Timing
from tests.controller.core.core_rig import d, m, s, t, x
from tests.controller.verify.verify_rig import specification_of
from tests.sampling import examples

COMMAND, SET_POINT = m(8), d(512)
SET_POINT_DEFAULT = 3
SCANS = examples(12, nightly=60)
"""Settings with fewer examples because a symbolic scan takes about a thousand times as long as a real one."""

DOWN = m(8200)
"""Bit that makes C200 count down."""

BITS = [
    *map(x, range(4)),
    *map(m, range(4)),
    m(500),
    COMMAND,
    DOWN,
    *map(s, range(20, 24)),
    s(900),
    s(901),
    Bit("Y", 0),
]
CONTACTS = [t(0), t(200), t(246), t(250), Bit("C", 0), Bit("C", 100), Bit("C", 200)]
SPECIAL = [m(n) for n in (RUN_MONITOR, INITIAL_PULSE, CLOCK_1_S, ANNUNCIATOR_ON)]
REGISTERS = [d(0), d(1), d(200)]
WORDS = [*REGISTERS, SET_POINT, d(LOWEST_ANNUNCIATOR), Word("T", 0), Word("T", 246), Word("C", 0), Word("C", 200)]
NARROW = [word for word in WORDS if word != Word("C", 200)]

RELATIONS = st.sampled_from(["==", "!=", "<", "<=", ">", ">="])
SMALL = st.integers(-3, 5)
NUMBERS = SMALL | st.sampled_from([32_767, -32_768, 70_000, -(2**31)])
COMPARISONS = st.builds(Compare, RELATIONS, st.sampled_from(WORDS), st.sampled_from(WORDS) | NUMBERS)
ATOMS = st.sampled_from([*BITS, *CONTACTS, *SPECIAL]) | COMPARISONS
CONDITIONS: st.SearchStrategy[Expr] = st.recursive(
    ATOMS | st.sampled_from([TRUE, FALSE]),
    lambda inner: (
        st.builds(lambda a: ~a, inner)
        | st.lists(inner, min_size=2, max_size=3).map(lambda parts: all_of(*parts))
        | st.lists(inner, min_size=2, max_size=3).map(lambda parts: any_of(*parts))
    ),
    max_leaves=4,
)
COILS = st.sampled_from([*(bit for bit in BITS if bit.kind != "X")])
PULSED = st.sampled_from([*map(m, range(4)), Bit("Y", 0)])
ZONES = st.sampled_from([ZoneReset(m(0), m(3)), ZoneReset(s(21), s(23)), ZoneReset(s(900), s(901))])
RESETTABLE = st.sampled_from(
    [*(bit for bit in BITS if bit.kind != "X"), *REGISTERS, Timer(0), Timer(246), Counter(0), Counter(200)]
)
MOVED = st.sampled_from(NARROW) | SMALL | st.sampled_from([32_767, -32_768])
DIVISORS = st.sampled_from(NARROW) | st.sampled_from([1, 2, 7, 32_767])
PRESETS = st.integers(1, 3) | st.sampled_from([d(0), SET_POINT])
COUNTED = st.sampled_from([Counter(0), Counter(100), Counter(200)])
FREELY_REPEATED: st.SearchStrategy[Rung] = st.one_of(
    st.builds(Set, COILS, CONDITIONS),
    st.builds(Rst, RESETTABLE, CONDITIONS),
    st.builds(lambda zone, when: ZoneReset(zone.first, zone.last, when), ZONES, CONDITIONS),
    st.builds(Pulse, PULSED, CONDITIONS),
    st.builds(PulseFalling, PULSED, CONDITIONS),
    st.builds(Count, COUNTED, PRESETS, CONDITIONS),
    st.builds(Mov, MOVED, st.sampled_from(REGISTERS), CONDITIONS),
    st.builds(Inc, st.sampled_from(REGISTERS), CONDITIONS),
    st.builds(Add, MOVED, MOVED, st.sampled_from(REGISTERS), CONDITIONS),
    st.builds(Subtract, MOVED, MOVED, st.sampled_from(REGISTERS), CONDITIONS),
    st.builds(Scale, MOVED, MOVED, DIVISORS, st.sampled_from(REGISTERS), CONDITIONS),
)


@st.composite
def sequences(draw: st.DrawFn) -> Sequence:
    """Draw a sequence of one to four steps with arbitrary transfers; one of the steps has a dwell."""
    size = draw(st.integers(1, 4))
    titles = [str(n) for n in range(size)]
    dwelling = draw(st.sampled_from(titles))
    counts = draw(st.integers(1, 3))
    preset = draw(st.just(10 * counts) | st.just(SET_POINT))
    dwell = Dwell(Timer(200), preset, draw(CONDITIONS))
    ways = st.lists(st.builds(To, st.sampled_from(titles), CONDITIONS), max_size=3)
    steps = [
        Step(title, go=draw(ways), dwell=dwell if title == dwelling else None, waits_for="anything") for title in titles
    ]
    enable, consumes = draw(st.none() | CONDITIONS), draw(st.none() | st.sampled_from([COMMAND, m(0)]))
    return Sequence("any", 20, steps, enable=enable, consumes=consumes)


@st.composite
def programs(draw: st.DrawFn) -> list[Rung | Sequence]:
    """Draw rungs of every kind around a sequence, in any order."""
    items: list[Rung | Sequence] = [*draw(st.lists(FREELY_REPEATED, max_size=5)), draw(sequences())]
    items += [Out(bit, draw(CONDITIONS)) for bit in draw(st.lists(COILS, max_size=2, unique=True))]
    items += [OnDelay(Timer(0), draw(st.sampled_from([100, 200]) | st.just(d(0))), draw(CONDITIONS))]
    items += [OnDelay(Timer(246), draw(st.sampled_from([1, 15]) | st.just(SET_POINT)), draw(CONDITIONS))]
    items += [OnDelay(Timer(250), draw(st.sampled_from([100, 300])), draw(CONDITIONS))]
    items += [Annunciate(Timer(1), 200, s(901), draw(CONDITIONS))]
    return draw(st.permutations(items))


@dataclass(frozen=True)
class Scanned:
    """External inputs of one scan."""

    pause_ms: int
    on: frozenset[int]
    command: bool
    set_point: int | None
    power_lost: bool


PAUSES_MS = st.integers(1, 25) | st.sampled_from([100, 150, 400])
STIMULI = st.lists(
    st.builds(
        Scanned,
        PAUSES_MS,
        st.frozensets(st.integers(0, 3)),
        st.booleans(),
        st.none() | st.integers(-1, 4),
        st.sampled_from([False] * 7 + [True]),
    ),
    min_size=1,
    max_size=6,
)


def model_of(items: list[Rung | Sequence]) -> Model:
    set_points = ((SET_POINT, SET_POINT_DEFAULT),)
    return Model(specification_of(*items, never=any_of(*BITS), system=(COMMAND,), set_points=set_points))


class Pair:
    """Soft PLC and the formulas of its program."""

    def __init__(self, items: list[Rung | Sequence], timing: Callable[[int], Timing]) -> None:
        self.model = model_of(items)
        self.plc = Plc(self.model.program, input_filter_ms=0)
        self.memory: SymbolicMemory = self.model.factory("none")
        self.now_ms = 0
        self._timing = timing

    def scan(self, inputs: Scanned) -> SymbolicMemory:
        """Execute the real and the symbolic scan, and return the symbolic memory, including the external inputs."""
        self.now_ms += inputs.pause_ms
        if inputs.power_lost:
            retained = self.plc.retained()
            self.plc = Plc(self.model.program, input_filter_ms=0)
            self.plc.restore_retained(retained)
            self.memory = self.model.powered_up(self.memory)
        self.plc.write(COMMAND, inputs.command)
        if inputs.set_point is not None:
            self.plc.write(SET_POINT, inputs.set_point)
        outside = {cell: int(cell.number in inputs.on) for cell in self.model.inputs if cell.kind == "X"}
        outside |= {cell_of(device): self.plc.read(device) for device in (COMMAND, SET_POINT)}
        first = self.plc.scans == 0
        frame = self.model.frame(self.memory, "now", first=first, timing=self._timing(self.now_ms))
        known = [(cell.variable("now"), cell.constant(value)) for cell, value in outside.items()]
        self.plc.scan(self.now_ms, [number in inputs.on for number in range(256)])
        return {cell: z3.simplify(z3.substitute(term, *known)) for cell, term in frame.after.items()}

    def real(self) -> dict[Cell, int]:
        """Return the memory of the soft PLC."""
        return {cell: cell.read(self.plc.memory) for cell in self.model.cells}


def exact(now_ms: int) -> ExactTimers:
    ticks = {base: z3.BitVecVal(now_ms // base, 32) for base in (MS_1, MS_10, MS_100)}
    return ExactTimers(ticks, z3.BoolVal(now_ms % 1000 < 500))


def number(term: z3.ExprRef) -> int:
    return int(z3.is_true(term)) if z3.is_bool(term) else int(term.as_signed_long())


@SCANS
@given(programs(), STIMULI)
def test_symbolic_scan_equals_the_real_scan(items: list[Rung | Sequence], scans: list[Scanned]) -> None:
    """The symbolic and the real scan of an arbitrary program give all devices the same values in every scan."""
    pair = Pair(items, exact)
    for given_now in scans:
        pair.memory = pair.scan(given_now)
        assert {cell: number(term) for cell, term in pair.memory.items()} == pair.real()


def chained(*ways: list[tuple[str, Expr]], consumes: Bit | None = None) -> Sequence:
    """Return a sequence of steps with these transfers; each step is named by its number."""
    steps = [Step(str(n), [To(*way) for way in row], waits_for="anything") for n, row in enumerate(ways)]
    return Sequence("chained", 20, steps, consumes=consumes)


STARTED = Set(s(20), when=m(8002))
WALK = [set(), {0}, {1}, {0, 1}, {2}, {0, 2}, {0, 1, 2}, set(), {3}, {0, 3}, {1, 3}]


def walked(on: set[int]) -> Scanned:
    """Return the inputs of a scan 100 ms after the previous one; the command has the level of the first terminal."""
    return Scanned(100, frozenset(on), command=0 in on, set_point=None, power_lost=False)


RULES: list[list[Rung | Sequence]] = [
    [STARTED, chained([("1", x(0))], [("0", x(1))])],
    [STARTED, chained([("0", x(0)), ("1", x(1))], [("0", x(2))])],
    [STARTED, chained([("1", x(0)), ("2", x(1))], [("0", x(2))], [("0", x(0))])],
    [STARTED, chained([("1", COMMAND)], [("2", COMMAND)], [("0", COMMAND)], consumes=COMMAND)],
    [Set(s(900), x(0)), Set(s(901), x(1)), Rst(s(900), x(2)), Rst(s(901), x(3))],
    [Out(DOWN, x(1)), Count(Counter(200), 2, x(0)), Rst(Counter(200), x(3))],
    [Out(DOWN, x(2)), Count(Counter(200), 1, x(0))],
    [Mov(5, d(LOWEST_ANNUNCIATOR), x(0)), Set(s(900), x(1)), Rst(s(900), x(2))],
    [Count(Counter(0), d(0), x(0)), Mov(2, d(0), x(1)), Rst(Counter(0), x(3))],
    [OnDelay(Timer(0), 200, x(0)), Rst(Timer(0), x(3))],
    [OnDelay(Timer(246), 150, x(0)), Rst(Timer(246), x(3))],
    [Annunciate(Timer(1), 200, s(901), x(0)), Rst(s(901), x(3))],
    [Pulse(m(0), x(0)), PulseFalling(m(1), x(0)), Inc(d(0), m(0))],
    [
        STARTED,
        Sequence("dwell", 20, [Step("only", [To("only", x(3))], dwell=Dwell(Timer(200), 150, when=x(0)))]),
    ],
]
"""Programs, each of which tests one rule of the symbolic scan."""


@pytest.mark.parametrize("items", RULES)
def test_symbolic_scan_of_each_rule(items: list[Rung | Sequence]) -> None:
    """The symbolic and the real scan of a program that tests one rule give all devices the same values."""
    pair = Pair(items, exact)
    for on in WALK * 2:
        pair.memory = pair.scan(walked(on))
        assert {cell: number(term) for cell, term in pair.memory.items()} == pair.real()


@SCANS
@given(programs(), STIMULI)
def test_free_timers_allow_all_behaviour_of_exact_timers(items: list[Rung | Sequence], scans: list[Scanned]) -> None:
    """After every scan of an arbitrary program, the formulas with free timers allow the real device values."""
    assert_free_timers_follow(Pair(items, lambda _: FreeTimers("now")), scans)


@pytest.mark.parametrize("items", RULES)
def test_free_timers_allow_the_behaviour_of_each_rule(items: list[Rung | Sequence]) -> None:
    """After every scan of a program that tests one rule, the formulas with free timers allow the real device values."""
    assert_free_timers_follow(Pair(items, lambda _: FreeTimers("now")), [walked(on) for on in WALK])


def assert_free_timers_follow(pair: Pair, scans: list[Scanned]) -> None:
    for given_now in scans:
        after = pair.scan(given_now)
        solver, real = z3.Solver(), pair.real()
        solver.add(*(term == cell.constant(real[cell]) for cell, term in after.items() if cell.kind != "TS"))
        assert solver.check() == z3.sat
        pair.memory = {cell: cell.constant(value) for cell, value in real.items()}


def test_only_a_driven_free_timer_may_have_elapsed() -> None:
    """A free timer may or may not have elapsed while its coil is on; while its coil is off, it has not elapsed."""
    model = Model(specification_of(OnDelay(Timer(0), 100, when=x(0))))
    before, _ = model.unknown("before")
    after = model.frame(before, "now", first=False, timing=FreeTimers("now")).after[Cell("T", 0)]
    driven = Cell("X", 0).variable("now")
    for on, done, answer in ((True, True, z3.sat), (True, False, z3.sat), (False, True, z3.unsat)):
        solver = z3.Solver()
        solver.add(driven == on, after == done)
        assert solver.check() == answer


@pytest.mark.parametrize(("timer", "base_ms"), [(246, MS_1), (200, MS_10)])
@pytest.mark.parametrize(("run_ms", "done"), [(290, False), (300, True)])
def test_aged_timer_has_run_since_its_start_tick(timer: int, base_ms: int, run_ms: int, done: bool) -> None:
    """An aged timer has elapsed if and only if it has run for its preset."""
    model = Model(specification_of(OnDelay(Timer(timer), 300, when=x(0))))
    before, facts = model.unknown("before")
    frame = model.frame(before, "now", first=False, timing=ExactTimers.aged("now"))
    contact, value, start = Cell("T", timer), Cell("TV", timer), Cell("TS", timer)
    solver = z3.Solver()
    solver.add(*facts, z3.Not(before[contact]), before[value] == 0, before[start] == LONG - run_ms // base_ms)
    solver.add(frame.start[Cell("X", 0)], frame.after[contact] != z3.BoolVal(val=done))
    assert solver.check() == z3.unsat


def test_move_of_32_bits_is_rejected() -> None:
    """A rung that moves a 32-bit counter into a register is rejected with an error that names the move."""
    with pytest.raises(ModelError, match="MOV C200 to D0: 32 bits"):
        Model(specification_of(Mov(Word("C", 200), d(0))))
