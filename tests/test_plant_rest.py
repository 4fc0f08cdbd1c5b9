"""What rests is not computed; whatever may move it wakes it."""

from __future__ import annotations

import pytest
from plant_rig import Rig

from plant_sim.faults import parse_fault


@pytest.mark.parametrize("jammed_ms", [100, 4_000])
def test_freed_claws_go_on_to_close(jammed_ms: int) -> None:
    """However long the jam has lasted and the air has settled, the pressure against it moves them when it is gone."""
    rig = Rig()
    claws = rig.left.claws
    claws.jammed = True
    rig.run(jammed_ms, "left.claws_close")
    assert claws.angle_deg == 30.0
    claws.jammed = False
    rig.run(200, "left.claws_close")
    assert claws.gripping


def test_a_freed_slide_without_a_brake_moves_by_what_is_trapped() -> None:
    """The air behind a jammed piston goes on pressing when the coil is off and the jam is gone."""
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
    """The claws are always fed: when their regulator is turned up, they clamp harder."""
    rig = Rig({"supply.pressure_pa": 0.6e6})
    rig.close()
    rig.run(20_000)
    clamped_n = rig.left.claws.clamp_n
    rig.plant.make[0]["air"]["network"]["claw_regulated_pa"] = 0.55e6
    rig.run(2_000)
    assert rig.left.claws.clamp_n > 1.3 * clamped_n
