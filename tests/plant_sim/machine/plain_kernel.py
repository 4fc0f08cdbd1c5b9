"""Plain form of the compiled plant: the same equations with the same operations, one number at a time.

Nothing is skipped except cylinders at rest, which are identified anew in every step. `plant_sim.machine.kernel` has to
give bit-identical states.
"""

from typing import Any

from plant_sim.common.compiled import compiled, compiled_and_cached
from plant_sim.devices.conveyor import step_conveyor
from plant_sim.devices.cups import step_cups
from plant_sim.devices.sensor import record_edge, step_switch, update_output
from plant_sim.devices.spreader import step_spreader
from plant_sim.machine.kernel import ARM_COILS, _any_busy, _update_clamp
from plant_sim.pneumatics.chamber import _nonlinear_share, implicit_factor, implicit_share, move, resize, settle
from plant_sim.pneumatics.cylinder import is_at_rest, move_cylinder, settle_cushions
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, flow
from plant_sim.pneumatics.line import update_nozzles
from plant_sim.pneumatics.supply import step_supply
from plant_sim.pneumatics.valve import supply_opening

_BELT = 2 * len(ARM_COILS)


@compiled
def exchange(a: Any, b: Any, conductance_m3_s_pa: float, critical_ratio: float, gas: Any) -> float:
    """Exchange air between two chambers for one step; return the mass that left `a`, kg."""
    if conductance_m3_s_pa <= 0.0:
        return 0.0
    if a.pressure_pa < b.pressure_pa:
        return -_pass(b, a, b.pressure_pa, conductance_m3_s_pa, critical_ratio, gas)
    return _pass(a, b, a.pressure_pa, conductance_m3_s_pa, critical_ratio, gas)


@compiled
def check(a: Any, b: Any, crack_pa: float, conductance_m3_s_pa: float, critical_ratio: float, gas: Any) -> float:
    """Pass air from `a` to `b` through a check valve for one step; return the mass, kg."""
    if conductance_m3_s_pa <= 0.0 or a.pressure_pa - crack_pa <= b.pressure_pa:
        return 0.0
    return _pass(a, b, a.pressure_pa - crack_pa, conductance_m3_s_pa, critical_ratio, gas)


@compiled
def _pass(up: Any, down: Any, up_pa: float, conductance_m3_s_pa: float, critical_ratio: float, gas: Any) -> float:
    kg_s, grows, falls = flow(up_pa, down.pressure_pa, conductance_m3_s_pa, critical_ratio, up.temperature_k)
    stiffness = down.stiffness * (up.temperature_k / down.temperature_k) if gas.thermal != 0 else down.stiffness
    turns = gas.step_s * (grows * up.stiffness + falls * stiffness)
    mass_kg: float = gas.step_s * kg_s * implicit_factor(turns)
    levels_kg = (up_pa - down.pressure_pa) / (up.stiffness + stiffness)
    if gas.thermal != 0:
        mass_kg = min(mass_kg, levels_kg)
    elif mass_kg > 0.2 * levels_kg:
        mass_kg = min(mass_kg, levels_kg * _nonlinear_share(down, levels_kg))
    move(up, down, mass_kg, gas)
    return mass_kg


@compiled
def flow_and_slopes(
    a: Any, b: Any, crack_pa: float, conductance_m3_s_pa: float, critical_ratio: float
) -> tuple[float, float, float]:
    """Return the flow from `a` to `b`, kg/s, and its derivatives with respect to both pressures, kg/(s Pa)."""
    up_pa = a.pressure_pa - crack_pa
    if conductance_m3_s_pa <= 0.0 or (up_pa <= b.pressure_pa and a.pressure_pa >= b.pressure_pa):
        return 0.0, 0.0, 0.0
    if up_pa > b.pressure_pa:
        return flow(up_pa, b.pressure_pa, conductance_m3_s_pa, critical_ratio, a.temperature_k)
    kg_s, grows, falls = flow(b.pressure_pa, a.pressure_pa, conductance_m3_s_pa, critical_ratio, b.temperature_k)
    return -kg_s, falls, grows


@compiled
def step_line(
    n: Any,
    params: Any,
    valve_params: Any,
    spool: float,
    pilot_pa: float,
    volume_m3: float,
    manifold: Any,
    outside: Any,
    gas: Any,
) -> None:
    """Advance a line by one time step."""
    tube, chamber, critical = n.tube, n.chamber, params.critical_ratio
    resize(chamber, volume_m3, gas)
    gauge_pa = chamber.pressure_pa - ATMOSPHERE_PA
    least_pa = max(params.pilot_ratio * gauge_pa, params.pilot_least_pa)
    n.piloted = 1 if params.checked == 0 or pilot_pa - ATMOSPHERE_PA >= least_pa else 0
    crack_pa, onward = 0.0 if n.piloted else params.crack_pa, params.free_m3_s_pa
    if tube.pressure_pa <= chamber.pressure_pa:
        crack_pa, onward = 0.0, params.throttle_m3_s_pa if n.piloted else params.slip_m3_s_pa
    if supply_opening(spool) > 0.0:
        update_nozzles(n, params, valve_params, spool, manifold.pressure_pa)
        n.drawn_kg += _step_flows(n, manifold, crack_pa, onward, critical, gas)
    else:
        update_nozzles(n, params, valve_params, spool, ATMOSPHERE_PA)
        _step_flows(n, outside, crack_pa, onward, critical, gas)
    exchange(chamber, outside, params.leak_m3_s_pa, critical, gas)


