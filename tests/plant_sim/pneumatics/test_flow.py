"""Flow and chambers compared with a data sheet, closed-form solutions and conservation laws.

The closed forms use kappa = 1.4 and R T0 = 84149 J/kg from `plant_sim.pneumatics.flow`.
"""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.pneumatics.chamber import CHAMBER, GAS, WALL, fill
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, REFERENCE_K, REFERENCE_KG_M3
from tests.plant_sim.pneumatics.pneumatics_rig import (
    NO_HEAT_S,
    flow_through,
    four_flows,
    join,
    nozzles_in_series,
    squeeze,
)
from tests.sampling import examples

KAPPA = 1.4


def make_gas(
    exponent: float = 1.2,
    wall_s: float = NO_HEAT_S,
    *,
    thermal: bool = False,
    wall_w_m2_k: float = 0.0,
    step_s: float = 0.001,
) -> Any:
    gas = np.zeros(1, GAS)
    gas[0] = (exponent, wall_s, thermal, wall_w_m2_k, step_s)
    return gas


def make_walls(m2: float = 0.0, per_m3: float = 0.0) -> Any:
    return np.array([(m2, per_m3)], WALL)


def make_chambers(gas: Any, *filled: tuple[float, float]) -> Any:
    """Create chambers from volumes, m3, and absolute pressures, Pa."""
    chambers = np.zeros(len(filled), CHAMBER)
    for chamber, (volume_m3, pressure_pa) in zip(chambers, filled, strict=True):
        fill(chamber, volume_m3, pressure_pa, gas[0])
    return chambers


def fill_up(chambers: Any, gas: Any, conductance_m3_s_pa: float, for_s: float) -> Any:
    """Fill (or vent) the second chamber from (or into) the first, which is constant; return all pressures."""
    chambers[0]["stiffness"] = 0.0
    steps = round(for_s / gas[0]["step_s"])
    seen_pa = np.empty((steps, 2))
    join(chambers, gas, make_walls(), conductance_m3_s_pa, 0.3, steps, True, seen_pa)
    return seen_pa


def test_v1_flow_of_a_data_sheet() -> None:
    """V1: C = 2 dm3/(s bar), b = 0.3 passes 420 L/min ANR, +-1 %, from 0.4 to 0.3 MPa gauge at 20 C; 600 if choked.

    The data sheet takes the atmosphere as 0.1 MPa. Source: SMC VX data sheet, docs/sources/plant.md 2.
    """
    l_min = 60_000 / REFERENCE_KG_M3
    assert flow_through(0.5e6, 0.4e6, 2e-8, 0.3, REFERENCE_K)[0] * l_min == pytest.approx(420.0, rel=0.01)
    assert flow_through(0.5e6, 0.15e6, 2e-8, 0.3, REFERENCE_K)[0] * l_min == pytest.approx(600.0, rel=1e-9)


def test_v3_choked_flow() -> None:
    """V3: C = 1e-8 m3/(s Pa), b = 0.35 passes 8.295e-3 kg/s, +-0.1 %, from 700 kPa, 293.15 K. Source: plant.md 2."""
    assert flow_through(700e3, 100e3, 1e-8, 0.35, 293.15)[0] == pytest.approx(8.295e-3, rel=0.001)


def test_warm_air_flows_less() -> None:
    """Choked flow is proportional to 1/sqrt(T): at four times the temperature, it is halved. Source: ISO 6358-1."""
    assert flow_through(7e5, 1e5, 1e-8, 0.3, 4 * REFERENCE_K)[0] == pytest.approx(
        0.5 * flow_through(7e5, 1e5, 1e-8, 0.3, REFERENCE_K)[0]
    )


def flow_in_series(down_pa: float, first: tuple[float, float], second: tuple[float, float]) -> float:
    """Return the flow of 6 bar abs through two restrictions (C, b) with a pressure in between."""
    low_pa, high_pa = down_pa, 6e5
    for _ in range(60):
        between_pa = (low_pa + high_pa) / 2
        surplus = ideal_flow(6e5, between_pa, *first) - ideal_flow(between_pa, down_pa, *second)
        low_pa, high_pa = (between_pa, high_pa) if surplus > 0 else (low_pa, between_pa)
    return ideal_flow(6e5, low_pa, *first)


def ideal_flow(up_pa: float, down_pa: float, conductance: float, critical: float) -> float:
    """Return the flow according to ISO 6358, without a laminar part, divided by the density ANR."""
    past = max((down_pa / up_pa - critical) / (1 - critical), 0.0)
    return conductance * up_pa * math.sqrt(1 - past**2)


