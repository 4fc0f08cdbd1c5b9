"""Double-acting cylinder with its valve, both lines and the load."""

from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled, inlined
from plant_sim.pneumatics.chamber import settle, settle_four
from plant_sim.pneumatics.cushion import move_plunger, step_cushion
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.pneumatics.friction import FRICTION, speed_after_friction_m_s
from plant_sim.pneumatics.line import LINE, LINE_PARAMS, lacks_supply, line_is_at_rest, step_lines
from plant_sim.pneumatics.valve import VALVE, VALVE_PARAMS, step_valve

_STILL_M_S, _STILL_N = 1e-6, 1.0

CYLINDER = np.dtype(
    [
        ("position_m", "f8"),
        ("speed_m_s", "f8"),
        ("piston_m", "f8"),
        ("piston_m_s", "f8"),
        ("magnet_n", "f8"),
        ("decoupled", "i8"),
        ("braked", "i8"),
        ("brake_s", "f8"),
        ("fastest_m_s", "f8"),
        ("valve", VALVE),
        ("plus", LINE),
        ("minus", LINE),
    ]
)
"""State.

The load is at `position_m` from the end stop at 0 and moves at `speed_m_s`. The piston has a separate position and
speed if it is magnetically coupled to the load, else those of the load. `braked` is 1 while the brake is engaged,
`brake_s` the time until it engages. `fastest_m_s` is the highest speed of the load so far, in either direction. `plus`
drives away from 0, `minus` towards it.
"""

CYLINDER_PARAMS = np.dtype(
    [
        ("stroke_m", "f8"),
        ("plus_area_m2", "f8"),
        ("minus_area_m2", "f8"),
        ("load_kg", "f8"),
        ("piston_kg", "f8"),
        ("weight_n", "f8"),
        ("cushion_m", "f8"),
        ("bumper_m", "f8"),
        ("bumper_n_m", "f8"),
        ("bumper_n_s_m", "f8"),
        ("magnet_holds_n", "f8"),
        ("magnet_n_m", "f8"),
        ("magnet_n_s_m", "f8"),
        ("recouples_m_s", "f8"),
        ("overtravel_m", "f8"),
        ("brake_n", "f8"),
        ("brake_bites_pa", "f8"),
        ("brake_delay_s", "f8"),
        ("blocked", "i8"),
        ("friction", FRICTION),
        ("valve", VALVE_PARAMS),
        ("plus", LINE_PARAMS),
        ("minus", LINE_PARAMS),
    ]
)
"""Parameters.

`weight_n` acts away from 0. The plunger of a cushion closes within `cushion_m` of either end. `bumper_n_m` is the
stiffness of the stops at both ends, which begin `bumper_m` before the end of the stroke; 0 means rigid stops.
`overtravel_m` is the distance beyond the stroke at which a coupled piston, or a load with elastic stops, meets a rigid
one. `magnet_holds_n` 0 means that load and piston are one body. `brake_n` is the force of a spring-applied brake on the
load. A valve whose coil is energised together with either coil of the cylinder releases it with air from the supply. It
engages `brake_delay_s` after this valve has switched off, and below `brake_bites_pa` (gauge). `blocked` 1 locks the
load in place (a fault).
"""


@compiled
def step_cylinder(c: Any, params: Any, plus: bool, minus: bool, manifold: Any, outside: Any, gas: Any) -> None:
    """Advance by one time step: the valve, then the piston motion, then the air in both lines.

    Args:
        c: The cylinder.
        params: Its parameters.
        plus: Level of the coil that drives away from 0.
        minus: Level of the coil that drives towards 0.
        manifold: Supply chamber of the valve.
        outside: The ambient air.
        gas: Gas model.
    """
    volumes_m3 = move_cylinder(c, params, plus, minus, manifold, gas)
    step_lines(c.plus, c.minus, params, c.valve.spool, volumes_m3, manifold, outside, gas)


