"""ZRST DECO ENCO BON ANS ANR REF REFF ALT SEGD."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.core.devices import SIZES
from controller.fx.engine.cpu import OperationError
from tests.controller.core.core_rig import copied
from tests.controller.fx.engine.applied.fx_applied_rig import Rig, State, assert_same, bits


@pytest.mark.parametrize(
    ("text", "before", "after"),
    [
        ("ZRST M1 M3", bits("M0", "11111"), bits("M1", "000")),
        ("ZRST Y6 Y11", bits("Y5", "111111"), bits("Y6", "0000")),
        ("ZRST S500 S502", bits("S499", "11111"), bits("S500", "000")),
        ("ZRST M5 M3", bits("M3", "111"), {"M5": 0}),
        ("ZRST D1 D2", {"D0": 1, "D1": 2, "D2": 3, "D3": 4}, {"D1": 0, "D2": 0}),
        (
            "ZRST T1 T2",
            {"T0": 3, "T1": 4, "T1 start": 6, "T1 contact": 1, "T2": 5, "T3": 6, "T3 start": 1},
            {"T1": 0, "T1 start": -1, "T1 contact": 0, "T2": 0},
        ),
        ("ZRST C1 C2", {"C0": 3, "C1": 4, "C1 contact": 1, "C2": 5, "C3": 6}, {"C1": 0, "C1 contact": 0, "C2": 0}),
        ("ZRST C200 C201", {"C200": 70_000, "C201": -1, "C201 contact": 1}, {"C200": 0, "C201": 0, "C201 contact": 0}),
        ("ZRST M0Z0 M2", bits("M0", "1111") | {"Z0": 1}, bits("M1", "00")),
        ("DECO X0 M10 K3", bits("X0", "1010") | {"M10": 1, "M18": 1}, {"M10": 0, "M15": 1}),
        ("DECO C0 S9 K4", {"C0": 9, "S9": 1, "S25": 1}, {"S9": 0, "S18": 1}),
        ("DECO D0 D1 K3", {"D0": 0xFD, "D1": -1}, {"D1": 32}),
        ("DECO D0 D1 K4", {"D0": 15}, {"D1": -32768}),
        ("DECO D0 M0 K0", {"D0": 1, "M0": 1}, {}),
        ("DECO D0 M0 K8", {"D0": 255}, {"M255": 1}),
        ("ENCO M10 D0 K3", bits("M10", "01010000") | {"M18": 1}, {"D0": 3}),
        ("ENCO D0 D1 K3", {"D0": 0x10C}, {"D1": 3}),
        ("ENCO D0 D1 K4", {"D0": -32768}, {"D1": 15}),
        ("ENCO M0 D1 K0", {"M0": 1, "D1": 9}, {}),
        ("BON D0 M0 K15", {"D0": -1}, {"M0": 1}),
        ("BON D0 M0 K3", {"D0": 0xF7, "M0": 1}, {"M0": 0}),
        ("DBON D0 Y0 K16", {"D1": 1}, {"Y0": 1}),
        ("ANR", bits("S899", "1011"), {"S901": 0}),
        ("ANR", {"S899": 1}, {}),
        ("ALT Y0", {"Y0": 1}, {"Y0": 0}),
        ("ALT M0", {}, {"M0": 1}),
        ("SEGD K0 K2Y0", {}, bits("Y0", "11111100")),
        ("SEGD D0 K2Y0", {"D0": 0x17} | bits("Y0", "11111111"), bits("Y0", "11100100")),
        ("SEGD HA D0", {"D0": 0x12FF}, {"D0": 0x1277}),
    ],
)
def test_result(text: str, before: State, after: State) -> None:
    Rig(before).changes_only(text, after)


@pytest.mark.parametrize(
    ("text", "before"),
    [
        ("ZRST M3071 M8000", {"M3071": 1}),
        ("ZRST D7999 D8000", {"D7999": 1, "D8000": 200}),
        ("ZRST M0Z0 M2", {"Z0": -1, "M0": 1}),
        ("ZRST C199 C200", {"C199": 1}),
        ("DECO D0 M0 K9", {"M0": 1}),
        ("DECO D0 D1 K5", {"D1": 1}),
        ("DECO D0 M3070 K2", {"M3070": 1}),
        ("DECO M3070 M0 K3", {"M1": 1}),
        ("ENCO D0 D1 K5", {"D0": 1}),
        ("BON D0 M0 K16", {"M0": 1}),
        ("DBON D0 M0 K32", {"M0": 1}),
        ("BON D0 M0 K-1", {"M0": 1}),
        ("REF X4 K8", {"X4": 1}),
        ("REF X0 K4", {"X0": 1}),
        ("REF Y370 K16", {"Y0": 1}),
        ("REFF K61", {"D8020": 10, "X0": 1}),
        ("REFF K-1", {"D8020": 10, "X0": 1}),
        ("ALT M0Z0", {"Z0": -1}),
        ("SEGD K1 D0Z0", {"Z0": -1}),
    ],
)
def test_error_changes_nothing(text: str, before: State) -> None:
    rig = Rig(before)
    rig.cpu.terminals = [False] * SIZES["X"]
    expected = copied(rig.memory)
    with pytest.raises(OperationError):
        rig.run(text)
    assert_same(rig.memory, expected)
    assert rig.cpu.refreshed is None


SEGMENTS_ON = [
    "abcdef",
    "bc",
    "abdeg",
    "abcdg",
    "bcfg",
    "acdfg",
    "acdefg",
    "abcf",
    "abcdefg",
    "abcdfg",
    "abcefg",
    "cdefg",
    "adef",
    "bcdeg",
    "adefg",
    "aefg",
]


@pytest.mark.parametrize("value", range(16))
def test_segments(value: int) -> None:
    rig = Rig({"D0": value})
    rig.run("SEGD D0 D1")
    assert rig.memory.D[1] == sum(1 << "abcdefg".index(segment) for segment in SEGMENTS_ON[value])


@given(st.integers(0, 255))
def test_enco_undoes_deco(value: int) -> None:
    rig = Rig({"D0": value})
    rig.run("DECO D0 M0 K8")
    assert sum(rig.memory.M) == 1
    rig.run("ENCO M0 D1 K8")
    assert rig.memory.D[1] == value


def test_enco_without_a_bit_is_an_error_and_writes_0() -> None:
    rig = Rig({"M8": 1, "D0": 5})
    with pytest.raises(OperationError):
        rig.run("ENCO M0 D0 K3")
    assert rig.memory.D[0] == 0


def test_ref_reads_only_its_inputs() -> None:
    rig = Rig({"X20": 1, "X10": 1})
    rig.cpu.terminals = [True] * 8 + [False, True] + [False] * 14
    rig.run("REF X10 K8")
    assert [n for n, on in enumerate(rig.memory.X) if on] == [9, 16]


def test_ref_does_not_change_inputs_without_a_terminal() -> None:
    rig = Rig({"X7": 1})
    rig.cpu.terminals = [True]
    rig.run("REF X0 K8")
    assert [n for n, on in enumerate(rig.memory.X) if on] == [0, 7]
    assert len(rig.memory.X) == SIZES["X"]


def test_ref_outputs_only_its_range() -> None:
    rig = Rig({"Y0": 1, "Y10": 1})
    rig.cpu.latches = [False] * SIZES["Y"]
    rig.cpu.latches[7] = rig.cpu.latches[16] = True
    rig.run("REF Y10 K8")
    refreshed = rig.cpu.refreshed
    assert refreshed is not None
    assert [n for n, on in enumerate(refreshed) if on] == [7, 8, 16]
    rig.set({"Y10": 0, "Y1": 1})
    assert refreshed[8], "the returned outputs are a copy"
    rig.run("REF Y0 K8")
    assert [n for n, on in enumerate(refreshed) if on] == [0, 1, 8, 16]
    assert not any(rig.cpu.latches[:7])


def test_reff_sets_the_filter_and_reads_sixteen_inputs() -> None:
    rig = Rig({"D8020": 10})
    rig.cpu.terminals = [True] * 24
    rig.run("REFF K5")
    assert rig.memory.D[8020] == 5
    assert [n for n, on in enumerate(rig.memory.X) if on] == list(range(16))


def test_ans_sets_its_state_after_the_delay() -> None:
    rig = Rig()
    ans = rig.level("ANS T0 K3 S900")
    shown = []
    for now_ms in (950, 1050, 1150, 1250, 1350):
        rig.cpu.now_ms = now_ms
        ans(True)
        shown.append((rig.memory.TV[0], rig.memory.T[0], rig.memory.S[900]))
    assert shown == [(0, False, False), (1, False, False), (2, False, False), (3, True, True), (3, True, True)]
    ans(False)
    assert (rig.memory.TV[0], rig.memory.T[0], rig.memory.TS[0], rig.memory.S[900]) == (0, False, -1, True)


def test_ans_restarts_after_its_drive_was_off() -> None:
    rig = Rig()
    ans = rig.level("ANS T0 K3 S900")
    for now_ms, on in ((0, True), (200, True), (300, False), (400, True), (600, True)):
        rig.cpu.now_ms = now_ms
        ans(on)
        assert not rig.memory.S[900]
    rig.cpu.now_ms = 700
    ans(True)
    assert rig.memory.S[900]