@examples(60, nightly=300, derandomize=True)
@given(
    wider=st.floats(-1.5, 1.5).map(lambda decades: 10**decades),
    ratios=st.tuples(st.floats(0.05, 0.6), st.floats(0.05, 0.6)),
    down=st.floats(0.02, 0.97),
)
def test_restrictions_in_series(wider: float, ratios: tuple[float, float], down: float) -> None:
    """Two restrictions pass the flow for which a pressure between them exists: 1e-6 if choked, else 2 %, either way."""
    first, second = (1e-8, ratios[0]), (1e-8 * wider, ratios[1])
    conductance, critical = nozzles_in_series(*first, *second)
    choked = flow_in_series(1.0, first, second)
    assert conductance * 6e5 == pytest.approx(choked, rel=1e-6)
    exact = flow_in_series(down * 6e5, first, second)
    assert ideal_flow(6e5, down * 6e5, conductance, critical) == pytest.approx(exact, rel=0.02)


def test_the_order_of_restrictions_in_series_matters() -> None:
    """1.2 before 0.6 (b = 0.3) passes 0.553, and 0.6 before 1.2 passes 0.579; a closed restriction passes nothing.

    Of two equal flows, the narrower restriction downstream is choked by a pressure reduced by the wider one; upstream,
    it is choked by the full pressure. A handbook gives 0.54 for both orders (plant.md 2, V4).
    """
    assert nozzles_in_series(1.2, 0.3, 0.6, 0.3)[0] == pytest.approx(0.5528, abs=5e-5)
    assert nozzles_in_series(0.6, 0.3, 1.2, 0.3)[0] == pytest.approx(0.5792, abs=5e-5)
    assert nozzles_in_series(0.0, 0.3, 1.0, 0.3)[0] == nozzles_in_series(1.0, 0.3, 0.0, 0.3)[0] == 0.0
    assert nozzles_in_series(1e-6, 0.3, 1e-15, 0.4) == (1e-15, 0.4)


@settings(derandomize=True)
@given(
    up_pa=st.floats(5e4, 1e6),
    ratios=st.tuples(*(st.sampled_from([0.0, 0.3, 0.99, 1.0]) | st.floats(0.0, 1.0) for _ in range(4))),
    kelvin=st.floats(200.0, 400.0),
)
def test_four_flows_are_bit_identical_to_single_ones(
    up_pa: float, ratios: tuple[float, float, float, float], kelvin: float
) -> None:
    results = np.empty((4, 3))
    four_flows(up_pa, up_pa * np.array(ratios), 1e-8, 0.3, kelvin, results)
    single = [flow_through(up_pa, up_pa * ratio, 1e-8, 0.3, kelvin) for ratio in ratios]
    assert results.tobytes() == np.array(single).tobytes()


@settings(derandomize=True)
@given(
    up_pa=st.floats(5e4, 1e6),
    ratio=st.floats(0.0, 1.0),
    critical=st.floats(0.05, 0.6),
    kelvin=st.floats(200.0, 400.0),
)
def test_the_flow_falls_with_the_downstream_pressure_and_returns_its_slopes(
    up_pa: float, ratio: float, critical: float, kelvin: float
) -> None:
    """The slopes match difference quotients of 1 Pa in either direction, to within 1 % of the choked slope.

    Points within 2 Pa of a kink are excluded because the left and right slopes differ there.
    """
    down_pa = ratio * up_pa
    kg_s, grows, falls = flow_through(up_pa, down_pa, 1e-8, critical, kelvin)
    assert 0.0 <= kg_s <= flow_through(up_pa, 0.0, 1e-8, critical, kelvin)[0] * (1 + 1e-12)
    assert grows >= 0.0
    assert falls >= 0.0
    kinks_pa = (critical * up_pa, 0.99 * up_pa, up_pa, 0.0)
    if min(abs(down_pa - kink_pa) for kink_pa in kinks_pa) > 2.0:
        more = (
            flow_through(up_pa, down_pa + 1, 1e-8, critical, kelvin)[0]
            - flow_through(up_pa, down_pa - 1, 1e-8, critical, kelvin)[0]
        )
        choked = flow_through(up_pa, 0.0, 1e-8, critical, kelvin)[1]
        assert -more / 2 == pytest.approx(falls, abs=0.01 * choked)
        higher = (
            flow_through(up_pa + 1, down_pa, 1e-8, critical, kelvin)[0]
            - flow_through(up_pa - 1, down_pa, 1e-8, critical, kelvin)[0]
        )
        assert higher / 2 == pytest.approx(grows, abs=0.01 * choked)


