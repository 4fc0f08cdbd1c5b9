"""Search, branches and commands on recorded runs of the twin, compared with a run whose values are all stored."""

from __future__ import annotations

from functools import cache

import pytest

from controller.common.errors import InputError
from controller.debug.commands import Debugger
from controller.debug.comparison import branch, differences_at, first_difference, outcomes, parse_change
from controller.debug.condition import parse_condition
from controller.debug.search import condition_changes, device_changes, first_met, following, last
from controller.debug.timeline import RunTimeline
from plant_sim.faults import parse_fault
from plant_sim.twin.debug.recorder import TwinRecorder
from plant_sim.twin.lock_step import SCAN_MS, Twin
from tests.sampling import one_in

NAMES = ("X1", "Y1", "M100", "D130", "TN206", "left.lift_up", "start", "C5")
CONDITION = "left.lift.position_m > 0.1 and not X1"
SCANS = 3_000


def played() -> RunTimeline:
    """Record a run in which the program holds because of a stuck switch."""
    twin = Twin(seed=2)
    recorder = TwinRecorder(twin)
    twin.home()
    twin.start()
    twin.plant.faults.add(parse_fault(f"stuck_off:left.lift_up@{twin.plant.time_ms + 2_000}ms.."))
    twin.run_for(SCANS * SCAN_MS - twin.now_ms)
    return recorder.close()


@cache
def recorded() -> tuple[RunTimeline, list[dict[str, object]]]:
    """Return a recorded run, and what some names and a condition have been after each scan."""
    line = played()
    machine = line.machine
    signals = {name: machine.signal(name) for name in NAMES}
    condition = parse_condition(CONDITION, machine.signal)
    rows: list[dict[str, object]] = []
    for scan in range(line.last + 1):
        line.seek(scan)
        rows.append({CONDITION: condition.holds()} | {name: signal.read() for name, signal in signals.items()})
    return line, rows


def changed(rows: list[dict[str, object]], name: str) -> list[int]:
    return [scan for scan in range(1, len(rows)) if rows[scan][name] != rows[scan - 1][name]]


@pytest.mark.parametrize("name", one_in(3, NAMES))
def test_every_change_of_a_device_is_found_from_everywhere(name: str) -> None:
    line, rows = recorded()
    find, scans = device_changes(line, [line.machine.signal(name)]), changed(rows, name)
    assert line.changes(0, line.last, [line.machine.signal(name)]) == scans
    for at in (0, 1, 777, 1_203, 2_400, line.last):
        assert last(line, find, at + 1) == max((scan for scan in scans if scan <= at), default=None)
        assert following(line, find, at) == min((scan for scan in scans if scan > at), default=None)


def test_every_change_of_a_condition_over_program_and_plant_is_found() -> None:
    line, rows = recorded()
    condition = parse_condition(CONDITION, line.machine.signal)
    find, scans = condition_changes(line, condition), changed(rows, CONDITION)
    assert len(scans) > 2
    for at in (0, 1_203, 2_400, line.last):
        assert last(line, find, at + 1) == max((scan for scan in scans if scan <= at), default=None)
        assert following(line, find, at) == min((scan for scan in scans if scan > at), default=None)
        met = [scan for scan in range(at + 1, len(rows)) if rows[scan][CONDITION]]
        assert first_met(line, condition, at) == min(met, default=None)


def test_a_pulse_of_one_scan_within_an_interval_is_found() -> None:
    line = played()
    pulsed = branch(line, parse_change("command=hold@2021"))  # the command relay is on in this scan only
    changes = pulsed.changes(pulsed.first, pulsed.last, [pulsed.machine.signal("hold_requested")])
    find = device_changes(pulsed, [pulsed.machine.signal("hold_requested")])
    assert changes[:2] == [2021, 2022]
    assert (last(pulsed, find, 2_400), last(pulsed, find, 2022)) == (2022, 2021)


def test_a_branch_differs_from_its_change_on_and_leaves_the_recorded_run_alone() -> None:
    line, rows = recorded()
    healed = branch(line, parse_change("mend=stuck_off:left.lift_up@1500"))
    assert (healed.first, healed.last) == (1_499, line.last)
    first = first_difference(line, healed)
    assert first is not None
    assert first.scan >= 1_500
    line.seek(first.scan - 1)
    before = line.machine.image("")
    healed.seek(first.scan - 1)
    assert healed.machine.image("") == before
    ends = {row.name: row for row in outcomes(line, healed)}
    assert ends["alarms"].recorded != "none"
    assert ends["alarms"].branched == "none"
    for scan in (0, 1_499, 1_700, line.last):
        line.seek(scan)
        assert {name: line.machine.signal(name).read() for name in NAMES} == {name: rows[scan][name] for name in NAMES}


