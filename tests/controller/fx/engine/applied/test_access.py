"""Operands of applied instructions: devices read and written, and rejected operands."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.fx.engine.access import bit_reader, bit_writer, reader, signed, words, writer
from controller.fx.engine.applied.table import ACTIONS, LEVELS
from controller.fx.engine.cpu import OperationError
from controller.fx.language.instruction import DeviceOperand, WordBit
from controller.fx.language.instruction_set import FORMS
from tests.controller.core.core_rig import copied
from tests.controller.fx.engine.applied.fx_applied_rig import Rig, State, assert_same, bits, operand

FLOW = {"CJ", "CALL", "SRET", "IRET", "FEND", "WDT", "FOR", "NEXT"}
INT_16 = st.integers(-(2**15), 2**15 - 1)
INT_32 = st.integers(-(2**31), 2**31 - 1)


def test_table_contains_exactly_the_supported_applied_instructions() -> None:
    kinds = {form.kind for form in FORMS.values()}
    applied = {kind.name for kind in kinds if kind.fnc is not None and kind.fnc < 224 and kind.supported}
    assert set(ACTIONS) | set(LEVELS) == applied - FLOW
    assert not set(ACTIONS) & set(LEVELS)


def test_instructions_executed_in_every_scan() -> None:
    assert set(LEVELS) == {
        *("ANS", "PLSY", "PWM", "PLSR", "IST", "ABSD", "INCD", "TTMR", "STMR", "RAMP", "HSCS", "HSCR", "HSZ", "SPD"),
        *("MTR", "PID", "RS", "DRVI", "DRVA"),
    }


@pytest.mark.parametrize(
    ("text", "before", "wide", "value"),
    [
        ("K-5", {}, False, -5),
        ("HFFFF", {}, False, -1),
        ("HFFFF", {}, True, 65535),
        ("HFFFFFFFF", {}, True, -1),
        ("D3", {"D3": -7}, False, -7),
        ("D3", {"D3": 1, "D4": 2}, True, 0x2_0001),
        ("D3", {"D3": -1, "D4": 0}, True, 65535),
        ("D3", {"D3": 0, "D4": -32768}, True, -(2**31)),
        ("D8000", {"D8000": 200}, True, 200),
        ("K1M8000", bits("M8000", "1010"), False, 5),
        ("T5", {"T5": 12, "T6": 1}, False, 12),
        ("T5", {"T5": 12, "T6": 1}, True, 65548),
        ("C5", {"C5": 3}, False, 3),
        ("C5", {"C5": 3, "C6": 1}, True, 65539),
        ("C200", {"C200": -70_000, "C201": 9}, True, -70_000),
        ("Z0", {"Z0": 4, "V0": 9}, False, 4),
        ("V3", {"V3": 8, "Z3": 2}, False, 8),
        ("Z3", {"Z3": 1, "V3": 2}, True, 0x2_0001),
        ("V3", {"Z3": 1, "V3": 2}, True, 0x2_0001),
        ("K1X0", bits("X0", "0101"), False, 0b1010),
        ("K3M0", bits("M0", "1" * 12), False, 4095),
        ("K4M5", bits("M5", "1" * 16), False, -1),
        ("K4M5", bits("M5", "0" * 15 + "1"), False, -32768),
        ("K4M5", bits("M5", "1" * 16), True, 65535),
        ("K7Y0", bits("Y0", "1" * 28), True, 2**28 - 1),
        ("K8S0", bits("S0", "1" * 32), True, -1),
        ("K2X6", bits("X6", "10000001"), False, 0x81),
    ],
)
def test_reading(text: str, before: State, wide: bool, value: int) -> None:
    assert reader(Rig(before).cpu, operand(text), wide)() == value


@pytest.mark.parametrize(
    ("text", "wide", "value", "after"),
    [
        ("D3", False, 32768, {"D3": -32768}),
        ("D3", False, -32769, {"D3": 32767}),
        ("D3", True, 0x1_0002, {"D3": 2, "D4": 1}),
        ("D3", True, 2**31, {"D3": 0, "D4": -32768}),
        ("D3", True, -2, {"D3": -2, "D4": -1}),
        ("T5", False, 12, {"T5": 12}),
        ("T5", True, 0x1_0002, {"T5": 2, "T6": 1}),
        ("C99", False, 12, {"C99": 12}),
        ("C200", True, 2**31 + 5, {"C200": -(2**31) + 5}),
        ("Z7", False, 12, {"Z7": 12}),
        ("V7", False, 12, {"V7": 12}),
        ("Z1", True, 0x3_0004, {"Z1": 4, "V1": 3}),
        ("K1Y6", False, 0x1F, bits("Y6", "1111")),
        ("K2M9", False, 0xA5, bits("M9", "10100101")),
        ("K8M0", True, -2, bits("M0", "0" + "1" * 31)),
        ("K4S1", False, -32767, bits("S1", "1" + "0" * 14 + "1")),
    ],
)
def test_writing_changes_only_the_operand(text: str, wide: bool, value: int, after: State) -> None:
    before = bits("Y0", "1" * 6) | {"D5": 77, "T7": 5}
    rig, expected = Rig(before), Rig({**before, **after}).memory
    writer(rig.cpu, operand(text), wide)(value)
    assert_same(rig.memory, expected)


@given(INT_32)
def test_pair_is_written_low_word_first(value: int) -> None:
    rig = Rig()
    writer(rig.cpu, operand("D10"), True)(value)
    low, high = rig.memory.D[10:12]
    assert low & 0xFFFF == value & 0xFFFF
    assert high == value >> 16
    assert reader(rig.cpu, operand("D10"), True)() == value


@given(INT_16, st.sampled_from(["K4M3", "D0", "T3", "C3", "V2"]))
def test_write_read_round_trip(value: int, place: str) -> None:
    rig = Rig()
    writer(rig.cpu, operand(place), False)(value)
    assert reader(rig.cpu, operand(place), False)() == value


@given(st.integers(-(10**12), 10**12), st.sampled_from([4, 8, 16, 32]))
def test_signed_preserves_the_low_bits(value: int, width: int) -> None:
    result = signed(value, width)
    assert (result - value) % 2**width == 0
    assert -(2 ** (width - 1)) <= result < 2 ** (width - 1)


@pytest.mark.parametrize(
    ("text", "index", "value", "wide"),
    [
        ("D10V0", {"V0": 5, "D15": 42}, 42, False),
        ("D10Z7", {"Z7": -10, "D0": 42}, 42, False),
        ("D10Z1", {"Z1": 2, "D12": 1, "D13": 1}, 65537, True),
        ("K10V0", {"V0": -3}, 7, False),
        ("K32767Z0", {"Z0": 1}, -32768, False),
        ("HFZ0", {"Z0": 1}, 16, False),
        ("K1X0Z0", {"Z0": 8, "X10": 1}, 1, False),
        ("K1M10Z2", {"Z2": 1, "M12": 1}, 2, False),
        ("T0Z0", {"Z0": 255, "T255": 3}, 3, False),
        ("C200Z0", {"Z0": 1, "C201": 70_000}, 70_000, True),
    ],
)
def test_index_is_added_at_run_time(text: str, index: State, value: int, wide: bool) -> None:
    rig = Rig()
    read = reader(rig.cpu, operand(text), wide)
    rig.set(index)
    assert read() == value


OUTSIDE = [
    ("D0Z0", -1, False),
    ("D7999Z0", 0, True),
    ("D7998Z0", 1, True),
    ("D0Z0", 8256, False),
    ("D8255Z0", 1, False),
    ("T0Z0", -1, False),
    ("T255Z0", 0, True),
    ("C199Z0", 1, False),
    ("C199Z0", 0, True),
    ("C200Z0", 0, False),
    ("C200Z0", -1, True),
    ("C255Z0", 1, True),
    ("K4M3060Z0", 0, False),
    ("K1M3071Z0", 0, False),
    ("K1M0Z0", -1, False),
    ("K1M8252Z0", 1, False),
    ("K1Y374Z0", 1, False),
    ("K4S985Z0", 0, False),
]


@pytest.mark.parametrize(("text", "index", "wide"), OUTSIDE)
def test_out_of_range_operand_is_neither_read_nor_written(text: str, index: int, wide: bool) -> None:
    rig = Rig({"Z0": index})
    before = copied(rig.memory)
    for use in (reader(rig.cpu, operand(text), wide), lambda: writer(rig.cpu, operand(text), wide)(-1)):
        with pytest.raises(OperationError) as error:
            use()
        assert error.value.code == 6706
    assert_same(rig.memory, before)


@pytest.mark.parametrize(("text", "index"), [("M0Z0", -1), ("M3071Z0", 1), ("X0Z0", 256), ("S999Z0", 1), ("Y0Z0", -8)])
def test_out_of_range_bit_is_rejected(text: str, index: int) -> None:
    rig = Rig({"Z0": index})
    before = copied(rig.memory)
    with pytest.raises(OperationError):
        bit_reader(rig.cpu, operand(text))()
    with pytest.raises(OperationError):
        bit_writer(rig.cpu, operand(text))(True)
    assert_same(rig.memory, before)


def test_bits_by_index_and_their_neighbours() -> None:
    rig = Rig({"Z0": 8, "Y10": 1})
    assert bit_reader(rig.cpu, operand("Y0Z0"))()
    bit_writer(rig.cpu, operand("M0Z0"))(True)
    assert [n for n, on in enumerate(rig.memory.M) if on] == [8]


@pytest.mark.parametrize("text", ["M3071", "M8255", "S999", "Y377"])
def test_last_bit_of_a_range_is_valid(text: str) -> None:
    rig = Rig()
    bit_writer(rig.cpu, operand(text))(True)
    assert bit_reader(rig.cpu, operand(text))()


def test_contacts_of_timers_and_counters_are_bits() -> None:
    rig = Rig({"T3 contact": 1, "C4": 9})
    assert bit_reader(rig.cpu, DeviceOperand("T", 3))()
    assert not bit_reader(rig.cpu, DeviceOperand("C", 4))()


def test_bits_of_a_register() -> None:
    rig = Rig({"D5": 1})
    bit_writer(rig.cpu, WordBit(5, 15))(True)
    assert rig.memory.D[5] == -32767
    assert bit_reader(rig.cpu, WordBit(5, 15))()
    bit_writer(rig.cpu, WordBit(5, 0))(False)
    assert rig.memory.D[5] == -32768
    assert not bit_reader(rig.cpu, WordBit(5, 0))()


def test_consecutive_words_by_operand_size() -> None:
    rig = Rig()
    assert list(words(rig.cpu, operand("D4"), False).places(3)) == [4, 5, 6]
    assert list(words(rig.cpu, operand("D4"), True).places(3)) == [4, 6, 8]
    assert list(words(rig.cpu, operand("K2M1"), False).places(3)) == [1, 9, 17]
    assert list(words(rig.cpu, operand("C210"), True).places(3)) == [210, 211, 212]
    assert list(words(rig.cpu, operand("Z1"), False).places(2)) == [8182, 8183]
    with pytest.raises(OperationError):
        words(rig.cpu, operand("V1"), False).places(2)
    for count in (0, -1):
        with pytest.raises(OperationError):
            words(rig.cpu, operand("D4"), False).places(count)


def test_running_timer_continues_from_the_written_value() -> None:
    rig = Rig({"T0": 5, "T0 start": 0})
    rig.cpu.now_ms = 500
    rig.run("MOV K20 T0")
    assert (rig.memory.TV[0], rig.memory.TS[0]) == (20, -15)
