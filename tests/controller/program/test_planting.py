"""Planting speeds: measurement, lambda, advice, and the speed of a planter with its own motor."""

from __future__ import annotations

import pytest

from controller.common.modbus.io_map import IoMap
from controller.core.expr import Word
from controller.core.scan import Plc
from controller.export.instruction_list import acting, export
from controller.fx.engine.plc import FxPlc
from controller.fx.language.check import MOST_STEPS, usage
from controller.program.machine import build
from controller.program.memory import lose
from controller.program.planting import GROUND_GAP_MS, WARNING_MS
from controller.program.states import State
from plant_sim.machine.parameters import load_machine
from plant_sim.twin.lock_step import Twin
from tests.sampling import first_of
from tests.wiring import DELIVERED, wired

MACHINE = load_machine()
SENSOR, DRIVE, BOTH = wired("ground_pulse"), wired("planter_speed"), wired("ground_pulse", "planter_speed")
PITCH_MM, SPACING_M = 489, MACHINE.ground.plant_spacing_m


def executing(io_map: IoMap = SENSOR, per_min: float = 45.0, **set_points: int) -> Twin:
    """Return a twin in Execute at a planting frequency, shortly after its start."""
    machine = MACHINE.with_values({"cups.planting_frequency_per_min": per_min})
    twin = Twin(io_map=io_map, parameters=machine, set_points=set_points, trays=4)
    twin.home()
    twin.start()
    return twin


def value(twin: Twin, name: str) -> int:
    word = getattr(twin.machine.tags.planting, name)
    assert isinstance(word, Word)
    return twin.plc.read(word)


def ground_mm_s(per_min: float) -> float:
    return 1_000 * SPACING_M * per_min / 60


# ---- measurement ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("per_min", first_of([20.0, 45.0, 75.0]))
def test_speeds_are_measured_within_one_percent(per_min: float) -> None:
    twin = executing(per_min=per_min)
    twin.run_for(round(1_000 * 13.5 * 60 / per_min))
    assert value(twin, "frequency") == pytest.approx(10 * per_min, rel=0.01)
    assert value(twin, "chain_speed") == pytest.approx(PITCH_MM * per_min / 60, rel=0.01, abs=1)
    assert value(twin, "ground_speed") == pytest.approx(ground_mm_s(per_min), rel=0.01, abs=1)
    assert value(twin, "ratio") == pytest.approx(100 * PITCH_MM / 1_000 / SPACING_M, rel=0.02)


def test_a_pulse_at_the_highest_speed_is_seen_by_filter_and_scan() -> None:
    """At 2.5 km/h, half a pulse distance takes 36 ms, longer than the input filter and two scans of 10 ms."""
    fastest_m_s = 2.5 / 3.6
    assert MACHINE.ground.pulse_distance_m / fastest_m_s > 0.060
    twin = executing(per_min=60 * fastest_m_s / SPACING_M)
    twin.run_for(5_000)
    assert value(twin, "ground_speed") == pytest.approx(1_000 * fastest_m_s, rel=0.01)


def test_speeds_are_zero_at_standstill() -> None:
    twin = executing()
    twin.run_for(18_000)
    assert min(value(twin, name) for name in ("frequency", "chain_speed", "ground_speed", "ratio")) > 0
    twin.plant.planting_frequency_per_min = 0
    twin.run_for(2_000 + GROUND_GAP_MS)
    assert (value(twin, "ground_speed"), value(twin, "ratio")) == (0, 0)
    twin.run_for(10_000)
    assert (value(twin, "frequency"), value(twin, "chain_speed")) == (0, 0)


def test_the_first_measurement_after_a_stop_does_not_contain_the_stop() -> None:
    twin = executing()
    twin.run_for(5_000)
    twin.plant.planting_frequency_per_min = 0
    twin.run_for(2_000 + GROUND_GAP_MS)
    twin.plant.planting_frequency_per_min = 45
    twin.run_until(lambda: value(twin, "ground_speed") > 0, within_ms=15_000)
    assert value(twin, "ground_speed") > 0.7 * ground_mm_s(45)  # the tractor accelerates for a second
    twin.run_for(8_000)
    assert value(twin, "ground_speed") == pytest.approx(ground_mm_s(45), rel=0.01)


def test_the_pulse_distance_scales_the_ground_speed() -> None:
    twin = executing(ground_pulse=100)
    twin.run_for(10_000)
    assert value(twin, "ground_speed") == pytest.approx(2 * ground_mm_s(45), rel=0.01)


# ---- lambda ---------------------------------------------------------------------------------------------------


