"""A double-acting cylinder with its valve and two lines, and the load it moves."""

from typing import Any

import numpy as np

from plant_sim.pneumatics.compiled import compiled
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.pneumatics.friction import FRICTION, rubbed_m_s
from plant_sim.pneumatics.line import LINE, LINE_MAKE, line_rests, step_line
from plant_sim.pneumatics.valve import VALVE, VALVE_MAKE, step_valve

_STILL_M_S, _STILL_N = 1e-6, 1.0

#: State. The load stands at `position_m` from the end stop at 0 and moves at `speed_m_s`; the piston
#: has its own place and speed where a magnet couples it to the load, else it has the load's. `plus`
#: drives away from 0, `minus` towards it.
CYLINDER = np.dtype(
    [
        ("position_m", "f8"),
        ("speed_m_s", "f8"),
        ("piston_m", "f8"),
        ("piston_m_s", "f8"),
        ("magnet_n", "f8"),
        ("decoupled", "i8"),
        ("valve", VALVE),
        ("plus", LINE),
        ("minus", LINE),
    ]
)

#: What it is. `weight_n` pulls away from 0. `cushion_m` before each end leaves `cushion_share` of the
#: throttle. `bumper_n_m` is a rubber bumper `bumper_m` thick, 0 for none. `magnet_holds_n` 0 means that
#: load and piston are one body. `brake_n` is the force of a spring-applied brake on the load that either line
#: lifts, through a shuttle valve, and that bites below `brake_bites_pa` (gauge). `blocked` 1 while the load
#: stands dead (a fault).
CYLINDER_MAKE = np.dtype(
    [
        ("stroke_m", "f8"),
        ("plus_area_m2", "f8"),
        ("minus_area_m2", "f8"),
        ("load_kg", "f8"),
        ("piston_kg", "f8"),
        ("weight_n", "f8"),
        ("cushion_m", "f8"),
        ("cushion_share", "f8"),
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
        ("blocked", "i8"),
        ("friction", FRICTION),
        ("valve", VALVE_MAKE),
        ("plus", LINE_MAKE),
        ("minus", LINE_MAKE),
    ]
)


@compiled
def step_cylinder(c: Any, make: Any, plus: bool, minus: bool, manifold: Any, outside: Any, gas: Any) -> None:
    """Let time pass: valve, then what the air does to the piston, then what the piston does to the air.

    Args:
        c: The cylinder.
        make: What it is.
        plus: Coil that drives away from 0.
        minus: Coil that drives towards 0.
        manifold: Chamber the valve is fed from.
        outside: The surroundings.
        gas: How air behaves.
    """
    step_valve(c.valve, make.valve, plus, minus, gas.step_s)
    push_n = _push_n(c, make)
    if make.magnet_holds_n > 0.0:
        _move_coupled(c, make, push_n, gas.step_s)
    else:
        _move(c, make, push_n, gas.step_s)
    spool = c.valve.spool
    plus_pa, minus_pa = c.plus.tube.pressure_pa, c.minus.tube.pressure_pa
    plus_share = make.cushion_share if c.position_m < make.cushion_m else 1.0
    minus_share = make.cushion_share if make.stroke_m - c.position_m < make.cushion_m else 1.0
    plus_m3 = make.plus.dead_m3 + make.plus_area_m2 * c.piston_m
    minus_m3 = make.minus.dead_m3 + make.minus_area_m2 * (make.stroke_m - c.piston_m)
    step_line(c.plus, make.plus, make.valve, spool, minus_pa, plus_share, plus_m3, manifold, outside, gas)
    step_line(c.minus, make.minus, make.valve, -spool, plus_pa, minus_share, minus_m3, manifold, outside, gas)


@compiled
def rests(c: Any, make: Any, plus: bool, minus: bool, manifold: Any) -> bool:
    """Whether a step would change nothing worth the name: nothing about to move, no flow, air as warm as the walls."""
    valve = c.valve
    if abs(c.piston_m_s) > _STILL_M_S or c.speed_m_s != 0.0 or valve.spool != valve.target:
        return False
    if plus != (valve.plus_acts != 0) or minus != (valve.minus_acts != 0):
        return False
    if valve.plus_pending_s != 0.0 or valve.minus_pending_s != 0.0 or not _holds(c, make):
        return False
    return line_rests(c.plus, make.plus, valve.spool, manifold) and line_rests(
        c.minus, make.minus, -valve.spool, manifold
    )


@compiled
def _push_n(c: Any, make: Any) -> float:
    """Force of the air on the piston, N, positive away from 0."""
    rod_m2 = make.plus_area_m2 - make.minus_area_m2
    push_n: float = (
        c.plus.chamber.pressure_pa * make.plus_area_m2
        - c.minus.chamber.pressure_pa * make.minus_area_m2
        - ATMOSPHERE_PA * rod_m2
    )
    return push_n


@compiled
def _holds(c: Any, make: Any) -> bool:
    """Whether a load that stands goes on standing: held by its friction, its brake, a fault or an end stop."""
    push_n = _push_n(c, make)
    if make.magnet_holds_n > 0.0:
        pull_n = 0.0 if c.decoupled else make.magnet_n_m * (c.piston_m - c.position_m)
        if abs(push_n - pull_n) > _STILL_N or abs(pull_n) > make.magnet_holds_n:
            return False
        push_n = pull_n + _bumper(c, make, 0.0)[0]
    else:
        push_n += make.weight_n
    if make.blocked:
        return True
    if (c.position_m <= 0.0 and push_n <= 0.0) or (c.position_m >= make.stroke_m and push_n >= 0.0):
        return True
    return bool(abs(push_n) <= make.friction.static_n + _brake_n(c, make))