@inlined
def move_cylinder(c: Any, params: Any, plus: bool, minus: bool, manifold: Any, gas: Any) -> tuple[float, float]:
    """Advance valve, piston and cushions by one time step; return the new volumes of both chambers, m3."""
    step_valve(c.valve, params.valve, plus, minus, gas.step_s)
    if params.brake_n > 0.0:
        _step_brake(c, params, manifold, gas.step_s)
    push_n = _push_n(c, params)
    if params.magnet_holds_n > 0.0:
        _move_coupled(c, params, push_n, gas.step_s)
    else:
        _move(c, params, push_n, gas.step_s)
    c.fastest_m_s = max(c.fastest_m_s, abs(c.speed_m_s))
    ahead_m = params.stroke_m - c.piston_m
    plus_m3 = params.plus.dead_m3 + params.plus_area_m2 * c.piston_m
    minus_m3 = params.minus.dead_m3 + params.minus_area_m2 * ahead_m
    if params.cushion_m > 0.0:
        plus_m3 = move_plunger(c.plus, params.plus, params.cushion_m, c.piston_m, plus_m3, gas)
        minus_m3 = move_plunger(c.minus, params.minus, params.cushion_m, ahead_m, minus_m3, gas)
        if c.plus.cushion.volume_m3 > 0.0:
            step_cushion(c.plus, params.plus, gas)
        if c.minus.cushion.volume_m3 > 0.0:
            step_cushion(c.minus, params.minus, gas)
    return plus_m3, minus_m3


@inlined
def settle_cylinder(c: Any, params: Any, gas: Any) -> None:
    """Finish a step: update temperature, pressure and stiffness of the air in both lines."""
    if gas.thermal == 0:
        settle_four(c.plus.tube, c.plus.chamber, c.minus.tube, c.minus.chamber, gas)
    else:
        settle(c.plus.tube, params.plus.tube_wall, gas)
        settle(c.plus.chamber, params.plus.chamber_wall, gas)
        settle(c.minus.tube, params.minus.tube_wall, gas)
        settle(c.minus.chamber, params.minus.chamber_wall, gas)
    if params.cushion_m > 0.0:
        settle_cushions(c, params, gas)


@compiled
def settle_cushions(c: Any, params: Any, gas: Any) -> None:
    """Finish a step of the closed cushions."""
    if c.plus.cushion.volume_m3 > 0.0:
        settle(c.plus.cushion, params.plus.cushion_wall, gas)
    if c.minus.cushion.volume_m3 > 0.0:
        settle(c.minus.cushion, params.minus.cushion_wall, gas)


@inlined
def is_at_rest(c: Any, params: Any, plus: bool, minus: bool, manifold: Any) -> bool:
    """Return True if a step would change nothing significantly: no pending motion, no flow, air at wall temperature."""
    valve = c.valve
    if abs(c.piston_m_s) > _STILL_M_S or c.speed_m_s != 0.0 or valve.spool != valve.target:
        return False
    if plus != (valve.plus_acts != 0) or minus != (valve.minus_acts != 0):
        return False
    if valve.plus_pending_s != 0.0 or valve.minus_pending_s != 0.0 or valve.waves != 0:
        return False
    if c.brake_s != 0.0 and not (plus or minus):
        return False
    if not line_is_at_rest(c.plus, params.plus, valve.spool, manifold):
        return False
    return line_is_at_rest(c.minus, params.minus, -valve.spool, manifold) and _stays_at_rest(c, params)


@compiled
def remains_at_rest(c: Any, manifold: Any) -> bool:
    """Return True if a cylinder at rest is still so after another step with the same coil levels and parameters.

    Nothing of it has changed, so `is_at_rest` can be False only because the pressure of its supply has changed.
    """
    spool = c.valve.spool
    if spool == 0.0:
        return True
    return not lacks_supply(c.plus if spool > 0.0 else c.minus, manifold)


