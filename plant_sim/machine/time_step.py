"""Length of the time steps that the air of a machine requires."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from plant_sim.pneumatics.flow import ATMOSPHERE_PA, GAS_CONSTANT, REFERENCE_K, REFERENCE_KG_M3, REFERENCE_PA

if TYPE_CHECKING:
    from plant_sim.devices.pneumatic import AirSpec
    from plant_sim.devices.supply import SupplySpec
    from plant_sim.machine.parameters import Machine

MOST_STEPS_PER_MS: Final = 100
"""Largest number of steps per millisecond; a machine that requires more is rejected."""

_TURNOVER: Final = 0.07
"""Largest part of the content of a volume that may flow through it in a step. Computed: with it, strokes in steps of up
to 1 ms take as long as in steps of 0.1 ms, see tests/plant_sim/machine/test_random_air.py."""

_TURN: Final = 1.2
"""Largest oscillation of a piston on its air in a step, rad. The semi-implicit step is stable below 2."""

_RESPONSE: Final = 0.65
"""Length of a step relative to the time constant of a regulator with the volume behind it. Computed like `_TURNOVER`;
the steps are not shortened beyond the limit for it, because the regulator is stable at any length."""

_CUSHION_PEAK: Final = 4.0
"""Pressure in a cushion relative to the supply pressure, both gauge. Assumed."""


def steps_per_ms_by_key(machine: Machine) -> dict[str, float]:
    """Return the least number of steps per millisecond, by the parameter of the volume that requires it."""
    supply = machine.supply
    needs = {}
    drawn_m3_s_pa = {}
    for section, spec, port, moved_kg, gauge_pa in (
        ("slide", machine.slide, machine.slide_port, machine.slide.piston_kg, supply.pressure_pa),
        ("lift", machine.lift, machine.lift_port, machine.lift.carried_kg, supply.pressure_pa),
        (
            "claws",
            machine.claws,
            machine.claws_port,
            machine.claws.grippers * machine.claws.moved_kg,
            machine.claw_pressure_pa,
        ),
    ):
        line_m3_s_pa = _in_series(port.valve_conductance_m3_s_pa, port.tube_conductance_m3_s_pa)
        drawn_m3_s_pa[section] = 2 * line_m3_s_pa
        needs[f"{section}_port.tube_length_m"] = _for_content(port.tube_m3, line_m3_s_pa)
        filled = _for_content(port.dead_volume_m3, min(line_m3_s_pa, port.fitting_conductance_m3_s_pa))
        swings = _for_spring(_spring_n_m(spec.area_m2, port.dead_volume_m3, machine, gauge_pa), moved_kg)
        needs[f"{section}_port.dead_volume_m3"] = max(filled, swings)
    lift = machine.lift
    cushion_n_m = _spring_n_m(lift.cushion_area_m2, lift.cushion_volume_m3, machine, _CUSHION_PEAK * supply.pressure_pa)
    needs["lift.cushion_volume_m3"] = _for_spring(cushion_n_m, lift.carried_kg)
    main_m3_s_pa = drawn_m3_s_pa["slide"] + drawn_m3_s_pa["lift"]
    through = {
        "header": min(supply.regulator_conductance_m3_s_pa, supply.main_conductance_m3_s_pa),
        "manifold": min(supply.main_conductance_m3_s_pa, main_m3_s_pa),
        "claw_reservoir": min(supply.check_conductance_m3_s_pa, supply.claw_regulator_conductance_m3_s_pa),
        "claw_manifold": min(supply.claw_regulator_conductance_m3_s_pa, drawn_m3_s_pa["claws"]),
    }
    regulators = {
        "header": supply.regulator_conductance_m3_s_pa,
        "claw_manifold": supply.claw_regulator_conductance_m3_s_pa,
    }
    for store, conductance_m3_s_pa in through.items():
        needs[f"supply.{store}_m3"] = _for_content(getattr(supply, f"{store}_m3"), conductance_m3_s_pa)
        if store in regulators:
            response = _for_regulator(supply, regulators[store], getattr(supply, f"{store}_m3"), machine.air)
            needs[f"supply.{store}_m3"] = max(needs[f"supply.{store}_m3"], response)
    return needs


def _spring_n_m(area_m2: float, volume_m3: float, machine: Machine, gauge_pa: float) -> float:
    """Return the stiffness of the air on both sides of a piston, each with its smallest volume, N/m."""
    return 2 * machine.air.stiffness_exponent * (gauge_pa + ATMOSPHERE_PA) * area_m2**2 / volume_m3


def _in_series(one_m3_s_pa: float, other_m3_s_pa: float) -> float:
    """Return the approximate conductance of two restrictions in series, m3/(s Pa)."""
    return 1 / math.hypot(1 / one_m3_s_pa, 1 / other_m3_s_pa)


def _for_content(volume_m3: float, conductance_m3_s_pa: float) -> float:
    """Return the number of steps per millisecond in which choked flow turns over a small part of a volume."""
    return 1e-3 * conductance_m3_s_pa * REFERENCE_PA / volume_m3 / _TURNOVER


def _for_spring(spring_n_m: float, mass_kg: float) -> float:
    """Return the number of steps per millisecond in which a mass on a spring oscillates by a small angle."""
    return 1e-3 * math.sqrt(spring_n_m / mass_kg) / _TURN


def _for_regulator(supply: SupplySpec, conductance_m3_s_pa: float, volume_m3: float, air: AirSpec) -> float:
    """Return the number of steps per millisecond that resolve the response of a regulator, or the largest number."""
    kg_s_pa = (
        conductance_m3_s_pa * REFERENCE_KG_M3 * (supply.compressor_off_pa + ATMOSPHERE_PA) / supply.regulator_band_pa
    )
    pa_kg = air.stiffness_exponent * GAS_CONSTANT * REFERENCE_K / volume_m3
    return min(1e-3 * kg_s_pa * pa_kg / _RESPONSE, MOST_STEPS_PER_MS)