@pytest.mark.parametrize("at", [0.3, 0.99])
def test_the_flow_is_continuous(at: float) -> None:
    """At the critical ratio and at the laminar limit, the flows on either side agree to 1e-6 of the choked flow."""
    below, above = (flow_through(7e5, 7e5 * (at + eps), 1e-8, 0.3, REFERENCE_K)[0] for eps in (-1e-10, 1e-10))
    assert below == pytest.approx(above, abs=1e-6 * flow_through(7e5, 0.0, 1e-8, 0.3, REFERENCE_K)[0])


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.4])
def test_a_closed_chamber_keeps_p_v_to_the_n(exponent: float) -> None:
    """Without heat transfer, compression to half in 500 steps gives p0 2^n to 1e-5, and expansion gives p0 to 1e-9.

    The integration is of second order.
    """
    gas = make_gas(exponent)
    chamber = make_chambers(gas, (200e-6, 3e5))
    way_m3 = np.linspace(200e-6, 100e-6, 501)
    squeeze(chamber, gas, make_walls(), way_m3)
    assert chamber[0]["pressure_pa"] == pytest.approx(3e5 * 2**exponent, rel=1e-5)
    squeeze(chamber, gas, make_walls(), way_m3[::-1])
    assert chamber[0]["pressure_pa"] == pytest.approx(3e5, rel=1e-9)
    assert chamber[0]["temperature_k"] == pytest.approx(REFERENCE_K, rel=1e-9)


def test_slow_and_fast_are_the_limits_of_the_walls() -> None:
    """Compression of air with n = 1.2 to half its volume is isothermal if slow and polytropic if fast, to within 1 %.

    Slow is 100 wall time constants, with p V = const; fast is a hundredth of one, with p V^1.2 = const.
    """
    for for_s, exponent in ((40.0, 1.0), (0.004, 1.2)):
        gas = make_gas(1.2, 0.4, step_s=for_s / 400)
        chamber = make_chambers(gas, (200e-6, 3e5))
        squeeze(chamber, gas, make_walls(), np.linspace(200e-6, 100e-6, 401)[1:])
        assert chamber[0]["pressure_pa"] == pytest.approx(3e5 * 2**exponent, rel=0.01)


def test_the_energy_balance_is_adiabatic_without_wall_and_isothermal_with_a_large_wall() -> None:
    """If air is compressed to half in a second, p V^1.4 is constant to 1e-4 or, with a large wall, p V to 1e-3."""
    for wall_w_m2_k, exponent, tolerance in ((0.0, KAPPA, 1e-4), (1e6, 1.0, 1e-3)):
        gas = make_gas(KAPPA, thermal=True, wall_w_m2_k=wall_w_m2_k)
        chamber = make_chambers(gas, (200e-6, 3e5))
        squeeze(chamber, gas, make_walls(0.05), np.linspace(200e-6, 100e-6, 1001)[1:])
        assert chamber[0]["pressure_pa"] == pytest.approx(3e5 * 2**exponent, rel=tolerance)
        assert chamber[0]["temperature_k"] == pytest.approx(REFERENCE_K * 2 ** (exponent - 1), rel=tolerance)


def test_heat_transfer_to_the_walls() -> None:
    """Air at 2.4 bar in 1 L, 20 K warmer than the wall, cools with tau = m cv / (h A), to within 1 %.

    h = 50 W/(m2 K), A = 0.02 m2 + 28.36 m2/m3 * 1 L = 0.04836 m2, m = 2.852 g, so tau = 2.0466 / 2.418 s = 0.8465 s.
    """
    gas = make_gas(KAPPA, thermal=True, wall_w_m2_k=50.0)
    chamber = make_chambers(gas, (1e-3, 2.4e5))
    chamber[0]["energy_j"] *= (REFERENCE_K + 20.0) / REFERENCE_K
    squeeze(chamber, gas, make_walls(0.02, 28.36), np.full(846, 1e-3))
    assert chamber[0]["temperature_k"] - REFERENCE_K == pytest.approx(20.0 / math.e, rel=0.01)


def test_the_final_temperature_of_adiabatic_filling() -> None:
    """A chamber filled from 1 to 6 bar abs by a main at T0 reaches the temperature T2 to within 0.3 %.

    Energy: m2 cv T2 = m1 cv T0 + (m2 - m1) cp T0, with m = p V / (R T). This gives
    T2 = kappa T0 / (1 + (kappa - 1) p1/p2) = 384.7 K.
    """
    gas = make_gas(KAPPA, thermal=True)
    chambers = make_chambers(gas, (1.0, 6e5), (1e-3, 1e5))
    fill_up(chambers, gas, 1e-8, 5.0)
    assert chambers[1]["pressure_pa"] == pytest.approx(6e5, rel=1e-3)
    assert chambers[1]["temperature_k"] == pytest.approx(KAPPA * REFERENCE_K / (1 + (KAPPA - 1) / 6), rel=0.003)


