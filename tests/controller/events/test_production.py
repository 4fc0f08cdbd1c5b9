"""Production log: reports of states, alarms, questions, cycles and trays."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import pytest

from controller.core.retentive_store import MemoryStore
from controller.events.kinds import (
    AlarmEvent,
    CycleEvent,
    Event,
    ModeEvent,
    NextPressEvent,
    QuestionEvent,
    RefusalEvent,
    RowEvent,
    StateEvent,
    TrayEvent,
    as_record,
)
from controller.events.production import ProductionLog
from controller.program.operator.next_press import NextPress
from controller.program.operator.refusals import Refusal
from controller.program.states import Mode, State
from controller.program.tags import ROWS, SIDES, Side
from controller.program.texts.next_press import NEXT_PRESSES
from controller.program.texts.operator import QUESTIONS, Text
from controller.program.texts.operator import SIDES as SIDE_TEXTS
from plant_sim.faults import parse_fault
from plant_sim.twin.ending.reported import ReportedEvents
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import home_again, repair
from tests.controller.program.recovery.test_ways_out import power_lost_clamping
from tests.plant_sim.twin.twin_rig import (
    ALARM,
    TRAY_MS,
    ChangeRecorder,
    at_work,
    free,
    go_on,
    switched_on,
    to_complete,
    until_picking,
    until_step,
)


class Run(NamedTuple):
    """Run that empties one tray, with its recorded outputs."""

    twin: Twin
    outputs: ChangeRecorder


@cache
def tray_run() -> Run:
    """Return an undisturbed run that empties one of two trays."""
    twin = switched_on({"trays_target": 1}, trays=2)
    outputs = ChangeRecorder.of_outputs(twin)
    twin.home()
    twin.start()
    to_complete(twin)
    return Run(twin, outputs)


def states(twin: Twin) -> list[State]:
    return [State(event.state) for event in twin.events if isinstance(event, StateEvent)]


def trays(twin: Twin) -> list[int]:
    return [event.trays_done for event in twin.events if isinstance(event, TrayEvent)]


def questions(twin: Twin, *names: str) -> list[QuestionEvent]:
    return [event for event in twin.events if isinstance(event, QuestionEvent) and event.question in names]


# undisturbed run


def test_each_state_is_reported_once_in_order() -> None:
    s = State
    twin = tray_run().twin
    assert states(twin) == [s.STOPPED, s.RESETTING, s.IDLE, s.STARTING, s.EXECUTE, s.COMPLETING, s.COMPLETE]
    texts = [event.text.en for event in twin.events if isinstance(event, StateEvent)]
    assert texts == ["Stopped", "Resetting", "Idle", "Starting", "Execute", "Completing", "Complete"]


def test_events_are_flat_records_in_chronological_order() -> None:
    events = tray_run().twin.events
    times = [event.at_ms for event in events]
    assert times == sorted(times)
    records = [as_record(event) for event in events]
    assert json.loads(json.dumps(records)) == records
    assert {record["event"] for record in records} == {"state", "question", "next", "cycle", "row", "tray"}


def test_an_event_occurs_only_after_a_scan_in_which_a_device_of_the_log_changed() -> None:
    """Otherwise a run in machine code, which calls the log for these devices only, would report it late or never."""
    twin = power_lost_clamping("left")
    (log,) = (each for each in twin.runtime.observers if isinstance(each, ProductionLog))
    twin.runtime.panel.read()
    late: list[Event] = []
    values: list[int] = []
    reported = len(twin.events)

    def check(twin: Twin) -> None:
        nonlocal values, reported
        before, values = values, [twin.plc.read(device) for device in log.devices]
        if values == before:
            late.extend(twin.events[reported:])
        reported = len(twin.events)

    twin.watch(check)
    twin.press("start", for_ms=2_300)  # answers the question
    twin.run_for(3_000)
    for command in ("mode_step", "mode_continuous", "unhold"):  # the last one is refused
        twin.command(command)
        twin.run_for(100)
    assert home_again(twin) == {"tray"}
    twin.start()
    to_complete(twin)
    kinds = {type(event) for event in twin.events}
    assert {NextPressEvent, ModeEvent, RefusalEvent, QuestionEvent, RowEvent, TrayEvent, CycleEvent} <= kinds
    assert late == []


def test_the_rows_are_counted_without_the_load_assumed_at_the_start() -> None:
    """By the events of rows and of cycles, and by the registers that the panel shows."""
    twin = tray_run().twin
    for side in SIDES:
        rows = [event.rows for event in twin.events if isinstance(event, RowEvent) and event.side == side]
        assert rows == list(ROWS)
        assert [cycle.row for cycle in twin.cycles() if cycle.side == side] == list(ROWS)
        assert twin.plc.read(twin.machine.tags.arms[side].cycles) == len(ROWS)


def test_a_row_whose_cycle_is_interrupted_is_counted_once_everywhere() -> None:
    """The lift jams when the row has been released: its cycle has no time, its row counts everywhere."""
    twin = at_work({"trays_target": 1})
    arm = twin.machine.tags.arms["left"]
    twin.run_until(arm.cycles.equals(1), within_ms=TRAY_MS)
    fault = parse_fault("jammed:left.lift")
    twin.plant.faults.add(fault)
    twin.run_until_state(State.HELD, within_ms=TRAY_MS)
    repair(twin, fault)
    home_again(twin)
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=TRAY_MS)
    reported = ReportedEvents()
    for event in twin.events:
        reported.apply(as_record(event))
    counted = sum(twin.plc.read(each.cycles) for each in twin.machine.tags.arms.values())
    assert reported.rows == counted == len(ROWS) * len(SIDES)
    assert len(twin.cycles()) < counted


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("row", ROWS)
def test_a_cycle_lasts_from_leaving_feed_to_claws_converged_including_the_wait_over_the_cups(
    side: Side, row: int
) -> None:
    twin, outputs = tray_run()
    cycle = next(cycle for cycle in twin.cycles() if (cycle.side, cycle.row) == (side, row))
    span = (cycle.at_ms - cycle.cycle_ms, cycle.at_ms + 10)
    at_ms = {(change.name, change.on): change.at_ms for change in outputs.of(f"{side}.", *span)}
    began_ms = min(change.at_ms for change in outputs.of(f"{side}.slide_inward", *span) if change.on)
    assert cycle.at_ms - cycle.cycle_ms == began_ms
    assert cycle.at_ms == at_ms["converge", False]
    down_ms, released_ms = at_ms["lift_extend", False], at_ms["claws_open", True]
    assert cycle.waiting_ms == released_ms - (down_ms - 10)
    assert cycle.missed_cups == 0


def test_a_tray_is_reported_when_its_last_row_is_lifted() -> None:
    twin, outputs = tray_run()
    (tray,) = [event for event in twin.events if isinstance(event, TrayEvent)]
    lifts_ms = [change.at_ms for side in SIDES for change in outputs.of(f"{side}.lift_retract") if change.on]
    assert tray.trays_done == 1
    assert 60 <= tray.at_ms - max(lifts_ms) <= 400, "6 mm at 0.2 m/s, after the air under the piston is exhausted"


# a new run and a power loss


def test_neither_a_new_run_nor_a_power_loss_is_reported_as_a_tray() -> None:
    """Neither the reset of the tray count in a new run nor its restoration after a power loss is reported as a tray."""
    twin = at_work({"trays_target": 1}, trays=2)
    to_complete(twin)
    twin.home()
    assert (trays(twin), twin.plc.read(twin.machine.tags.machine.trays_done)) == ([1], 0)
    twin.start()
    to_complete(twin)
    twin.power_cycle()
    twin.run_for(1_000)
    assert (trays(twin), twin.plc.read(twin.machine.tags.machine.trays_done)) == ([1, 1], 1)


def test_the_count_reset_clears_trays_cycles_and_missed_cups() -> None:
    twin = at_work({"trays_target": 1, "descend_at_count": 12})
    to_complete(twin)
    tags = twin.machine.tags
    words = [tags.machine.trays_done, *(w for arm in tags.arms.values() for w in (arm.cycles, arm.missed_cups))]
    assert [twin.plc.read(word) for word in words] == [1, 3, 3, 3, 3]
    twin.command("count_reset")
    twin.scan()
    assert [twin.plc.read(word) for word in words] == [0] * 5
    assert trays(twin) == [1]


# aborted cycles


def abort_by_emergency_stop(twin: Twin) -> None:
    twin.press("emergency_stop")
    twin.run_for(500)
    twin.command("clear")
    twin.run_for(100)


def abort_by_jam(twin: Twin) -> None:
    twin.plant.left.slide.jammed = True
    twin.run_until_state(State.HELD, within_ms=20_000)
    free(twin.plant.left.slide)


def abort_by_power_cycle(twin: Twin) -> None:
    twin.power_cycle()
    twin.scan()


@pytest.mark.parametrize(
    ("abort", "asked"),
    [(abort_by_emergency_stop, {"tray"}), (abort_by_jam, set()), (abort_by_power_cycle, {"tray"})],
)
def test_an_aborted_cycle_is_not_reported(abort: Callable[[Twin], None], asked: set[str]) -> None:
    """If both arms are stopped while carrying their first rows to feed, these rows are not reported as cycles."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", "slide to feed")
    abort(twin)
    assert home_again(twin) == asked
    twin.start()
    to_complete(twin)
    for side in SIDES:
        assert [cycle.row for cycle in twin.cycles() if cycle.side == side] == [2, 3]