@compiled
def _step_flows(n: Any, source: Any, crack_pa: float, onward_m3_s_pa: float, onward_critical: float, gas: Any) -> float:
    """Pass air through the valve and the fitting for one step; return the mass drawn from the source, kg."""
    tube, chamber, step_s = n.tube, n.chamber, gas.step_s
    valve_m3_s_pa, valve_critical = n.nozzles.conductance_m3_s_pa, n.nozzles.critical_ratio
    in_kg_s, in_grows, in_falls = flow_and_slopes(source, tube, 0.0, valve_m3_s_pa, valve_critical)
    on_kg_s, on_grows, on_falls = flow_and_slopes(tube, chamber, crack_pa, onward_m3_s_pa, onward_critical)
    source_stiffness, in_stiffness = source.stiffness, tube.stiffness
    on_stiffness, chamber_stiffness = tube.stiffness, chamber.stiffness
    if gas.thermal != 0:
        in_k = source.temperature_k if in_kg_s >= 0.0 else tube.temperature_k
        on_k = tube.temperature_k if on_kg_s >= 0.0 else chamber.temperature_k
        source_stiffness = source.stiffness * in_k / source.temperature_k
        in_stiffness = tube.stiffness * in_k / tube.temperature_k
        on_stiffness = tube.stiffness * on_k / tube.temperature_k
        chamber_stiffness = chamber.stiffness * on_k / chamber.temperature_k
    in_turns = step_s * (in_grows * source_stiffness + in_falls * in_stiffness)
    on_turns = step_s * (on_grows * on_stiffness + on_falls * chamber_stiffness)
    in_share, on_share = implicit_share(in_turns), implicit_share(on_turns)
    a11 = 1.0 + in_share * in_turns
    a12 = -step_s * in_share * in_falls * on_stiffness
    a21 = -step_s * on_share * on_grows * in_stiffness
    a22 = 1.0 + on_share * on_turns
    by = step_s / (a11 * a22 - a12 * a21)
    in_kg: float = by * (a22 * in_kg_s - a12 * on_kg_s)
    on_kg = by * (a11 * on_kg_s - a21 * in_kg_s)
    tube_pa = tube.pressure_pa + (in_stiffness * in_kg - on_stiffness * on_kg)
    source_pa, chamber_pa = (
        source.pressure_pa - source_stiffness * in_kg,
        chamber.pressure_pa + chamber_stiffness * on_kg,
    )
    settles = _keeps_order(source.pressure_pa, tube.pressure_pa, source_pa, tube_pa)
    settles = settles and _keeps_order(tube.pressure_pa, chamber.pressure_pa, tube_pa, chamber_pa)
    if settles and on_kg * on_kg_s >= 0.0:
        if on_kg > 0.0:
            move(source, tube, in_kg, gas)
            move(tube, chamber, on_kg, gas)
        else:
            move(tube, chamber, on_kg, gas)
            move(source, tube, in_kg, gas)
        return in_kg
    # one pressure would overshoot another: solve the flows one after the other, each limited to equal pressures
    in_kg = exchange(source, tube, valve_m3_s_pa, valve_critical, gas)
    if on_kg_s > 0.0:
        check(tube, chamber, crack_pa, onward_m3_s_pa, onward_critical, gas)
    elif on_kg_s < 0.0:
        check(chamber, tube, 0.0, onward_m3_s_pa, onward_critical, gas)
    return in_kg


@compiled
def _keeps_order(one_pa: float, other_pa: float, one_after_pa: float, other_after_pa: float) -> bool:
    """Return True if two pressures keep their order, or if their difference before or after is negligible."""
    slight_pa = 0.01 * one_pa
    apart_pa, after_pa = one_pa - other_pa, one_after_pa - other_after_pa
    return apart_pa * after_pa >= 0.0 or abs(apart_pa) <= slight_pa or abs(after_pa) <= slight_pa


