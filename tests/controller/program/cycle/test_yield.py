"""Optional yield inputs: a row that is not held or not planted is told, and nothing changes without the inputs."""

from __future__ import annotations

import pytest

from controller.common.modbus.io_map import IoMap
from controller.core.expr import Word
from controller.core.rungs import Mov
from controller.export.instruction_list import acting, export
from controller.fx.language.check import usage
from controller.program.machine import build
from controller.program.set_points import CUPS, MISSING_MOST
from controller.program.states import State
from controller.program.tags import FULL, SIDES, Side
from plant_sim.crop.seedling import CELLS_ALONG, COLUMNS, Location
from plant_sim.faults import parse_fault
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.monitors import guard
from plant_sim.twin.recovery import clear, home_again, press_emergency_stop
from tests.controller.export.fx_equality import Pair
from tests.plant_sim.twin.twin_rig import moving_outputs
from tests.sampling import first_of
from tests.wiring import DELIVERED, YIELD, wired


def both(*names: str) -> tuple[str, ...]:
    return tuple(f"{side}.{name}" for name in names for side in SIDES)


CUP_SENSOR, BEAM, PRESSURE = wired(*both("cup_filled")), wired(*both("seedling_beam")), wired(*both("claw_pressure"))
ALL = wired(*YIELD)
ROW_MS = 16_000
"""Time of twelve cups at 45 per minute, ms."""
CUP_MS = ROW_MS // CUPS
JAMMED_MS, EQUAL_MS = 17_000, 60_000
"""Time at which claws jam, and length of the comparison of program and export, ms."""


def at_work(io_map: IoMap, *, trays: int = 1, faults: tuple[str, ...] = (), **set_points: int) -> Twin:
    """Return a guarded machine in Execute with typical seedlings."""
    targets = {"trays_target": trays, **set_points}
    faulty = [parse_fault(fault) for fault in faults]
    twin = guard(Twin(trays=trays, io_map=io_map, set_points=targets, faults=faulty))
    twin.plant.seedlings.make_typical()
    twin.home(within_ms=60_000)
    twin.start()
    return twin


def empty(twin: Twin, side: Side, row: int, cells: int) -> None:
    """Take seedlings out of a row of the first tray, before it is picked."""
    column = row - 1 if side == "left" else COLUMNS - row
    for seedling in twin.plant.seedlings.column(0, column)[:cells]:
        twin.plant.seedlings.move(seedling, Location.LOST_PICK)


def released(twin: Twin, side: Side, rows: int) -> None:
    """Run until an arm has released a number of rows of seedlings."""
    twin.run_until(twin.machine.tags.arms[side].cycles.equals(rows), within_ms=120_000)


def complete(twin: Twin) -> None:
    twin.run_until_state(State.COMPLETE, within_ms=200_000)


def states_of(twin: Twin) -> set[str]:
    return {f"{side}: {name}" for side in SIDES for name in ("row short", "claw pressure")} & {*twin.alarms()}


# --- without the inputs ------------------------------------------------------------------------------


def test_the_delivered_program_has_no_trace_of_the_inputs() -> None:
    """Neither alarms, constants, registers nor steps: the export keeps its size."""
    machine = build(DELIVERED)
    assert {alarm.key for alarm in machine.alarms} & {"row short", "claw pressure"} == set()
    assert "missing_most" not in machine.tags.sp.names()
    assert all(arm.opened == arm.t_opening.done for arm in machine.tags.arms.values())
    assert all(arm.closed == arm.t_closing.done for arm in machine.tags.arms.values())


@pytest.mark.parametrize("io_map", first_of([ALL, PRESSURE, BEAM, CUP_SENSOR]), ids=["all", "pressure", "beam", "cups"])
def test_a_sound_trial_completes_without_an_alarm(io_map: IoMap) -> None:
    twin = at_work(io_map, trays=2)
    twin.run_until_state(State.COMPLETE, within_ms=300_000)
    assert twin.plant.counts().in_cups == 2 * CELLS_ALONG * COLUMNS
    assert [event for event in twin.alarm_events() if "claws" in event.text.en or "row" in event.text.en] == []


