"""A volume of air: its mass is a state, so that no air is ever made or lost."""

from typing import Any

import numpy as np

from plant_sim.pneumatics.compiled import compiled, compiled_and_kept
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, GAS_CONSTANT, HEAT_P, HEAT_V, REFERENCE_K, flow

#: State of a chamber. `stiffness` is the pressure it gains a kilogram, Pa/kg; `energy_j` its inner energy.
CHAMBER = np.dtype(
    [
        ("mass_kg", "f8"),
        ("temperature_k", "f8"),
        ("volume_m3", "f8"),
        ("pressure_pa", "f8"),
        ("stiffness", "f8"),
        ("density_kg_m3", "f8"),
        ("energy_j", "f8"),
    ]
)

#: How the air of every chamber behaves. With `thermal` 0 its temperature follows its density with
#: `exponent` and relaxes to that of the walls within `wall_s`; with 1 it follows the energy balance
#: with `wall_w_m2_k` at the walls of a ball of the same volume.
GAS = np.dtype([("exponent", "f8"), ("wall_s", "f8"), ("thermal", "i8"), ("wall_w_m2_k", "f8"), ("step_s", "f8")])

_BALL = 4.835975862049409  # (36 pi)^(1/3): wall of a ball is this times its volume^(2/3)


@compiled_and_kept
def fill(c: Any, volume_m3: float, pressure_pa: float, gas: Any) -> None:
    """Put a chamber at a pressure and at the temperature of the surroundings."""
    c.volume_m3 = volume_m3
    c.temperature_k = REFERENCE_K
    c.pressure_pa = pressure_pa
    c.mass_kg = pressure_pa * volume_m3 / (GAS_CONSTANT * REFERENCE_K)
    c.density_kg_m3 = c.mass_kg / volume_m3
    c.stiffness = gas.exponent * GAS_CONSTANT * REFERENCE_K / volume_m3
    c.energy_j = c.mass_kg * HEAT_V * REFERENCE_K


@compiled_and_kept
def surroundings(c: Any) -> None:
    """Make a chamber the surroundings: no flow changes its pressure; its mass is what it was given."""
    c.volume_m3 = 1.0
    c.temperature_k = REFERENCE_K
    c.pressure_pa = ATMOSPHERE_PA
    c.mass_kg = 0.0
    c.stiffness = 0.0
    c.energy_j = 0.0
    c.density_kg_m3 = ATMOSPHERE_PA / (GAS_CONSTANT * REFERENCE_K)


@compiled
def exchange(a: Any, b: Any, conductance_m3_s_pa: float, critical_ratio: float, step_s: float) -> float:
    """Let air flow through a restriction between two chambers for a step; return the mass that left `a`, kg.

    The flow is linearly implicit in both pressures and ends where they are equal: however small the volumes,
    it settles instead of overshooting, and what leaves one enters the other. Source: PLANT.md 3.3, 3.4.
    """
    if conductance_m3_s_pa <= 0.0:
        return 0.0
    if a.pressure_pa < b.pressure_pa:
        return -_pass(b, a, b.pressure_pa, conductance_m3_s_pa, critical_ratio, step_s)
    return _pass(a, b, a.pressure_pa, conductance_m3_s_pa, critical_ratio, step_s)


@compiled
def check(a: Any, b: Any, crack_pa: float, conductance_m3_s_pa: float, critical_ratio: float, step_s: float) -> float:
    """Let air flow from `a` to `b` only, and only above a cracking pressure; return its mass, kg."""
    if conductance_m3_s_pa <= 0.0 or a.pressure_pa - crack_pa <= b.pressure_pa:
        return 0.0
    return _pass(a, b, a.pressure_pa - crack_pa, conductance_m3_s_pa, critical_ratio, step_s)


@compiled
def _pass(up: Any, down: Any, up_pa: float, conductance_m3_s_pa: float, critical_ratio: float, step_s: float) -> float:
    kg_s, grows, falls = flow(up_pa, down.pressure_pa, conductance_m3_s_pa, critical_ratio, up.temperature_k)
    mass_kg: float = step_s * kg_s / (1.0 + step_s * (grows * up.stiffness + falls * down.stiffness))
    levels_kg = (up_pa - down.pressure_pa) / (up.stiffness + down.stiffness)
    if mass_kg > 0.2 * levels_kg:
        mass_kg = min(mass_kg, levels_kg * _softer(down, levels_kg))
    move(up, down, mass_kg)
    return mass_kg


