"""Line from a valve port to a cylinder chamber: tube, throttle and pilot check valve."""

from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled, inlined
from plant_sim.common.lanes import joined, lanes, pair, select, split, truths, unpacked
from plant_sim.pneumatics.chamber import CHAMBER, WALL, check, exchange, flows_and_slopes, implicit_share, move, resize
from plant_sim.pneumatics.cushion import cushion_is_at_rest
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, REFERENCE_K, in_series
from plant_sim.pneumatics.valve import exhaust_opening, supply_opening

NOZZLES = np.dtype(
    [("valve_m3_s_pa", "f8"), ("tube_m3_s_pa", "f8"), ("conductance_m3_s_pa", "f8"), ("critical_ratio", "f8")]
)
"""Valve port and tube in series: the conductances for which `conductance_m3_s_pa` and `critical_ratio` were computed,
that of the port with a negative sign if the tube is upstream.
"""

LINE = np.dtype(
    [
        ("tube", CHAMBER),
        ("chamber", CHAMBER),
        ("cushion", CHAMBER),
        ("nozzles", NOZZLES),
        ("drawn_kg", "f8"),
        ("piloted", "i8"),
    ]
)
"""State: tube, chamber behind it, the part of the chamber that the cushion plunger has closed off (volume 0 if none),
and mass of air admitted by the valve so far. `piloted` is 1 while the pilot holds the check valve open.
"""

LINE_PARAMS = np.dtype(
    [
        ("tube_m3_s_pa", "f8"),
        ("tube_ratio", "f8"),
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
        ("cushion_m3", "f8"),
        ("cushion_m2", "f8"),
        ("needle_m3_s_pa", "f8"),
        ("tube_wall", WALL),
        ("chamber_wall", WALL),
        ("cushion_wall", WALL),
    ]
)
"""Parameters.

`free` is the inward path past the throttle, `throttle` the outward path (meter-out), each including the check valve.
`checked` 0 means no check valve. `slip` is a leak past the seat of the check valve and `leak` is one from the chamber
to the ambient air (both faults). The volume of the chamber is `dead_m3` plus the swept volume. The plunger closes off
`cushion_m3` plus the volume swept by the area `cushion_m2`; this air leaves through the needle.
"""


_STILL_PA = 20.0
_STILL_K = 0.1


@compiled
def line_is_at_rest(n: Any, params: Any, spool: float, manifold: Any) -> bool:
    """Return True if no air is flowing in a line and all of it is at wall temperature."""
    tube, chamber = n.tube, n.chamber
    if params.leak_m3_s_pa > 0.0 or params.slip_m3_s_pa > 0.0 or not cushion_is_at_rest(n):
        return False
    if abs(chamber.temperature_k - REFERENCE_K) > _STILL_K or abs(tube.temperature_k - REFERENCE_K) > _STILL_K:
        return False
    if lacks_supply(n, manifold) if spool > 0.0 else abs(tube.pressure_pa - ATMOSPHERE_PA) > _STILL_PA:
        return False
    if params.checked:
        # a closed check valve holds the air only against a lower pressure in the tube
        return bool(spool == 0.0 and n.piloted == 0 and chamber.pressure_pa > tube.pressure_pa)
    return bool(abs(chamber.pressure_pa - tube.pressure_pa) <= _STILL_PA)


@compiled
def lacks_supply(n: Any, manifold: Any) -> bool:
    """Return True if air is flowing into or out of a line that is connected to its supply."""
    return bool(abs(n.tube.pressure_pa - manifold.pressure_pa) > _STILL_PA)


