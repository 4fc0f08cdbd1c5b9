"""MOV CML XCH BMOV FMOV BCD BIN CMP ZCP: written values, and no other changes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.fx.engine.cpu import OperationError
from tests.controller.core.core_rig import copied
from tests.controller.fx.engine.applied.fx_applied_rig import Rig, State, assert_same, bits

BLOCK = {f"D{n}": n for n in range(10, 16)}


@pytest.mark.parametrize(
    ("text", "before", "after"),
    [
        ("MOV K100 D0", {}, {"D0": 100}),
        ("MOV D0 K2Y0", {"D0": 0x1A5}, bits("Y0", "10100101")),
        ("MOV K255 K4M103", {}, bits("M103", "1" * 8 + "0" * 8)),
        ("MOV K1X4 D0", bits("X4", "0110"), {"D0": 6}),
        ("DMOV K-2 D0", {}, {"D0": -2, "D1": -1}),
        ("DMOV C200 D0", {"C200": 65536}, {"D0": 0, "D1": 1}),
        ("MOV D20V0 K1M10", {"V0": 3, "D23": 9, "D20": 6}, bits("M10", "1001")),
        ("CML D0 K1Y0", {"D0": 5}, bits("Y0", "0101")),
        ("CML K1X0 D0", bits("X0", "1010"), {"D0": -6}),
        ("DCML D0 D2", {"D0": 1}, {"D2": -2, "D3": -1}),
        ("XCH D0 D1", {"D0": 3, "D1": 8}, {"D0": 8, "D1": 3}),
        ("XCH D0 K1M0", {"D0": 0x1C, **bits("M0", "1010")}, {"D0": 5, **bits("M0", "0011")}),
        ("DXCH D0 D2", {"D0": 1, "D1": 2, "D2": 3, "D3": 4}, {"D0": 3, "D1": 4, "D2": 1, "D3": 2}),
        ("BMOV D10 D20 K3", BLOCK, {"D20": 10, "D21": 11, "D22": 12}),
        ("BMOV D10 D12 K4", BLOCK, {"D12": 10, "D13": 11, "D14": 12, "D15": 13}),
        ("BMOV D12 D10 K4", BLOCK, {"D10": 12, "D11": 13, "D12": 14, "D13": 15}),
        ("BMOV D10 D12 K4", BLOCK | {"M8024": 1}, {"D10": 12, "D11": 13, "D12": 14, "D13": 15}),
        ("BMOV K1M0 K1Y0 K2", bits("M0", "10010110"), bits("Y0", "10010110")),
        ("BMOV D10 D20 D0", BLOCK | {"D0": 2}, {"D20": 10, "D21": 11}),
        ("FMOV K7 D0 K3", {}, {"D0": 7, "D1": 7, "D2": 7}),
        ("FMOV D0 D0 K3", {"D0": 4}, {"D1": 4, "D2": 4}),
        ("DFMOV K65537 D0 K2", {}, {"D0": 1, "D1": 1, "D2": 1, "D3": 1}),
        ("BCD K1234 D0", {}, {"D0": 0x1234}),
        ("BCD K9999 D0", {}, {"D0": 0x9999 - 0x10000}),
        ("BCD D0 K2Y0", {"D0": 42}, bits("Y0", "01000010")),
        ("DBCD K12345678 D0", {}, {"D0": 0x5678, "D1": 0x1234}),
        ("BIN K4X0 D0", bits("X0", "1001100110011001"), {"D0": 9999}),
        ("BIN H1234 D0", {}, {"D0": 1234}),
        (
            "DBIN D0 D2",
            {"D0": 0x9999 - 0x10000, "D1": 0x9999 - 0x10000},
            {"D2": 0xE0FF - 0x10000, "D3": 0x05F5},
        ),
        ("CMP K5 D0 M0", {"D0": 4, "M1": 1, "M2": 1}, bits("M0", "100")),
        ("CMP K5 D0 M0", {"D0": 5}, bits("M0", "010")),
        ("CMP K-5 D0 M0", {"D0": 4}, bits("M0", "001")),
        ("DCMP K65536 D0 Y6", {"D0": 0, "D1": 1}, bits("Y6", "010")),
        ("ZCP K10 K20 D0 M0", {"D0": 9}, bits("M0", "100")),
        ("ZCP K10 K20 D0 M0", {"D0": 10}, bits("M0", "010")),
        ("ZCP K10 K20 D0 M0", {"D0": 20}, bits("M0", "010")),
        ("ZCP K10 K20 D0 M0", {"D0": 21}, bits("M0", "001")),
        ("ZCP K200 K100 D1 M1", {"D1": 200}, bits("M1", "010")),
        ("ZCP K200 K100 D1 M1", {"D1": 150}, bits("M1", "100")),
        ("DZCP K0 K65536 D0 S0", {"D0": 1, "D1": 1}, bits("S0", "001")),
    ],
)
def test_result(text: str, before: State, after: State) -> None:
    Rig(before).changes_only(text, after)


@pytest.mark.parametrize(
    ("text", "before"),
    [
        ("MOV K1 D0Z0", {"Z0": -1}),
        ("MOV K1 C200", {}),
        ("XCH D0 D0Z0", {"D0": 1, "Z0": -1}),
        ("XCH D0Z0 D1", {"D1": 1, "Z0": -1}),
        ("BMOV D0 D7990 K11", {"D0": 1}),
        ("BMOV D7990 D0 K11", {"D7990": 1}),
        ("BMOV D0 D10 K0", {"D0": 1}),
        ("BMOV D0 D1000 K513", {"D0": 1}),
        ("BMOV D0 D10 D1", {"D0": 1, "D1": -1}),
        ("BMOV D0 C195 K6", {"D0": 1}),
        ("FMOV K1 D7990 K11", {}),
        ("FMOV K1 D0 K513", {}),
        ("BCD K10000 D0", {}),
        ("BCD K-1 D0", {}),
        ("DBCD K100000000 D0", {}),
        ("BIN HA D0", {}),
        ("BIN H1A34 D0", {}),
        ("DBIN HF0000000 D0", {}),
        ("CMP K1 K0 M3070", {}),
        ("ZCP K1 K2 K0 M0Z0", {"Z0": -1}),
    ],
)
def test_error_changes_nothing(text: str, before: State) -> None:
    rig = Rig(before)
    expected = copied(rig.memory)
    with pytest.raises(OperationError):
        rig.run(text)
    assert_same(rig.memory, expected)


@given(st.integers(0, 9999))
def test_bin_undoes_bcd(value: int) -> None:
    rig = Rig({"D0": value})
    rig.run("BCD D0 D1")
    assert f"{rig.memory.D[1] & 0xFFFF:04x}" == f"{value:04d}"
    rig.run("BIN D1 D2")
    assert rig.memory.D[2] == value


@given(st.integers(0, 99_999_999))
def test_bin_undoes_bcd_in_32_bits(value: int) -> None:
    rig = Rig()
    rig.run(f"DMOV K{value} D0")
    rig.run("DBCD D0 D2")
    assert f"{rig.memory.D[3] & 0xFFFF:04x}{rig.memory.D[2] & 0xFFFF:04x}" == f"{value:08d}"
    rig.run("DBIN D2 D4")
    assert rig.memory.D[4:6] == rig.memory.D[0:2]


@given(st.lists(st.integers(-32768, 32767), min_size=20, max_size=20), st.integers(0, 10), st.integers(1, 10))
def test_block_is_copied_unchanged_to_any_target(values: list[int], target: int, count: int) -> None:
    rig = Rig({f"D{n}": value for n, value in enumerate(values)})
    rig.run(f"BMOV D5 D{target} K{count}")
    assert rig.memory.D[target : target + count] == values[5 : 5 + count]