def test_the_final_temperature_of_adiabatic_venting() -> None:
    """A chamber vented from 6 to 3 bar abs cools to T2 = T0 2^(-0.4/1.4) = 240.5 K, to within 0.3 %."""
    gas = make_gas(KAPPA, thermal=True)
    chambers = make_chambers(gas, (1.0, 3e5), (1e-3, 6e5))
    fill_up(chambers, gas, 1e-8, 5.0)
    assert chambers[1]["temperature_k"] == pytest.approx(REFERENCE_K * 0.5 ** (1 - 1 / KAPPA), rel=0.003)


def test_the_time_to_fill_while_choked() -> None:
    """A main at 12 bar fills 1 L from 1 to 3 bar abs in 1.671 s, +-2 steps: dp/dt = C rho0 R T0 p_main / V.

    The flow is choked throughout because 3/12 is below b = 0.3.
    """
    gas = make_gas(1.0, 1e-9)
    chambers = make_chambers(gas, (1.0, 12e5), (1e-3, 1e5))
    seen_pa = fill_up(chambers, gas, 1e-9, 2.0)
    expected_s = 2e5 * 1e-3 / (1e-9 * REFERENCE_KG_M3 * 287.05 * REFERENCE_K * 12e5)
    assert int(np.argmax(seen_pa[:, 1] >= 3e5)) * 1e-3 == pytest.approx(expected_s, abs=0.002)


def test_exchange_conserves_mass_and_energy() -> None:
    """Mass is conserved to 1e-14; with the energy balance and without a wall, energy is conserved to 1e-12."""
    gas = make_gas(KAPPA, thermal=True)
    chambers = make_chambers(gas, (1e-4, 7e5), (5e-4, 1e5))
    before = chambers["mass_kg"].sum(), chambers["energy_j"].sum()
    join(chambers, gas, make_walls(), 1e-8, 0.3, 1000, False, np.empty((1000, 2)))
    assert chambers["mass_kg"].sum() == pytest.approx(before[0], rel=1e-14)
    assert chambers["energy_j"].sum() == pytest.approx(before[1], rel=1e-12)
    assert chambers[0]["pressure_pa"] == pytest.approx(chambers[1]["pressure_pa"], rel=1e-3)


@settings(max_examples=60, derandomize=True)
@given(
    volume_m3=st.floats(1e-6, 1e-3),
    conductance_m3_s_pa=st.sampled_from([1e-9, 1e-8, 1e-7, 1e-6]),
    step_ms=st.sampled_from([0.2, 1.0, 5.0]),
    gauge_pa=st.floats(0.1e6, 0.8e6),
    thermal=st.booleans(),
)
def test_any_volume_fills_and_vents_without_overshoot(
    volume_m3: float, conductance_m3_s_pa: float, step_ms: float, gauge_pa: float, thermal: bool
) -> None:
    """For all allowed volumes and conductances and steps of up to 5 ms, the pressure overshoots by less than 0.5 %."""
    gas = make_gas(KAPPA if thermal else 1.2, 0.4, thermal=thermal, wall_w_m2_k=50.0, step_s=step_ms / 1000)
    full_pa = ATMOSPHERE_PA + gauge_pa
    for main_pa, start_pa in ((full_pa, ATMOSPHERE_PA), (ATMOSPHERE_PA, full_pa)):
        chambers = make_chambers(gas, (1.0, main_pa), (volume_m3, start_pa))
        seen_pa = fill_up(chambers, gas, conductance_m3_s_pa, 0.4)[:, 1]
        past_pa = (seen_pa - main_pa) * math.copysign(1.0, main_pa - start_pa)
        assert past_pa.max() < 5e-3 * main_pa


def test_settled_air_is_bit_identical() -> None:
    """Once the air has settled, nothing changes during a minute with an open valve between equal pressures."""
    gas = make_gas(1.2, 0.4)
    chambers = make_chambers(gas, (1e-4, ATMOSPHERE_PA), (1e-5, ATMOSPHERE_PA))
    join(chambers, gas, make_walls(), 1e-8, 0.3, 1000, False, np.empty((1000, 2)))
    before = chambers.tobytes()
    join(chambers, gas, make_walls(), 1e-8, 0.3, 60_000, False, np.empty((60_000, 2)))
    assert chambers.tobytes() == before