@compiled
def step_lines(
    plus: Any,
    minus: Any,
    params: Any,
    spool: float,
    volumes_m3: tuple[float, float],
    manifold: Any,
    outside: Any,
    gas: Any,
) -> None:
    """Advance both lines of a cylinder by one time step, up to `settle_four` of their chambers.

    At most one line is connected to the supply, and the ambient pressure is constant. The flows in one line therefore
    do not depend on those in the other, and all four are computed together.

    Args:
        plus: The line fed at a spool position of +1.
        minus: The line fed at a spool position of -1.
        params: Parameters of the cylinder.
        spool: Spool position of the valve.
        volumes_m3: New volumes of both chambers, m3.
        manifold: Supply chamber of the valve.
        outside: The ambient air.
        gas: Gas model.
    """
    resize(plus.chamber, volumes_m3[0], gas)
    resize(minus.chamber, volumes_m3[1], gas)
    plus_crack_pa, plus_onward = _fitting(plus, params.plus, minus.tube.pressure_pa)
    minus_crack_pa, minus_onward = _fitting(minus, params.minus, plus.tube.pressure_pa)
    plus_fed, minus_fed = supply_opening(spool) > 0.0, supply_opening(-spool) > 0.0
    sources = _sources(plus_fed, minus_fed, manifold)
    update_nozzles(plus, params.plus, params.valve, spool, manifold.pressure_pa if plus_fed else ATMOSPHERE_PA)
    update_nozzles(minus, params.minus, params.valve, -spool, manifold.pressure_pa if minus_fed else ATMOSPHERE_PA)
    plus_through, minus_through = plus.nozzles.conductance_m3_s_pa, minus.nozzles.conductance_m3_s_pa
    conductances = lanes(plus_through, minus_through, plus_onward, minus_onward)
    cracks_pa = lanes(0.0, 0.0, plus_crack_pa, minus_crack_pa)
    mass_kg, kg_s, settles = _solve(plus, minus, params, sources, conductances, cracks_pa, gas)
    plus_in_kg, minus_in_kg, plus_on_kg, minus_on_kg = unpacked(mass_kg)
    _, _, plus_kg_s, minus_kg_s = unpacked(kg_s)
    plus_settles, minus_settles, _, _ = truths(settles)
    source = manifold if plus_fed else outside
    if plus_settles:
        _move_both(source, plus, plus_in_kg, plus_on_kg, gas)
    else:
        plus_in_kg = pass_in_turn(plus, params.plus, source, plus_kg_s, plus_crack_pa, plus_onward, gas)
    if plus_fed:
        plus.drawn_kg += plus_in_kg
    exchange(plus.chamber, outside, params.plus.leak_m3_s_pa, params.plus.critical_ratio, gas)
    source = manifold if minus_fed else outside
    if minus_settles:
        _move_both(source, minus, minus_in_kg, minus_on_kg, gas)
    else:
        minus_in_kg = pass_in_turn(minus, params.minus, source, minus_kg_s, minus_crack_pa, minus_onward, gas)
    if minus_fed:
        minus.drawn_kg += minus_in_kg
    exchange(minus.chamber, outside, params.minus.leak_m3_s_pa, params.minus.critical_ratio, gas)


@inlined
def _fitting(n: Any, params: Any, pilot_pa: float) -> tuple[float, float]:
    """Update the pilot of the check valve; return the cracking pressure and the conductance from tube to chamber.

    `pilot_pa` is the pressure in the tube of the opposite line.
    """
    tube, chamber = n.tube, n.chamber
    gauge_pa = chamber.pressure_pa - ATMOSPHERE_PA
    # the pilot must reach both limits (docs/sources/plant.md 1.9)
    least_pa = max(params.pilot_ratio * gauge_pa, params.pilot_least_pa)
    n.piloted = 1 if params.checked == 0 or pilot_pa - ATMOSPHERE_PA >= least_pa else 0
    crack_pa, onward = 0.0 if n.piloted else params.crack_pa, params.free_m3_s_pa
    if tube.pressure_pa <= chamber.pressure_pa:
        crack_pa, onward = 0.0, params.throttle_m3_s_pa if n.piloted else params.slip_m3_s_pa
    return crack_pa, onward


