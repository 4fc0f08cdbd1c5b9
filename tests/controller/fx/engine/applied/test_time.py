"""ABSD INCD TTMR STMR RAMP TCMP TZCP TRD, scan by scan."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.fx.engine.cpu import OperationError
from tests.controller.core.core_rig import copied
from tests.controller.fx.engine.applied.fx_applied_rig import Rig, State, assert_same, bits

TIME = {"D0": 10, "D1": 30, "D2": 50}


def on_bits(rig: Rig, first: int, count: int) -> str:
    return "".join("01"[bit] for bit in rig.memory.M[first : first + count])


# ---- drums ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("count", "expected"),
    [
        (0, "0010"),
        (39, "0010"),
        (40, "1010"),
        (99, "1010"),
        (100, "1110"),
        (139, "1110"),
        (140, "0110"),
        (159, "0110"),
        (160, "0100"),
        (199, "0100"),
        (200, "0000"),
        (240, "0001"),
        (279, "0001"),
        (280, "0011"),
        (300, "0010"),
    ],
)
def test_absd_turns_on_at_the_first_count_and_off_at_the_second(count: int, expected: str) -> None:
    table = {"D300": 40, "D301": 140, "D302": 100, "D303": 200, "D304": 280, "D305": 160, "D306": 240, "D307": 300}
    rig = Rig(table | {"C0": count, "M4": 1})
    rig.level("ABSD D300 C0 M0 K4")(True)
    assert on_bits(rig, 0, 5) == expected + "1"


def test_absd_bits_are_unchanged_without_drive() -> None:
    rig = Rig({"D0": 1, "D1": 2, "C0": 1})
    absd = rig.level("ABSD D0 C0 Y0 K1")
    absd(True)
    rig.set({"C0": 5})
    absd(False)
    assert rig.memory.Y[0]
    absd(True)
    assert not rig.memory.Y[0]


def test_absd_in_32_bits() -> None:
    rig = Rig({"D0": 0, "D1": 1, "D2": 0, "D3": 2, "C200": 65535})
    absd = rig.level("DABSD D0 C200 M0 K1")
    shown = []
    for value in (65535, 65536, 131071, 131072):
        rig.set({"C200": value})
        absd(True)
        shown.append(rig.memory.M[0])
    assert shown == [False, True, True, False]


@pytest.mark.parametrize(
    "text", ["ABSD D0 C0 M3070 K4", "ABSD D7999 C0 M0 K1", "ABSD D0 C0 M0 K65", "ABSD D0 C200 M0 K1"]
)
def test_absd_out_of_range(text: str) -> None:
    rig = Rig({"M0": 1})
    before = copied(rig.memory)
    with pytest.raises(OperationError):
        rig.level(text)(True)
    assert_same(rig.memory, before)


def test_incd_advances_from_bit_to_bit_and_sets_m8029_after_the_last() -> None:
    rig = Rig({"D0": 2, "D1": 1, "D2": 3})
    incd = rig.level("INCD D0 C0 M0 K3")
    shown = []
    for _ in range(7):
        incd(True)
        memory = rig.memory
        shown.append((on_bits(rig, 0, 3), memory.CV[0], memory.CV[1], memory.M[8029]))
        memory.CV[0] += 1
    assert shown == [
        ("100", 0, 0, False),
        ("100", 1, 0, False),
        ("010", 0, 1, False),
        ("001", 0, 2, False),
        ("001", 1, 2, False),
        ("001", 2, 2, False),
        ("100", 0, 0, True),
    ]
    incd(True)
    assert not rig.memory.M[8029]


def test_incd_clears_once_when_its_drive_goes_off() -> None:
    rig = Rig({"D0": 2, "D1": 5})
    incd = rig.level("INCD D0 C0 M0 K2")
    incd(True)
    rig.set({"C0": 2, "C0 contact": 1})
    incd(True)
    rig.set({"C0": 1, "C0 contact": 1})
    incd(False)
    assert (rig.memory.CV[0], rig.memory.CV[1], rig.memory.C[0], on_bits(rig, 0, 2)) == (0, 0, False, "00")
    rig.set({"C0": 4, "M1": 1, "M8029": 1})
    incd(False)
    assert (rig.memory.CV[0], rig.memory.M[1], rig.memory.M[8029]) == (4, True, True)


# ---- timers ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "shown"), [(0, [0, 1, 2]), (1, [0, 12, 25]), (2, [0, 125, 250])])
def test_ttmr_measures_the_drive_time(unit: int, shown: list[int]) -> None:
    rig = Rig()
    ttmr = rig.level(f"TTMR D0 K{unit}")
    values = []
    for now_ms in (700, 1950, 3200):
        rig.cpu.now_ms = now_ms
        ttmr(True)
        values.append(tuple(rig.memory.D[0:2]))
    assert values == list(zip(shown, (0, 12, 25), strict=True))
    rig.cpu.now_ms = 9000
    ttmr(False)
    assert rig.memory.D[0:2] == [shown[2], 0]
    rig.cpu.now_ms = 9500
    ttmr(True)
    assert rig.memory.D[0:2] == [0, 0]


def test_ttmr_stops_at_the_highest_number() -> None:
    rig = Rig()
    ttmr = rig.level("TTMR D0 K2")
    ttmr(True)
    rig.cpu.now_ms = 400_000
    ttmr(True)
    assert rig.memory.D[0:2] == [32767, 4000]


@pytest.mark.parametrize(("text", "before"), [("TTMR D0 K3", {"D0": 1}), ("TTMR D7999 K0", {"D7999": 1})])
def test_ttmr_out_of_range(text: str, before: State) -> None:
    rig = Rig(before)
    with pytest.raises(OperationError):
        rig.level(text)(True)
    assert rig.memory.D == Rig(before).memory.D


def stmr_trace(drives: str, preset: int = 3) -> list[str]:
    """Return one string for each of the four bits, with its level after each scan; scans are 100 ms apart."""
    rig = Rig()
    stmr = rig.level(f"STMR T10 K{preset} M0")
    shown = []
    for scan, drive in enumerate(drives):
        rig.cpu.now_ms = 50 + 100 * scan
        stmr(drive == "1")
        shown.append(on_bits(rig, 0, 4))
    return ["".join(column) for column in zip(*shown, strict=True)]


def test_stmr_four_bits_of_a_long_drive() -> None:
    assert stmr_trace("0111111000000") == [
        "0111111111000",
        "0000000111000",
        "0111000000000",
        "0000111111000",
    ]


def test_stmr_a_drive_shorter_than_the_timer() -> None:
    assert stmr_trace("0110000000") == [
        "0111110000",
        "0001110000",
        "0110000000",
        "0000000000",
    ]


def test_stmr_without_drive_does_nothing_and_does_not_start_its_timer() -> None:
    rig = Rig()
    stmr = rig.level("STMR T10 K3 M0")
    before = copied(rig.memory)
    stmr(False)
    assert_same(rig.memory, before)


def test_stmr_shows_its_time() -> None:
    rig = Rig()
    stmr = rig.level("STMR T10 K2 M0")
    shown = []
    for scan, on in enumerate((True, True, True, True, False, False, False)):
        rig.cpu.now_ms = 100 * scan
        stmr(on)
        shown.append((rig.memory.TV[10], rig.memory.T[10], rig.memory.TS[10] >= 0))
    assert shown == [
        (0, False, True),
        (1, False, True),
        (2, True, True),
        (2, True, True),
        (0, False, True),
        (1, False, True),
        (0, False, False),
    ]


# ---- ramp -----------------------------------------------------------------------------------------------------


def test_ramp_runs_to_its_end_and_restarts() -> None:
    rig = Rig({"D1": 10, "D2": 50})
    ramp = rig.level("RAMP D1 D2 D3 K4")
    shown = []
    for _ in range(7):
        ramp(True)
        shown.append((rig.memory.D[3], rig.memory.D[4], rig.memory.M[8029]))
    assert shown == [
        (10, 0, False),
        (20, 1, False),
        (30, 2, False),
        (40, 3, False),
        (50, 4, True),
        (10, 0, False),
        (20, 1, False),
    ]


def test_ramp_downwards_stays_at_its_end_with_m8026() -> None:
    rig = Rig({"D1": 10, "D2": -1, "M8026": 1})
    ramp = rig.level("RAMP D1 D2 D3 K2")
    shown = []
    for _ in range(5):
        ramp(True)
        shown.append((rig.memory.D[3], rig.memory.D[4], rig.memory.M[8029]))
    assert shown == [(10, 0, False), (5, 1, False), (-1, 2, True), (-1, 2, True), (-1, 2, True)]


def test_ramp_without_drive_retains_its_value_and_restarts() -> None:
    rig = Rig({"D1": 0, "D2": 100})
    ramp = rig.level("RAMP D1 D2 D3 K4")
    for _ in range(2):
        ramp(True)
    ramp(False)
    assert (rig.memory.D[3], rig.memory.D[4], rig.memory.M[8029]) == (25, 0, False)
    ramp(True)
    assert rig.memory.D[3] == 0


@pytest.mark.parametrize("text", ["RAMP D1 D2 D3 K0", "RAMP D1 D2 D7999 K4"])
def test_ramp_out_of_range(text: str) -> None:
    rig = Rig({"D1": 5, "D2": 6})
    before = copied(rig.memory)
    with pytest.raises(OperationError):
        rig.level(text)(True)
    assert_same(rig.memory, before)


@given(st.integers(-32768, 32767), st.integers(-32768, 32767), st.integers(1, 40))
def test_ramp_is_monotonic_and_within_its_limits(a: int, b: int, count: int) -> None:
    rig = Rig({"D1": a, "D2": b})
    ramp = rig.level(f"RAMP D1 D2 D3 K{count}")
    values = []
    for _ in range(count + 1):
        ramp(True)
        values.append(rig.memory.D[3])
    assert (values[0], values[-1]) == (a, b)
    assert values == sorted(values, reverse=b < a)
    assert rig.memory.M[8029]


# ---- clock ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "before", "after"),
    [
        ("TCMP K10 K30 K51 D0 M0", TIME, bits("M0", "100")),
        ("TCMP K10 K30 K50 D0 M0", TIME | {"M0": 1}, bits("M0", "010")),
        ("TCMP K9 K59 K59 D0 M0", TIME, bits("M0", "001")),
        ("TZCP D20 D30 D0 M0", TIME | {"D20": 10, "D21": 31, "D30": 12}, bits("M0", "100")),
        ("TZCP D20 D30 D0 M0", TIME | {"D20": 10, "D21": 30, "D22": 50, "D30": 12}, bits("M0", "010")),
        ("TZCP D20 D30 D0 M0", TIME | {"D30": 10, "D31": 30, "D32": 50}, bits("M0", "010")),
        ("TZCP D20 D30 D0 M0", TIME | {"D20": 9, "D30": 10, "D31": 30, "D32": 49}, bits("M0", "001")),
        (
            "TRD D0",
            {"D8013": 1, "D8014": 2, "D8015": 3, "D8016": 4, "D8017": 5, "D8018": 26, "D8019": 6},
            {"D0": 26, "D1": 5, "D2": 4, "D3": 3, "D4": 2, "D5": 1, "D6": 6},
        ),
    ],
)
def test_clock(text: str, before: State, after: State) -> None:
    Rig(before).changes_only(text, after)


@pytest.mark.parametrize(
    ("text", "before"),
    [
        ("TCMP K24 K0 K0 D0 M0", TIME),
        ("TCMP K0 K60 K0 D0 M0", TIME),
        ("TCMP K0 K0 K0 D0 M0", {"D2": 60}),
        ("TCMP K0 K0 K0 D7998 M0", {}),
        ("TZCP D20 D30 D0 M0", {"D21": -1}),
        ("TZCP D20 D30 D0 M3070", {}),
        ("TRD D7994", {"D8018": 26}),
    ],
)
def test_clock_error_changes_nothing(text: str, before: State) -> None:
    rig = Rig(before)
    expected = copied(rig.memory)
    with pytest.raises(OperationError):
        rig.run(text)
    assert_same(rig.memory, expected)


def test_incd_with_one_bit_and_a_drum_that_was_out_of_range() -> None:
    rig = Rig({"D0": 1, "C0": 1, "C1": 7})
    rig.level("INCD D0 C0 M0 K1")(True)
    assert (on_bits(rig, 0, 2), rig.memory.CV[:2], rig.memory.M[8029]) == ("10", [0, 0], True)
