"""Alarm list: ISA-18.2 states, acknowledging, shelving, first-out and reported changes."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.events.alarm_list import LONGEST_SHELF_MS, AlarmChange, AlarmList, AlarmRefusalError
from controller.events.alarm_states import AlarmState
from controller.events.kinds import as_record
from controller.program.texts.alarms.messages import ALARMS
from tests.controller.core.core_rig import PATIENT_S, THOROUGH
from tests.controller.events.alarm_rig import (
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
    AlarmRig,
)

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
    pytest.param(WARNING, "come:U acknowledge:A go:LA reset:N", id="normal sequence"),
    pytest.param(WARNING, "come:U acknowledge:A reset:A go:LA", id="reset too early"),
    pytest.param(WARNING, "come:U go:L acknowledge:LA reset:N", id="cleared before acknowledgement"),
    pytest.param(WARNING, "come:U go:L reset:R acknowledge:N", id="reset before acknowledgement"),
    pytest.param(WARNING, "come:U go:L come:U", id="recurs while latched"),
    pytest.param(WARNING, "come:U go:L acknowledge:LA come:U", id="recurs while latched and acknowledged"),
    pytest.param(WARNING, "come:U go:L reset:R come:U", id="recurs before acknowledgement"),
    pytest.param(EMPTY, "come:U acknowledge:A go:N", id="clears itself, acknowledged"),
    pytest.param(EMPTY, "come:U go:R acknowledge:N", id="clears itself, not acknowledged"),
    pytest.param(JAM, "come:L go:L acknowledge:LA reset:N", id="without a cause"),
    pytest.param(JAM, "come:L go:L reset:R acknowledge:N", id="without a cause, reset before acknowledgement"),
    pytest.param(WARNING, "shelve:S unshelve:N", id="shelved while normal"),
    pytest.param(WARNING, "shelve:S come:S acknowledge:S go:S reset:S wait:N", id="came and was reset while shelved"),
    pytest.param(WARNING, "shelve:S come:S go:S wait:L", id="came while shelved"),
    pytest.param(WARNING, "come:U shelve:S unshelve:U", id="unshelved"),
    pytest.param(WARNING, "come:U acknowledge:A shelve:S wait:U", id="unacknowledged again after shelving"),
    pytest.param(WARNING, "come:U go:L reset:R shelve:S wait:N", id="shelved after the reset"),
    pytest.param(WARNING, "come:U unshelve:U acknowledge:A unshelve:A", id="was not shelved"),
]


def play(rig: AlarmRig, number: int, actions: Iterable[str]) -> list[AlarmState]:
    """Perform one action per scan on one alarm or its cause, and return the state of the alarm after each scan."""
    present, states = False, []
    for action in actions:
        present = {"come": True, "go": False}.get(action, present)
        if action == "acknowledge":
            rig.list.acknowledge(number, by="Li")
        elif action == "shelve":
            rig.list.shelve(number, SHELF_MS, by="Li")
        elif action == "unshelve":
            rig.list.unshelve(number, by="Li")
        causes = (number,) if present else ()
        rig.scan(*causes, reset=action == "reset", after_ms=SHELF_MS if action == "wait" else None)
        states.append(rig.state(number))
    return states


@pytest.mark.parametrize(("number", "sequence"), CHART)
def test_states_follow_the_chart(number: int, sequence: str) -> None:
    """After each action (one per scan), the alarm is in the state given after the colon."""
    pairs = [word.split(":") for word in sequence.split()]
    assert play(AlarmRig(), number, [action for action, _ in pairs]) == [STATES[state] for _, state in pairs]


# reported changes


def test_every_change_is_reported_once_with_operator_and_time() -> None:
    """An alarm that is raised, acknowledged and cleared causes three reports, regardless of the number of scans."""
    rig = AlarmRig()
    rig.scan()
    for _ in range(2):
        rig.scan(EMPTY)
    rig.list.acknowledge(EMPTY, by="Li")
    for _ in range(2):
        rig.scan(EMPTY)
    for _ in range(2):
        rig.scan()
    message = ALARMS["magazine_empty"].message
    assert rig.changes == [
        AlarmChange(10, EMPTY, "magazine_empty", NORMAL, UNACKNOWLEDGED, None, message),
        AlarmChange(30, EMPTY, "magazine_empty", UNACKNOWLEDGED, ACKNOWLEDGED, "Li", message),
        AlarmChange(50, EMPTY, "magazine_empty", ACKNOWLEDGED, NORMAL, None, message),
    ]


def test_changes_are_flat_records_in_the_selected_language() -> None:
    rig = AlarmRig()
    rig.scan(EMPTY)
    record = as_record(rig.changes[0], "zh")
    assert json.loads(json.dumps(record)) == record
    assert (record["event"], record["before"], record["after"]) == ("alarm_state", "normal", "unacknowledged")
    assert record["text"] == ALARMS["magazine_empty"].message.zh


def test_simultaneous_alarms_are_reported_by_severity() -> None:
    rig = AlarmRig()
    rig.scan(EMPTY, JAM, E_STOP)
    assert [change.number for change in rig.changes] == [E_STOP, JAM, EMPTY]


@pytest.mark.parametrize(
    ("sequence", "times_ms"),
    [
        ("come", (10, None, None)),
        ("come acknowledge acknowledge", (10, None, 20)),
        ("come acknowledge go", (10, 30, 20)),
        ("come acknowledge go come", (40, None, None)),
    ],
)
def test_rows_contain_the_times_of_activation_clearing_and_acknowledgement(
    sequence: str, times_ms: tuple[int | None, int | None, int | None]
) -> None:
    rig = AlarmRig()
    rig.scan()
    play(rig, WARNING, sequence.split())
    row = rig.row(WARNING)
    assert row is not None
    assert (row.came_ms, row.went_ms, row.acknowledged_ms) == times_ms


# acknowledging


def test_acknowledging_all_affects_all_listed_alarms_except_shelved_ones() -> None:
    rig = AlarmRig()
    rig.scan(AIR, WARNING, EMPTY)
    rig.list.shelve(WARNING, SHELF_MS, by="Li")
    rig.list.acknowledge(by="Li")
    rig.scan(AIR, WARNING, EMPTY)
    assert [rig.state(number) for number in (AIR, WARNING, EMPTY)] == [ACKNOWLEDGED, SHELVED, ACKNOWLEDGED]
    rig.list.acknowledge(by="Wang")
    rig.scan(AIR, WARNING, EMPTY)
    assert "Wang" not in {change.by for change in rig.changes}
    assert [row.acknowledged_ms for row in rig.list.rows() if row.state is SHELVED] == [None]


def test_an_alarm_of_the_same_scan_is_not_acknowledged() -> None:
    """An alarm that is raised in the scan that executes 'acknowledge all' stays unacknowledged."""
    rig = AlarmRig()
    rig.scan(AIR)
    rig.list.acknowledge(by="Li")
    rig.scan(AIR, EMPTY)
    assert (rig.state(AIR), rig.state(EMPTY)) == (ACKNOWLEDGED, UNACKNOWLEDGED)


def test_actions_of_another_thread_take_effect_in_the_next_scan() -> None:
    rig = AlarmRig()
    rig.scan(AIR)
    reporting_threads: list[str] = []
    rig.list._report = lambda _: reporting_threads.append(threading.current_thread().name)
    panel = threading.Thread(target=rig.list.acknowledge, kwargs={"by": "Li"}, name="panel")
    panel.start()
    panel.join(PATIENT_S)
    assert rig.state(AIR) is UNACKNOWLEDGED
    rig.scan(AIR)
    assert rig.state(AIR) is ACKNOWLEDGED
    assert reporting_threads == [threading.current_thread().name]


# shelving


def test_shelving_ends_automatically_at_its_time_and_not_before() -> None:
    rig = AlarmRig()
    rig.scan(WARNING)
    rig.list.shelve(WARNING, SHELF_MS, by="Li")
    rig.scan(WARNING)
    until_ms = rig.now_ms + SHELF_MS
    row = rig.row(WARNING)
    assert row is not None
    assert row.shelved_until_ms == rig.changes[-1].shelved_until_ms == until_ms
    rig.scan(WARNING, after_ms=SHELF_MS - 1)
    assert rig.state(WARNING) is SHELVED
    rig.scan(WARNING, after_ms=1)
    last = rig.changes[-1]
    assert (last.at_ms, last.before, last.after, last.by) == (until_ms, SHELVED, UNACKNOWLEDGED, None)
    assert last.shelved_until_ms is None


def test_shelving_ends_on_a_machine_without_alarms() -> None:
    rig = AlarmRig()
    rig.list.shelve(WARNING, LONGEST_SHELF_MS, by="Li")
    rig.scan()
    rig.scan(after_ms=LONGEST_SHELF_MS)
    assert rig.list.rows() == ()
    assert [(change.before, change.after) for change in rig.changes] == [(NORMAL, SHELVED), (SHELVED, NORMAL)]


def test_shelving_and_unshelving_are_reported_with_the_operator() -> None:
    rig = AlarmRig()
    play(rig, WARNING, ["come", "shelve", "unshelve"])
    reported = [(change.after, change.by) for change in rig.changes]
    assert reported == [(UNACKNOWLEDGED, None), (SHELVED, "Li"), (UNACKNOWLEDGED, "Li")]


def test_shelving_again_restarts_the_time_and_is_reported() -> None:
    rig = AlarmRig()
    for who in ("Li", "Wang"):
        rig.list.shelve(WARNING, SHELF_MS, by=who)
        rig.scan(WARNING)
    assert [(c.before, c.after, c.by, c.shelved_until_ms) for c in rig.changes] == [
        (NORMAL, SHELVED, "Li", SHELF_MS),
        (SHELVED, SHELVED, "Wang", SHELF_MS + 10),
    ]
    rig.scan(WARNING, after_ms=SHELF_MS - 1)
    assert rig.state(WARNING) is SHELVED
    rig.scan(WARNING, after_ms=1)
    assert rig.state(WARNING) is UNACKNOWLEDGED


REFUSED = [
    pytest.param(lambda list_: list_.shelve(E_STOP, SHELF_MS, by="Li"), "S900 is a safety alarm", id="safety"),
    pytest.param(lambda list_: list_.shelve(AIR, SHELF_MS, by="Li"), "S920 stops the machine", id="stops work"),
    pytest.param(lambda list_: list_.shelve(WARNING, 0, by="Li"), "the shelving time must be", id="no time"),
    pytest.param(lambda list_: list_.shelve(WARNING, LONGEST_SHELF_MS + 1, by="Li"), "the shelving time", id="long"),
    pytest.param(lambda list_: list_.shelve(999, SHELF_MS, by="Li"), "unknown alarm S999", id="shelve unknown"),
    pytest.param(lambda list_: list_.unshelve(999, by="Li"), "unknown alarm S999", id="unshelve unknown"),
    pytest.param(lambda list_: list_.acknowledge(999, by="Li"), "unknown alarm S999", id="acknowledge unknown"),
    pytest.param(lambda list_: list_.shelve(WARNING, SHELF_MS, by=""), "operator name required", id="shelve"),
    pytest.param(lambda list_: list_.unshelve(WARNING, by=" "), "operator name required", id="unshelve without name"),
    pytest.param(lambda list_: list_.acknowledge(by=""), "operator name required", id="acknowledge without name"),
]


@pytest.mark.parametrize(("action", "reason"), REFUSED)
def test_a_forbidden_action_is_refused_with_a_reason_and_has_no_effect(
    action: Callable[[AlarmList], None], reason: str
) -> None:
    rig = AlarmRig()
    rig.scan(E_STOP, AIR, WARNING)
    rows, count = rig.list.rows(), len(rig.changes)
    with pytest.raises(AlarmRefusalError, match=f"^{reason}") as refusal:
        action(rig.list)
    rig.scan(E_STOP, AIR, WARNING)
    assert (rig.list.rows(), len(rig.changes)) == (rows, count)
    assert refusal.value.reason.en == str(refusal.value)
    assert "{" not in refusal.value.reason.en + refusal.value.reason.zh


# order and first-out


def test_the_first_out_is_listed_first_then_the_unacknowledged_by_severity() -> None:
    rig = AlarmRig()
    rig.scan(AIR)
    rig.scan(AIR, E_STOP, WARNING)
    assert (rig.order(), rig.first_out()) == ([AIR, E_STOP, WARNING], [AIR])
    rig.list.acknowledge(E_STOP, by="Li")
    rig.list.shelve(EMPTY, SHELF_MS, by="Li")
    rig.scan(AIR, E_STOP, WARNING)
    assert rig.order() == [AIR, WARNING, E_STOP, EMPTY]
    rig.scan(AIR, WARNING, JAM)
    assert rig.state(E_STOP) is LATCHED_ACKNOWLEDGED
    assert rig.order() == [AIR, JAM, WARNING, E_STOP, EMPTY]


def test_returned_unacknowledged_alarms_are_listed_after_active_ones() -> None:
    """After the reset, E_STOP is the most severe of the alarms that remain and thus the first-out."""
    rig = AlarmRig()
    rig.scan(AIR)
    rig.scan(AIR, E_STOP, JAM)
    rig.list.acknowledge(AIR, by="Li")
    rig.scan(AIR, E_STOP, WARNING, reset=True)
    assert (rig.state(JAM), rig.state(AIR)) == (RETURNED, ACKNOWLEDGED)
    assert rig.order() == [E_STOP, WARNING, JAM, AIR]


def test_the_first_out_mark_is_retained_after_the_reset() -> None:
    """An alarm that is reset before it is acknowledged retains the first-out mark until it leaves the list."""
    rig = AlarmRig()
    rig.scan(AIR, WARNING)
    rig.scan(JAM, WARNING)
    rig.scan(WARNING, reset=True)
    assert (rig.state(AIR), rig.first_out()) == (RETURNED, [AIR])
    rig.list.acknowledge(AIR, by="Li")
    rig.scan(WARNING)
    assert (rig.state(JAM), rig.first_out()) == (RETURNED, [])


def test_a_new_episode_moves_the_first_out_mark() -> None:
    rig = AlarmRig()
    rig.scan(AIR)
    rig.scan(reset=True)
    assert rig.first_out() == [AIR]
    rig.scan(E_STOP)
    assert rig.first_out() == [E_STOP]


def test_a_snapshot_does_not_change_with_the_list() -> None:
    rig = AlarmRig()
    rig.scan(AIR)
    rows = rig.list.rows()
    rig.list.acknowledge(by="Li")
    rig.scan(AIR)
    assert [row.state for row in rows] == [UNACKNOWLEDGED]


def test_after_a_restart_set_alarms_are_unacknowledged_and_nothing_is_shelved() -> None:
    rig = AlarmRig()
    rig.scan(WARNING, EMPTY)
    rig.list.shelve(EMPTY, SHELF_MS, by="Li")
    rig.list.acknowledge(WARNING, by="Li")
    rig.scan(WARNING, EMPTY)
    rig.list = AlarmList(SMALL, FIRST_OUT, rig.changes.append)
    rig.scan(WARNING, EMPTY)
    assert [rig.state(number) for number in (WARNING, EMPTY)] == [UNACKNOWLEDGED] * 2


# random actions of operators and the machine

NUMBERS = st.sampled_from(sorted(CAUSES))
ACTIONS = st.one_of(
    st.tuples(st.just("scan"), st.sets(NUMBERS), st.booleans(), st.sampled_from([10, SHELF_MS])),
    st.tuples(st.just("acknowledge"), st.none() | NUMBERS),
    st.tuples(st.just("shelve"), NUMBERS, st.sampled_from([1, SHELF_MS])),
    st.tuples(st.just("unshelve"), NUMBERS),
)
NEED_ACKNOWLEDGEMENT = {UNACKNOWLEDGED, RETURNED, LATCHED}


def perform(rig: AlarmRig, action: tuple[Any, ...]) -> None:
    """Perform an action of the machine or of an operator; shelving an alarm that stops work must be refused."""
    match action:
        case ("scan", causes, reset, after_ms):
            rig.scan(*causes, reset=reset, after_ms=after_ms)
        case ("acknowledge", number):
            rig.list.acknowledge(number, by="Li")
        case ("shelve", number, for_ms) if number in STOPPING:
            with pytest.raises(AlarmRefusalError):
                rig.list.shelve(number, for_ms, by="Li")
        case ("shelve", number, for_ms):
            rig.list.shelve(number, for_ms, by="Li")
        case ("unshelve", number):
            rig.list.unshelve(number, by="Li")


@THOROUGH
@given(st.lists(ACTIONS, max_size=40))
def test_after_random_actions_no_alarm_is_lost_and_no_stopping_alarm_is_shelved(actions: list[tuple[Any, ...]]) -> None:
    """Reports start from the last reported state, active alarms are listed, and only operators acknowledge alarms."""
    rig, states = AlarmRig(), dict.fromkeys(CAUSES, NORMAL)
    for action in actions:
        count = len(rig.changes)
        perform(rig, action)
        for change in rig.changes[count:]:
            assert change.before == states[change.number]
            assert change.before != change.after or change.after is SHELVED
            assert change.after is not SHELVED or (change.by == "Li" and change.number not in STOPPING)
            assert (
                change.before not in NEED_ACKNOWLEDGEMENT or change.after in NEED_ACKNOWLEDGEMENT or change.by == "Li"
            )
            states[change.number] = change.after
        rows = rig.list.rows()
        assert {row.alarm.bit.number: row.state for row in rows} == {n: a for n, a in states.items() if a is not NORMAL}
        assert set(rig.core.plc.annunciators()) <= {row.alarm.bit.number for row in rows}
        assert [row for row in rows if row.shelved_until_ms is not None and row.shelved_until_ms <= rig.now_ms] == []