@compiled
def step_cylinder(c: Any, params: Any, plus: bool, minus: bool, manifold: Any, outside: Any, gas: Any) -> None:
    """Advance a cylinder by one time step."""
    plus_m3, minus_m3 = move_cylinder(c, params, plus, minus, manifold, gas)
    spool = c.valve.spool
    plus_pa, minus_pa = c.plus.tube.pressure_pa, c.minus.tube.pressure_pa
    step_line(c.plus, params.plus, params.valve, spool, minus_pa, plus_m3, manifold, outside, gas)
    step_line(c.minus, params.minus, params.valve, -spool, plus_pa, minus_m3, manifold, outside, gas)
    for n, line_params in ((c.plus, params.plus), (c.minus, params.minus)):
        settle(n.tube, line_params.tube_wall, gas)
        settle(n.chamber, line_params.chamber_wall, gas)
    settle_cushions(c, params, gas)


@compiled
def _step_arm(arm: Any, params: Any, coils: Any, supply: Any, at_s: float, gas: Any) -> None:
    """Advance an arm by one time step."""
    step_s = gas.step_s
    x_m, y_m, opening_m, travel_m = (
        arm.slide.position_m,
        arm.lift.position_m,
        arm.claws.position_m,
        arm.spreader.travel_m,
    )
    if not is_at_rest(arm.lift, params.lift, coils[0], coils[1], supply.manifold):
        step_cylinder(arm.lift, params.lift, coils[0], coils[1], supply.manifold, supply.outside, gas)
    if not is_at_rest(arm.slide, params.slide, coils[2], coils[3], supply.manifold):
        step_cylinder(arm.slide, params.slide, coils[2], coils[3], supply.manifold, supply.outside, gas)
    if not is_at_rest(arm.claws, params.claws, coils[6], coils[7], supply.claw_manifold):
        step_cylinder(arm.claws, params.claws, coils[6], coils[7], supply.claw_manifold, supply.outside, gas)
    step_spreader(arm.spreader, params.spreader, coils[5], coils[4], at_s, step_s)
    step_cups(arm.cups, params.cups, at_s, step_s)
    if x_m != arm.slide.position_m or _any_busy(arm.slide_switches):
        for number in range(4):
            step_switch(
                arm.slide_switches[number], params.slide_switches[number], x_m, arm.slide.position_m, at_s, step_s
            )
    if y_m != arm.lift.position_m or _any_busy(arm.lift_switches):
        for number in range(2):
            step_switch(arm.lift_switches[number], params.lift_switches[number], y_m, arm.lift.position_m, at_s, step_s)
    now_m = arm.claws.position_m
    if opening_m < params.frees_above_m <= now_m:
        arm.freed_s = at_s + step_s * (params.frees_above_m - opening_m) / (now_m - opening_m)
    if opening_m > params.grips_below_m >= now_m:
        arm.gripped_s = at_s + step_s * (opening_m - params.grips_below_m) / (opening_m - now_m)
    _update_clamp(arm, params)
    stirs = x_m != arm.slide.position_m or y_m != arm.lift.position_m
    if stirs or opening_m != now_m or travel_m != arm.spreader.travel_m:
        arm.stirred += 1


@compiled
def settle_air(a: Any, params: Any, now_s: float, gas: Any) -> None:
    """Finish a step of the supply and update the pressure switch."""
    network = a.network
    settle(network.receiver, params.network.receiver_wall, gas)
    settle(network.header, params.network.header_wall, gas)
    settle(network.manifold, params.network.manifold_wall, gas)
    settle(network.claw_reservoir, params.network.claw_reservoir_wall, gas)
    settle(network.claw_manifold, params.network.claw_manifold_wall, gas)
    gauge_pa = network.manifold.pressure_pa - ATMOSPHERE_PA
    least_pa = params.ok_above_pa - params.ok_gap_pa if a.pressure_ok.detected else params.ok_above_pa
    if (gauge_pa >= least_pa) != (a.pressure_ok.detected != 0):
        record_edge(a.pressure_ok, now_s)
    if a.pressure_ok.busy:
        update_output(a.pressure_ok, params.pressure_ok, now_s)


@compiled_and_cached
def advance_plainly(machine: Any, params: Any, coils: Any, fed: bool, first: int, steps: int) -> None:
    """Advance the machine by several steps, as `plant_sim.machine.kernel.advance` does."""
    m, gas, air_params = machine[0], params[0].gas, params[0].air
    air = m.air
    for step in range(steps):
        at_s = (first + step) * gas.step_s
        step_supply(air.network, air_params.network, fed, gas)
        step_conveyor(m.conveyor, params[0].conveyor, coils[_BELT], coils[_BELT + 1], at_s, gas.step_s)
        for side in range(2):
            _step_arm(
                m.arms[side],
                params[0].arms[side],
                coils[len(ARM_COILS) * side : len(ARM_COILS) * (side + 1)],
                air.network,
                at_s,
                gas,
            )
        settle_air(air, air_params, at_s + gas.step_s, gas)