def test_lambda_outside_its_limits_is_a_warning_that_does_not_stop_work() -> None:
    """With 35 % slip of the drive wheel, lambda decreases from 1.22 to 0.79, below the limit of 1.00."""
    twin = executing()
    twin.run_for(25_000)
    assert twin.alarms() == []
    twin.plant.ground.slip = 0.35
    twin.run_for(WARNING_MS - 1_000)
    assert twin.alarms() == []
    twin.run_for(8_000)
    assert twin.alarms() == ["lambda"]
    assert twin.state is State.EXECUTE
    assert value(twin, "ratio") == pytest.approx(79, abs=2)
    twin.plant.ground.slip = 0.0
    twin.run_for(8_000)
    assert twin.alarms() == []


@pytest.mark.parametrize(
    ("lowest", "highest", "warns"), first_of([(125, 160, True), (100, 118, True), (100, 160, False)], 2)
)
def test_the_limits_of_lambda_are_set_points(lowest: int, highest: int, warns: bool) -> None:
    twin = executing(lambda_lowest=lowest, lambda_highest=highest)
    twin.run_for(28_000)
    assert twin.alarms() == (["lambda"] if warns else [])


def test_without_a_ground_sensor_nothing_is_said_about_lambda() -> None:
    twin = executing(DELIVERED, lambda_lowest=300, lambda_highest=300)
    twin.plant.ground.slip = 0.5
    twin.run_for(30_000)
    assert (value(twin, "ground_speed"), value(twin, "ratio"), twin.alarms()) == (0, 0, [])
    assert value(twin, "frequency") > 0


# ---- advice ---------------------------------------------------------------------------------------------------


def advised_per_min(name: str) -> float:
    """Return the advice at the default frequency after the first tray."""
    twin = executing(DELIVERED)
    tray = twin.machine.tags.machine.trays_done
    twin.run_until(tray.equals(1), within_ms=120_000)
    twin.run_for(60_000)
    return value(twin, name) / 10


def test_the_arms_keep_up_with_the_advised_frequency_but_not_with_a_faster_one() -> None:
    """Below the advice, cups are missed only after a wait of an arm; above it, in other cycles too, with a warning."""
    advised = advised_per_min("fastest")
    assert 60 < advised < 100
    results = {}
    for factor in (0.98, 1.06):
        twin = executing(DELIVERED, advised * factor)
        twin.run_for(75_000)
        own_motion = any(cycle.gap_cause == "row" for cycle in twin.cycles())
        results[factor] = (own_motion, "planting_fast" in twin.alarms(), twin.state)
    assert results == {0.98: (False, False, State.EXECUTE), 1.06: (True, True, State.EXECUTE)}


def test_no_cups_are_missed_up_to_the_gapless_frequency() -> None:
    """Below the gapless frequency, no cup is missed over two trays, including the tray changes."""
    advised = advised_per_min("gapless")
    assert 45 < advised < 70
    missed = {}
    for factor in (0.98, 1.06):
        twin = executing(DELIVERED, advised * factor)
        tray = twin.machine.tags.machine.trays_done
        twin.run_until(tray.equals(2), within_ms=200_000)
        twin.run_for(30_000)
        missed[factor] = sum(twin.plc.read(arm.missed_cups) for arm in twin.machine.tags.arms.values())
    assert missed[0.98] == 0
    assert missed[1.06] > 0


def test_advice_is_given_only_after_both_arms_have_prepared_a_row() -> None:
    twin = executing(DELIVERED)
    arms = twin.machine.tags.planting.arms.values()
    twin.run_until(lambda: value(twin, "fastest") > 0, within_ms=40_000)
    assert all(twin.plc.read(arm.times[0]) > 0 for arm in arms)
    longest = max(twin.plc.read(time) for arm in arms for time in arm.times)
    assert value(twin, "fastest") == 720_000 // longest


def test_there_is_no_advice_while_the_arms_wait_for_cups_before_they_move_down() -> None:
    """The time between releases would then depend on the cups, and the advice would equal the current frequency."""
    twin = executing(DELIVERED, descend_at_count=12)
    twin.run_for(60_000)
    assert twin.cycles()
    assert (value(twin, "fastest"), value(twin, "gapless"), twin.alarms()) == (0, 0, [])


def test_waits_for_the_tray_count_only_for_the_gapless_frequency() -> None:
    """At 90 cups per minute, every release is late, but waits are still detected.

    The release delay, which is longer at low chain speed, is part of the measured time: 0.25 s of 9.4 s from 45 to 90
    per minute.
    """
    slow, fast = executing(DELIVERED), executing(DELIVERED, 90)
    for twin in (slow, fast):
        twin.run_for(100_000)
    assert 1.0 <= value(fast, "fastest") / value(slow, "fastest") < 1.04
    assert value(fast, "gapless") == pytest.approx(value(slow, "gapless"), rel=0.05)
    assert value(fast, "gapless") < 0.8 * value(fast, "fastest")


# ---- planter with its own motor -------------------------------------------------------------------------------


