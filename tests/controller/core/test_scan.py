"""Scan: images, input filter, order of the rungs, special relays, first scan."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.core.clock import MonotonicClock
from controller.core.devices import Memory
from controller.core.expr import Bit, Expr, Timer, Word, all_of, any_of, evaluate
from controller.core.input_filter import InputFilter
from controller.core.program import Block, Program
from controller.core.rungs import Inc, Mov, OnDelay, Out, Pulse, Rst, Rung, Set
from controller.core.scan import Plc
from tests.controller.core.core_rig import THOROUGH, Rig, d, levels, m, program_of, s, x, y

RUN, FIRST_SCAN, CLOCK_1_S = m(8000), m(8002), m(8013)

# ---- images ---------------------------------------------------------------------------------------------------

BITS = st.one_of(st.builds(x, st.integers(0, 3)), st.builds(m, st.integers(0, 5)), st.builds(y, st.integers(0, 3)))
CONTACTS = BITS | BITS.map(lambda bit: ~bit)
CONDITIONS: st.SearchStrategy[Expr] = st.builds(
    lambda series, parallel: all_of(*series) | any_of(*parallel),
    st.lists(CONTACTS, min_size=1, max_size=3),
    st.lists(CONTACTS, max_size=2),
)
COILS = st.one_of(st.builds(m, st.integers(0, 5)), st.builds(y, st.integers(0, 3)))
RUNGS: st.SearchStrategy[Rung] = st.one_of(
    st.builds(Out, COILS, CONDITIONS), st.builds(Set, COILS, CONDITIONS), st.builds(Rst, COILS, CONDITIONS)
)


def without_double_coils(rungs: list[Rung]) -> list[Rung]:
    driven: set[object] = set()
    selected = []
    for rung in rungs:
        if not (isinstance(rung, Out) and rung.target in driven):
            selected.append(rung)
        if isinstance(rung, Out):
            driven.add(rung.target)
    return selected


def interpret(rungs: list[Rung], memory: Memory) -> None:
    """Execute the rungs in order; each rung reads the results of the previous ones."""
    for rung in rungs:
        assert isinstance(rung, Out | Set | Rst)
        assert isinstance(rung.target, Bit)
        on = evaluate(rung.when, memory)
        bits = memory.bits(rung.target.kind)
        bits[rung.target.number] = {
            Out: on,
            Set: bits[rung.target.number] or on,
            Rst: bits[rung.target.number] and not on,
        }[type(rung)]


@THOROUGH
@given(st.lists(RUNGS, min_size=1, max_size=12), st.lists(st.sets(st.integers(0, 3)), min_size=1, max_size=10))
def test_the_y_image_is_the_result_of_executing_the_rungs_in_order(rungs: list[Rung], inputs: list[set[int]]) -> None:
    rungs = without_double_coils(rungs)
    rig, memory = Rig(*rungs), Memory()
    for on in inputs:
        memory.X[:32] = levels(*on)
        interpret(rungs, memory)
        assert rig.scan(*on) == memory.Y
        assert rig.memory.M[:6] == memory.M[:6]


@THOROUGH
@given(st.lists(st.lists(st.booleans(), min_size=32, max_size=32), min_size=1, max_size=10))
def test_the_x_image_is_constant_during_a_scan(inputs: list[list[bool]]) -> None:
    """All rungs of a scan read the same raw levels, and later changes of the terminals do not affect the image."""
    early = [Out(m(n), when=x(n)) for n in range(32)]
    late = [Out(y(n), when=x(n)) for n in range(32)]
    rig = Rig(*early, Inc(d(0), when=RUN), *late)
    for terminals in inputs:
        given_levels = terminals.copy()
        image = rig.plc.scan(rig.now_ms, terminals)
        terminals[:] = [not level for level in terminals]
        assert rig.memory.M[:32] == image[:32] == rig.memory.X[:32] == given_levels
        rig.now_ms += 10


def test_a_coil_acts_on_later_rungs_in_the_same_scan_and_on_earlier_rungs_in_the_next_scan() -> None:
    rig = Rig(Out(y(0), when=m(0)), Out(m(0), when=x(0)), Out(y(1), when=m(0)))
    assert [rig.scan(*on)[:2] for on in ([0], [0], [], [])] == [
        [False, True],
        [True, True],
        [True, False],
        [False, False],
    ]


def test_blocks_run_in_order() -> None:
    blocks = tuple(Block(str(n), (Mov(n, d(0)), Mov(d(0), d(n)))) for n in (3, 1, 2))
    plc = Plc(Program("order", blocks, outputs="none"))
    plc.scan(0, levels())
    assert plc.memory.D[:4] == [2, 1, 2, 3]


def test_the_returned_image_is_a_copy() -> None:
    rig = Rig(Set(y(3), when=x(0)))
    image = rig.scan(0)
    image[:] = [not level for level in image]
    assert rig.memory.Y[3]
    assert rig.scan() == [number == 3 for number in range(256)]


def test_two_plcs_with_the_same_program_share_no_state() -> None:
    program = program_of(Set(y(0), when=x(0)), Pulse(m(0), when=x(0)), OnDelay(Timer(200), 10, when=x(0)))
    one, other = Plc(program, input_filter_ms=0), Plc(program, input_filter_ms=0)
    one.scan(0, levels(0))
    one.scan(10, levels(0))
    other.scan(10, levels())
    assert (one.memory.Y[0], one.memory.T[200], one.memory.E) == (True, True, [True])
    assert (other.memory.Y[0], other.memory.T[200], other.memory.E) == (False, False, [False])


# ---- special relays and external writes -----------------------------------------------------------------------


@pytest.mark.parametrize(("relay", "scans"), [(FIRST_SCAN, "1..."), (RUN, "1111")])
def test_m8002_is_on_in_the_first_scan_only_and_m8000_always(relay: Bit, scans: str) -> None:
    rig = Rig(Out(m(0), when=relay), start_ms=5_000)
    assert rig.track(m(0), [[]] * 4) == scans
    assert rig.plc.scans == 4


def test_m8013_is_on_in_the_first_half_of_every_second() -> None:
    rig = Rig(Out(m(0), when=CLOCK_1_S), start_ms=0, scan_ms=250)
    assert rig.track(m(0), [[]] * 9) == "11..11..1"
    late = Rig(Out(m(0), when=CLOCK_1_S), start_ms=499, scan_ms=1)
    assert late.track(m(0), [[]] * 2) == "1."


def test_a_pressed_bit_is_on_in_the_next_scan() -> None:
    rig = Rig(Out(m(1), when=m(0)), Rst(m(0)))
    rig.plc.press(m(0))
    assert rig.track(m(1), [[], []]) == "1."


def test_any_device_can_be_written_before_and_read_after_a_scan() -> None:
    rig = Rig()
    for device, value in ((m(7), 1), (s(7), 1), (d(7), -7), (Word("C", 7), 7), (Word("T", 7), 70)):
        rig.plc.write(device, value)
        assert rig.plc.read(device) == value
    rig.plc.write(m(7), 0)
    assert rig.plc.read(m(7)) == 0


def test_set_points_have_their_default_value_before_the_first_scan() -> None:
    plc = Plc(program_of(Mov(d(512), d(0)), set_points=((d(512), 30), (d(513), -1))))
    assert (plc.read(d(512)), plc.read(d(513))) == (30, -1)
    plc.write(d(512), 31)
    plc.scan(0, levels())
    assert (plc.read(d(0)), plc.read(d(512))) == (31, 31)


def test_the_system_clock_starts_at_zero_and_never_goes_back() -> None:
    clock = MonotonicClock()
    instants = [clock.now_ms() for _ in range(1000)]
    assert instants == sorted(instants)
    assert 0 <= instants[0] < 60_000


# ---- input filter ---------------------------------------------------------------------------------------------


def filtered(filter_ms: int, number: int, scan_ms: int, text: str) -> str:
    """Return the levels of a terminal in the X image, one per scan, for these raw levels."""
    plc = Plc(program_of(), input_filter_ms=filter_ms)
    shown = ""
    for n, level in enumerate(text):
        plc.scan(n * scan_ms, levels(*[number] * (level == "1")))
        shown += ".1"[plc.memory.X[number]]
    return shown


@pytest.mark.parametrize(
    ("filter_ms", "number", "terminal", "image"),
    [
        # one scan is 5 ms
        (10, 0, ".1111....", "...1111.."),
        (10, 0o17, ".11.11.111..", ".........111"),
        (20, 0, ".1111111", ".....111"),
        (20, 0o17, ".1111111", ".....111"),
        (60, 7, ".11111111111111", ".............11"),
        (1, 7, ".1111", "..111"),
        (60, 0o20, ".1111", "...11"),
        (1, 0o20, ".1111", "...11"),
        (20, 0o37, ".1111", "...11"),
        (0, 0, ".1.11", ".1.11"),
        (0, 0o20, ".1.11", ".1.11"),
        (60, 0, "1.1.1.1", "1111111"),
    ],
)
def test_a_level_must_be_stable_for_the_filter_time(filter_ms: int, number: int, terminal: str, image: str) -> None:
    assert filtered(filter_ms, number, 5, terminal) == image


@THOROUGH
@given(
    st.integers(1, 60),
    st.lists(st.tuples(st.integers(1, 40), st.booleans(), st.booleans()), min_size=1, max_size=40),
)
def test_a_pulse_shorter_than_the_filter_time_is_suppressed(
    filter_ms: int, scans: list[tuple[int, bool, bool]]
) -> None:
    image = [False] * 32
    input_filter = InputFilter(image, filter_ms)
    times_ms = {3: filter_ms, 0o23: 10}
    stable: dict[int, tuple[bool, int]] = {}  # terminal: its level and the time of its first sample, ms
    expected: dict[int, bool] = {}
    now_ms = 0
    for interval_ms, *terminals in scans:
        now_ms += interval_ms
        on = [number for number, level in zip(times_ms, terminals, strict=True) if level]
        input_filter.latch(now_ms, levels(*on))
        for number, level in zip(times_ms, terminals, strict=True):
            if number not in stable or stable[number][0] != level:
                stable[number] = (level, now_ms)
            if number not in expected or now_ms - stable[number][1] >= times_ms[number]:
                expected[number] = level
        assert image == levels(*(number for number in expected if expected[number]))


@pytest.mark.parametrize("filter_ms", [-1, 61, 1000])
def test_a_filter_time_out_of_range_is_rejected(filter_ms: int) -> None:
    with pytest.raises(ValueError, match=f"input filter {filter_ms} ms: must be 0 to 60 ms, the range of an FX2N"):
        Plc(program_of(), input_filter_ms=filter_ms)


def test_the_default_filter_is_10_ms_and_the_first_scan_is_unfiltered() -> None:
    plc = Plc(program_of())
    shown = []
    for now_ms, on in ((0, [5]), (3, []), (12, []), (13, []), (20, [5])):
        plc.scan(now_ms, levels(*on))
        shown.append(plc.memory.X[5])
    assert shown == [True, True, True, False, False]