def test_a_cycle_with_a_parked_row_is_not_reported() -> None:
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", "wait for cups")
    twin.plant.planting_frequency_per_min = 0.0
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=10_000)
    twin.plant.planting_frequency_per_min = 45.0
    go_on(twin)
    to_complete(twin)
    assert sorted(cycle.row for cycle in twin.cycles()) == [2, 2, 3, 3]


def test_a_cycle_finished_by_a_stop_is_reported() -> None:
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=30_000)
    assert sorted((cycle.side, cycle.row) for cycle in twin.cycles()) == [("left", 1), ("right", 1)]


# operator actions


def test_a_mode_change_and_a_refusal_with_its_reason_are_reported() -> None:
    twin = switched_on()
    for command in ("mode_manual", "mode_one_cycle", "mode_one_cycle", "start"):
        twin.command(command)
        twin.scan()
    reported = [event for event in twin.events if isinstance(event, ModeEvent | RefusalEvent)]
    assert reported == [
        ModeEvent(20, Mode.MANUAL, Text("manual", "手动")),
        ModeEvent(30, Mode.ONE_CYCLE, Text("one cycle", "单周期")),
        RefusalEvent(
            50,
            "start",
            Refusal.NOT_IDLE,
            Text("cannot start: the machine is not in Idle or Suspended", "无法启动：机器不在待机或暂挂状态"),
            Text("press X0 to reset and home (mode: one cycle)", "按 X0 复位并回原点（模式：单周期）"),
        ),
    ]