def test_the_planter_follows_the_set_point_without_a_ground_sensor() -> None:
    twin = executing(DRIVE, planter_speed=456)
    twin.run_for(100)
    assert (value(twin, "planter_speed"), twin.plant.planter_speed_m_s) == (456, 0.456)


def test_the_planter_follows_the_ground_speed_if_it_is_measured() -> None:
    twin = executing(BOTH, planter_lambda=117, planter_speed=2_000)
    twin.run_for(10_000)
    assert value(twin, "planter_speed") == pytest.approx(1.17 * ground_mm_s(45), rel=0.01)
    twin.plant.planting_frequency_per_min = 0
    twin.run_for(6_000)
    assert (value(twin, "planter_speed"), twin.plant.planter_speed_m_s) == (0, 0.0)


@pytest.mark.parametrize("cause", ["stop", "emergency_stop", "abort", "hold", "link", "scan"])
def test_the_planter_stops_with_the_machine(cause: str) -> None:
    twin = executing(DRIVE, planter_speed=456)
    twin.run_for(200)
    assert twin.plant.planter_speed_m_s == 0.456
    if cause in ("stop", "emergency_stop"):
        twin.press(cause, for_ms=200)
    elif cause == "link":
        twin.runtime.field.lost = True
        twin.runtime._write = lambda now_ms: None  # type: ignore[method-assign]
    elif cause == "scan":
        twin.runtime.plc.scan = None  # type: ignore[assignment, method-assign]
    else:
        twin.command(cause)
    within_ms = {"stop": 60_000, "hold": 60_000}.get(cause, 50)
    twin.run_until(lambda: twin.runtime.released_words == [0], within_ms=within_ms)
    if cause not in ("link", "scan"):
        assert value(twin, "planter_speed") == 0
        assert twin.state in (State.STOPPED, State.HELD, State.ABORTED, State.ABORTING)


def test_the_planter_does_not_turn_in_manual_mode_or_while_homing() -> None:
    seen: list[int] = []
    for manual in (False, True):
        twin = Twin(io_map=DRIVE, set_points={"planter_speed": 456}, trays=1)
        twin.watch(lambda twin: seen.append(value(twin, "planter_speed")))
        if manual:
            twin.scan()
            twin.command("mode_manual")
            twin.scan()
        twin.home()
        if manual:
            twin.start()
            assert (twin.state, twin.plc.read(twin.machine.tags.machine.manual)) == (State.EXECUTE, 1)
    assert set(seen) == {0}


def test_on_exit_the_safe_value_is_written() -> None:
    twin = executing(DRIVE, planter_speed=456)
    twin.run_for(100)
    assert twin.runtime.write_safe_outputs()
    assert twin.plant.planter_speed_m_s == 0.0


# ---- export ---------------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_the_export_contains_the_planter_speed_only_if_it_is_wired() -> None:
    """Measurement, advice and warnings are for information only and are not exported."""
    blocks = {
        name: [block.title for block in acting(build(io_map).program).blocks]
        for name, io_map in (("delivered", DELIVERED), ("sensor", SENSOR), ("both", BOTH))
    }
    assert "planting speeds" not in blocks["delivered"]
    assert "planting speeds" not in blocks["sensor"]
    assert "planting speeds" in blocks["both"]
    assert usage(export(acting(build(DELIVERED).program))).steps <= MOST_STEPS
    assert MOST_STEPS < usage(export(acting(build(BOTH).program))).steps <= MOST_STEPS + 250, "with a memory cassette"


@pytest.mark.nightly
def test_the_exported_planter_speed_is_equal_in_every_scan() -> None:
    """Outputs and planter speed are equal in a run with both points wired, a standstill and an emergency stop."""
    machine = build(BOTH)
    (speed,) = machine.program.output_words
    reference, fx = Plc(machine.program), FxPlc(export(acting(machine.program)))
    seen: list[int] = []

    def compare(twin: Twin) -> None:
        levels = twin.plant.x  # the plant does not move between the scan and this call
        assert reference.scan(twin.now_ms, levels) == fx.scan(twin.now_ms, levels)
        assert reference.read(speed) == fx.memory.D[speed.number] == value(twin, "planter_speed")
        seen.append(reference.read(speed))

    twin = Twin(io_map=BOTH, trays=1)
    for plc in (reference, twin.plc):
        lose(machine.tags, plc)  # the memory of the export has never been written
    twin.watch(compare)
    twin.scan()
    new = machine.tags.commands.new_machine
    for plc in (reference, twin.plc):
        plc.write(new, 1)
    fx.memory.M[new.number] = True
    twin.home()
    twin.start()
    twin.run_for(10_000)
    twin.plant.planting_frequency_per_min = 0
    twin.run_for(6_000)
    twin.plant.planting_frequency_per_min = 60
    twin.run_for(8_000)
    assert max(seen) > 400
    twin.press("emergency_stop", for_ms=500)
    twin.run_for(600)
    assert seen[-1] == 0