@compiled
def _push_n(c: Any, params: Any) -> float:
    """Return the force of the air on the piston, N, positive away from 0."""
    # the atmosphere acts on the rod where it leaves the cylinder
    rod_m2 = params.plus_area_m2 - params.minus_area_m2
    push_n: float = (
        c.plus.chamber.pressure_pa * params.plus_area_m2
        - c.minus.chamber.pressure_pa * params.minus_area_m2
        - ATMOSPHERE_PA * rod_m2
    )
    if c.plus.cushion.volume_m3 > 0.0:
        push_n += (c.plus.cushion.pressure_pa - c.plus.chamber.pressure_pa) * params.plus.cushion_m2
    if c.minus.cushion.volume_m3 > 0.0:
        push_n -= (c.minus.cushion.pressure_pa - c.minus.chamber.pressure_pa) * params.minus.cushion_m2
    return push_n


@compiled
def _stays_at_rest(c: Any, params: Any) -> bool:
    """Return True if a stationary load stays at rest, held by friction, the brake, a fault or an end stop."""
    push_n = _push_n(c, params)
    if params.magnet_holds_n > 0.0:
        pull_n = 0.0 if c.decoupled else params.magnet_n_m * (c.piston_m - c.position_m)
        if abs(push_n - pull_n) > _STILL_N or abs(pull_n) > params.magnet_holds_n:
            return False
        push_n = pull_n
    else:
        push_n += params.weight_n
    bumper_n = _bumper(c, params, 0.0)[0]
    push_n += bumper_n
    if params.blocked:
        return True
    over_m = _over_m(params)
    if (c.position_m <= -over_m and push_n <= 0.0) or (c.position_m >= params.stroke_m + over_m and push_n >= 0.0):
        return True
    slack_n = _STILL_N if bumper_n != 0.0 else 0.0  # an elastic stop yields until the pressure has settled
    return bool(abs(push_n) <= params.friction.static_n + _brake_n(c, params) + slack_n)


@compiled
def _over_m(params: Any) -> float:
    """Return the distance of the rigid stops of the load beyond its stroke, m."""
    over_m: float = params.overtravel_m if params.magnet_holds_n <= 0.0 else 0.0
    return over_m


@compiled
def _move(c: Any, params: Any, push_n: float, step_s: float) -> None:
    """Move load and piston as one body; elastic stops are integrated implicitly, and a rigid stop absorbs the speed."""
    mass_kg = params.load_kg + params.piston_kg
    speed_m_s = 0.0
    if params.blocked == 0:
        bumper_n, give = _bumper(c, params, step_s)
        eased = 1.0 + step_s * give / mass_kg
        free_m_s = (c.speed_m_s + step_s * (push_n + params.weight_n + bumper_n) / mass_kg) / eased
        speed_m_s = speed_after_friction_m_s(
            params.friction, free_m_s, c.speed_m_s, mass_kg * eased, step_s, _brake_n(c, params)
        )
        # otherwise the load would approach its balance with the bumper for ever, and never be at rest
        if bumper_n != 0.0 and abs(speed_m_s) < _STILL_M_S:
            speed_m_s = 0.0
    over_m = _over_m(params)
    # semi-implicit: the position follows the new speed (docs/sources/plant.md 3.2)
    c.speed_m_s, c.position_m = _stopped(
        speed_m_s, c.position_m + step_s * speed_m_s, -over_m, params.stroke_m + over_m
    )
    c.piston_m, c.piston_m_s = c.position_m, c.speed_m_s


