"""PLSY PWM PLSR: pulses computed from the scan times."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.fx.engine.applied.pulse import profile, pulses_after
from controller.fx.engine.cpu import OperationError
from tests.controller.core.core_rig import copied
from tests.controller.fx.engine.applied.fx_applied_rig import Rig, assert_same


def total(rig: Rig, low: int = 8140) -> int:
    return (rig.memory.D[low] & 0xFFFF) + (rig.memory.D[low + 1] << 16)


def scan(rig: Rig, level: Callable[[bool], None], now_ms: int, on: bool = True) -> tuple[bool, int, bool]:
    rig.cpu.now_ms = now_ms
    level(on)
    return rig.memory.Y[0], total(rig), rig.memory.M[8029]


def test_plsy_outputs_and_counts_a_slow_train() -> None:
    rig = Rig()
    plsy = rig.level("PLSY K10 K2 Y0")
    assert [scan(rig, plsy, 1000 + ms) for ms in (0, 40, 60, 100, 140, 160, 200, 300)] == [
        (True, 0, False),
        (True, 0, False),
        (False, 0, False),
        (True, 1, False),
        (True, 1, False),
        (False, 1, False),
        (False, 2, True),
        (False, 2, True),
    ]
    assert scan(rig, plsy, 1400, on=False) == (False, 2, False)


def test_plsy_faster_than_the_scan_counts_correctly() -> None:
    rig = Rig()
    plsy = rig.level("DPLSY K20000 K100000 Y0")
    assert [scan(rig, plsy, ms)[1:] for ms in (0, 10, 4990, 5000, 5010)] == [
        (0, False),
        (200, False),
        (99_800, False),
        (100_000, True),
        (100_000, True),
    ]


def test_plsy_without_a_number_is_endless() -> None:
    rig = Rig()
    plsy = rig.level("PLSY K1000 K0 Y0")
    scan(rig, plsy, 0)
    assert scan(rig, plsy, 60_000)[1:] == (60_000, False)


def test_plsy_stops_with_its_drive_and_restarts() -> None:
    rig = Rig()
    plsy = rig.level("PLSY K10 K5 Y0")
    scan(rig, plsy, 0)
    scan(rig, plsy, 200)
    assert scan(rig, plsy, 230, on=False) == (False, 2, False)
    assert scan(rig, plsy, 900, on=False) == (False, 2, False)
    assert scan(rig, plsy, 1000) == (True, 2, False)
    assert scan(rig, plsy, 1499)[1:] == (6, False)
    assert scan(rig, plsy, 1500) == (False, 7, True)


def test_plsy_follows_its_frequency_but_not_its_number() -> None:
    rig = Rig({"D0": 10, "D1": 5})
    plsy = rig.level("PLSY D0 D1 Y0")
    scan(rig, plsy, 0)
    assert scan(rig, plsy, 100)[1] == 1
    rig.set({"D0": 20, "D1": 1})
    assert scan(rig, plsy, 200)[1:] == (3, False)
    assert scan(rig, plsy, 300)[1:] == (5, True)


def test_plsy_at_y1_has_a_separate_total() -> None:
    rig = Rig({"D8142": -1})
    plsy = rig.level("PLSY K10 K1 Y1")
    scan(rig, plsy, 0)
    assert rig.memory.Y[:2] == [False, True]
    scan(rig, plsy, 100)
    assert (total(rig), rig.memory.D[8142:8144]) == (0, [0, 1])


def test_undriven_instruction_does_not_change_output_and_flag() -> None:
    rig = Rig({"Y0": 1, "M8029": 1})
    before = copied(rig.memory)
    for text in ("PLSY K10 K1 Y0", "PLSR K100 K200 K100 Y0", "PWM K1 K2 Y0"):
        rig.level(text)(False)
    assert_same(rig.memory, before)


@pytest.mark.parametrize(
    "text",
    [
        "PLSY K0 K1 Y0",
        "PLSY K20001 K1 Y0",
        "PLSY K10 K-1 Y0",
        "PLSY K10 K1 Y2",
        "PLSR K9 K200 K100 Y0",
        "PLSR K100 K0 K100 Y0",
        "PLSR K100 K200 K0 Y0",
        "PLSR K100 K200 K5001 Y0",
        "PLSR K100 K200 K100 Y7",
        "PWM K3 K2 Y0",
        "PWM K-1 K2 Y0",
        "PWM K0 K0 Y0",
        "PWM K1 K2 Y0Z0",
    ],
)
def test_error_changes_nothing(text: str) -> None:
    rig = Rig({"Z0": -1})
    before = copied(rig.memory)
    with pytest.raises(OperationError):
        rig.level(text)(True)
    assert_same(rig.memory, before)


def test_pwm_is_on_for_its_width() -> None:
    rig = Rig({"D0": 30})
    pwm = rig.level("PWM D0 K100 Y3")

    def level_at(now_ms: int) -> bool:
        rig.cpu.now_ms = now_ms
        pwm(True)
        return rig.memory.Y[3]

    assert [level_at(570 + ms) for ms in (0, 29, 30, 99, 100, 129, 130)] == [
        True,
        True,
        False,
        False,
        True,
        True,
        False,
    ]
    rig.set({"D0": 50})
    assert level_at(815)
    pwm(False)
    assert not rig.memory.Y[3]
    assert level_at(903), "a new period starts when the input turns on again"
    rig.set({"D0": 0})
    assert not level_at(903)


def test_plsr_accelerates_and_decelerates() -> None:
    """At 1000 Hz with ramps of 100 ms, each ramp has ten steps with 1 to 10 pulses; the other 90 pulses take 90 ms."""
    rig = Rig()
    plsr = rig.level("PLSR K1000 K200 K100 Y0")
    times = (0, 10, 20, 100, 190, 200, 280, 289, 290, 400)
    assert [scan(rig, plsr, 70 + ms)[1:] for ms in times] == [
        (0, False),
        (1, False),
        (3, False),
        (55, False),
        (145, False),
        (155, False),
        (199, False),
        (199, False),
        (200, True),
        (200, True),
    ]
    assert scan(rig, plsr, 500, on=False) == (False, 200, False)


def test_plsr_with_few_pulses_uses_only_low_frequencies() -> None:
    """With 7 pulses, each ramp has only its first two steps (1 and 2 pulses); the seventh pulse runs at 200 Hz."""
    assert [(hz, float(pulses)) for hz, pulses in profile(1000, 7, 100)] == [
        (100, 1.0),
        (200, 2.0),
        (200, 1.0),
        (200, 2.0),
        (100, 1.0),
    ]
    assert [(hz, float(pulses)) for hz, pulses in profile(1000, 1, 100)] == [(100, 1.0)]


@given(st.integers(10, 20_000), st.integers(1, 40_000), st.integers(1, 5000))
def test_profile_is_complete_and_symmetric(hz: int, count: int, ramp_ms: int) -> None:
    steps = profile(hz, count, ramp_ms)
    assert sum(pulses for _, pulses in steps) == count
    assert steps == steps[::-1]
    assert all(0 < speed <= hz and pulses >= 0 for speed, pulses in steps)
    needed_ms = sum(pulses * 1000 / speed for speed, pulses in steps)
    assert pulses_after(steps, int(needed_ms) + 1) == count
    assert pulses_after(steps, int(needed_ms / 2)) <= count / 2


@given(st.integers(1, 20_000), st.lists(st.integers(1, 50), min_size=1, max_size=20))
def test_the_count_does_not_depend_on_the_scans(hz: int, scans: list[int]) -> None:
    rig, one = Rig(), Rig()
    plsy, whole = rig.level(f"PLSY K{hz} K0 Y0"), one.level(f"PLSY K{hz} K0 Y0")
    plsy(True)
    whole(True)
    for scan_ms in scans:
        rig.cpu.now_ms += scan_ms
        plsy(True)
    one.cpu.now_ms = sum(scans)
    whole(True)
    assert total(rig) == total(one) == hz * sum(scans) // 1000


def test_pwm_of_the_shortest_period_is_always_on() -> None:
    rig = Rig()
    pwm = rig.level("PWM K1 K1 Y0")
    for now_ms in range(3):
        assert scan(rig, pwm, now_ms)[0]
