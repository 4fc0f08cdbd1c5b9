"""Line from a valve port to a cylinder chamber: tube, throttle and pilot check valve."""

from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled
from plant_sim.pneumatics.chamber import CHAMBER, check, exchange, flow_and_slopes, move, resize, settle
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, REFERENCE_K, in_series
from plant_sim.pneumatics.valve import exhaust_opening, supply_opening

LINE = np.dtype([("tube", CHAMBER), ("chamber", CHAMBER), ("drawn_kg", "f8"), ("piloted", "i8")])
"""State: tube, chamber behind it, and mass of air admitted by the valve so far. `piloted` is 1 while the pilot holds
the check valve open.
"""

LINE_PARAMS = np.dtype(
    [
        ("tube_m3_s_pa", "f8"),
        ("tube_m3", "f8"),
        ("dead_m3", "f8"),
        ("free_m3_s_pa", "f8"),
        ("throttle_m3_s_pa", "f8"),
        ("critical_ratio", "f8"),
        ("checked", "i8"),
        ("crack_pa", "f8"),
        ("pilot_ratio", "f8"),
        ("pilot_least_pa", "f8"),
        ("slip_m3_s_pa", "f8"),
        ("leak_m3_s_pa", "f8"),
    ]
)
"""Parameters.

`free` is the inward path past the throttle, `throttle` the outward path (meter-out); both are in series with the check
valve. `checked` 0 means no check valve. `slip` is a leak past the seat of the check valve and `leak` is one from the
chamber to the ambient air (both faults). The volume of the chamber is `dead_m3` plus the swept volume.
"""


_STILL_PA = 20.0
_STILL_K = 0.1


@compiled
def line_is_at_rest(n: Any, params: Any, spool: float, manifold: Any) -> bool:
    """Return True if no air is flowing in a line and all of it is at wall temperature."""
    tube, chamber = n.tube, n.chamber
    if params.leak_m3_s_pa > 0.0 or params.slip_m3_s_pa > 0.0:
        return False
    if abs(chamber.temperature_k - REFERENCE_K) > _STILL_K or abs(tube.temperature_k - REFERENCE_K) > _STILL_K:
        return False
    source_pa = manifold.pressure_pa if spool > 0.0 else ATMOSPHERE_PA
    if abs(tube.pressure_pa - source_pa) > _STILL_PA:
        return False
    if params.checked:
        return bool(spool == 0.0 and n.piloted == 0 and chamber.pressure_pa > tube.pressure_pa)
    return bool(abs(chamber.pressure_pa - tube.pressure_pa) <= _STILL_PA)


@compiled
def step_line(
    n: Any,
    params: Any,
    valve_params: Any,
    spool: float,
    pilot_pa: float,
    out_share: float,
    volume_m3: float,
    manifold: Any,
    outside: Any,
    gas: Any,
) -> None:
    """Advance by one time step.

    Args:
        n: The line.
        params: Its parameters.
        valve_params: Parameters of the valve.
        spool: Spool position of the valve; +1 feeds this line.
        pilot_pa: Pressure in the tube of the opposite line, Pa.
        out_share: Fraction of the throttle left open by the cushion, 0 to 1.
        volume_m3: New volume of the chamber, m3.
        manifold: Supply chamber of the valve.
        outside: The ambient air.
        gas: Gas model.
    """
    step_s = gas.step_s
    tube, chamber, critical = n.tube, n.chamber, params.critical_ratio
    resize(chamber, volume_m3, gas)
    gauge_pa = chamber.pressure_pa - ATMOSPHERE_PA
    least_pa = max(params.pilot_ratio * gauge_pa, params.pilot_least_pa)
    n.piloted = 1 if params.checked == 0 or pilot_pa - ATMOSPHERE_PA >= least_pa else 0
    crack_pa, onward = 0.0 if n.piloted else params.crack_pa, params.free_m3_s_pa
    if tube.pressure_pa <= chamber.pressure_pa:
        crack_pa, onward = 0.0, params.throttle_m3_s_pa * out_share if n.piloted else params.slip_m3_s_pa
    opening = supply_opening(spool)
    if opening > 0.0:
        through = in_series(valve_params.conductance_m3_s_pa * opening, params.tube_m3_s_pa)
        n.drawn_kg += _step_flows(n, manifold, through, valve_params.critical_ratio, crack_pa, onward, critical, step_s)
    else:
        through = in_series(valve_params.conductance_m3_s_pa * exhaust_opening(spool), params.tube_m3_s_pa)
        _step_flows(n, outside, through, valve_params.critical_ratio, crack_pa, onward, critical, step_s)
    exchange(chamber, outside, params.leak_m3_s_pa, critical, step_s)
    settle(tube, gas)
    settle(chamber, gas)


@compiled
def _step_flows(
    n: Any,
    source: Any,
    valve_m3_s_pa: float,
    valve_critical: float,
    crack_pa: float,
    onward_m3_s_pa: float,
    onward_critical: float,
    step_s: float,
) -> float:
    """Pass air through the valve and the fitting for one step; return the mass drawn from the source, kg.

    Both flows are linearly implicit in all three pressures. If they were solved one after the other, the error of the
    tube pressure would be the change that one of the flows causes in a step.
    """
    tube, chamber = n.tube, n.chamber
    in_kg_s, in_grows, in_falls = flow_and_slopes(source, tube, 0.0, valve_m3_s_pa, valve_critical)
    on_kg_s, on_grows, on_falls = flow_and_slopes(tube, chamber, crack_pa, onward_m3_s_pa, onward_critical)
    a11 = 1.0 + step_s * (in_grows * source.stiffness + in_falls * tube.stiffness)
    a12 = -step_s * in_falls * tube.stiffness
    a21 = -step_s * on_grows * tube.stiffness
    a22 = 1.0 + step_s * (on_grows * tube.stiffness + on_falls * chamber.stiffness)
    by = step_s / (a11 * a22 - a12 * a21)
    in_kg: float = by * (a22 * in_kg_s - a12 * on_kg_s)
    on_kg = by * (a11 * on_kg_s - a21 * in_kg_s)
    tube_pa = tube.pressure_pa + tube.stiffness * (in_kg - on_kg)
    source_pa, chamber_pa = (
        source.pressure_pa - source.stiffness * in_kg,
        chamber.pressure_pa + chamber.stiffness * on_kg,
    )
    settles = _keeps_order(source.pressure_pa, tube.pressure_pa, source_pa, tube_pa)
    settles = settles and _keeps_order(tube.pressure_pa, chamber.pressure_pa, tube_pa, chamber_pa)
    if settles and on_kg * on_kg_s >= 0.0:
        move(source, tube, in_kg)
        move(tube, chamber, on_kg)
        return in_kg
    # one pressure would overshoot another: solve the flows one after the other, each limited to equal pressures
    in_kg = exchange(source, tube, valve_m3_s_pa, valve_critical, step_s)
    if on_kg_s > 0.0:
        check(tube, chamber, crack_pa, onward_m3_s_pa, onward_critical, step_s)
    elif on_kg_s < 0.0:
        check(chamber, tube, 0.0, onward_m3_s_pa, onward_critical, step_s)
    return in_kg


@compiled
def _keeps_order(one_pa: float, other_pa: float, one_after_pa: float, other_after_pa: float) -> bool:
    """Return True if two pressures keep their order, or if their difference before or after is negligible."""
    slight_pa = 0.01 * one_pa
    apart_pa, after_pa = one_pa - other_pa, one_after_pa - other_after_pa
    return apart_pa * after_pa >= 0.0 or abs(apart_pa) <= slight_pa or abs(after_pa) <= slight_pa