# alarms and questions


def test_an_alarm_is_reported_when_it_is_set_and_when_it_is_reset() -> None:
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    limit = twin.machine.cycles["left"].steps[1].watch
    assert limit is not None
    twin.plant.left.slide.jammed = True
    twin.run_until(ALARM, within_ms=6_000)
    came_ms = twin.now_ms - 10
    twin.run_until_state(State.HELD, within_ms=20_000)
    twin.plant.left.slide.jammed = False
    twin.press("start")
    twin.run_until_state(State.RESETTING, within_ms=50)
    went_ms = twin.now_ms - 10
    text = Text("left slide did not reach the row", "左滑块未到达取苗位")
    number = limit.alarm.number
    assert twin.alarm_events() == [
        AlarmEvent(came_ms, number, active=True, text=text),
        AlarmEvent(went_ms, number, active=False, text=text),
    ]
    chinese = [event.text.zh for event in twin.events if isinstance(event, StateEvent)]
    assert chinese[-3:] == ["保持中", "已保持", "复位中"]


def test_the_warning_of_machine_constants_names_those_that_differ() -> None:
    """At its end, when a tool has written the default back, none differs."""
    twin = switched_on()
    for value in (15, 20):
        twin.plc.write(twin.machine.tags.sp.clamp, value)
        twin.run_for(20)
    text = "A machine constant differs from its default"
    assert [(each.active, each.text.en) for each in twin.alarm_events()] == [
        (True, f"{text}: clamp 15 (default 20)"),
        (False, text),
    ]
    text = "机器常数与默认值不同"
    assert [each.text.zh for each in twin.alarm_events()] == [f"{text}：clamp 15（默认值 20）", text]


