"""Compressed-air supply: conservation of mass, dump valve, claw reservoir, soft start."""

import math
from typing import Any

import numpy as np
import pytest

from plant_sim.pneumatics.flow import ATMOSPHERE_PA, GAS_CONSTANT, REFERENCE_K, REFERENCE_KG_M3
from tests.plant_sim.pneumatics.pneumatics_rig import CLAWS, LIFT, MINUS, OFF, PLUS, SLIDE, Rig, machine_bench
from tests.sampling import first_of


def gauge_pa(records: Any) -> Any:
    return records["pressure_pa"] - ATMOSPHERE_PA


def settled_bench(**values: Any) -> Rig:
    rig = machine_bench({f"supply.{name}": value for name, value in values.items()})
    rig.run(3.0)
    return rig


@pytest.mark.parametrize(
    ("seed", "thermal", "faulty"), first_of([(2, True, False), (3, False, True), (1, False, False)], 2)
)
def test_air_mass_is_conserved(seed: int, thermal: bool, faulty: bool) -> None:
    """During a minute of random coils and dumps, total mass including exhaust and intake is constant to 1e-9.

    Air is only moved between chambers, so the only error is rounding, 2e-13 here.
    """
    rng = np.random.default_rng(seed)
    rig = machine_bench({"air.thermal": thermal})
    if faulty:
        rig.all_params["plus"]["leak_m3_s_pa"], rig.all_params["minus"]["slip_m3_s_pa"] = 5e-10, 5e-10
        rig.supply_params["leak_m3_s_pa"], rig.supply_params["slip_m3_s_pa"] = 2e-9, 1e-9
    before_kg = rig.air_kg()
    taken_kg = 0.0
    for _ in range(12):
        coils = np.repeat(rng.random((25, 3, 2)) < 0.45, 200, axis=0)
        fed = np.repeat(rng.random(25) < 0.85, 200)
        trace = rig.run(5.0, coils, fed=fed, every=100)
        taken_kg = float(trace.supply["taken_in_kg"][-1])
        assert rig.air_kg() == pytest.approx(before_kg, rel=1e-9)
        for line in ("plus", "minus"):
            assert (trace.cylinders[line]["chamber"]["mass_kg"] > 0).all()
    assert taken_kg > 0.2 * before_kg  # the compressor has run, so much air was exchanged


def test_a_stroke_consumes_the_air_of_its_volumes() -> None:
    """A lift that moves up and down at 0.5 MPa consumes the air of its volumes: 3.81 L ANR per cycle, +-3 %.

    Tubes, 16.3 cm3 each, and dead volumes, 44 cm3 each, fill from ambient pressure; the swept volumes, 294.5 and
    247.4 cm3, fill from zero. The check valve reduces the chamber pressure by 10 kPa.
    """
    rig = settled_bench()
    rig.run(3.0, [OFF, MINUS, OFF])
    rig.run(3.0, [OFF, PLUS, OFF])
    before_kg = sum(float(rig.cylinders[LIFT][line]["drawn_kg"]) for line in ("plus", "minus"))
    for coils in (MINUS, PLUS):
        rig.run(4.0, [OFF, coils, OFF])
    drawn_kg = sum(float(rig.cylinders[LIFT][line]["drawn_kg"]) for line in ("plus", "minus")) - before_kg
    params = rig.all_params[LIFT]
    expected_kg = 0.0
    for line, area in (("plus", "plus_area_m2"), ("minus", "minus_area_m2")):
        swept_m3 = float(params[area]) * 0.150
        full_pa = 0.5e6 - float(params[line]["crack_pa"])
        chamber = full_pa * float(params[line]["dead_m3"]) + (full_pa + ATMOSPHERE_PA) * swept_m3
        expected_kg += (chamber + 0.5e6 * float(params[line]["tube_m3"])) / (GAS_CONSTANT * REFERENCE_K)
    assert drawn_kg == pytest.approx(expected_kg, rel=0.03)


