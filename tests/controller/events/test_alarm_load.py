"""Alarm load: counts in ten minutes, chattering and standing alarms, and the fold under the first-out alarm."""

from __future__ import annotations

import pytest

from controller.events.alarm_load import (
    CHATTER_MS,
    STANDING_MS,
    WINDOW_MS,
    AlarmLoad,
    is_chattering,
    is_standing,
)
from controller.events.alarm_states import AlarmState
from tests.controller.events.alarm_rig import AIR, E_STOP, EMPTY, JAM, WARNING, AlarmRig


def follows(rig: AlarmRig) -> dict[int, int | None]:
    return {row.alarm.bit.number: row.follows for row in rig.list.rows()}


# --- fold ---------------------------------------------------------------------------------------


def test_a_fault_after_the_first_out_is_its_consequence() -> None:
    rig = AlarmRig()
    rig.scan(AIR)
    rig.scan(AIR, JAM)
    assert follows(rig) == {AIR: None, JAM: AIR}
    assert rig.order() == [AIR, JAM]


def test_of_two_faults_in_one_scan_the_first_out_of_the_program_is_the_first() -> None:
    rig = AlarmRig()
    rig.scan(AIR, JAM)
    assert rig.first_out() == [JAM]
    assert follows(rig) == {JAM: None, AIR: JAM}


def test_safety_alarms_and_warnings_are_never_folded() -> None:
    rig = AlarmRig()
    rig.scan(AIR)
    rig.scan(AIR, E_STOP, WARNING, EMPTY)
    assert follows(rig) == {AIR: None, E_STOP: None, WARNING: None, EMPTY: None}


def test_an_alarm_before_the_first_out_is_not_folded() -> None:
    """A warning, and a fault that has been reset and not acknowledged, stand for themselves."""
    rig = AlarmRig()
    rig.scan(JAM, WARNING)
    rig.scan(WARNING, reset=True)
    rig.scan(AIR, WARNING)
    assert follows(rig) == {AIR: None, JAM: None, WARNING: None}


def test_a_consequence_that_outlasts_its_first_out_becomes_the_first_out() -> None:
    """The reset clears JAM, whose cause has gone; AIR, which followed it, now holds the machine."""
    rig = AlarmRig()
    rig.scan(JAM)
    rig.scan(AIR)
    assert follows(rig) == {JAM: None, AIR: JAM}
    rig.scan(AIR, reset=True)
    rig.scan(AIR)
    assert rig.first_out() == [AIR]
    assert follows(rig) == {AIR: None, JAM: None}


def test_a_consequence_is_listed_alone_when_its_first_out_has_left_the_list() -> None:
    rig = AlarmRig()
    rig.scan(JAM)
    rig.scan(AIR)
    rig.list.acknowledge(JAM, by="Li")
    rig.scan(reset=True)
    assert follows(rig) == {AIR: None}


# --- counts -------------------------------------------------------------------------------------


def test_activations_are_counted_within_ten_minutes() -> None:
    load = AlarmLoad()
    for number in range(3):
        load.announce(900 + number, 1_000 * number)
    times = (2_000, WINDOW_MS - 1, WINDOW_MS, WINDOW_MS + 1_999, WINDOW_MS + 2_000)
    assert [load.recent(at_ms) for at_ms in times] == [3, 3, 2, 1, 0]
    load.announce(900, WINDOW_MS + 2_000)
    assert load.peak == 3


def test_three_activations_within_a_minute_are_chattering_until_a_minute_has_passed() -> None:
    load = AlarmLoad()
    counts = [load.announce(990, at_ms) for at_ms in (0, 30_000, CHATTER_MS - 1)]
    assert counts == [1, 2, 3]
    assert is_chattering(3, CHATTER_MS - 1, 2 * CHATTER_MS - 2)
    assert not is_chattering(3, CHATTER_MS - 1, 2 * CHATTER_MS - 1)
    assert not is_chattering(2, 0, 0)
    assert load.chattered == {990: 1}


@pytest.mark.parametrize(
    ("times", "begun"),
    [((0, 30_000, CHATTER_MS), 0), ((0, 25_000, 50_000, 75_000), 1), ((0, 1, 2, 200_000, 200_001, 200_002), 2)],
)
def test_each_beginning_of_chattering_is_counted_once(times: tuple[int, ...], begun: int) -> None:
    load = AlarmLoad()
    for at_ms in times:
        load.announce(990, at_ms)
        load.announce(991, at_ms + 1)
    assert load.chattered == {990: begun, 991: begun}


def test_a_standing_alarm_is_active_for_a_day() -> None:
    assert is_standing(AlarmState.ACKNOWLEDGED, 5, STANDING_MS + 5)
    assert not is_standing(AlarmState.ACKNOWLEDGED, 5, STANDING_MS + 4)
    assert is_standing(AlarmState.LATCHED_UNACKNOWLEDGED, 0, STANDING_MS)
    assert not is_standing(AlarmState.RETURNED_UNACKNOWLEDGED, 0, STANDING_MS)
    assert not is_standing(AlarmState.SHELVED, 0, STANDING_MS)


def test_the_list_counts_a_chattering_alarm_and_not_the_end_of_shelving() -> None:
    rig = AlarmRig()
    for _ in range(3):
        rig.scan(EMPTY, after_ms=10_000)
        rig.scan()
    (row,) = rig.list.rows()
    assert (row.activations, rig.list.load.recent(rig.now_ms), rig.list.load.peak) == (3, 3, 3)
    rig.list.shelve(EMPTY, 1_000, by="Li")
    rig.scan(EMPTY)
    rig.scan(EMPTY, after_ms=2_000)
    assert rig.state(EMPTY) is AlarmState.UNACKNOWLEDGED
    assert rig.list.load.recent(rig.now_ms) == 3
