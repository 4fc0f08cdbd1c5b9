"""Skipped computation of parts at rest, and its resumption by every possible cause of motion."""

from __future__ import annotations

import pytest

from plant_sim.faults import parse_fault
from tests.plant_sim.machine.plant_rig import Rig


@pytest.mark.parametrize("jammed_ms", [100, 4_000])
def test_released_claws_continue_to_close(jammed_ms: int) -> None:
    """When a jam of any duration is cleared, the pressure closes the claws, even if all air has settled."""
    rig = Rig()
    claws = rig.left.claws
    claws.jammed = True
    rig.run(jammed_ms, "left.claws_close")
    assert claws.angle_deg == 30.0
    claws.jammed = False
    rig.run(200, "left.claws_close")
    assert claws.gripping


def test_a_released_slide_without_a_brake_moves_by_its_trapped_air() -> None:
    """The air behind a jammed piston retains its pressure while the coil is off, until the jam is cleared."""
    rig = Rig({"slide.brake_n": 0.0})
    slide = rig.left.slide
    slide.jammed = True
    rig.run(3_000, "left.slide_inward")
    rig.run(5_000)
    stood_m = slide.x_m
    slide.jammed = False
    rig.run(300)
    assert slide.x_m > stood_m + 0.01


def test_a_resting_lift_sinks_when_its_check_valve_begins_to_leak() -> None:
    rig = Rig()
    rig.raise_arm()
    rig.run(20_000)
    up_m = rig.left.lift.rise_m
    rig.plant.faults.add(parse_fault("leaking_check_valve:left.lift.minus=1e-9"))
    rig.run(4_000)
    assert rig.left.lift.rise_m < up_m - 0.02


def test_resting_claws_follow_their_supply() -> None:
    """The claws are always connected to their supply, so they clamp with more force if its set pressure rises."""
    rig = Rig({"supply.pressure_pa": 0.6e6})
    rig.close()
    rig.run(20_000)
    clamped_n = rig.left.claws.clamp_n
    rig.plant.params[0]["air"]["network"]["claw_regulated_pa"] = 0.55e6
    rig.run(2_000)
    assert rig.left.claws.clamp_n > 1.3 * clamped_n


def test_short_pulses_with_long_rests_do_not_add_up() -> None:
    """A 10 ms pulse is shorter than the 19 ms delay of valve and tube; its effect is cancelled when it ends."""
    rig = Rig()
    rig.run(20_000)
    stood_m = rig.left.slide.x_m
    for _ in range(4):
        rig.run(10, "left.slide_inward")
        rig.run(5_000)
    assert rig.left.slide.x_m == stood_m
    rig.close()
    rig.run(5_000)
    for _ in range(4):
        rig.run(10, "left.claws_open")
        rig.run(5_000)
    assert rig.left.claws.angle_deg == -10.0


def run_to_row(rig: Rig) -> None:
    """Drive inward to row 2 and let the slide stop there with trapped air in its chambers."""
    rig.go_to_pick(2)
    rig.run(10_000)


def test_a_resting_slide_decouples_when_the_magnet_weakens() -> None:
    rig = Rig()
    run_to_row(rig)
    slide = rig.left.slide
    assert not slide.decoupled
    rig.plant.faults.add(parse_fault("decoupled_magnet:left.slide=5N"))
    rig.run(20)
    assert slide.decoupled


def test_a_decoupled_carriage_recouples_when_the_piston_passes() -> None:
    """By default, the magnets recouple below 0.25 m/s; the piston moves at only 0.15 m/s."""
    rig = Rig()
    run_to_row(rig)
    slide = rig.left.slide
    rig.plant.faults.add(
        parse_fault(f"decoupled_magnet:left.slide=5N@{rig.plant.time_ms}ms..{rig.plant.time_ms + 10}ms")
    )
    rig.run(2_000, "left.slide_inward")
    assert [slide.decoupled, slide.at_feed.read()] == [True, False]
    rig.run(6_000, "left.slide_outward")
    assert [slide.decoupled, slide.at_feed.read()] == [False, True]


def test_claws_without_air_drop_their_seedlings() -> None:
    """If the claw air leaks out after an emergency stop, the fingers lose their force and drop all seedlings."""
    rig = Rig()
    rig.plant.seedlings.make_typical()
    rig.bring_tray()
    rig.go_to_pick(1)
    rig.close()
    rig.raise_arm()
    assert len(rig.left.grip.held) == 12
    rig.plant.box.emergency_stop = True
    rig.run(60_000)
    assert len(rig.left.grip.held) == 12
    rig.plant.faults.add(parse_fault("leak:left.claws.minus=1e-7"))
    rig.plant.faults.add(parse_fault("failing_supply:compressor=0"))
    rig.run(60_000)
    assert rig.left.grip.held == []
    assert rig.kinds() == ["dropped", "drop_over_tray"]
    counts = rig.plant.counts()
    assert (counts.D, counts.in_claw) == (12, 0)


def test_a_late_pressure_switch_delays_its_edges() -> None:
    rig = Rig()
    switch = rig.plant.sensors["air_pressure_ok"]
    rig.plant.faults.add(parse_fault("late_sensor:air_pressure_ok=2s"))
    rig.run(10_000)
    rig.plant.box.emergency_stop = True
    rig.run(1_500)
    assert rig.plant.supply.pressure_pa < 10_000
    assert switch.read()
    rig.run(1_000)
    assert not switch.read()