def test_a_change_that_changes_nothing_makes_an_equal_run() -> None:
    line, rows = recorded()
    level = "on" if rows[1_000]["X1"] else "off"
    same = branch(line, parse_change(f"X1={level}@1001..1002"))
    assert first_difference(line, same) is None
    assert differences_at(line, same, line.last) == []


def test_a_changed_input_ends_with_its_last_scan() -> None:
    line, rows = recorded()
    on = "off" if rows[1_000]["X1"] else "on"
    line_1 = branch(line, parse_change(f"X1={on}@1001..1010"))
    changes = line_1.changes(1_000, 1_030, [line_1.machine.signal("X1")])
    assert len(changes) == 2
    assert changes[1] - changes[0] == 10


@pytest.mark.parametrize(
    ("change", "name", "scan"),
    [
        ("start=on@2500..2510", "X0", 2_502),
        ("command=hold@1300", "D100", 1_303),
        ("trays_target=3@2500", "trays_target", 2_500),
        ("fault=stuck_on:right.lift_down@2500..2600", "right.lift_down", 2_599),
    ],
)
def test_each_kind_of_change_acts(change: str, name: str, scan: int) -> None:
    line, _ = recorded()
    other = branch(line, parse_change(change))
    line.seek(scan)
    before = line.machine.signal(name).read()
    other.seek(scan)
    assert other.machine.signal(name).read() != before


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("nonsense", "no such command"),
        ("goto", "whole number"),
        ("goto 99999", "not recorded; choose one from 0 to 3000"),
        ("show M9999", "M9999: no such device; choose one from M0 to M8255"),
        ("show X8", "X8: no such device"),
        ("show left.lift.position", "did you mean left.lift.position_m"),
        ("last left.lift.position_m", "ask for a condition"),
        ("last", "write a device or a condition"),
        ("until X1 and", "ends too early"),
        ("until (X1", "closing parenthesis"),
        ("until left.lift.position_m == 0.1", "never exactly"),
        ("back 3 laps", "write back N scan"),
        ("diff", "there is no branch"),
        ("branch X1=on", "not a change"),
        ("branch X1=up@5", "on or off"),
        ("branch X1=on@9..5", "ends before it begins"),
        ("branch X777=on@5", "no such terminal"),
        ("branch command=jump@5", "no such command"),
        ("branch fault=stuck_on:nothing@5", "not a"),
        ("branch trays_target=-1@5", "must be"),
        ("branch command=hold@5..9", "happens once"),
        ("branch X1=on@5000", "not recorded"),
    ],
)
def test_an_invalid_command_has_a_clear_answer(command: str, answer: str) -> None:
    with pytest.raises(InputError, match=answer) as error:
        list(Debugger(recorded()[0]).execute(command))
    assert "\n" not in str(error.value)


def test_a_repeated_search_goes_on_before_what_it_has_found() -> None:
    line, rows = recorded()
    debugger = Debugger(line)
    scans = changed(rows, "Y1")
    found = []
    for _ in range(2):
        list(debugger.execute("last Y1"))
        found.append(debugger.scan)
    assert found == scans[-1:-3:-1]
    list(debugger.execute("next Y1"))
    assert debugger.scan == scans[-1]
    list(debugger.execute(f"goto {scans[-1]}"))
    assert next(debugger.execute("last Y1")).endswith(f"in scan {scans[-1]}, {scans[-1] / 100:.2f} s")


def test_the_steps_are_followed_forwards_and_backwards() -> None:
    debugger = Debugger(recorded()[0])
    list(debugger.execute("goto 1500"))
    list(debugger.execute("forward 3 steps"))
    there = debugger.scan
    list(debugger.execute("forward 1 step"))
    list(debugger.execute("back 1 step"))
    assert debugger.scan == there > 1_500


@pytest.mark.parametrize("at", [1, 49, 50, 51, 99, 100, 101, 1_234, 2_950, 2_951, 3_000])
def test_a_search_leaves_out_no_scan(at: int) -> None:
    line, _ = recorded()

    def find(since: int, to: int) -> list[int]:
        return [at] if since < at <= to else []

    for before in (at + 1, at + 2, at + 60, 3_001):
        assert last(line, find, before) == at
    for after in (0, max(0, at - 60), at - 1):
        assert following(line, find, after) == at
