"""The operator's alarm list: states of ISA-18.2, acknowledging, shelving, first-out, and what is told."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import Any

import pytest
from alarm_desk import (
    ACKNOWLEDGED,
    AIR,
    CAUSES,
    E_STOP,
    EMPTY,
    FIRST_OUT,
    JAM,
    LATCHED,
    LATCHED_ACKNOWLEDGED,
    NORMAL,
    RETURNED,
    SHELF_MS,
    SHELVED,
    SMALL,
    STOPPING,
    UNACKNOWLEDGED,
    WARNING,
    Desk,
)
from core_rig import PATIENT_S, THOROUGH
from hypothesis import given
from hypothesis import strategies as st

from controller.hmi.alarm_list import LONGEST_SHELF_MS, AlarmChange, AlarmList, AlarmRefusalError, AlarmState
from controller.program.alarm_texts import ALARMS

STATES = {
    "N": NORMAL,
    "U": UNACKNOWLEDGED,
    "A": ACKNOWLEDGED,
    "R": RETURNED,
    "L": LATCHED,
    "LA": LATCHED_ACKNOWLEDGED,
    "S": SHELVED,
}
CHART = [
    pytest.param(WARNING, "come:U acknowledge:A go:LA reset:N", id="as it should be"),
    pytest.param(WARNING, "come:U acknowledge:A reset:A go:LA", id="reset too early"),
    pytest.param(WARNING, "come:U go:L acknowledge:LA reset:N", id="gone before it is acknowledged"),
    pytest.param(WARNING, "come:U go:L reset:R acknowledge:N", id="reset before it is acknowledged"),
    pytest.param(WARNING, "come:U go:L come:U", id="back while latched"),
    pytest.param(WARNING, "come:U go:L acknowledge:LA come:U", id="back while latched and acknowledged"),
    pytest.param(WARNING, "come:U go:L reset:R come:U", id="back before it is acknowledged"),
    pytest.param(EMPTY, "come:U acknowledge:A go:N", id="lets go by itself, acknowledged"),
    pytest.param(EMPTY, "come:U go:R acknowledge:N", id="lets go by itself, not acknowledged"),
    pytest.param(JAM, "come:L go:L acknowledge:LA reset:N", id="without a cause"),
    pytest.param(JAM, "come:L go:L reset:R acknowledge:N", id="without a cause, reset before it is acknowledged"),
    pytest.param(WARNING, "shelve:S unshelve:N", id="shelved while normal"),
    pytest.param(WARNING, "shelve:S come:S acknowledge:S go:S reset:S wait:N", id="came and went on the shelf"),
    pytest.param(WARNING, "shelve:S come:S go:S wait:L", id="came on the shelf"),
    pytest.param(WARNING, "come:U shelve:S unshelve:U", id="unshelved"),
    pytest.param(WARNING, "come:U acknowledge:A shelve:S wait:U", id="announced anew"),
    pytest.param(WARNING, "come:U go:L reset:R shelve:S wait:N", id="shelved after it went"),
    pytest.param(WARNING, "come:U unshelve:U acknowledge:A unshelve:A", id="was not shelved"),
]


def play(desk: Desk, number: int, deeds: Iterable[str]) -> list[AlarmState]:
    """Do one thing a scan with one alarm and its cause; return its state after each."""
    there, states = False, []
    for deed in deeds:
        there = {"come": True, "go": False}.get(deed, there)
        if deed == "acknowledge":
            desk.list.acknowledge(number, by="Li")
        elif deed == "shelve":
            desk.list.shelve(number, SHELF_MS, by="Li")
        elif deed == "unshelve":
            desk.list.unshelve(number, by="Li")
        causes = (number,) if there else ()
        desk.scan(*causes, reset=deed == "reset", after_ms=SHELF_MS if deed == "wait" else None)
        states.append(desk.state(number))
    return states


@pytest.mark.parametrize(("number", "story"), CHART)
def test_states_follow_the_chart(number: int, story: str) -> None:
    """Given a small machine, when this happens scan by scan, then the alarm is in the state behind each colon."""
    pairs = [word.split(":") for word in story.split()]
    assert play(Desk(), number, [deed for deed, _ in pairs]) == [STATES[state] for _, state in pairs]


# what is told


def test_every_change_is_told_once_with_who_and_when() -> None:
    """Given an alarm that comes, is acknowledged and goes, when scans go on between, then just that is told."""
    desk = Desk()
    desk.scan()
    desk.scan(EMPTY)
    desk.scan(EMPTY)
    desk.list.acknowledge(EMPTY, by="Li")
    desk.scan(EMPTY)
    desk.scan(EMPTY)
    desk.scan()
    desk.scan()
    message = "Tray magazine empty"
    assert desk.changes == [
        AlarmChange(10, EMPTY, "magazine_empty", NORMAL, UNACKNOWLEDGED, None, message),
        AlarmChange(30, EMPTY, "magazine_empty", UNACKNOWLEDGED, ACKNOWLEDGED, "Li", message),
        AlarmChange(50, EMPTY, "magazine_empty", ACKNOWLEDGED, NORMAL, None, message),
    ]


def test_changes_are_flat_records_in_the_language_chosen() -> None:
    desk = Desk()
    desk.list = AlarmList(SMALL, FIRST_OUT, desk.changes.append, "zh")
    desk.scan(EMPTY)
    record = asdict(desk.changes[0])
    assert json.loads(json.dumps(record)) == record
    assert (record["event"], record["before"], record["after"]) == ("alarm_state", "normal", "unacknowledged")
    assert record["text"] == ALARMS["magazine_empty"].message.zh


def test_what_comes_together_is_told_by_severity() -> None:
    desk = Desk()
    desk.scan(EMPTY, JAM, E_STOP)
    assert [change.number for change in desk.changes] == [E_STOP, JAM, EMPTY]


@pytest.mark.parametrize(
    ("story", "times_ms"),
    [
        ("come", (10, None, None)),
        ("come acknowledge acknowledge", (10, None, 20)),
        ("come acknowledge go", (10, 30, 20)),
        ("come acknowledge go come", (40, None, None)),
    ],
)
def test_rows_keep_when_an_alarm_came_last_when_it_went_and_was_acknowledged(
    story: str, times_ms: tuple[int | None, int | None, int | None]
) -> None:
    desk = Desk()
    desk.scan()
    play(desk, WARNING, story.split())
    row = desk.row(WARNING)
    assert row is not None
    assert (row.came_ms, row.went_ms, row.acknowledged_ms) == times_ms


# acknowledging


def test_all_that_are_listed_are_acknowledged_and_a_shelved_one_is_not() -> None:
    desk = Desk()
    desk.scan(AIR, WARNING, EMPTY)
    desk.list.shelve(WARNING, SHELF_MS, by="Li")
    desk.list.acknowledge(by="Li")
    desk.scan(AIR, WARNING, EMPTY)
    assert [desk.state(number) for number in (AIR, WARNING, EMPTY)] == [ACKNOWLEDGED, SHELVED, ACKNOWLEDGED]
    desk.list.acknowledge(by="Wang")
    desk.scan(AIR, WARNING, EMPTY)
    assert "Wang" not in {change.by for change in desk.changes}
    assert [row.acknowledged_ms for row in desk.list.rows() if row.state is SHELVED] == [None]


def test_nobody_acknowledges_what_comes_with_the_same_scan() -> None:
    """Given an order to acknowledge all, when another alarm comes in the scan that takes it, then that one waits."""
    desk = Desk()
    desk.scan(AIR)
    desk.list.acknowledge(by="Li")
    desk.scan(AIR, EMPTY)
    assert (desk.state(AIR), desk.state(EMPTY)) == (ACKNOWLEDGED, UNACKNOWLEDGED)


def test_actions_of_another_thread_take_effect_with_the_next_scan() -> None:
    desk = Desk()
    desk.scan(AIR)
    told_in: list[str] = []
    desk.list._tell = lambda _: told_in.append(threading.current_thread().name)
    panel = threading.Thread(target=desk.list.acknowledge, kwargs={"by": "Li"}, name="panel")
    panel.start()
    panel.join(PATIENT_S)
    assert desk.state(AIR) is UNACKNOWLEDGED
    desk.scan(AIR)
    assert desk.state(AIR) is ACKNOWLEDGED
    assert told_in == [threading.current_thread().name]


# shelving


def test_a_shelf_ends_by_itself_at_its_time_and_not_before() -> None:
    desk = Desk()
    desk.scan(WARNING)
    desk.list.shelve(WARNING, SHELF_MS, by="Li")
    desk.scan(WARNING)
    until_ms = desk.now_ms + SHELF_MS
    row = desk.row(WARNING)
    assert row is not None
    assert row.shelved_until_ms == desk.changes[-1].shelved_until_ms == until_ms
    desk.scan(WARNING, after_ms=SHELF_MS - 1)
    assert desk.state(WARNING) is SHELVED
    desk.scan(WARNING, after_ms=1)
    last = desk.changes[-1]
    assert (last.at_ms, last.before, last.after, last.by) == (until_ms, SHELVED, UNACKNOWLEDGED, None)
    assert last.shelved_until_ms is None


def test_a_shelf_ends_on_a_machine_without_any_alarm() -> None:
    desk = Desk()
    desk.list.shelve(WARNING, LONGEST_SHELF_MS, by="Li")
    desk.scan()
    desk.scan(after_ms=LONGEST_SHELF_MS)
    assert desk.list.rows() == ()
    assert [(change.before, change.after) for change in desk.changes] == [(NORMAL, SHELVED), (SHELVED, NORMAL)]


def test_shelving_and_unshelving_are_told_with_who() -> None:
    desk = Desk()
    play(desk, WARNING, ["come", "shelve", "unshelve"])
    told = [(change.after, change.by) for change in desk.changes]
    assert told == [(UNACKNOWLEDGED, None), (SHELVED, "Li"), (UNACKNOWLEDGED, "Li")]


def test_shelving_again_begins_the_time_anew_and_is_told() -> None:
    desk = Desk()
    for who in ("Li", "Wang"):
        desk.list.shelve(WARNING, SHELF_MS, by=who)
        desk.scan(WARNING)
    assert [(c.before, c.after, c.by, c.shelved_until_ms) for c in desk.changes] == [
        (NORMAL, SHELVED, "Li", SHELF_MS),
        (SHELVED, SHELVED, "Wang", SHELF_MS + 10),
    ]
    desk.scan(WARNING, after_ms=SHELF_MS - 1)
    assert desk.state(WARNING) is SHELVED
    desk.scan(WARNING, after_ms=1)
    assert desk.state(WARNING) is UNACKNOWLEDGED


REFUSED = [
    pytest.param(lambda list_: list_.shelve(E_STOP, SHELF_MS, by="Li"), "S900 is a safety alarm", id="safety"),
    pytest.param(lambda list_: list_.shelve(AIR, SHELF_MS, by="Li"), "S920 stops work", id="stops work"),
    pytest.param(lambda list_: list_.shelve(WARNING, 0, by="Li"), "an alarm is shelved for 1 ms to 8 h", id="no time"),
    pytest.param(lambda list_: list_.shelve(WARNING, LONGEST_SHELF_MS + 1, by="Li"), "an alarm is", id="too long"),
    pytest.param(lambda list_: list_.shelve(999, SHELF_MS, by="Li"), "there is no alarm S999", id="shelve unknown"),
    pytest.param(lambda list_: list_.unshelve(999, by="Li"), "there is no alarm S999", id="unshelve unknown"),
    pytest.param(lambda list_: list_.acknowledge(999, by="Li"), "there is no alarm S999", id="acknowledge unknown"),
    pytest.param(lambda list_: list_.shelve(WARNING, SHELF_MS, by=""), "say who does it", id="nobody shelves"),
    pytest.param(lambda list_: list_.unshelve(WARNING, by=" "), "say who does it", id="nobody unshelves"),
    pytest.param(lambda list_: list_.acknowledge(by=""), "say who does it", id="nobody acknowledges"),
]


@pytest.mark.parametrize(("action", "reason"), REFUSED)
def test_what_may_not_be_is_refused_with_a_reason_and_changes_nothing(
    action: Callable[[AlarmList], None], reason: str
) -> None:
    desk = Desk()
    desk.scan(E_STOP, AIR, WARNING)
    rows, told = desk.list.rows(), len(desk.changes)
    with pytest.raises(AlarmRefusalError, match=f"^{reason}") as refusal:
        action(desk.list)
    desk.scan(E_STOP, AIR, WARNING)
    assert (desk.list.rows(), len(desk.changes)) == (rows, told)
    assert refusal.value.reason.en == str(refusal.value)
    assert "{" not in refusal.value.reason.en + refusal.value.reason.zh


# order and first-out


def test_the_first_out_leads_then_the_unacknowledged_by_severity() -> None:
    desk = Desk()
    desk.scan(AIR)
    desk.scan(AIR, E_STOP, WARNING)
    assert (desk.order(), desk.first_out()) == ([AIR, E_STOP, WARNING], [AIR])
    desk.list.acknowledge(E_STOP, by="Li")
    desk.list.shelve(EMPTY, SHELF_MS, by="Li")
    desk.scan(AIR, E_STOP, WARNING)
    assert desk.order() == [AIR, WARNING, E_STOP, EMPTY]
    desk.scan(AIR, WARNING, JAM)
    assert desk.state(E_STOP) is LATCHED_ACKNOWLEDGED
    assert desk.order() == [AIR, JAM, WARNING, E_STOP, EMPTY]


def test_what_went_unacknowledged_comes_after_what_is_active() -> None:
    desk = Desk()
    desk.scan(AIR)
    desk.scan(AIR, E_STOP, JAM)
    desk.list.acknowledge(E_STOP, by="Li")
    desk.scan(AIR, E_STOP, WARNING, reset=True)
    assert (desk.state(JAM), desk.state(E_STOP)) == (RETURNED, ACKNOWLEDGED)
    assert desk.order() == [AIR, WARNING, JAM, E_STOP]


def test_the_first_out_mark_stays_past_the_reset() -> None:
    """Given a stop that was reset before anybody acknowledged it, then it keeps its mark until it leaves the list."""
    desk = Desk()
    desk.scan(AIR, WARNING)
    desk.scan(JAM, WARNING)
    desk.scan(WARNING, reset=True)
    assert (desk.state(AIR), desk.first_out()) == (RETURNED, [AIR])
    desk.list.acknowledge(AIR, by="Li")
    desk.scan(WARNING)
    assert (desk.state(JAM), desk.first_out()) == (RETURNED, [])


def test_a_new_episode_takes_the_mark() -> None:
    desk = Desk()
    desk.scan(AIR)
    desk.scan(reset=True)
    assert desk.first_out() == [AIR]
    desk.scan(E_STOP)
    assert desk.first_out() == [E_STOP]


def test_a_snapshot_does_not_change_with_the_list() -> None:
    desk = Desk()
    desk.scan(AIR)
    rows = desk.list.rows()
    desk.list.acknowledge(by="Li")
    desk.scan(AIR)
    assert [row.state for row in rows] == [UNACKNOWLEDGED]


def test_after_a_restart_what_is_still_set_is_announced_anew_and_nothing_is_shelved() -> None:
    desk = Desk()
    desk.scan(WARNING, EMPTY)
    desk.list.shelve(EMPTY, SHELF_MS, by="Li")
    desk.list.acknowledge(WARNING, by="Li")
    desk.scan(WARNING, EMPTY)
    desk.list = AlarmList(SMALL, FIRST_OUT, desk.changes.append)
    desk.scan(WARNING, EMPTY)
    assert [desk.state(number) for number in (WARNING, EMPTY)] == [UNACKNOWLEDGED] * 2


# anything that operators and a machine may do

NUMBERS = st.sampled_from(sorted(CAUSES))
DEEDS = st.one_of(
    st.tuples(st.just("scan"), st.sets(NUMBERS), st.booleans(), st.sampled_from([10, SHELF_MS])),
    st.tuples(st.just("acknowledge"), st.none() | NUMBERS),
    st.tuples(st.just("shelve"), NUMBERS, st.sampled_from([1, SHELF_MS])),
    st.tuples(st.just("unshelve"), NUMBERS),
)
TO_BE_SEEN = {UNACKNOWLEDGED, RETURNED, LATCHED}


def do(desk: Desk, deed: tuple[Any, ...]) -> None:
    """Do what a machine or an operator may; shelving what stops work must be refused."""
    match deed:
        case ("scan", causes, reset, after_ms):
            desk.scan(*causes, reset=reset, after_ms=after_ms)
        case ("acknowledge", number):
            desk.list.acknowledge(number, by="Li")
        case ("shelve", number, for_ms) if number in STOPPING:
            with pytest.raises(AlarmRefusalError):
                desk.list.shelve(number, for_ms, by="Li")
        case ("shelve", number, for_ms):
            desk.list.shelve(number, for_ms, by="Li")
        case ("unshelve", number):
            desk.list.unshelve(number, by="Li")


@THOROUGH
@given(st.lists(DEEDS, max_size=40))
def test_whatever_is_done_no_alarm_is_lost_and_no_stop_is_shelved(deeds: list[tuple[Any, ...]]) -> None:
    """Given any deeds, then what is told is a chain, what is set is listed, and only people end the unseen."""
    desk, states = Desk(), dict.fromkeys(CAUSES, NORMAL)
    for deed in deeds:
        told = len(desk.changes)
        do(desk, deed)
        for change in desk.changes[told:]:
            assert change.before == states[change.number]
            assert change.before != change.after or change.after is SHELVED
            assert change.after is not SHELVED or (change.by == "Li" and change.number not in STOPPING)
            assert change.before not in TO_BE_SEEN or change.after in TO_BE_SEEN or change.by == "Li"
            states[change.number] = change.after
        rows = desk.list.rows()
        assert {row.alarm.bit.number: row.state for row in rows} == {n: a for n, a in states.items() if a is not NORMAL}
        assert set(desk.bench.plc.annunciators()) <= {row.alarm.bit.number for row in rows}
        assert [row for row in rows if row.shelved_until_ms is not None and row.shelved_until_ms <= desk.now_ms] == []
