"""ROR ROL RCR RCL SFTR SFTL WSFR WSFL SFWR SFRD: bits and words that are shifted, filled in and lost."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.fx.engine.cpu import OperationError
from tests.controller.core.core_rig import copied
from tests.controller.fx.engine.applied.fx_applied_rig import Rig, State, assert_same, bits

INT_16 = st.integers(-(2**15), 2**15 - 1)
ROW = {f"D{n}": n for n in range(10, 17)}


@pytest.mark.parametrize(
    ("text", "before", "after"),
    [
        ("ROR D0 K4", {"D0": 0x1234}, {"D0": 0x4123}),
        ("ROR D0 K4", {"D0": 0x1238}, {"D0": 0x8123 - 0x10000, "M8022": 1}),
        ("ROR D0 K16", {"D0": 0x0001}, {}),
        ("ROR D0 K0", {"D0": 1, "M8022": 1}, {}),
        ("ROL D0 K4", {"D0": 0x1234}, {"D0": 0x2341, "M8022": 1}),
        ("ROL D0 K4", {"D0": 0x2341, "M8022": 1}, {"D0": 0x3412, "M8022": 0}),
        ("ROL D0 K1", {"D0": -32768}, {"D0": 1, "M8022": 1}),
        ("DROR D0 K1", {"D0": 1}, {"D0": 0, "D1": -32768, "M8022": 1}),
        ("DROL D0 K4", {"D1": 0x1000}, {"D0": 1, "D1": 0, "M8022": 1}),
        ("ROL K4M0 K1", bits("M0", "1" + "0" * 14 + "1"), bits("M0", "11" + "0" * 14) | {"M8022": 1}),
        ("DROL K8M0 K1", bits("M0", "1" + "0" * 31), bits("M0", "01" + "0" * 30)),
        ("RCR D0 K1", {"D0": 1}, {"D0": 0, "M8022": 1}),
        ("RCR D0 K1", {"D0": 2, "M8022": 1}, {"D0": -32767, "M8022": 0}),
        ("RCR D0 K3", {"D0": 0b101, "M8022": 0}, {"D0": 0x4000, "M8022": 1}),
        ("RCL D0 K1", {"D0": -32768}, {"D0": 0, "M8022": 1}),
        ("RCL D0 K1", {"D0": 1, "M8022": 1}, {"D0": 3, "M8022": 0}),
        ("DRCL D0 K2", {"D1": 0x4000, "M8022": 1}, {"D0": 2, "D1": 0, "M8022": 1}),
        (
            "SFTL M100 M0 K8 K3",
            bits("M0", "10110011") | bits("M100", "010"),
            bits("M0", "01010110"),
        ),
        (
            "SFTR M100 M0 K8 K3",
            bits("M0", "10110011") | bits("M100", "010"),
            bits("M0", "10011010"),
        ),
        ("SFTL M1523 S10 K9 K1", {"M1523": 1, "S10": 0, "S18": 1}, {"S10": 1, "S18": 0}),
        ("SFTL X6 Y0 K4 K4", bits("X6", "1011"), bits("Y0", "1011")),
        ("SFTL M0 M0 K4 K1", bits("M0", "1100"), bits("M0", "1110")),
        ("SFTL M9 M0 K1 K1", {"M1": 1, "M9": 1}, {"M0": 1}),
        ("SFTL M9 M0 K4 K0", bits("M0", "1100") | {"M9": 1}, {}),
        ("WSFL D0 D10 K5 K2", ROW | {"D0": 1, "D1": 2}, {"D10": 1, "D11": 2, "D12": 10, "D13": 11, "D14": 12}),
        ("WSFR D0 D10 K5 K2", ROW | {"D0": 1, "D1": 2}, {"D10": 12, "D11": 13, "D12": 14, "D13": 1, "D14": 2}),
        ("WSFL K1X0 K1Y0 K2 K1", bits("X0", "1010") | bits("Y0", "1100"), bits("Y0", "10101100")),
        ("SFWR D0 D10 K4", {"D0": 7, "M8022": 1}, {"D10": 1, "D11": 7, "M8022": 0}),
        ("SFWR D0 D10 K4", {"D0": 8, "D10": 2, "D11": 7, "D12": 6}, {"D10": 3, "D13": 8}),
        ("SFWR D0 D10 K4", {"D0": 9, "D10": 3, "D13": 8}, {"M8022": 1}),
        (
            "SFRD D10 D20 K4",
            {"D10": 3, "D11": 7, "D12": 6, "D13": 5, "M8020": 1},
            {"D10": 2, "D11": 6, "D12": 5, "D20": 7, "M8020": 0},
        ),
        ("SFRD D10 D20 K2", {"D10": 1, "D11": 7}, {"D10": 0, "D20": 7}),
        ("SFRD D10 D20 K4", {"D11": 7, "D20": 3}, {"M8020": 1}),
    ],
)
def test_result(text: str, before: State, after: State) -> None:
    Rig(before).changes_only(text, after)


@pytest.mark.parametrize(
    ("text", "before"),
    [
        ("ROR D0 K17", {"D0": 1}),
        ("DROR D0 K33", {"D0": 1}),
        ("ROL D0 K-1", {"D0": 1}),
        ("ROR K3M0 K1", {"M0": 1}),
        ("DROR K4M0 K1", {"M0": 1}),
        ("RCL D0Z0 K1", {"Z0": -1, "M8022": 1}),
        ("SFTL M0 M10 K4 K5", {"M0": 1}),
        ("SFTL M0 M10 K1025 K1", {"M0": 1}),
        ("SFTR M3071 M10 K4 K2", {"M3071": 1}),
        ("SFTR M0 S998 K4 K2", {"M0": 1}),
        ("WSFR D7999 D10 K4 K2", ROW),
        ("WSFL D0 D7998 K4 K2", {"D0": 1}),
        ("WSFL D0 D10 K513 K2", {"D0": 1}),
        ("SFWR K5 D10 K1", {}),
        ("SFWR K5 D10 K4", {"D10": 4}),
        ("SFWR K5 D10 K4", {"D10": -1}),
        ("SFWR K5 D7998 K4", {}),
        ("SFRD D10 D20 K4", {"D10": 4}),
        ("SFRD D10 D20Z0 K4", {"D10": 1, "D11": 5, "Z0": -21}),
    ],
)
def test_error_changes_nothing(text: str, before: State) -> None:
    rig = Rig(before)
    expected = copied(rig.memory)
    with pytest.raises(OperationError):
        rig.run(text)
    assert_same(rig.memory, expected)


@given(INT_16, st.integers(0, 16))
def test_rotating_right_undoes_rotating_left(value: int, count: int) -> None:
    rig = Rig({"D0": value})
    rig.run(f"ROL D0 K{count}")
    rig.run(f"ROR D0 K{count}")
    assert rig.memory.D[0] == value


@given(INT_16, st.integers(0, 16))
def test_rotating_through_the_carry_loses_nothing(value: int, count: int) -> None:
    rig = Rig({"D0": value, "M8022": 1})
    rig.run(f"RCL D0 K{count}")
    rig.run(f"RCR D0 K{count}")
    assert (rig.memory.D[0], rig.memory.M[8022]) == (value, True)


@given(st.lists(INT_16, max_size=9))
def test_queue_is_first_in_first_out(values: list[int]) -> None:
    rig = Rig()
    for value in values:
        rig.run(f"MOV K{value} D0")
        rig.run("SFWR D0 D10 K10")
    out = []
    while rig.memory.D[10]:
        rig.run("SFRD D10 D1 K10")
        out.append(rig.memory.D[1])
    assert out == values
