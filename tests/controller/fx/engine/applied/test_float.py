"""FLT INT ECMP EZCP EADD ESUB EMUL EDIV: single-precision numbers in registers, rounding, flags, errors."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.fx.engine.cpu import OperationError
from tests.controller.core.core_rig import copied
from tests.controller.fx.engine.applied.fx_applied_rig import Rig, State, assert_same, bits

SINGLES = st.floats(-(2.0**50), 2.0**50, width=32).filter(lambda value: value == 0 or abs(value) > 1e-15)
NAN, INFINITY = {"D0": 0, "D1": 0x7FC0}, {"D0": 0, "D1": 0x7F80}
LARGEST = {"D0": -1, "D1": 0x7F7F}


def single(number: int, value: float) -> dict[str, int]:
    """Return the values of the two registers, from D<number> on, that contain a single-precision number."""
    low, high = struct.unpack("<hh", struct.pack("<f", value))
    return {f"D{number}": low, f"D{number + 1}": high}


def value_at(rig: Rig, number: int) -> float:
    value: float = struct.unpack("<f", struct.pack("<hh", *rig.memory.D[number : number + 2]))[0]
    return value


@pytest.mark.parametrize(
    ("text", "before", "after"),
    [
        ("FLT D0 D2", {"D0": 1}, {"D2": 0, "D3": 0x3F80}),
        ("FLT D0 D2", {"D0": -2}, {"D2": 0, "D3": 0xC000 - 0x10000}),
        ("DFLT D0 D2", {"D0": 0, "D1": 1}, {"D2": 0, "D3": 0x4780}),
        ("DFLT D0 D2", {"D0": 1, "D1": 0x100}, {"D2": 0, "D3": 0x4B80}),
        ("INT D0 D2", single(0, 2.75) | {"D3": 9}, {"D2": 2, "M8021": 1}),
        ("INT D0 D2", single(0, -2.75), {"D2": -2, "M8021": 1}),
        ("INT D0 D2", single(0, 3.0) | bits("M8020", "111"), {"D2": 3} | bits("M8020", "000")),
        ("INT D0 D2", single(0, 0.5) | {"D2": 7}, {"D2": 0, "M8020": 1, "M8021": 1}),
        ("INT D0 D2", single(0, 32767.0), {"D2": 32767}),
        ("INT D0 D2", single(0, 32768.0) | {"D2": 7}, {"M8022": 1}),
        ("DINT D0 D2", single(0, 65537.0), {"D2": 1, "D3": 1}),
        ("DINT D0 D2", single(0, 2.0**31), {"M8022": 1}),
        ("DECMP D0 D2 M0", single(0, 1.5) | single(2, 1.25), bits("M0", "100")),
        ("DECMP D0 K2 M0", single(0, 2.0) | {"M0": 1}, bits("M0", "010")),
        ("DECMP D0 K2 M0", single(0, 1.9), bits("M0", "001")),
        ("DEZCP K1 K2 D0 M0", single(0, 0.99), bits("M0", "100")),
        ("DEZCP K1 K2 D0 M0", single(0, 1.0), bits("M0", "010")),
        ("DEZCP K1 K2 D0 M0", single(0, 2.0), bits("M0", "010")),
        ("DEZCP K1 K2 D0 M0", single(0, 2.01), bits("M0", "001")),
        ("DEZCP K2 K1 D0 M0", single(0, 1.5), bits("M0", "100")),
        ("DEADD D0 K1 D2", single(0, 0.5) | bits("M8020", "111"), single(2, 1.5) | bits("M8020", "000")),
        ("DEADD D0 K-1 D2", single(0, 1.0) | single(2, 5.0), single(2, 0.0) | {"M8020": 1}),
        ("DESUB D0 K1 D2", single(0, 0.5), single(2, -0.5)),
        ("DEMUL D0 D0 D2", single(0, -1.5), single(2, 2.25)),
        ("DEDIV K1 K4 D2", {}, single(2, 0.25)),
        ("DEDIV K1 K3 D2", {}, {"D2": 0xAAAB - 0x10000, "D3": 0x3EAA}),
        ("DEMUL D0 K2 D2", LARGEST, {"D2": -1, "D3": 0x7F7F, "M8022": 1}),
        ("DEMUL D0 K-2 D2", LARGEST, {"D2": -1, "D3": -129, "M8022": 1}),
        ("DEMUL D0 D0 D2", single(0, 1e-30), {"D2": 0, "D3": 0x0080, "M8021": 1}),
    ],
)
def test_result(text: str, before: State, after: State) -> None:
    Rig(before).changes_only(text, after)


@pytest.mark.parametrize(
    ("text", "before"),
    [
        ("DEDIV D0 K0 D2", single(0, 1.0)),
        ("DEDIV D0 D4 D2", single(0, 1.0)),
        ("DEADD D0 K1 D2", NAN),
        ("DEADD K1 D0 D2", INFINITY),
        ("DECMP D0 K1 M0", NAN | {"M0": 1}),
        ("DEZCP K0 K1 D0 M0", INFINITY | {"M0": 1}),
        ("INT D0 D2", NAN | {"D2": 5}),
        ("DEADD K1 K1 D7999", {}),
        ("FLT D0 D7999", {"D0": 1}),
        ("DECMP K1 K1 M3070", {}),
    ],
)
def test_error_changes_nothing(text: str, before: State) -> None:
    rig = Rig(before)
    expected = copied(rig.memory)
    with pytest.raises(OperationError):
        rig.run(text)
    assert_same(rig.memory, expected)


@given(st.integers(-(2**24), 2**24))
def test_int_undoes_flt(value: int) -> None:
    rig = Rig()
    rig.run(f"DMOV K{value} D0")
    rig.run("DFLT D0 D2")
    assert value_at(rig, 2) == value
    rig.run("DINT D2 D4")
    assert rig.memory.D[4:6] == rig.memory.D[0:2]


@given(SINGLES, SINGLES)
def test_results_are_rounded_to_the_nearest_single(a: float, b: float) -> None:
    rig = Rig({**single(0, a), **single(2, b)})
    for text, exact in (("DEADD", a + b), ("DESUB", a - b), ("DEMUL", a * b)):
        rig.run(f"{text} D0 D2 D4")
        assert value_at(rig, 4) == struct.unpack("<f", struct.pack("<f", exact))[0]


def test_both_registers_are_written_or_none() -> None:
    before: State = single(0, 2.0)
    rig = Rig({**before, "Z0": -5})
    expected = copied(rig.memory)
    with pytest.raises(OperationError):
        rig.run("DEMUL D0 D0 D4Z0")
    assert_same(rig.memory, expected)
