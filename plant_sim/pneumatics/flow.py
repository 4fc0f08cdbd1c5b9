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

_ROUNDING = 1e-9
"""Pressure drop below which a restriction has no effect on another one in series, relative."""


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
    # from continuity at the limit (docs/sources/plant.md 1.1); the square root has no finite slope at equal pressures
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
    # the root of a choked lane may be nan; it is not selected
    shape = root(1.0 - past * past)
    falls = past / ((1.0 - critical_ratio) * shape)
    slope = gain * shape / (1.0 - LAMINAR_RATIO)
    return (
        select(choked, gain * up_pa, select(turbulent, gain * up_pa * shape, slope * (up_pa - down_pa))),
        select(choked, gain, select(turbulent, gain * (shape + ratio * falls), slope)),
        select(choked, 0.0, select(turbulent, gain * falls, slope)),
    )


@compiled
def in_series(
    first_m3_s_pa: float, first_ratio: float, second_m3_s_pa: float, second_ratio: float
) -> tuple[float, float]:
    """Return the conductance, m3/(s Pa), and the critical ratio of two restrictions in series.

    The choked flow is exact. Below it, the flow is that of a single restriction which agrees with the two at one
    pressure ratio and differs from them by at most 2 % at any other.

    Args:
        first_m3_s_pa: Sonic conductance of the upstream restriction, m3/(s Pa).
        first_ratio: Its critical pressure ratio.
        second_m3_s_pa: Sonic conductance of the downstream restriction, m3/(s Pa).
        second_ratio: Its critical pressure ratio.

    Source: computed, ISO 6358-1 for each restriction with a common flow and a common pressure between them. The rule
    1/C^2 = 1/C1^2 + 1/C2^2 of docs/sources/plant.md 1.1 does not depend on their order and is up to 8 % lower.
    """
    if first_m3_s_pa <= 0.0 or second_m3_s_pa <= 0.0:
        return 0.0, first_ratio
    wider = second_m3_s_pa / first_m3_s_pa
    if wider * first_ratio >= 1.0:  # the first restriction is choked first
        between = first_ratio
        conductance_m3_s_pa = first_m3_s_pa
    else:
        # pressure ratio of the first restriction at which it passes the choked flow of the second one
        bend = 1.0 / (1.0 - first_ratio) ** 2
        falls = first_ratio * bend
        between = (falls + math.sqrt(wider * wider * (1.0 - first_ratio * falls) + bend)) / (wider * wider + bend)
        conductance_m3_s_pa = second_m3_s_pa * between
        # a first restriction without pressure drop; `1.0 - past` below would be 0
        if between > 1.0 - _ROUNDING:
            return second_m3_s_pa, second_ratio
    # the point of agreement: half of the pressure drop at which the series is choked is left at the first restriction
    middle = 0.5 * (1.0 + between)
    kg_s = first_m3_s_pa * _subsonic(middle, first_ratio)
    share = kg_s / (second_m3_s_pa * middle)
    overall = middle * (second_ratio + (1.0 - second_ratio) * math.sqrt(max(1.0 - share * share, 0.0)))
    share = kg_s / conductance_m3_s_pa
    past = math.sqrt(max(1.0 - share * share, 0.0))
    return conductance_m3_s_pa, max((overall - past) / (1.0 - past), 0.0)


@compiled
def _subsonic(ratio: float, critical_ratio: float) -> float:
    """Return the subsonic flow through a restriction as a fraction of its choked flow."""
    past = (ratio - critical_ratio) / (1.0 - critical_ratio)
    return math.sqrt(1.0 - past * past)


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


def tube_critical_ratio(inner_m: float, length_m: float) -> float:
    """Return the critical pressure ratio of a smooth tube, at most 0.6.

    Args:
        inner_m: Inner diameter, m.
        length_m: Length, m.

    Source: docs/sources/plant.md 1.3, from memory like the conductance.

    >>> round(tube_critical_ratio(0.004, 1.45), 2)
    0.31
    """
    return min(474.0 * tube_conductance_m3_s_pa(inner_m, length_m) / inner_m**2, 0.6)