@pytest.mark.nightly
def test_the_inputs_do_not_change_the_times_of_a_sound_trial() -> None:
    times = [
        [cycle.at_ms for cycle in twin.cycles()]
        for twin in (at_work(DELIVERED, trays=2), at_work(ALL, trays=2))
        if twin.run_until_state(State.COMPLETE, within_ms=300_000)
    ]
    assert len(times) == 2
    assert times[0] == times[1]


# --- rows with missing seedlings ---------------------------------------------------------------------


@pytest.mark.parametrize("side", SIDES)
def test_empty_cups_are_told_within_one_cup_cycle(side: Side) -> None:
    twin = at_work(CUP_SENSOR)
    empty(twin, side, 2, MISSING_MOST + 1)
    released(twin, side, 2)
    assert states_of(twin) == set()
    twin.run_until_state(State.HOLDING, State.HELD, within_ms=ROW_MS)
    assert states_of(twin) == {f"{side}: row short"}
    twin.run_until_state(State.HELD, within_ms=20_000)
    twin.run_for(5_000)
    assert twin.state is State.HELD, "nothing restarts by itself"
    assert moving_outputs(twin) == set()


def test_a_row_is_told_once() -> None:
    """The tractor stands, and the emergency stop is cleared: the empty cups of the row told before are no new alarm."""
    twin = at_work(CUP_SENSOR)
    empty(twin, "left", 1, CELLS_ALONG)
    twin.run_until_state(State.HELD, within_ms=60_000)
    twin.plant.planting_frequency_per_min = 0.0
    press_emergency_stop(twin)
    clear(twin)
    assert states_of(twin) == set()


@pytest.mark.parametrize("side", SIDES)
def test_missing_stems_are_told_before_the_row_is_released(side: Side) -> None:
    twin = at_work(BEAM)
    empty(twin, side, 2, MISSING_MOST + 1)
    released(twin, side, 1)
    twin.run_until_state(State.HOLDING, State.HELD, within_ms=60_000)
    assert states_of(twin) == {f"{side}: row short"}
    assert twin.plc.read(twin.machine.tags.arms[side].cycles) == 1
    twin.run_until_state(State.HELD, within_ms=20_000)
    home_again(twin)
    twin.start()
    complete(twin)
    assert twin.plant.counts().in_cups == CELLS_ALONG * COLUMNS - MISSING_MOST - 1


@pytest.mark.nightly
@pytest.mark.parametrize("io_map", first_of([ALL, BEAM, CUP_SENSOR]), ids=["all", "beam", "cups"])
def test_as_many_missing_seedlings_as_permitted_are_counted_and_not_told(io_map: IoMap) -> None:
    twin = at_work(io_map)
    for side in SIDES:
        empty(twin, side, 1, MISSING_MOST)
        empty(twin, side, 3, MISSING_MOST)
    complete(twin)
    twin.run_for(ROW_MS + CUP_MS)
    assert states_of(twin) == set()
    planted = [arm.yields.planted for arm in twin.machine.tags.arms.values()]
    assert all(tags is None or twin.plc.read(tags.empty_cups) == 2 * MISSING_MOST for tags in planted)


@pytest.mark.nightly
def test_a_row_told_by_the_beam_is_not_told_again_by_its_cups() -> None:
    twin = at_work(ALL)
    empty(twin, "left", 1, CELLS_ALONG)
    twin.run_until_state(State.HELD, within_ms=60_000)
    home_again(twin)
    twin.start()
    complete(twin)
    assert states_of(twin) == set()


