"""Mass flow of air through a restriction according to ISO 6358."""

import math
from typing import Any

from plant_sim.common.compiled import compiled, inlined
from plant_sim.common.lanes import root, select

GAS_CONSTANT = 287.05
"""Specific gas constant of air, J/(kg K)."""

HEAT_P, HEAT_V = 1004.675, 717.625
"""Heat capacities of air at constant pressure and constant volume, J/(kg K). Their difference is the gas constant."""

REFERENCE_K = 293.15
"""Temperature of the reference atmosphere ANR and of the ambient air, K. Source: ISO 8778."""

REFERENCE_KG_M3 = 1.185
"""Density of the reference atmosphere ANR, kg/m3. Source: ISO 8778."""

REFERENCE_PA = 100_000.0
"""Pressure of the reference atmosphere ANR, to which a sonic conductance refers, Pa. Source: ISO 8778."""

ATMOSPHERE_PA = 101_325.0
"""Ambient pressure, Pa."""

LAMINAR_RATIO = 0.99
"""Pressure ratio above which the flow is laminar. Source: docs/sources/plant.md 1.1 for steps of 1 ms."""


@compiled
def flow(
    up_pa: float, down_pa: float, conductance_m3_s_pa: float, critical_ratio: float, up_k: float
) -> tuple[float, float, float]:
    """Return the mass flow through a restriction: choked, subsonic or, near equal pressures, laminar.

    Args:
        up_pa: Absolute pressure upstream, Pa.
        down_pa: Absolute pressure downstream, Pa, not above `up_pa`.
        conductance_m3_s_pa: Sonic conductance C, m3/(s Pa).
        critical_ratio: Critical pressure ratio b.
        up_k: Temperature upstream, K.

    Returns:
        The flow, kg/s; its increase with the upstream pressure, kg/(s Pa); its decrease with the downstream
        pressure, kg/(s Pa).

    Source: ISO 6358-1; docs/sources/plant.md 1.1.
    """
    gain = conductance_m3_s_pa * REFERENCE_KG_M3 * math.sqrt(REFERENCE_K / up_k)
    ratio = down_pa / up_pa
    if ratio <= critical_ratio:
        return gain * up_pa, gain, 0.0
    if ratio < LAMINAR_RATIO:
        past = (ratio - critical_ratio) / (1.0 - critical_ratio)
        root = math.sqrt(1.0 - past * past)
        falls = past / ((1.0 - critical_ratio) * root)
        return gain * up_pa * root, gain * (root + ratio * falls), gain * falls
    past = (LAMINAR_RATIO - critical_ratio) / (1.0 - critical_ratio)
    slope = gain * math.sqrt(1.0 - past * past) / (1.0 - LAMINAR_RATIO)
    return slope * (up_pa - down_pa), slope, slope


@inlined
def flows(up_pa: Any, down_pa: Any, conductance_m3_s_pa: Any, critical_ratio: Any, up_k: Any) -> tuple[Any, Any, Any]:
    """Return four mass flows as `flow` does for each of them; all arguments and results are lanes.

    The three kinds of flow are computed for every restriction, with the operations of `flow` in the same order.
    """
    gain = conductance_m3_s_pa * REFERENCE_KG_M3 * root(REFERENCE_K / up_k)
    ratio = down_pa / up_pa
    choked, turbulent = ratio <= critical_ratio, ratio < LAMINAR_RATIO
    past = (select(turbulent, ratio, LAMINAR_RATIO) - critical_ratio) / (1.0 - critical_ratio)
    shape = root(1.0 - past * past)
    falls = past / ((1.0 - critical_ratio) * shape)
    slope = gain * shape / (1.0 - LAMINAR_RATIO)
    return (
        select(choked, gain * up_pa, select(turbulent, gain * up_pa * shape, slope * (up_pa - down_pa))),
        select(choked, gain, select(turbulent, gain * (shape + ratio * falls), slope)),
        select(choked, 0.0, select(turbulent, gain * falls, slope)),
    )


@inlined
def in_series(one_m3_s_pa: Any, other_m3_s_pa: Any) -> Any:
    """Return the conductances of four pairs of restrictions in series, m3/(s Pa): 1/C^2 = 1/C1^2 + 1/C2^2.

    Arguments and result are lanes. Source: docs/sources/plant.md 1.1 (an approximation).
    """
    share = one_m3_s_pa / other_m3_s_pa
    closed = (one_m3_s_pa <= 0.0) | (other_m3_s_pa <= 0.0)
    return select(closed, 0.0, one_m3_s_pa / root(1.0 + share * share))


def tube_conductance_m3_s_pa(inner_m: float, length_m: float) -> float:
    """Return the sonic conductance of a smooth tube, m3/(s Pa).

    Args:
        inner_m: Inner diameter, m.
        length_m: Length, m.

    Source: docs/sources/plant.md 1.3, a rule of thumb quoted from memory and not verified.

    >>> round(1e8 * tube_conductance_m3_s_pa(0.004, 1.45), 2)
    1.05
    """
    return 0.029 * inner_m**2 / math.sqrt(length_m / inner_m**1.25 + 510.0)
