"""A solenoid valve with two coils: pilots with their delays, and the spool between them."""

from typing import Any

import numpy as np

from plant_sim.pneumatics.compiled import compiled

#: State: what the pilots do, for how long the coils have asked for something else, and the spool,
#: from -1 to +1.
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

#: Delays from the coil to the air at the cylinder, tube included; `spool_s` from the middle to an
#: end; `latching` 1 for a 5/2 valve that keeps its position, 0 for a 5/3 valve that springs back;
#: `stuck` 1 while the spool does not move.
VALVE_MAKE = np.dtype(
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

_ROUNDING_S = 1e-9


@compiled
def step_valve(v: Any, make: Any, plus: bool, minus: bool, step_s: float) -> None:
    """Let time pass; a pulse shorter than the delay passes unseen, and both coils together cancel."""
    if plus == (v.plus_acts != 0):
        v.plus_pending_s = 0.0
    else:
        v.plus_pending_s += step_s
        if v.plus_pending_s >= (make.on_delay_s if plus else make.off_delay_s) - _ROUNDING_S:
            v.plus_acts = 1 if plus else 0
            v.plus_pending_s = 0.0
    if minus == (v.minus_acts != 0):
        v.minus_pending_s = 0.0
    else:
        v.minus_pending_s += step_s
        if v.minus_pending_s >= (make.on_delay_s if minus else make.off_delay_s) - _ROUNDING_S:
            v.minus_acts = 1 if minus else 0
            v.minus_pending_s = 0.0
    wish = float(v.plus_acts - v.minus_acts)
    if make.latching == 0 or wish != 0.0:
        v.target = wish
    if v.spool != v.target and make.stuck == 0:
        way = step_s / make.spool_s
        v.spool = min(v.spool + way, v.target) if v.target > v.spool else max(v.spool - way, v.target)


@compiled
def supply_opening(spool: float) -> float:
    """How far a port is open to the supply, 0 to 1, for the spool towards this port."""
    return min(max(2.0 * spool - 1.0, 0.0), 1.0)


@compiled
def exhaust_opening(spool: float) -> float:
    """How far a port is open to the exhaust, 0 to 1: fully in the middle (exhaust centre) and beyond."""
    return min(max(1.0 - 2.0 * spool, 0.0), 1.0)
