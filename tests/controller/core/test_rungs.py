"""Rungs in the scan: coils, edges, timers, counters, annunciators and words, compared with the FX semantics."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from controller.core.devices import ANNUNCIATOR_ON, LOWEST_ANNUNCIATOR
from controller.core.expr import Bit, Counter, Timer, Word
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
    RungError,
    Scale,
    Set,
    Subtract,
    ZoneReset,
)
from tests.controller.core.core_rig import THOROUGH, Rig, base_pulses, d, m, s, t, x, y

DRIVE, RESET = 0, 1
SCANS = st.lists(st.tuples(st.integers(1, 250), st.booleans()), min_size=1, max_size=60)
"""Scans, each as (time since the previous scan in ms, True if the timer is driven)."""


# ---- on-delay timers ------------------------------------------------------------------------------------------


@THOROUGH
@given(SCANS, st.sampled_from([(0, 100), (191, 100), (200, 10), (245, 10)]), st.integers(1, 8), st.integers(0, 1099))
@example([(1, True)] * 5, (200, 10), 1, 0)
def test_an_on_delay_counts_its_base_from_scan_to_scan(
    scans: list[tuple[int, bool]], timer: tuple[int, int], counts: int, start_ms: int
) -> None:
    number, base_ms = timer
    rig = Rig(OnDelay(Timer(number), counts * base_ms, when=x(DRIVE)), start_ms=start_ms)
    counted: int | None = None
    before_ms = start_ms
    for interval_ms, driven in scans:
        rig.scan(*[DRIVE] * driven, after_ms=interval_ms)
        if not driven:
            counted = None
        elif counted is None:
            counted = 0
        else:
            counted += base_pulses(before_ms, rig.now_ms, base_ms)
        before_ms = rig.now_ms
        assert rig.memory.T[number] is (counted is not None and counted >= counts)
        assert rig.memory.TV[number] == min(counted or 0, counts)


@THOROUGH
@given(st.integers(0, 999), st.integers(1, 250), st.sampled_from([(7, 100, 300), (210, 10, 300), (210, 10, 10)]))
def test_an_on_delay_is_at_most_one_base_early_and_one_scan_late(
    start_ms: int, scan_ms: int, timer: tuple[int, int, int]
) -> None:
    number, base_ms, delay_ms = timer
    rig = Rig(OnDelay(Timer(number), delay_ms, when=x(DRIVE)), start_ms=start_ms, scan_ms=scan_ms)
    rig.scan(DRIVE)
    while not rig.memory.T[number]:
        rig.scan(DRIVE)
        assert rig.now_ms <= start_ms + delay_ms + scan_ms
    assert delay_ms - base_ms < rig.now_ms - start_ms < delay_ms + scan_ms


def test_a_timer_can_start_at_time_zero() -> None:
    rig = Rig(OnDelay(Timer(200), 30, when=x(DRIVE)), start_ms=0)
    assert rig.track(t(200), [[DRIVE]] * 5) == "...11"


def test_an_on_delay_is_reset_in_the_first_scan_in_which_it_is_not_driven() -> None:
    rig = Rig(OnDelay(Timer(200), 20, when=x(DRIVE)))
    assert rig.track(t(200), [[DRIVE]] * 4 + [[]] + [[DRIVE]] * 3) == "..11...1"
    rig.scan()
    assert (rig.memory.TV[200], rig.memory.TS[200]) == (0, -1)


@pytest.mark.parametrize(("preset", "contact"), [(0, "11111"), (-1, "11111"), (1, ".1111"), (3, "...11"), (9, ".....")])
def test_a_preset_from_a_register_is_in_counts_of_the_base(preset: int, contact: str) -> None:
    rig = Rig(OnDelay(Timer(200), d(512), when=x(DRIVE)))
    rig.plc.write(d(512), preset)
    assert rig.track(t(200), [[DRIVE]] * 5) == contact


def test_the_preset_register_is_read_in_every_scan() -> None:
    rig = Rig(OnDelay(Timer(200), d(512), when=x(DRIVE)))
    rig.plc.write(d(512), 100)
    assert rig.track(t(200), [[DRIVE]] * 4) == "...."
    rig.plc.write(d(512), 4)
    assert rig.track(t(200), [[DRIVE]]) == "1"


@pytest.mark.parametrize("delay_ms", [0, -100, 150, 100 * 32768])
def test_a_delay_must_be_a_multiple_of_the_base_within_the_word_range(delay_ms: int) -> None:
    with pytest.raises(RungError, match=f"OUT T0: {delay_ms} ms is out of range or not a multiple of 100 ms"):
        OnDelay(Timer(0), delay_ms)
    assert OnDelay(Timer(0), 100 * 32767).counts == 32767


# ---- retentive timers -----------------------------------------------------------------------------------------


@THOROUGH
@given(
    st.lists(st.tuples(st.integers(1, 250), st.booleans(), st.integers(0, 9)), min_size=1, max_size=60),
    st.sampled_from([(246, 1, 400), (250, 100, 400), (255, 100, 100)]),
)
def test_a_retentive_timer_accumulates_until_it_is_reset(
    scans: list[tuple[int, bool, int]], timer: tuple[int, int, int]
) -> None:
    number, base_ms, delay_ms = timer
    rig = Rig(OnDelay(Timer(number), delay_ms, when=x(DRIVE)), Rst(Timer(number), when=x(RESET)))
    counted, contact, was_driven, before_ms = 0, False, False, 0
    for interval_ms, driven, dice in scans:
        reset = dice == 0
        rig.scan(*[DRIVE] * driven, *[RESET] * reset, after_ms=interval_ms)
        if driven and was_driven:
            counted += base_pulses(before_ms, rig.now_ms, base_ms)
        contact = contact or (driven and counted * base_ms >= delay_ms)
        was_driven, before_ms = driven, rig.now_ms
        if reset:
            counted, contact, was_driven = 0, False, False
        assert rig.memory.T[number] is contact
        assert rig.memory.TV[number] == counted


def test_a_retentive_timer_stops_at_the_largest_word() -> None:
    rig = Rig(OnDelay(Timer(246), d(512), when=x(DRIVE)), scan_ms=20_000)
    rig.plc.write(d(512), 32_767)
    assert rig.track(t(246), [[DRIVE]] * 4) == "..11"
    assert rig.memory.TV[246] == 32_767


def test_a_reset_also_stops_a_non_retentive_timer() -> None:
    rig = Rig(OnDelay(Timer(200), 20, when=x(DRIVE)), Rst(Timer(200), when=x(RESET)))
    assert rig.track(t(200), [[DRIVE]] * 3 + [[DRIVE, RESET]] + [[DRIVE]] * 3) == "..1...1"


# ---- counters -------------------------------------------------------------------------------------------------

COUNT_INPUTS = st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(0, 19)), min_size=1, max_size=80)


@THOROUGH
@given(COUNT_INPUTS, st.integers(1, 5), st.sampled_from([0, 99, 100, 199]))
def test_a_16_bit_counter_counts_edges_and_stops_at_its_preset(
    inputs: list[tuple[bool, bool, int]], preset: int, number: int
) -> None:
    rig = Rig(Count(Counter(number), preset, when=x(DRIVE)), Rst(Counter(number), when=x(RESET)))
    counted, before = 0, False
    for on, _, dice in inputs:
        reset = dice == 0
        rig.scan(*[DRIVE] * on, *[RESET] * reset)
        counted = 0 if reset else counted + (on and not before)
        before = on
        assert rig.memory.CV[number] == min(counted, preset)
        assert rig.memory.C[number] is (counted >= preset)


@THOROUGH
@given(COUNT_INPUTS, st.integers(1, 3), st.sampled_from([200, 219, 220, 234]))
def test_a_32_bit_counter_counts_up_and_down_and_its_contact_follows_the_crossing(
    inputs: list[tuple[bool, bool, int]], preset: int, number: int
) -> None:
    rig = Rig(Count(Counter(number), preset, when=x(DRIVE)), Rst(Counter(number), when=x(RESET)))
    direction = m(8000 + number)
    value, before = 0, False
    for on, down, dice in inputs:
        reset = dice == 0
        rig.plc.write(direction, down)
        rig.scan(*[DRIVE] * on, *[RESET] * reset)
        if on and not before:
            value += -1 if down else 1
        value, before = 0 if reset else value, on
        assert rig.memory.CV[number] == value
        # The value starts below the preset and changes by one, so the contact is on if and only if value >= preset.
        assert rig.memory.C[number] is (value >= preset)


def test_a_32_bit_counter_changes_its_contact_only_at_the_crossing() -> None:
    rig = Rig(Count(Counter(200), 3, when=x(DRIVE)))
    rig.plc.write(Counter(200).value, 10)
    rig.plc.write(m(8200), 1)
    assert rig.track(Bit("C", 200), [[DRIVE], []] * 2) == "...."
    rig.plc.write(Counter(200).value, 32_767)
    rig.plc.write(m(8200), 0)
    rig.scan(DRIVE)
    assert (rig.memory.CV[200], rig.memory.C[200]) == (32_768, False)


@pytest.mark.parametrize("number", [5, 205])
def test_an_input_that_is_on_in_the_first_scan_counts_once(number: int) -> None:
    rig = Rig(Count(Counter(number), 9, when=x(DRIVE)))
    for _ in range(3):
        rig.scan(DRIVE)
    assert rig.memory.CV[number] == 1


def test_a_counter_reads_its_preset_from_a_register() -> None:
    rig = Rig(Count(Counter(0), d(512), when=x(DRIVE)))
    rig.plc.write(d(512), 2)
    assert rig.track(Bit("C", 0), [[DRIVE], []] * 3) == "..1111"


def test_an_undriven_reset_does_not_change_the_counter() -> None:
    rig = Rig(Count(Counter(0), 2, when=x(DRIVE)), Rst(Counter(0), when=x(RESET)))
    assert rig.track(Bit("C", 0), [[DRIVE], [], [DRIVE], [], [RESET], []]) == "..11.."


@pytest.mark.parametrize(("number", "preset"), [(0, 0), (0, -1), (0, 32_768), (200, 0), (200, 2**31)])
def test_a_counter_preset_out_of_range_is_rejected(number: int, preset: int) -> None:
    with pytest.raises(RungError, match=f"OUT C{number}: preset {preset} is out of range"):
        Count(Counter(number), preset, when=x(DRIVE))


# ---- edges ----------------------------------------------------------------------------------------------------


@THOROUGH
@given(st.lists(st.booleans(), min_size=1, max_size=40))
def test_pulses_last_one_scan_and_are_independent(inputs: list[bool]) -> None:
    rig = Rig(
        Pulse(m(0), when=x(DRIVE)),
        PulseFalling(m(1), when=x(DRIVE)),
        Pulse(m(2), when=x(DRIVE)),
        PulseFalling(m(3), when=~x(DRIVE)),
    )
    before = False
    not_before = False  # the stored input of an edge that was never executed is off
    for now in inputs:
        rig.scan(*[DRIVE] * now)
        rising, falling = now and not before, before and not now
        assert rig.memory.M[:4] == [rising, falling, rising, not_before and now]
        before, not_before = now, not now


@pytest.mark.parametrize(
    ("edge", "inputs", "output"),
    [
        (Pulse, "1110011", "1....1."),
        (Pulse, "0011001", "..1...1"),
        (PulseFalling, "1110011", "...1..."),
        (PulseFalling, "0011001", "....1.."),
        (Pulse, "101010", "1.1.1."),
        (PulseFalling, "101010", ".1.1.1"),
    ],
)
def test_edges_of_inputs_that_start_high_or_low(
    edge: Callable[[Bit, Bit], Pulse | PulseFalling], inputs: str, output: str
) -> None:
    rig = Rig(edge(m(0), x(DRIVE)))
    assert rig.track(m(0), [[DRIVE] if on == "1" else [] for on in inputs]) == output


# ---- coils and words ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bit", [m(3), s(3), y(3)])
def test_a_set_bit_stays_until_reset_and_the_last_rung_wins(bit: Bit) -> None:
    rig = Rig(Set(bit, when=x(0)), Rst(bit, when=x(1)))
    assert rig.track(bit, [[], [0], [], [], [1], [], [0, 1], []]) == ".111...."


def test_an_out_follows_its_condition_and_is_always_on_without_one() -> None:
    rig = Rig(Out(y(3), when=x(0)), Out(y(4)))
    assert rig.track(y(3), [[], [0], []]) == ".1."
    assert rig.scan() == [number == 4 for number in range(256)]


@pytest.mark.parametrize("kind", "MSY")
def test_a_zone_reset_clears_exactly_its_zone(kind: str) -> None:
    rig = Rig(ZoneReset(Bit(kind, 3), Bit(kind, 5), when=x(0)), ZoneReset(Bit(kind, 8), Bit(kind, 8), when=x(0)))
    bits = rig.memory.bits(kind)
    bits[:10] = [True] * 10
    size = len(bits)
    rig.scan()
    assert bits[:10] == [True] * 10
    rig.scan(0)
    assert [number for number in range(10) if bits[number]] == [0, 1, 2, 6, 7, 9]
    assert len(bits) == size


def test_moves_copy_while_driven() -> None:
    rig = Rig(Mov(-7, d(0), when=x(0)), Mov(d(0), d(1), when=x(1)), Mov(Counter(3).value, d(2)), Mov(9, d(3)))
    rig.plc.write(Counter(3).value, 4)
    rig.scan()
    assert rig.memory.D[:4] == [0, 0, 4, 9]
    rig.scan(0, 1)
    rig.plc.write(d(0), 5)
    rig.scan()
    assert rig.memory.D[:4] == [5, -7, 4, 9]


@pytest.mark.parametrize(("before", "after"), [(0, 1), (-1, 0), (32_766, 32_767), (32_767, -32_768)])
def test_an_increment_wraps_as_a_16_bit_word(before: int, after: int) -> None:
    rig = Rig(Inc(d(0), when=x(0)))
    rig.plc.write(d(0), before)
    rig.scan()
    assert rig.memory.D[0] == before
    rig.scan(0)
    assert rig.memory.D[0] == after


@pytest.mark.parametrize(
    ("one", "two", "total", "difference"),
    [
        (7, 3, 10, 4),
        (-7, 3, -4, -10),
        (32_767, 1, -32_768, 32_766),
        (-32_768, 1, -32_767, 32_767),
        (0, -32_768, -32_768, -32_768),
        (-32_768, -32_768, 0, 0),
    ],
)
def test_sums_and_differences_wrap_as_16_bit_words(one: int, two: int, total: int, difference: int) -> None:
    rig = Rig(
        Add(d(0), d(1), d(2), when=x(0)),
        Subtract(d(0), d(1), d(3), when=x(0)),
        Add(d(0), two, d(4)),
        Subtract(one, d(1), d(5)),
    )
    for number, value in enumerate((one, two, 99, 99)):
        rig.plc.write(d(number), value)
    rig.scan()
    assert rig.memory.D[2:6] == [99, 99, total, difference]
    rig.scan(0)
    assert rig.memory.D[2:6] == [total, difference, total, difference]


@pytest.mark.parametrize(
    ("source", "factor", "divisor", "scaled"),
    [
        (7, 3, 2, 10),
        (5, 200, 1_000, 1),
        (32_767, 32_767, 32_767, 32_767),
        (32_767, 2, 1, 32_767),
        (-7, 3, 2, 0),
        (-7, -3, 2, 10),
        (7, 3, 0, 99),
        (7, 3, -2, 99),
    ],
)
def test_a_word_is_scaled_with_a_product_of_32_bits(source: int, factor: int, divisor: int, scaled: int) -> None:
    """The fraction is omitted, the result is limited to 0..32767, and a divisor of 0 or less changes nothing."""
    rig = Rig(Scale(d(0), d(1), d(2), d(3), when=x(0)), Scale(d(0), factor, d(2), d(4)))
    for number, value in enumerate((source, factor, divisor, 99, 99)):
        rig.plc.write(d(number), value)
    rig.scan()
    assert rig.memory.D[3:5] == [99, scaled]
    rig.scan(0)
    assert rig.memory.D[3:5] == [scaled, scaled]


def test_a_word_is_reset_to_zero() -> None:
    rig = Rig(Rst(d(0), when=x(0)))
    rig.plc.write(d(0), 5)
    rig.scan()
    assert rig.memory.D[0] == 5
    rig.scan(0)
    assert rig.memory.D[0] == 0


# ---- annunciators ---------------------------------------------------------------------------------------------


def test_an_annunciator_is_set_after_its_time_and_stays_set_when_its_timer_is_reset() -> None:
    rig = Rig(Annunciate(Timer(0), 300, s(900), when=x(0)), Rst(s(900), when=x(1)), scan_ms=100)
    assert rig.track(s(900), [[0], [0], [0], [], [0], [0], [0]]) == "......."  # interrupted: the time restarts
    assert rig.track(s(900), [[0], [], [], [1], []]) == "111.."
    assert (rig.memory.T[0], rig.memory.TV[0]) == (False, 0)
    assert rig.track(t(0), [[0]] * 4 + [[]]) == "...1."
    assert rig.states() == {900}


def test_m8048_and_d8049_show_the_lowest_annunciator_after_the_scan() -> None:
    rig = Rig(
        *(Set(s(n), when=x(n - 900)) for n in (900, 905, 907)),
        ZoneReset(s(900), s(905), when=x(10)),
        Rst(s(907), when=x(11)),
        Set(s(899)),
        Out(m(0), when=m(ANNUNCIATOR_ON)),
    )

    def seen() -> tuple[bool, int, list[int], bool]:
        memory = rig.memory
        return memory.M[ANNUNCIATOR_ON], memory.D[LOWEST_ANNUNCIATOR], rig.plc.annunciators(), memory.M[0]

    rig.scan()
    assert seen() == (False, 0, [], False)
    rig.scan(7)
    assert seen() == (True, 907, [907], False)
    rig.scan(5)
    assert seen() == (True, 905, [905, 907], True)
    rig.scan(10)
    assert seen() == (True, 907, [907], True)
    rig.scan(11)
    assert seen() == (False, 0, [], True)
    rig.scan()
    assert seen() == (False, 0, [], False)


# ---- rungs that an FX2N cannot execute ------------------------------------------------------------------------


@pytest.mark.parametrize(
    "declare",
    [
        lambda: Out(x(0)),
        lambda: Out(t(0)),
        lambda: Set(x(0)),
        lambda: Set(Bit("C", 0)),
        lambda: Rst(x(0)),
        lambda: Rst(t(0)),
        lambda: Pulse(s(0), when=x(0)),
        lambda: PulseFalling(s(0), when=x(0)),
        lambda: ZoneReset(m(5), m(4)),
        lambda: ZoneReset(m(5), s(6)),
        lambda: ZoneReset(x(0), x(1)),
        lambda: Mov(1, Word("T", 0)),
        lambda: Mov(32_768, d(0)),
        lambda: Mov(-32_769, d(0)),
        lambda: Inc(Word("C", 0), when=x(0)),
        lambda: Add(1, 1, Word("C", 0)),
        lambda: Add(32_768, 1, d(0)),
        lambda: Subtract(1, Word("C", 200), d(0)),
        lambda: Scale(1, 1, 1, Word("C", 0)),
        lambda: Scale(1, 1, 0, d(0)),
        lambda: Scale(1, 1, -1, d(0)),
        lambda: Scale(32_768, 1, 1, d(0)),
        lambda: Scale(1, -32_769, 1, d(0)),
        lambda: Scale(1, Word("C", 200), 1, d(0)),
        lambda: Annunciate(Timer(0), 100, s(899), when=x(0)),
        lambda: Annunciate(Timer(0), 100, m(900), when=x(0)),
        lambda: Annunciate(Timer(200), 100, s(900), when=x(0)),
        lambda: Annunciate(Timer(250), 100, s(900), when=x(0)),
        lambda: Annunciate(Timer(0), 150, s(900), when=x(0)),
        lambda: Annunciate(Timer(0), 0, s(900), when=x(0)),
        lambda: Annunciate(Timer(0), 100 * 32_768, s(900), when=x(0)),
    ],
)
def test_a_rung_that_an_fx2n_cannot_execute_is_rejected(declare: Callable[[], object]) -> None:
    with pytest.raises(RungError):
        declare()


def test_rungs_with_a_common_first_contact_are_blocked_once_one_of_them_resets_it() -> None:
    """If consecutive rungs begin with the same contact, a rung that resets this contact blocks the rungs after it."""
    common = m(0)
    rig = Rig(
        Set(common, when=m(8002)),
        Set(m(1), when=common & x(0)),
        Set(m(2), when=common & x(1)),
        Rst(common, when=common & x(2)),
        Set(m(3), when=common & x(0)),
        Mov(7, d(0), when=common),
        Set(m(4), when=~common & x(0)),
    )
    rig.scan(0, 2)
    assert [rig.plc.read(m(number)) for number in range(5)] == [0, 1, 0, 0, 1]
    assert rig.plc.read(d(0)) == 0
