"""Solenoid valve with two coils: pilot stages with delays, and the spool."""

from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled, inlined

VALVE = np.dtype(
    [
        ("plus_acts", "i8"),
        ("minus_acts", "i8"),
        ("plus_pending_s", "f8"),
        ("minus_pending_s", "f8"),
        ("spool", "f8"),
        ("target", "f8"),
    ]
)
"""State: levels of the pilots, times for which a coil level has differed from its pilot, and the spool position from -1
to +1.
"""

VALVE_PARAMS = np.dtype(
    [
        ("on_delay_s", "f8"),
        ("off_delay_s", "f8"),
        ("spool_s", "f8"),
        ("conductance_m3_s_pa", "f8"),
        ("critical_ratio", "f8"),
        ("latching", "i8"),
        ("stuck", "i8"),
    ]
)
"""Parameters.

The delays are from the coil to the air at the cylinder, including the tube. `spool_s` is the travel time from the
middle to an end. `latching` is 1 for a 5/2 valve, which keeps its position, and 0 for a 5/3 valve with spring return.
`stuck` is 1 while the spool does not move.
"""

_ROUNDING_S = 1e-9


@compiled
def step_valve(v: Any, params: Any, plus: bool, minus: bool, step_s: float) -> None:
    """Advance by one time step; a pulse shorter than the delay has no effect, and opposite coils cancel each other."""
    if plus == (v.plus_acts != 0):
        v.plus_pending_s = 0.0
    else:
        v.plus_pending_s += step_s
        if v.plus_pending_s >= (params.on_delay_s if plus else params.off_delay_s) - _ROUNDING_S:
            v.plus_acts = 1 if plus else 0
            v.plus_pending_s = 0.0
    if minus == (v.minus_acts != 0):
        v.minus_pending_s = 0.0
    else:
        v.minus_pending_s += step_s
        if v.minus_pending_s >= (params.on_delay_s if minus else params.off_delay_s) - _ROUNDING_S:
            v.minus_acts = 1 if minus else 0
            v.minus_pending_s = 0.0
    wish = float(v.plus_acts - v.minus_acts)
    if params.latching == 0 or wish != 0.0:
        v.target = wish
    if v.spool != v.target and params.stuck == 0:
        way = step_s / params.spool_s
        v.spool = min(v.spool + way, v.target) if v.target > v.spool else max(v.spool - way, v.target)


@inlined
def supply_opening(spool: float) -> float:
    """Return the opening of a port to the supply, 0 to 1; `spool` is positive towards this port."""
    return min(max(2.0 * spool - 1.0, 0.0), 1.0)


@inlined
def exhaust_opening(spool: float) -> float:
    """Return the opening of a port to the exhaust, 0 to 1; 1 if `spool` is 0 (exhaust centre) or negative."""
    return min(max(1.0 - 2.0 * spool, 0.0), 1.0)