@compiled
def _softer(c: Any, mass_kg: float) -> float:
    """Share of a mass that brings a chamber to where its stiffness says the whole would: filling, it stiffens."""
    grows = c.stiffness * mass_kg / c.pressure_pa
    if grows <= 0.0:
        return 1.0
    exponent = c.stiffness * c.mass_kg / c.pressure_pa
    share: float = ((1.0 + grows) ** (1.0 / exponent) - 1.0) * exponent / grows
    return share


@compiled
def move(a: Any, b: Any, mass_kg: float) -> None:
    """Take air with its heat from one chamber to the other; a negative mass goes back."""
    heat_j = HEAT_P * mass_kg * (a.temperature_k if mass_kg > 0.0 else b.temperature_k)
    a.mass_kg -= mass_kg
    a.pressure_pa -= a.stiffness * mass_kg
    a.energy_j -= heat_j
    b.mass_kg += mass_kg
    b.pressure_pa += b.stiffness * mass_kg
    b.energy_j += heat_j


@compiled
def tendency(
    a: Any, b: Any, crack_pa: float, conductance_m3_s_pa: float, critical_ratio: float
) -> tuple[float, float, float]:
    """Flow from `a` to `b`, kg/s, and how it grows with the pressure of `a` and falls with that of `b`, kg/(s Pa).

    It is negative if it goes back. Towards `b` it opens at a cracking pressure.
    """
    up_pa = a.pressure_pa - crack_pa
    if conductance_m3_s_pa <= 0.0 or (up_pa <= b.pressure_pa and a.pressure_pa >= b.pressure_pa):
        return 0.0, 0.0, 0.0
    if up_pa > b.pressure_pa:
        return flow(up_pa, b.pressure_pa, conductance_m3_s_pa, critical_ratio, a.temperature_k)
    kg_s, grows, falls = flow(b.pressure_pa, a.pressure_pa, conductance_m3_s_pa, critical_ratio, b.temperature_k)
    return -kg_s, falls, grows


@compiled
def resize(c: Any, volume_m3: float, gas: Any) -> None:
    """Move the piston of a chamber."""
    if volume_m3 == c.volume_m3:
        return
    before_m3 = c.volume_m3
    half = 0.5 * gas.exponent * (before_m3 - volume_m3)
    middle_m3 = 0.5 * (before_m3 + volume_m3)
    pressure_pa = c.pressure_pa * (middle_m3 + half) / (middle_m3 - half)
    c.energy_j -= 0.5 * (c.pressure_pa + pressure_pa) * (volume_m3 - before_m3)
    c.pressure_pa = pressure_pa
    c.volume_m3 = volume_m3
    c.stiffness = gas.exponent * pressure_pa / c.mass_kg


@compiled
def settle(c: Any, gas: Any) -> None:
    """Close a step: temperature from what happened to the air, pressure from mass, temperature and volume."""
    density_kg_m3 = c.mass_kg / c.volume_m3
    if gas.thermal == 0:
        # (rho/rho_before)^(n-1) as a quotient: right to the second order, and no power to compute
        turn = (gas.exponent - 1.0) * (density_kg_m3 - c.density_kg_m3) / (density_kg_m3 + c.density_kg_m3)
        temperature_k = c.temperature_k * (1.0 + turn) / (1.0 - turn)
        temperature_k += (REFERENCE_K - temperature_k) * gas.step_s / (gas.wall_s + gas.step_s)
    else:
        wall_j_k = gas.wall_w_m2_k * _BALL * c.volume_m3 ** (2.0 / 3.0) * gas.step_s
        temperature_k = (c.energy_j + wall_j_k * REFERENCE_K) / (c.mass_kg * HEAT_V + wall_j_k)
    c.temperature_k = temperature_k
    c.density_kg_m3 = density_kg_m3
    c.pressure_pa = density_kg_m3 * GAS_CONSTANT * temperature_k
    c.stiffness = gas.exponent * GAS_CONSTANT * temperature_k / c.volume_m3
    c.energy_j = c.mass_kg * HEAT_V * temperature_k