def test_a_question_is_reported_when_it_is_asked_and_when_it_is_answered() -> None:
    """After a power loss while the claws are closing, the operator is asked whether the arm holds the row."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", "close claws")
    twin.power_cycle()
    twin.run_until(lambda: twin.plc.read(twin.machine.tags.arms["left"].ask) == 1, within_ms=50)
    asked_ms = twin.now_ms - 10
    twin.run_for(500)
    twin.command("left_loaded_yes")
    answered_ms = twin.now_ms + 10  # the question is cleared one scan after the stored row has changed
    twin.run_for(20)
    text = QUESTIONS["loaded"].of(SIDE_TEXTS["left"])
    assert text.en == "Is the left arm holding seedlings?"
    assert questions(twin, "left_loaded") == [
        QuestionEvent(asked_ms, "left_loaded", active=True, text=text),
        QuestionEvent(answered_ms, "left_loaded", active=False, text=text),
    ]


def test_the_cup_question_is_asked_once_over_the_cups_until_it_is_answered() -> None:
    """For the first row after power-up, the cup question is asked after the claws spread and remains until answered."""
    twin = at_work({"trays_target": 1})
    twin.run_until(lambda: bool(questions(twin, "right_cups")), within_ms=10_000)
    assert twin.in_step("right arm", "wait to lower") or twin.in_step("right arm", "lower over cups")
    until_step(twin, "right arm", "wait for cups")
    twin.run_for(500)
    assert [event.active for event in questions(twin, "right_cups")] == [True]
    twin.command("cups_empty")
    twin.scan()
    assert [event.active for event in questions(twin, "right_cups")] == [True, False]
    text = "Are the cups under the claws of both arms empty? If not confirmed, twelve cups must pass first"
    assert {event.text.en for event in questions(twin, "right_cups")} == {text}
    to_complete(twin)
    assert len(questions(twin, "left_cups")) == len(questions(twin, "right_cups")) == 2


def test_twelve_passed_cups_also_answer_the_cup_question() -> None:
    twin = at_work({"trays_target": 1})
    tags = twin.machine.tags.arms["left"]
    twin.run_until(lambda: bool(twin.plc.read(tags.cup_counter.value) == 11), within_ms=20_000)
    assert [event.active for event in questions(twin, "left_cups")] == [True]
    until_step(twin, "left arm", "release delay", within_ms=2_000)
    twin.run_for(20)
    assert [event.active for event in questions(twin, "left_cups")] == [True, False]


def test_the_tray_question_is_reported() -> None:
    twin = at_work({"trays_target": 1})
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=30_000)
    twin.store = MemoryStore()
    twin.power_cycle()
    twin.scan()
    twin.press("start")
    twin.run_until_state(State.HELD, within_ms=15_000)
    assert [event.active for event in questions(twin, "tray")] == [True]
    twin.command("tray_full")
    twin.scan()
    assert [event.active for event in questions(twin, "tray")] == [True, False]
    assert isinstance(twin.events[-2], QuestionEvent)
    assert twin.events[-1] == NextPressEvent(twin.events[-2].at_ms, NextPress.HOME, NEXT_PRESSES[NextPress.HOME])
