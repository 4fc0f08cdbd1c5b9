"""ADD SUB MUL DIV INC DEC NEG WAND WOR WXOR SUM MEAN SQR: results, flags, wrap-around, errors."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.fx.engine.cpu import OperationError
from tests.controller.core.core_rig import copied
from tests.controller.fx.engine.applied.fx_applied_rig import Rig, State, assert_same, bits

FLAGS = bits("M8020", "111")
CLEAR = bits("M8020", "000")
INT_16 = st.integers(-(2**15), 2**15 - 1)
INT_32 = st.integers(-(2**31), 2**31 - 1)


@pytest.mark.parametrize(
    ("text", "before", "after"),
    [
        ("ADD D0 K3 D1", {"D0": 4} | FLAGS, {"D1": 7} | CLEAR),
        ("ADD D0 K-4 D1", {"D0": 4, "D1": 9}, {"D1": 0, "M8020": 1}),
        ("ADD D0 K1 D0", {"D0": 32767}, {"D0": -32768, "M8022": 1}),
        ("ADD D0 K-1 D0", {"D0": -32768}, {"D0": 32767, "M8021": 1}),
        ("ADD D0 D0 D1", {"D0": -32768, "D1": 5}, {"D1": 0, "M8020": 1, "M8021": 1}),
        ("DADD D0 K1 D2", {"D0": -1, "D1": 0}, {"D2": 0, "D3": 1}),
        ("DADD D0 K1 D2", {"D0": -1, "D1": 32767}, {"D2": 0, "D3": -32768, "M8022": 1}),
        ("SUB K3 D0 D1", {"D0": 4} | FLAGS, {"D1": -1} | CLEAR),
        ("SUB D0 K4 D1", {"D0": 4, "D1": 9}, {"D1": 0, "M8020": 1}),
        ("SUB D0 K1 D0", {"D0": -32768}, {"D0": 32767, "M8021": 1}),
        ("SUB D0 K-1 D0", {"D0": 32767}, {"D0": -32768, "M8022": 1}),
        ("DSUB D0 K1 D2", {"D0": 0, "D1": -32768}, {"D2": -1, "D3": 32767, "M8021": 1}),
        ("MUL D0 D1 D2", {"D0": 1000, "D1": 1000} | FLAGS, {"D2": 16960, "D3": 15}),
        ("MUL D0 K-1 D2", {"D0": 5}, {"D2": -5, "D3": -1}),
        ("MUL D0 D0 D2", {"D0": -32768}, {"D2": 0, "D3": 16384}),
        ("MUL D0 K3 K2M0", {"D0": 87}, bits("M0", "10100000")),
        ("MUL D0 D0 K8M0", {"D0": 256}, bits("M0", "0" * 16 + "1" + "0" * 15)),
        ("MUL K2 K3 Z1", {}, {"Z1": 6, "V1": 0}),
        ("DMUL D0 D2 D4", {"D1": 1, "D3": 1}, {"D4": 0, "D5": 0, "D6": 1, "D7": 0}),
        ("DMUL K-1 K1 D4", {}, {"D4": -1, "D5": -1, "D6": -1, "D7": -1}),
        ("DIV D0 K4 D1", {"D0": 7} | FLAGS, {"D1": 1, "D2": 3}),
        ("DIV D0 K2 D1", {"D0": -7}, {"D1": -3, "D2": -1}),
        ("DIV D0 K-2 D1", {"D0": 7}, {"D1": -3, "D2": 1}),
        ("DIV D0 K-2 D1", {"D0": -7}, {"D1": 3, "D2": -1}),
        ("DIV D0 K2 K1M0", {"D0": 7, "M4": 1}, bits("M0", "11001")),
        ("DDIV D0 K3 D2", {"D0": 1, "D1": 1}, {"D2": 21845, "D3": 0, "D4": 2, "D5": 0}),
        ("INC D0", {"D0": 32767} | FLAGS, {"D0": -32768}),
        ("INC K1M0", bits("M0", "11110"), bits("M0", "00000")),
        ("DINC D0", {"D0": -1, "D1": 0}, {"D0": 0, "D1": 1}),
        ("DEC D0", {"D0": -32768} | FLAGS, {"D0": 32767}),
        ("DDEC D0", {"D0": 0, "D1": 1}, {"D0": -1, "D1": 0}),
        ("DDEC C200", {"C200": -(2**31)}, {"C200": 2**31 - 1}),
        ("INC Z3", {"Z3": 4}, {"Z3": 5}),
        ("NEG D0", {"D0": 5}, {"D0": -5}),
        ("NEG D0", {"D0": -32768}, {}),
        ("DNEG D0", {"D0": 1}, {"D0": -1, "D1": -1}),
        ("WAND D0 H0FF0 D1", {"D0": 0x1234}, {"D1": 0x0230}),
        ("WOR D0 H00FF D1", {"D0": 0x1200}, {"D1": 0x12FF}),
        ("WXOR D0 HFFFF D1", {"D0": 0x00FF}, {"D1": -256}),
        ("DWAND D0 HFFFF0000 D2", {"D0": 5, "D1": 6}, {"D2": 0, "D3": 6}),
        ("DWOR D0 H10000 D2", {"D0": 5, "D1": 6}, {"D2": 5, "D3": 7}),
        ("DWXOR D0 D0 D2", {"D0": 5, "D1": 6, "D2": 1, "D3": 1}, {"D2": 0, "D3": 0}),
        ("SUM D0 D1", {"D0": 0b1011, "M8020": 1}, {"D1": 3, "M8020": 0}),
        ("SUM D0 D1", {"D0": -1}, {"D1": 16}),
        ("SUM D0 D1", {"D1": 7}, {"D1": 0, "M8020": 1}),
        ("DSUM D0 D2", {"D0": -1, "D1": -1, "D3": 9}, {"D2": 32, "D3": 0}),
        ("MEAN D0 D9 K3", {"D0": 1, "D1": 2, "D2": 5}, {"D9": 2}),
        ("MEAN D0 D9 K2", {"D0": -1, "D1": -2}, {"D9": -1}),
        ("MEAN D0 D9 K2", {"D0": 32767, "D1": 32767}, {"D9": 32767}),
        ("DMEAN D0 D9 K2", {"D1": 1, "D3": 3}, {"D9": 0, "D10": 2}),
        ("MEAN K1M0 D9 K2", bits("M0", "11110001"), {"D9": 11}),
        ("SQR K100 D0", {"M8021": 1}, {"D0": 10, "M8021": 0}),
        ("SQR K110 D0", {}, {"D0": 10, "M8021": 1}),
        ("SQR K0 D0", {"D0": 5}, {"D0": 0, "M8020": 1}),
        ("DSQR K2147395600 D0", {}, {"D0": 46340 - 65536, "D1": 0}),
    ],
)
def test_result(text: str, before: State, after: State) -> None:
    Rig(before).changes_only(text, after)


@pytest.mark.parametrize(
    ("text", "before"),
    [
        ("DIV D0 K0 D1", {"D0": 7, "D1": 3}),
        ("DDIV D0 D2 D4", {"D0": 7}),
        ("DIV D0 K2 D7999", {"D0": 7}),
        ("DIV D0 K2 V0", {"D0": 7}),
        ("MUL D0 K2 D7999", {"D0": 7}),
        ("DMUL D0 K2 D7997", {"D0": 7}),
        ("ADD D0 K1 D0Z0", {"D0": 7, "Z0": -1} | FLAGS),
        ("INC D0Z0", {"Z0": -1}),
        ("SUM K1 D0Z0", {"Z0": -1, "M8020": 1}),
        ("MEAN D0 D9 K0", {"D0": 1}),
        ("MEAN D0 D9 K65", {"D0": 1}),
        ("MEAN D7999 D9 K2", {"D7999": 1}),
        ("SQR K-1 D0", FLAGS),
    ],
)
def test_error_changes_nothing(text: str, before: State) -> None:
    rig = Rig(before)
    expected = copied(rig.memory)
    with pytest.raises(OperationError) as error:
        rig.run(text)
    assert error.value.code == 6706
    assert_same(rig.memory, expected)


@given(INT_16, INT_16)
def test_adding_a_difference_restores_the_number(a: int, b: int) -> None:
    rig = Rig({"D0": a, "D1": b})
    rig.run("SUB D0 D1 D2")
    rig.run("ADD D2 D1 D3")
    assert rig.memory.D[3] == a


@given(INT_16, INT_16)
def test_flags_of_a_sum_indicate_the_overflow_direction(a: int, b: int) -> None:
    rig = Rig({"D0": a, "D1": b})
    rig.run("ADD D0 D1 D2")
    assert rig.memory.M[8021] == (a + b < -32768)
    assert rig.memory.M[8022] == (a + b > 32767)
    assert rig.memory.M[8020] == (rig.memory.D[2] == 0)


@given(INT_32, INT_32.filter(bool))
def test_quotient_and_remainder_restore_the_dividend(a: int, b: int) -> None:
    rig = Rig()
    rig.run(f"DMOV K{a} D0")
    rig.run(f"DDIV D0 K{b} D4")
    quotient, remainder = ((rig.memory.D[n] & 0xFFFF) + (rig.memory.D[n + 1] << 16) for n in (4, 6))
    assert (quotient * b + remainder - a) % 2**32 == 0
    assert abs(remainder) < abs(b)
    assert remainder == 0 or (remainder < 0) == (a < 0)


@given(INT_16, INT_16)
def test_a_product_has_32_bits(a: int, b: int) -> None:
    rig = Rig({"D0": a, "D1": b})
    rig.run("MUL D0 D1 D2")
    assert (rig.memory.D[2] & 0xFFFF) + (rig.memory.D[3] << 16) == a * b