def test_the_regulator_holds_its_pressure_without_flow_and_droops_with_flow() -> None:
    """The pressure is 0.500 MPa to 0.1 % without flow; while the cylinders move, it droops by less than 0.03 MPa."""
    rig = settled_bench()
    assert float(gauge_pa(rig.supply[0]["header"])) == pytest.approx(0.5e6, rel=1e-3)
    header_pa = gauge_pa(rig.run(0.5, [PLUS, MINUS, MINUS]).supply["header"])
    assert header_pa.max() <= 0.5e6 * 1.001
    assert 0.47e6 < header_pa.min() < 0.499e6


@pytest.mark.parametrize("cycles", first_of([8, 15]))
def test_the_compressor_runs_between_its_limits(cycles: int) -> None:
    """The compressor starts below 0.65 MPa, stops above 0.75 MPa, and delivers 4 L/s ANR, 4.74 g/s, while running."""
    rig = settled_bench()
    coils = np.repeat(np.array([[PLUS] * 3, [MINUS] * 3] * cycles), 4000, axis=0)
    supply = rig.run(8.0 * cycles, coils, every=10).supply
    runs, receiver_pa = supply["compressor_runs"] != 0, gauge_pa(supply["receiver"])
    starts, stops = np.flatnonzero(~runs[:-1] & runs[1:]), np.flatnonzero(runs[:-1] & ~runs[1:])
    assert len(starts)
    assert len(stops)
    assert receiver_pa[starts] == pytest.approx(0.65e6, abs=2e3)
    assert receiver_pa[stops] == pytest.approx(0.75e6, abs=2e3)
    rate_kg_s = (supply["taken_in_kg"][-1] - supply["taken_in_kg"][0]) / (runs[1:].sum() * 0.01)
    assert rate_kg_s == pytest.approx(4.0e-3 * REFERENCE_KG_M3, rel=0.02)


def test_emergency_stop_vents_the_manifold_and_not_the_claws() -> None:
    """With the relay off, the manifold pressure falls below 10 kPa within 0.2 s; the claws keep their air.

    The pressure of the claw manifold falls by less than 2 % in a minute, and the fingers do not move.
    """
    rig = settled_bench()
    rig.run(1.0, [OFF, OFF, MINUS])
    trace = rig.run(60.0, OFF, fed=False)
    manifold_pa, claws_pa = gauge_pa(trace.supply["manifold"]), gauge_pa(trace.supply["claw_manifold"])
    assert manifold_pa[199] < 10e3
    assert np.abs(manifold_pa[5000:]).max() < 50.0
    assert (np.diff(manifold_pa[:200]) <= 0).all()
    assert claws_pa.min() > 0.98 * 0.40e6
    assert (trace.cylinders[:, CLAWS]["position_m"] == 0.0).all()


def test_the_claw_reservoir_retains_its_pressure_after_the_main_is_lost() -> None:
    """With a failed compressor and a leaking manifold the main air is vented. The reservoir retains its 0.695 MPa
    behind the check valve and the claws can still close; with a leaking check valve it empties."""
    for slip_m3_s_pa, keeps in ((0.0, True), (1e-9, False)):
        rig = settled_bench(receiver_m3=0.002)
        rig.supply_params["compressor_kg_s"], rig.supply_params["leak_m3_s_pa"] = 0.0, 5e-8
        rig.supply_params["slip_m3_s_pa"] = slip_m3_s_pa
        supply = rig.run(30.0, OFF, every=100).supply[-1]
        assert gauge_pa(supply["header"]) < 0.05e6
        assert (gauge_pa(supply["claw_reservoir"]) > 0.69e6) is np.bool_(keeps)
        assert (gauge_pa(supply["claw_reservoir"]) < 0.06e6) is np.bool_(not keeps)
        rig.run(1.0, [OFF, OFF, MINUS])
        assert gauge_pa(rig.cylinders[CLAWS]["minus"]["chamber"]) > 0.3e6 or not keeps