@pytest.mark.nightly
def test_the_cups_of_the_row_after_a_told_one_are_looked_at_again() -> None:
    twin = at_work(ALL)
    empty(twin, "left", 1, CELLS_ALONG)
    twin.run_until_state(State.HELD, within_ms=60_000)
    home_again(twin)
    twin.start()
    released(twin, "left", 1)
    twin.run_until(twin.step_of("left arm", "wait for cups"), within_ms=60_000)
    twin.plant.faults.add(parse_fault(f"slow_valve:left.claws=0.5@{twin.plant.time_ms}ms.."))
    twin.run_until_state(State.HELD, within_ms=2 * ROW_MS + 10_000)
    assert states_of(twin) == {"left: row short"}


@pytest.mark.nightly
def test_the_number_is_a_machine_constant() -> None:
    """With 12 permitted, an empty row is only counted."""
    machine = build(CUP_SENSOR)
    most = machine.tags.sp.missing_most
    assert isinstance(most, Word)
    assert most in machine.tags.sp.constants
    twin = at_work(CUP_SENSOR, missing_most=CUPS)
    empty(twin, "left", 1, CELLS_ALONG)
    complete(twin)
    twin.run_for(ROW_MS)
    planted = twin.machine.tags.arms["left"].yields.planted
    assert planted is not None
    assert twin.plc.read(planted.empty_cups) == CELLS_ALONG


def test_cups_before_the_first_row_are_not_counted() -> None:
    """After power-up the claws count as loaded; the row that is only assumed leaves its cups empty without an alarm."""
    twin = at_work(CUP_SENSOR)
    released(twin, "left", 1)
    planted = twin.machine.tags.arms["left"].yields.planted
    assert planted is not None
    assert twin.plc.read(planted.empty_cups) == 0


# --- the sensors themselves --------------------------------------------------------------------------


@pytest.mark.parametrize("fault", first_of(["stuck_on", "stuck_off", "broken_wire"]))
@pytest.mark.parametrize(("tag", "io_map"), [("cup_filled", CUP_SENSOR), ("seedling_beam", BEAM)])
def test_a_failed_sensor_is_told_with_its_first_row(fault: str, tag: str, io_map: IoMap) -> None:
    twin = at_work(io_map, faults=(f"{fault}:right.{tag}@1s..",))
    twin.run_until_state(State.HELD, within_ms=60_000)
    assert states_of(twin) == {"right: row short"}
    assert twin.plant.counts().in_claw + twin.plant.counts().in_cups + twin.plant.counts().in_tray == 72


@pytest.mark.parametrize(("fault", "alarm"), [("stuck_off", "close claws"), ("stuck_on", "open claws")])
def test_a_failed_pressure_switch_is_told_with_its_next_stroke(fault: str, alarm: str) -> None:
    twin = at_work(PRESSURE)
    released(twin, "left", 1)
    twin.run_until(
        twin.step_of("left arm", "close claws" if fault == "stuck_off" else "wait for cups"), within_ms=60_000
    )
    twin.plant.faults.add(parse_fault(f"{fault}:left.claw_pressure@{twin.plant.time_ms}ms.."))
    twin.run_until_state(State.HELD, within_ms=60_000)
    assert f"left: {alarm}" in twin.alarms()
    assert twin.plant.counts().in_cups % CELLS_ALONG == 0


# --- claws -------------------------------------------------------------------------------------------


def test_claws_without_air_lift_nothing_and_keep_their_row() -> None:
    twin = at_work(PRESSURE)
    released(twin, "left", 1)
    arm = twin.machine.tags.arms["left"]
    twin.run_until(twin.step_of("left arm", "settle at row"), within_ms=60_000)
    twin.plant.faults.add(parse_fault(f"stuck_valve:left.claws@{twin.plant.time_ms}ms.."))
    twin.run_until_state(State.HELD, within_ms=20_000)
    assert "left: close claws" in twin.alarms()
    assert not twin.plc.read(arm.clamped)
    twin.plant.faults.clear("stuck_valve:left.claws")
    home_again(twin)
    assert twin.plc.read(arm.rows[2]) == FULL
    twin.start()
    complete(twin)
    assert twin.plant.counts().in_cups == CELLS_ALONG * COLUMNS


