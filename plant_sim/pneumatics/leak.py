"""Leak of a chamber to the atmosphere."""

from __future__ import annotations

from typing import Any, Final

from plant_sim.common.compiled import compiled_and_cached
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, GAS_CONSTANT, REFERENCE_K, flow

_PARTS: Final = 1_000


@compiled_and_cached
def leak_conductance(line: Any, start_pa: float, end_pa: float, time_s: float, critical_ratio: float) -> float:
    """Return the conductance through which a chamber at wall temperature leaks from one pressure to another.

    The flow is proportional to the conductance, so the time is the integral of dm / flow with a conductance of 1. The
    pressures of the integral are a geometric series.

    Args:
        line: Line of the chamber, a `LINE` record.
        start_pa: Pressure at the start, absolute, Pa.
        end_pa: Pressure at the end, absolute, Pa; above that of the atmosphere.
        time_s: Duration of the leak, s.
        critical_ratio: Critical pressure ratio of the leak.

    Returns:
        Conductance of the leak, m3/(s Pa).
    """
    kg_pa = (line.chamber.volume_m3 + line.cushion.volume_m3) / (GAS_CONSTANT * REFERENCE_K)
    ratio = (start_pa / end_pa) ** (1.0 / _PARTS)
    pressure_pa, time_of_one = end_pa, 0.0
    for _ in range(_PARTS):
        next_pa = pressure_pa * ratio
        kg_s = flow(0.5 * (pressure_pa + next_pa), ATMOSPHERE_PA, 1.0, critical_ratio, REFERENCE_K)[0]
        time_of_one += kg_pa * (next_pa - pressure_pa) / kg_s
        pressure_pa = next_pa
    return time_of_one / time_s