def test_air_returns_softly_and_moves_nothing() -> None:
    """After a stop, the manifold pressure rises no faster than choked flow allows, and no cylinder moves.

    The soft-start valve opens fully at half of the upstream pressure. Choked flow of C = 2e-9 into 0.3 L with n = 1.2
    gives dp/dt = n R T C rho0 p_header / V = 0.48 MPa/s, and up to 1.25 times that while the air warms.
    """
    rig = settled_bench()
    rig.run(5.0, OFF, fed=False)
    places_m = rig.cylinders["position_m"].copy()
    trace = rig.run(3.0, OFF)
    supply = trace.supply
    manifold_pa, soft = gauge_pa(supply["manifold"]), supply["soft_started"] == 0
    assert (manifold_pa[:19] < 50.0).all()
    rate_pa_s = np.diff(manifold_pa[soft]).max() / 1e-3
    choked_pa_s = 1.2 * GAS_CONSTANT * REFERENCE_K * 2e-9 * REFERENCE_KG_M3 * (0.5e6 + ATMOSPHERE_PA) / 0.3e-3
    assert 0.9 * choked_pa_s < rate_pa_s < 1.25 * choked_pa_s
    opened = int((~soft).argmax())
    # compared with the header after the regulator has refilled it in the same step
    assert supply["manifold"]["pressure_pa"][opened - 2] < 0.5 * supply["header"]["pressure_pa"][opened - 2] + 500.0
    assert supply["manifold"]["pressure_pa"][opened] >= 0.5 * supply["header"]["pressure_pa"][opened]
    assert 300 < opened < 700
    assert manifold_pa[-1] == pytest.approx(0.5e6, rel=0.005)
    assert (trace.cylinders["position_m"] == places_m).all()


def test_a_stop_at_full_speed_holds_slide_and_lift() -> None:
    """Slide and lift stop within 1 s after coils and air are switched off at full speed.

    They then hold their positions for a minute, and the claws remain closed.
    """
    rig = settled_bench()
    rig.run(1.5, [PLUS, OFF, MINUS])
    rig.run(0.4, [PLUS, MINUS, MINUS])
    assert abs(rig.cylinders["speed_m_s"][SLIDE]) > 0.1
    assert abs(rig.cylinders["speed_m_s"][LIFT]) > 0.1
    before_m = rig.cylinders["position_m"].copy()
    rig.run(1.0, OFF, fed=False)
    stopped_m = rig.cylinders["position_m"].copy()
    trace = rig.run(60.0, OFF, fed=False, every=100)
    assert np.abs(stopped_m - before_m).max() < 0.02
    assert (trace.cylinders["position_m"] == stopped_m).all()


def test_a_volume_behind_a_regulator_does_not_overshoot() -> None:
    """An empty volume of any size fills to the set pressure with an overshoot below 0.2 %."""
    for header_m3, claw_manifold_m3 in ((0.3e-3, 0.1e-3), (1e-5, 1e-5), (1e-5, 2e-3)):
        rig = settled_bench(header_m3=header_m3, claw_manifold_m3=claw_manifold_m3)
        network = rig.supply[0]
        for name in ("header", "claw_manifold"):
            share = ATMOSPHERE_PA / float(network[name]["pressure_pa"])
            for field in ("mass_kg", "pressure_pa", "density_kg_m3", "energy_j"):
                network[name][field] *= share
        supply = rig.run(6.0, OFF).supply
        assert gauge_pa(supply["header"]).max() < 0.5e6 * 1.002
        assert gauge_pa(supply["claw_manifold"]).max() < 0.4e6 * 1.002
        assert gauge_pa(supply["claw_manifold"])[-1] == pytest.approx(0.4e6, rel=2e-3)
        assert math.isfinite(float(supply["header"]["temperature_k"][-1]))
