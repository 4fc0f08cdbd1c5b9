"""FX2N devices: ranges, names and retention."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest

from controller.core.clock import SimulatedClock
from controller.core.devices import (
    DeviceError,
    Memory,
    check_device,
    device_name,
    is_32_bit_counter,
    is_retentive,
    timer_base_ms,
)
from controller.core.expr import Bit, Counter, Timer, Word
from controller.core.rungs import OnDelay

RANGES = [
    # kind, first, last number that exists (docs/sources/fx2n.md 1.5; X377 and Y377 are 255)
    ("X", 0, 0o377),
    ("Y", 0, 0o377),
    ("M", 0, 3071),
    ("M", 8000, 8255),
    ("S", 0, 999),
    ("T", 0, 255),
    ("C", 0, 255),
    ("D", 0, 7999),
    ("D", 8000, 8255),
]
MISSING = [
    ("X", -1),
    ("X", 0o400),
    ("Y", 0o400),
    ("M", -1),
    ("M", 3072),
    ("M", 7999),
    ("M", 8256),
    ("S", 1000),
    ("T", 256),
    ("C", 256),
    ("D", -1),
    ("D", 8256),
]
RETENTION = [
    # kind, first, last, retentive? (docs/sources/fx2n.md 1.5, transcribed manually)
    ("X", 0, 0o377, False),
    ("Y", 0, 0o377, False),
    ("M", 0, 499, False),
    ("M", 500, 3071, True),
    ("M", 8000, 8255, False),
    ("S", 0, 9, False),
    ("S", 10, 19, False),
    ("S", 20, 499, False),
    ("S", 500, 899, True),
    ("T", 0, 199, False),
    ("T", 200, 245, False),
    ("T", 246, 249, True),
    ("T", 250, 255, True),
    ("C", 0, 99, False),
    ("C", 100, 199, True),
    ("C", 200, 219, False),
    ("C", 220, 234, True),
    ("C", 235, 255, True),
    ("D", 0, 199, False),
    ("D", 200, 511, True),
    ("D", 512, 7999, True),
    ("D", 8000, 8255, False),
]


@pytest.mark.parametrize(("kind", "first", "last"), RANGES)
def test_a_range_exists_from_its_first_to_its_last_device(kind: str, first: int, last: int) -> None:
    for number in (first, first + 1, last - 1, last):
        check_device(kind, number)


@pytest.mark.parametrize(("kind", "number"), MISSING)
def test_a_device_out_of_range_is_rejected_with_its_name(kind: str, number: int) -> None:
    with pytest.raises(DeviceError, match=rf"^{device_name(kind, number)}: outside the range of an FX2N$"):
        check_device(kind, number)


@pytest.mark.parametrize("kind", ["Q", "x", "V", ""])
def test_an_unknown_kind_is_rejected_with_the_list_of_known_kinds(kind: str) -> None:
    with pytest.raises(DeviceError, match="use one of X, Y, M, S, T, C, D"):
        check_device(kind, 0)


@pytest.mark.parametrize(
    ("kind", "number", "name"),
    [("X", 7, "X7"), ("X", 8, "X10"), ("Y", 0o25, "Y25"), ("X", 255, "X377"), ("M", 8, "M8"), ("S", 900, "S900")],
)
def test_terminals_have_octal_names_and_other_devices_decimal_names(kind: str, number: int, name: str) -> None:
    assert device_name(kind, number) == name
    assert str(Bit(kind, number)) == name


@pytest.mark.parametrize(("kind", "first", "last", "retentive"), RETENTION)
def test_retention_follows_the_table_of_ranges(kind: str, first: int, last: int, retentive: bool) -> None:
    assert {is_retentive(kind, number) for number in range(first, last + 1)} == {retentive}


@pytest.mark.parametrize(("first", "last", "base_ms"), [(0, 199, 100), (200, 245, 10), (246, 249, 1), (250, 255, 100)])
def test_timers_count_the_base_of_their_range(first: int, last: int, base_ms: int) -> None:
    assert {timer_base_ms(number) for number in range(first, last + 1)} == {base_ms}
    assert Timer(last).base_ms == base_ms


def test_counters_are_32_bit_from_c200() -> None:
    assert [is_32_bit_counter(number) for number in (0, 199, 200, 255)] == [False, False, True, True]


def test_a_data_register_is_not_a_contact_and_a_relay_is_not_a_word() -> None:
    with pytest.raises(TypeError, match="D7: a data register is a word; use a comparison"):
        Bit("D", 7)
    with pytest.raises(TypeError, match="M7: only D, T and C are words"):
        Word("M", 7)


@pytest.mark.parametrize(
    "declare",
    [
        partial(Bit, "X", 0o400),
        partial(Bit, "M", 3072),
        partial(Word, "D", 8256),
        partial(getattr, Timer(256), "done"),
        partial(getattr, Timer(256), "base_ms"),
        partial(getattr, Counter(256), "done"),
        partial(getattr, Counter(256), "value"),
        partial(OnDelay, Timer(256), 100),
    ],
)
def test_a_device_that_does_not_exist_cannot_be_declared(declare: Callable[[], object]) -> None:
    with pytest.raises(DeviceError, match="outside the range"):
        declare()


def test_memory_starts_cleared_with_every_timer_stopped() -> None:
    memory = Memory()
    assert not any(any(memory.bits(kind)) for kind in "XYMSTC")
    assert {*memory.D, *memory.TV, *memory.CV} == {0}
    assert set(memory.TS) == {-1}
    for kind, _, last in RANGES:
        if kind in "TCD":
            memory.set_word(kind, last, -5)
            assert memory.word(kind, last) == -5
        if kind != "D":
            memory.bits(kind)[last] = True


def test_the_words_of_a_timer_and_a_counter_are_their_current_values() -> None:
    memory = Memory()
    memory.set_word("T", 7, 11)
    memory.set_word("C", 7, 12)
    memory.set_word("D", 7, 13)
    assert (memory.TV[7], memory.CV[7], memory.D[7]) == (11, 12, 13)
    assert (memory.word("T", 7), memory.word("C", 7), memory.word("D", 7)) == (11, 12, 13)


def test_a_simulated_clock_changes_only_when_advanced_and_never_goes_back() -> None:
    clock = SimulatedClock()
    assert [clock.now_ms(), clock.now_ms()] == [0, 0]
    clock.advance(7)
    clock.advance(0)
    assert clock.now_ms() == 7
    with pytest.raises(ValueError, match="-1 ms"):
        clock.advance(-1)
    assert clock.now_ms() == 7