@pytest.mark.nightly
def test_claws_that_keep_their_air_release_no_row() -> None:
    twin = at_work(PRESSURE)
    cycles = twin.machine.tags.arms["left"].cycles
    released(twin, "left", 1)
    twin.run_until(twin.step_of("left arm", "wait for cups"), within_ms=60_000)
    twin.plant.faults.add(parse_fault(f"stuck_valve:left.claws@{twin.plant.time_ms}ms.."))
    twin.run_until_state(State.HELD, within_ms=60_000)
    assert "left: open claws" in twin.alarms()
    assert twin.plc.read(cycles) == 1
    assert twin.plc.read(twin.machine.tags.arms["left"].loaded)


@pytest.mark.nightly
def test_claws_that_close_slowly_lift_only_once_they_hold() -> None:
    """Without the switch, the arm lifts before the claws have closed, and no seedling is planted."""
    twin = at_work(PRESSURE)
    twin.plant.faults.add(parse_fault(f"slow_valve:left.claws=0.5@{twin.plant.time_ms}ms.."))
    twin.run_until(twin.step_of("left arm", "lift from row"), within_ms=60_000)
    twin.plant.faults.clear("slow_valve:left.claws")
    complete(twin)
    assert twin.plant.counts().in_cups == CELLS_ALONG * COLUMNS


@pytest.mark.nightly
def test_the_last_row_is_told_after_the_work_has_ended() -> None:
    twin = at_work(CUP_SENSOR)
    empty(twin, "left", 3, CELLS_ALONG)
    complete(twin)
    assert states_of(twin) == set()
    twin.run_until(lambda: states_of(twin) == {"left: row short"}, within_ms=ROW_MS)
    assert moving_outputs(twin) == set()


def test_a_leak_of_closed_claws_is_told_on_the_way() -> None:
    twin = at_work(PRESSURE)
    twin.run_until(twin.step_of("left arm", "slide to feed"), within_ms=60_000)
    twin.plant.faults.add(parse_fault(f"leak:left.claws.minus=1e-8@{twin.plant.time_ms}ms.."))
    twin.run_until_state(State.HOLDING, State.HELD, within_ms=1_500)
    assert states_of(twin) == {"left: claw pressure"}


# --- export ------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_the_inputs_take_less_than_250_steps() -> None:
    sizes = [usage(export(acting(build(io_map).program))).steps for io_map in (DELIVERED, ALL)]
    assert 0 < sizes[1] - sizes[0] <= 250
    assert any(isinstance(rung, Mov) and rung.source == CUPS for rung in build(ALL).program.rungs())


@pytest.mark.nightly
def test_the_export_acts_like_the_program() -> None:
    """Program and export control the same plant, while the left claws jam and a row is told."""
    machine = build(ALL)
    pair = Pair(ladder=export(acting(machine.program)), program=machine.program)
    plant = Plant(ALL, load_machine(), seed=1, trays=1)
    plant.seedlings.make_typical()
    short = next(alarm.bit for alarm in machine.alarms if alarm.key == "row short" and alarm.side == "left")
    image = ALL.safe_outputs()
    for now_ms in range(0, EQUAL_MS, 10):
        if now_ms == 100:  # the memory has never been written
            pair.write(machine.tags.commands["new_machine"], 1)
        plant.box.start = now_ms in range(500, 600) or now_ms in range(14_000, 14_100)
        if now_ms == JAMMED_MS:
            plant.faults.add(parse_fault(f"jammed:left.claws@{plant.time_ms}ms.."))
        plant.step(10, image)
        image = pair.scan(now_ms, plant.x)
    assert pair.soft.read(short)
    assert pair.moving > 500