@inlined
def update_nozzles(n: Any, params: Any, valve_params: Any, spool: float, source_pa: float) -> None:
    """Update the conductance of valve port and tube in series; it changes only with the spool, the flow, or a fault.

    Args:
        n: The line.
        params: Its parameters.
        valve_params: Parameters of the valve.
        spool: Spool position, positive towards the port of this line.
        source_pa: Pressure at the outer port of the valve, Pa.
    """
    opening = supply_opening(spool)
    if opening <= 0.0:
        opening = exhaust_opening(spool)
    valve_m3_s_pa = valve_params.conductance_m3_s_pa * (opening if source_pa >= n.tube.pressure_pa else -opening)
    if valve_m3_s_pa != n.nozzles.valve_m3_s_pa or params.tube_m3_s_pa != n.nozzles.tube_m3_s_pa:
        _combine(n.nozzles, valve_m3_s_pa, valve_params.critical_ratio, params.tube_m3_s_pa, params.tube_ratio)


@compiled
def _combine(nozzles: Any, valve_m3_s_pa: float, valve_ratio: float, tube_m3_s_pa: float, tube_ratio: float) -> None:
    """Compute the conductance of valve port and tube in the order of the flow."""
    nozzles.valve_m3_s_pa, nozzles.tube_m3_s_pa = valve_m3_s_pa, tube_m3_s_pa
    if valve_m3_s_pa >= 0.0:
        both_m3_s_pa, ratio = in_series(valve_m3_s_pa, valve_ratio, tube_m3_s_pa, tube_ratio)
    else:
        both_m3_s_pa, ratio = in_series(tube_m3_s_pa, tube_ratio, -valve_m3_s_pa, valve_ratio)
    nozzles.conductance_m3_s_pa, nozzles.critical_ratio = both_m3_s_pa, ratio


@inlined
def _sources(plus_fed: bool, minus_fed: bool, manifold: Any) -> tuple[Any, Any, Any]:
    """Return pressure, temperature and stiffness at the outer ports of the valve, as pairs.

    Those of the ambient air are constants, so that a line does not wait for the flow of the line computed before it.
    """
    plus_pa, plus_k, plus_stiffness = ATMOSPHERE_PA, REFERENCE_K, 0.0
    minus_pa, minus_k, minus_stiffness = ATMOSPHERE_PA, REFERENCE_K, 0.0
    if plus_fed:
        plus_pa, plus_k, plus_stiffness = manifold.pressure_pa, manifold.temperature_k, manifold.stiffness
    if minus_fed:
        minus_pa, minus_k, minus_stiffness = manifold.pressure_pa, manifold.temperature_k, manifold.stiffness
    return pair(plus_pa, minus_pa), pair(plus_k, minus_k), pair(plus_stiffness, minus_stiffness)