@inlined
def _move_coupled(c: Any, params: Any, push_n: float, step_s: float) -> None:
    """Move piston and load, coupled by a magnet that yields like a spring and decouples above its holding force.

    Spring and damper are integrated implicitly, so their stiffness does not limit the time step. The load sticks if the
    force required to hold it does not exceed its friction.
    """
    lag_m = c.piston_m - c.position_m
    if c.decoupled != 0:
        # the magnet couples again only if the piston passes slowly (docs/sources/plant.md 1.8)
        near = abs(lag_m) * params.magnet_n_m <= params.magnet_holds_n
        if near and abs(c.piston_m_s - c.speed_m_s) <= params.recouples_m_s:
            c.decoupled = 0
    elif abs(lag_m) * params.magnet_n_m > params.magnet_holds_n:
        c.decoupled = 1
    pull_n, give = 0.0, 0.0
    if c.decoupled == 0:
        pull_n = params.magnet_n_m * lag_m
        # the lag at the end of the step is larger by the step times the difference of the speeds
        give = step_s * params.magnet_n_m + params.magnet_n_s_m
    piston_s_kg, load_s_kg = step_s / params.piston_kg, step_s / params.load_kg
    bumper_n, bumper_give = _bumper(c, params, step_s)
    piston_m_s, load_m_s = c.piston_m_s, 0.0
    if params.blocked == 0:
        # speeds of both at the end of the step without friction: two linear equations
        a11 = 1.0 + piston_s_kg * give
        a12 = -piston_s_kg * give
        a22 = 1.0 + load_s_kg * (give + bumper_give)
        a21 = -load_s_kg * give
        right1 = c.piston_m_s + piston_s_kg * (push_n - pull_n)
        right2 = c.speed_m_s + load_s_kg * (pull_n + bumper_n)
        free_m_s = (a11 * right2 - a21 * right1) / (a11 * a22 - a12 * a21)
        # friction acts on the load plus the mass that follows it through the magnet
        carried_kg = params.load_kg * (a22 - a12 * a21 / a11)
        load_m_s = speed_after_friction_m_s(
            params.friction, free_m_s, c.speed_m_s, carried_kg, step_s, _brake_n(c, params)
        )
    piston_m_s = (c.piston_m_s + piston_s_kg * (push_n - pull_n + give * load_m_s)) / (1.0 + piston_s_kg * give)
    c.magnet_n = pull_n + give * (piston_m_s - load_m_s)
    c.speed_m_s, c.position_m = _stopped(load_m_s, c.position_m + step_s * load_m_s, 0.0, params.stroke_m)
    over_m = params.overtravel_m
    c.piston_m_s, c.piston_m = _stopped(piston_m_s, c.piston_m + step_s * piston_m_s, -over_m, params.stroke_m + over_m)


@compiled
def _brake_n(c: Any, params: Any) -> float:
    """Return the force of the engaged brake, N; 0 while it is released."""
    return params.brake_n if c.braked != 0 else 0.0


@compiled
def _step_brake(c: Any, params: Any, manifold: Any, step_s: float) -> None:
    """Advance the brake by one time step; its valve switches like that of the cylinder."""
    if c.valve.plus_acts != 0 or c.valve.minus_acts != 0:
        c.brake_s = params.brake_delay_s
    elif c.brake_s > 0.0:
        c.brake_s = max(c.brake_s - step_s, 0.0)
    engaged = c.brake_s <= 0.0 or manifold.pressure_pa - ATMOSPHERE_PA < params.brake_bites_pa
    c.braked = 1 if engaged else 0


@compiled
def _bumper(c: Any, params: Any, step_s: float) -> tuple[float, float]:
    """Return the bumper force at the start of the step, N, and its decrease with speed, N s/m."""
    if params.bumper_n_m <= 0.0:
        return 0.0, 0.0
    sign = 1.0
    into_m = params.bumper_m - c.position_m
    if into_m < 0.0:
        sign = -1.0
        into_m = c.position_m - (params.stroke_m - params.bumper_m)
    if into_m < 0.0:
        return 0.0, 0.0
    give = step_s * params.bumper_n_m
    if sign * c.speed_m_s * params.bumper_n_s_m < params.bumper_n_m * into_m:  # the bumper pushes but never pulls
        give += params.bumper_n_s_m
    return sign * params.bumper_n_m * into_m, give


@compiled
def _stopped(speed_m_s: float, position_m: float, low_m: float, high_m: float) -> tuple[float, float]:
    """Return speed and position, limited by the end stops; at an end stop, the speed towards it becomes 0."""
    if position_m <= low_m:
        return max(speed_m_s, 0.0), low_m
    if position_m >= high_m:
        return min(speed_m_s, 0.0), high_m
    return speed_m_s, position_m
