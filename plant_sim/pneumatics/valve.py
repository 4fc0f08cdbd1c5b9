"""Solenoid valve with two coils: pilot stages with delays, travel of the effect through the tube, and the spool."""

from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled, inlined

WAVES = 16
"""Largest number of changes on their way through a tube."""

VALVE = np.dtype(
    [
        ("plus_acts", "i8"),
        ("minus_acts", "i8"),
        ("plus_pending_s", "f8"),
        ("minus_pending_s", "f8"),
        ("spool", "f8"),
        ("target", "f8"),
        ("sent", "f8"),
        ("waves", "i8"),
        ("arrives_s", "f8", (WAVES,)),
        ("sends", "f8", (WAVES,)),
    ]
)
"""State: levels of the pilots, times for which a coil level has differed from its pilot, and the spool position from -1
to +1 as it appears at the cylinder.

`sent` is the latest target of the spool at the valve, `target` the one that has arrived at the cylinder. The first
`waves` elements of `arrives_s` and `sends` are the times until the changes in the tube arrive, and the targets they
carry.
"""

VALVE_PARAMS = np.dtype(
    [
        ("on_delay_s", "f8"),
        ("off_delay_s", "f8"),
        ("tube_s", "f8"),
        ("spool_s", "f8"),
        ("conductance_m3_s_pa", "f8"),
        ("critical_ratio", "f8"),
        ("latching", "i8"),
        ("stuck", "i8"),
    ]
)
"""Parameters.

A pilot follows its coil after `on_delay_s` or `off_delay_s`; a shorter pulse has no effect. Its effect arrives at the
cylinder after the travel time of a pressure change through the tube, `tube_s`, however short it is. `spool_s` is the
travel time of the spool from the middle to an end. `latching` is 1 for a 5/2 valve, which keeps its position, and 0
for a 5/3 valve with spring return. `stuck` is 1 while the spool does not move.
"""

_ROUNDING_S = 1e-9


@compiled
def step_valve(v: Any, params: Any, plus: bool, minus: bool, step_s: float) -> None:
    """Advance by one time step; opposite coils cancel each other."""
    # a pilot acts within the step: time from then to the end of the step, in which the change already travels
    late_s = 0.0
    if plus == (v.plus_acts != 0):
        v.plus_pending_s = 0.0
    else:
        v.plus_pending_s += step_s
        past_s = v.plus_pending_s - (params.on_delay_s if plus else params.off_delay_s)
        if past_s >= -_ROUNDING_S:
            v.plus_acts = 1 if plus else 0
            v.plus_pending_s = 0.0
            late_s = max(late_s, past_s)
    if minus == (v.minus_acts != 0):
        v.minus_pending_s = 0.0
    else:
        v.minus_pending_s += step_s
        past_s = v.minus_pending_s - (params.on_delay_s if minus else params.off_delay_s)
        if past_s >= -_ROUNDING_S:
            v.minus_acts = 1 if minus else 0
            v.minus_pending_s = 0.0
            late_s = max(late_s, past_s)
    wish = float(v.plus_acts - v.minus_acts)
    # a latching valve keeps its position if neither pilot acts, or both do
    sends = wish != v.sent and (params.latching == 0 or wish != 0.0)
    moves_s = step_s
    if sends or v.waves != 0:
        moves_s = _pass_waves(v, params.tube_s - late_s, sends, wish, step_s)
    if v.spool != v.target and params.stuck == 0:
        way = moves_s / params.spool_s
        v.spool = min(v.spool + way, v.target) if v.target > v.spool else max(v.spool - way, v.target)


@compiled
def _pass_waves(v: Any, tube_s: float, sends: bool, wish: float, step_s: float) -> float:
    """Advance the changes in the tube by one time step.

    Args:
        v: The valve.
        tube_s: Time from the end of the step until a new change arrives, s.
        sends: True if the valve sends a new change in this step.
        wish: Its target.
        step_s: Length of the step, s.

    Returns:
        Time from the latest arrival in this step to the end of the step, s; the whole step if nothing arrives.
    """
    for number in range(v.waves):
        v.arrives_s[number] -= step_s
    # if the tube is full, `sent` still differs from the wish and the change is sent in a later step
    if sends and v.waves < WAVES:
        v.arrives_s[v.waves] = tube_s
        v.sends[v.waves] = wish
        v.waves += 1
        v.sent = wish
    arrived, moves_s = 0, step_s
    while arrived < v.waves and v.arrives_s[arrived] <= _ROUNDING_S:
        v.target = v.sends[arrived]
        moves_s = min(max(-v.arrives_s[arrived], 0.0), step_s)
        arrived += 1
    if arrived > 0:
        v.waves -= arrived
        for number in range(v.waves):
            v.arrives_s[number] = v.arrives_s[number + arrived]
            v.sends[number] = v.sends[number + arrived]
    return moves_s


@inlined
def supply_opening(spool: float) -> float:
    """Return the opening of a port to the supply, 0 to 1; `spool` is positive towards this port."""
    # the first half of the travel closes the exhaust, the second opens the supply: never both at once
    return min(max(2.0 * spool - 1.0, 0.0), 1.0)


@inlined
def exhaust_opening(spool: float) -> float:
    """Return the opening of a port to the exhaust, 0 to 1; 1 if `spool` is 0 (exhaust centre) or negative."""
    return min(max(1.0 - 2.0 * spool, 0.0), 1.0)