@inlined
def _solve(
    plus: Any, minus: Any, params: Any, sources: Any, conductances: Any, cracks_pa: Any, gas: Any
) -> tuple[Any, Any, Any]:
    """Solve the flows through the valve and the fitting of both lines for one step.

    Both flows of a line are linearly implicit in all three pressures. If they were solved one after the other, the
    error of the tube pressure would be the change that one of the flows causes in a step.

    Args:
        plus: The line fed at a spool position of +1.
        minus: The line fed at a spool position of -1.
        params: Parameters of the cylinder.
        sources: Result of `_sources`.
        conductances: Conductances of the valve ports of both lines, then of their fittings, m3/(s Pa).
        cracks_pa: Cracking pressures in the same order, Pa.
        gas: Gas model.

    Returns:
        The masses in the same order, kg; the flows at the start of the step, kg/s; and, as a pair, True for a line
        whose pressures keep their order.
    """
    step_s = gas.step_s
    source_pa, source_k, source_stiffness = sources
    tube_pa = pair(plus.tube.pressure_pa, minus.tube.pressure_pa)
    tube_k = pair(plus.tube.temperature_k, minus.tube.temperature_k)
    tube_stiffness = pair(plus.tube.stiffness, minus.tube.stiffness)
    chamber_pa = pair(plus.chamber.pressure_pa, minus.chamber.pressure_pa)
    chamber_k = pair(plus.chamber.temperature_k, minus.chamber.temperature_k)
    chamber_stiffness = pair(plus.chamber.stiffness, minus.chamber.stiffness)
    critical_ratios = lanes(
        plus.nozzles.critical_ratio,
        minus.nozzles.critical_ratio,
        params.plus.critical_ratio,
        params.minus.critical_ratio,
    )
    kg_s, grows, falls = flows_and_slopes(
        joined(source_pa, tube_pa),
        joined(tube_pa, chamber_pa),
        joined(source_k, tube_k),
        joined(tube_k, chamber_k),
        cracks_pa,
        conductances,
        critical_ratios,
    )
    (in_kg_s, on_kg_s), (in_grows, on_grows), (in_falls, on_falls) = split(kg_s), split(grows), split(falls)
    in_stiffness = on_stiffness = tube_stiffness  # pressure rise of the tube per mass through the valve, the fitting
    if gas.thermal != 0:  # per enthalpy of the air received instead of per mass
        in_k, on_k = select(in_kg_s >= 0.0, source_k, tube_k), select(on_kg_s >= 0.0, tube_k, chamber_k)
        source_stiffness = source_stiffness * in_k / source_k
        in_stiffness = tube_stiffness * in_k / tube_k
        on_stiffness = tube_stiffness * on_k / tube_k
        chamber_stiffness = chamber_stiffness * on_k / chamber_k
    in_turns = step_s * (in_grows * source_stiffness + in_falls * in_stiffness)
    on_turns = step_s * (on_grows * on_stiffness + on_falls * chamber_stiffness)
    in_share, on_share = split(implicit_share(joined(in_turns, on_turns)))
    a11 = 1.0 + in_share * in_turns
    a12 = -step_s * in_share * in_falls * on_stiffness
    a21 = -step_s * on_share * on_grows * in_stiffness
    a22 = 1.0 + on_share * on_turns
    # the determinant is at least 1: no slope is negative, and the product a12 a21 is one of the terms of a11 a22
    by = step_s / (a11 * a22 - a12 * a21)
    in_kg = by * (a22 * in_kg_s - a12 * on_kg_s)
    on_kg = by * (a11 * on_kg_s - a21 * in_kg_s)
    tube_after_pa = tube_pa + (in_stiffness * in_kg - on_stiffness * on_kg)
    settles = _keeps_order(source_pa, tube_pa, source_pa - source_stiffness * in_kg, tube_after_pa)
    settles = settles & _keeps_order(tube_pa, chamber_pa, tube_after_pa, chamber_pa + chamber_stiffness * on_kg)
    return joined(in_kg, on_kg), kg_s, settles & (on_kg * on_kg_s >= 0.0)


@inlined
def _move_both(source: Any, n: Any, in_kg: float, on_kg: float, gas: Any) -> None:
    """Transfer air through the valve and the fitting, in the direction of the flow."""
    if on_kg > 0.0:
        move(source, n.tube, in_kg, gas)
        move(n.tube, n.chamber, on_kg, gas)
    else:
        move(n.tube, n.chamber, on_kg, gas)
        move(source, n.tube, in_kg, gas)


@compiled
def pass_in_turn(n: Any, params: Any, source: Any, on_kg_s: float, crack_pa: float, onward: float, gas: Any) -> float:
    """Solve both flows of a line one after the other, each limited to equal pressures; return the mass drawn, kg.

    Required if one pressure would otherwise overshoot another. `onward` is the conductance from the tube to the
    chamber, and `on_kg_s` the flow through it.
    """
    nozzles = n.nozzles
    in_kg: float = exchange(source, n.tube, nozzles.conductance_m3_s_pa, nozzles.critical_ratio, gas)
    if on_kg_s > 0.0:
        check(n.tube, n.chamber, crack_pa, onward, params.critical_ratio, gas)
    elif on_kg_s < 0.0:
        check(n.chamber, n.tube, 0.0, onward, params.critical_ratio, gas)
    return in_kg


@inlined
def _keeps_order(one_pa: Any, other_pa: Any, one_after_pa: Any, other_after_pa: Any) -> Any:
    """Return True where two pressures keep their order, or where their difference before or after is negligible."""
    slight_pa = 0.01 * one_pa
    apart_pa, after_pa = one_pa - other_pa, one_after_pa - other_after_pa
    return (apart_pa * after_pa >= 0.0) | (abs(apart_pa) <= slight_pa) | (abs(after_pa) <= slight_pa)