@compiled
def _move(c: Any, make: Any, push_n: float, step_s: float) -> None:
    """Move load and piston as one body; the end stops take all its speed."""
    mass_kg = make.load_kg + make.piston_kg
    speed_m_s = 0.0
    if make.blocked == 0:
        free_m_s = c.speed_m_s + step_s * (push_n + make.weight_n) / mass_kg
        speed_m_s = rubbed_m_s(make.friction, free_m_s, c.speed_m_s, mass_kg, step_s, _brake_n(c, make))
    position_m = c.position_m + step_s * speed_m_s
    if position_m <= 0.0:
        position_m = 0.0
        speed_m_s = max(speed_m_s, 0.0)
    elif position_m >= make.stroke_m:
        position_m = make.stroke_m
        speed_m_s = min(speed_m_s, 0.0)
    c.position_m = c.piston_m = position_m
    c.speed_m_s = c.piston_m_s = speed_m_s


@compiled
def _move_coupled(c: Any, make: Any, push_n: float, step_s: float) -> None:
    """Move piston and load, between them a magnet that gives way like a spring and lets go beyond its force.

    Spring and damper are taken at the end of the step, so that their stiffness sets no limit to it. The
    load sticks if that takes no more than its friction.
    """
    lag_m = c.piston_m - c.position_m
    if c.decoupled != 0:
        near = abs(lag_m) * make.magnet_n_m <= make.magnet_holds_n
        if near and abs(c.piston_m_s - c.speed_m_s) <= make.recouples_m_s:
            c.decoupled = 0
    elif abs(lag_m) * make.magnet_n_m > make.magnet_holds_n:
        c.decoupled = 1
    pull_n, give = 0.0, 0.0
    if c.decoupled == 0:
        pull_n = make.magnet_n_m * lag_m
        give = step_s * make.magnet_n_m + make.magnet_n_s_m
    piston_s_kg, load_s_kg = step_s / make.piston_kg, step_s / make.load_kg
    bumper_n, bumper_give = _bumper(c, make, step_s)
    piston_m_s, load_m_s = c.piston_m_s, 0.0
    if make.blocked == 0:
        # both at the end of the step without friction: two equations in the two speeds
        a11 = 1.0 + piston_s_kg * give
        a12 = -piston_s_kg * give
        a22 = 1.0 + load_s_kg * (give + bumper_give)
        a21 = -load_s_kg * give
        right1 = c.piston_m_s + piston_s_kg * (push_n - pull_n)
        right2 = c.speed_m_s + load_s_kg * (pull_n + bumper_n)
        free_m_s = (a11 * right2 - a21 * right1) / (a11 * a22 - a12 * a21)
        # friction acts on the load together with what the magnet makes follow it
        carried_kg = make.load_kg * (a22 - a12 * a21 / a11)
        load_m_s = rubbed_m_s(make.friction, free_m_s, c.speed_m_s, carried_kg, step_s, _brake_n(c, make))
    piston_m_s = (c.piston_m_s + piston_s_kg * (push_n - pull_n + give * load_m_s)) / (1.0 + piston_s_kg * give)
    c.magnet_n = pull_n + give * (piston_m_s - load_m_s)
    c.speed_m_s, c.position_m = _stopped(load_m_s, c.position_m + step_s * load_m_s, 0.0, make.stroke_m)
    over_m = make.overtravel_m
    c.piston_m_s, c.piston_m = _stopped(piston_m_s, c.piston_m + step_s * piston_m_s, -over_m, make.stroke_m + over_m)


@compiled
def _brake_n(c: Any, make: Any) -> float:
    """Force with which the brake bites, N."""
    lifts_pa = max(c.plus.tube.pressure_pa, c.minus.tube.pressure_pa) - ATMOSPHERE_PA
    return make.brake_n if lifts_pa < make.brake_bites_pa else 0.0


@compiled
def _bumper(c: Any, make: Any, step_s: float) -> tuple[float, float]:
    """Force of the rubber bumper at either end at the start of the step, N, and how much speed lessens it, N s/m."""
    if make.bumper_n_m <= 0.0:
        return 0.0, 0.0
    sign = 1.0
    into_m = make.bumper_m - c.position_m
    if into_m < 0.0:
        sign = -1.0
        into_m = c.position_m - (make.stroke_m - make.bumper_m)
    if into_m < 0.0:
        return 0.0, 0.0
    give = step_s * make.bumper_n_m
    if sign * c.speed_m_s * make.bumper_n_s_m < make.bumper_n_m * into_m:  # rubber pushes, it never pulls
        give += make.bumper_n_s_m
    return sign * make.bumper_n_m * into_m, give


@compiled
def _stopped(speed_m_s: float, position_m: float, low_m: float, high_m: float) -> tuple[float, float]:
    """Speed and place, unless an end stop is in the way: it takes all the speed towards it."""
    if position_m <= low_m:
        return max(speed_m_s, 0.0), low_m
    if position_m >= high_m:
        return min(speed_m_s, 0.0), high_m
    return speed_m_s, position_m
