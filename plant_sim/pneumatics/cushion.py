"""Pneumatic cushion: at the end of the stroke a plunger closes off a part of the chamber, which empties by a needle."""

from typing import Any

from plant_sim.common.compiled import compiled
from plant_sim.pneumatics.chamber import exchange, resize
from plant_sim.pneumatics.flow import REFERENCE_K

_STILL_PA = 20.0
_STILL_K = 0.1


@compiled
def move_plunger(n: Any, params: Any, cushion_m: float, from_end_m: float, volume_m3: float, gas: Any) -> float:
    """Close off or open the cushion of a line after the piston has moved; return the new volume of the chamber, m3.

    Args:
        n: The line.
        params: Its parameters.
        cushion_m: Length of the cushion, m.
        from_end_m: Distance of the piston from the end of the stroke, m.
        volume_m3: New volume of chamber and cushion, m3.
        gas: Gas model.
    """
    cushion, chamber = n.cushion, n.chamber
    if from_end_m >= cushion_m and cushion.volume_m3 <= 0.0:
        return volume_m3
    closed_m3: float = params.cushion_m3 + params.cushion_m2 * from_end_m
    if cushion.volume_m3 <= 0.0:
        _close_off(chamber, cushion, closed_m3 / volume_m3)
    # before it opens, so that the last part of the motion also changes the pressure of the cushion
    resize(cushion, closed_m3, gas)
    if from_end_m >= cushion_m:
        resize(chamber, volume_m3 - closed_m3, gas)
        _unite(chamber, cushion, gas)
        return volume_m3
    return volume_m3 - closed_m3


@compiled
def step_cushion(n: Any, params: Any, gas: Any) -> None:
    """Exchange air between a closed cushion and the chamber for one step: out by the needle, in past the seal lip."""
    out = n.cushion.pressure_pa > n.chamber.pressure_pa
    conductance_m3_s_pa = params.needle_m3_s_pa if out else params.free_m3_s_pa
    exchange(n.cushion, n.chamber, conductance_m3_s_pa, params.critical_ratio, gas)


@compiled
def cushion_is_at_rest(n: Any) -> bool:
    """Return True if there is no cushion, or if its air has the pressure of the chamber and the wall temperature."""
    if n.cushion.volume_m3 <= 0.0:
        return True
    apart_pa = abs(n.cushion.pressure_pa - n.chamber.pressure_pa)
    return bool(apart_pa <= _STILL_PA and abs(n.cushion.temperature_k - REFERENCE_K) <= _STILL_K)


@compiled
def _close_off(chamber: Any, cushion: Any, share: float) -> None:
    """Split off a share of the volume of a chamber with its air."""
    cushion.volume_m3, chamber.volume_m3 = share * chamber.volume_m3, (1.0 - share) * chamber.volume_m3
    cushion.mass_kg, chamber.mass_kg = share * chamber.mass_kg, (1.0 - share) * chamber.mass_kg
    cushion.energy_j, chamber.energy_j = share * chamber.energy_j, (1.0 - share) * chamber.energy_j
    # the same amount of air raises the pressure more in less volume
    cushion.stiffness, chamber.stiffness = chamber.stiffness / share, chamber.stiffness / (1.0 - share)
    cushion.temperature_k, cushion.pressure_pa = chamber.temperature_k, chamber.pressure_pa
    cushion.density_kg_m3 = chamber.density_kg_m3


@compiled
def _unite(chamber: Any, cushion: Any, gas: Any) -> None:
    """Return the air of the cushion to the chamber; mass and energy are conserved."""
    mass_kg, volume_m3 = chamber.mass_kg + cushion.mass_kg, chamber.volume_m3 + cushion.volume_m3
    # energy is mass times temperature and also pressure times volume: hence temperatures weighted by mass, pressures by
    # volume
    share = cushion.mass_kg / mass_kg
    filled = cushion.volume_m3 / volume_m3
    chamber.pressure_pa += filled * (cushion.pressure_pa - chamber.pressure_pa)
    chamber.temperature_k += share * (cushion.temperature_k - chamber.temperature_k)
    chamber.density_kg_m3 = 1.0 / ((1.0 - share) / chamber.density_kg_m3 + share / cushion.density_kg_m3)
    chamber.energy_j += cushion.energy_j
    chamber.mass_kg, chamber.volume_m3 = mass_kg, volume_m3
    chamber.stiffness = gas.exponent * chamber.pressure_pa / mass_kg
    cushion.mass_kg = cushion.volume_m3 = cushion.energy_j = cushion.pressure_pa = cushion.stiffness = 0.0
