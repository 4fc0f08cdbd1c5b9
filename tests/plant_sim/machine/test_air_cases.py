"""Single cases of air that was not physical: short tubes, wide valves, a regulator without relief, slow motion."""

from __future__ import annotations

import numpy as np
import pytest

from plant_sim.common.parameter_file import Value
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from tests.plant_sim.machine.air_survey import DEFAULT, SurveyedArm
from tests.plant_sim.machine.plant_rig import make_rig
from tests.plant_sim.pneumatics.pneumatics_rig import OFF, machine_bench

SHORT: dict[str, Value] = {
    f"{section}_port.{key}": value
    for section in ("slide", "lift", "claws")
    for key, value in (("tube_length_m", 0.1), ("valve_conductance_m3_s_pa", 4.5e-8))
}
"""Tubes of 0.5 to 1.3 cm3 behind wide valves."""


@pytest.mark.parametrize("thermal", [False, True])
def test_short_tubes_behind_wide_valves(thermal: bool) -> None:
    """No pressure exceeds that of its source by 2 %, and strokes take as long as in steps of 0.1 ms, +-2 ms."""
    machine = DEFAULT.with_values({**SHORT, "air.thermal": thermal})
    assert machine.steps_per_ms > 1
    coarse = SurveyedArm(machine).survey()
    fine = SurveyedArm(machine.with_values({"simulation.step_s": 1e-4})).survey()
    assert coarse.over[0] < 1.02
    assert 180.0 < coarse.kelvin[0] < coarse.kelvin[1] < 450.0
    assert coarse.strokes_s == pytest.approx(fine.strokes_s, abs=0.002)


@pytest.mark.parametrize("thermal", [False, True])
def test_the_default_machine_needs_no_shorter_steps(thermal: bool) -> None:
    assert DEFAULT.with_values({"air.thermal": thermal}).steps_per_ms == 1


@pytest.mark.parametrize(("relief_m3_s_pa", "relieves"), [(0.2e-8, True), (0.0, False)])
def test_a_regulator_relieves_above_its_band(relief_m3_s_pa: float, relieves: bool) -> None:
    """Set from 0.5 to 0.3 MPa without consumption, the pressure falls to 0.32 MPa with a relief only."""
    bench = machine_bench({"supply.relief_conductance_m3_s_pa": relief_m3_s_pa})
    bench.supply_params[0]["regulated_pa"] = 0.3e6
    bench.run(5.0, OFF)
    gauge_pa = float(bench.supply[0]["header"]["pressure_pa"]) - ATMOSPHERE_PA
    assert gauge_pa == pytest.approx(0.32e6 if relieves else 0.5e6, rel=0.02)


@pytest.mark.parametrize(("speed_m_s", "sticks"), [(0.011, True), (0.02, True), (0.08, False), (0.15, False)])
def test_a_slide_sticks_and_slips_at_every_low_speed(speed_m_s: float, sticks: bool) -> None:
    """The catalogue rates a slide from 0.05 m/s; below about 0.04 m/s it moves in jerks, also at 0.01 m/s.

    At the higher speeds the friction curve falls less than the viscous friction rises.
    """
    throttle_m3_s_pa = speed_m_s * DEFAULT.slide.area_m2 / 1e5
    rig = make_rig({"slide.throttle_conductance_m3_s_pa": throttle_m3_s_pa, "slide_friction.static_n": 60.0})
    slide = rig.left.slide
    rig.run_until(lambda: slide.x_m > 0.01, "left.slide_inward", within_ms=60_000)
    speeds_m_s = np.array(rig.trace(lambda: slide.speed_m_s, round(0.04 / speed_m_s * 1000), "left.slide_inward"))
    assert bool((speeds_m_s == 0.0).any()) is sticks
