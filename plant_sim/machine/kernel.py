"""Compiled motion of the complete machine: one call advances all moving parts by several steps."""

from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled, compiled_and_cached
from plant_sim.devices.conveyor import CONVEYOR, CONVEYOR_PARAMS, step_conveyor
from plant_sim.devices.cups import CUPS, CUPS_PARAMS, step_cups
from plant_sim.devices.sensor import SENSOR, SENSOR_PARAMS, step_switch
from plant_sim.devices.spreader import SPREADER, SPREADER_PARAMS, step_spreader
from plant_sim.devices.supply import AIR, AIR_PARAMS, settle_air
from plant_sim.devices.yield_sensors import (
    BEAM,
    BEAM_PARAMS,
    CLAW_PRESSURE,
    CLAW_PRESSURE_PARAMS,
    CUP_SENSOR,
    CUP_SENSOR_PARAMS,
    step_beam,
    step_claw_pressure,
    step_cup_sensor,
)
from plant_sim.pneumatics.chamber import GAS
from plant_sim.pneumatics.cylinder import (
    CYLINDER,
    CYLINDER_PARAMS,
    is_at_rest,
    remains_at_rest,
    settle_cylinder,
    step_cylinder,
)
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.pneumatics.supply import step_supply

ARM_COILS = (
    "lift_extend",
    "lift_retract",
    "slide_inward",
    "slide_outward",
    "converge",
    "spread",
    "claws_open",
    "claws_close",
)
"""Coils of an arm in kernel order."""

ARM_SENSORS = (
    "lift_up",
    "lift_down",
    "slide_at_feed",
    "slide_at_pick_1",
    "slide_at_pick_2",
    "slide_at_pick_3",
    "claws_converged",
    "claws_spread",
    "cup_pulse",
    "claw_pressure",
    "seedling_beam",
    "cup_filled",
)
"""Sensors of an arm in kernel order."""

SENSORS = (
    *(f"{side}.{tag}" for side in ("left", "right") for tag in ARM_SENSORS),
    "tray_front_edge",
    "air_pressure_ok",
    "magazine_empty",
)
"""All sensors in kernel order."""

_BELT = 2 * len(ARM_COILS)
"""Index of the first coil that is common to both arms."""

_COMMON = 2 * len(ARM_SENSORS)

ARM = np.dtype(
    [
        ("slide", CYLINDER),
        ("lift", CYLINDER),
        ("claws", CYLINDER),
        ("spreader", SPREADER),
        ("cups", CUPS),
        ("slide_switches", SENSOR, (4,)),
        ("lift_switches", SENSOR, (2,)),
        ("claw_pressure", CLAW_PRESSURE),
        ("seedling_beam", BEAM),
        ("cup_filled", CUP_SENSOR),
        ("stirred", "i8"),
        ("freed_s", "f8"),
        ("gripped_s", "f8"),
        ("clamp_pa", "f8"),
        ("clamped", "i8"),
        ("slips", "i8"),
    ]
)
"""State of an arm.

`stirred` counts the steps with any motion. `freed_s` and `gripped_s` are the times at which the claws last opened far
enough to be free of the stems, and closed far enough to grip. `clamp_pa` is the pressure that closes the fingers;
`clamped` is 1 while closed fingers have their holding force, and `slips` counts the losses of this force.
"""

ARM_PARAMS = np.dtype(
    [
        ("slide", CYLINDER_PARAMS),
        ("lift", CYLINDER_PARAMS),
        ("claws", CYLINDER_PARAMS),
        ("spreader", SPREADER_PARAMS),
        ("cups", CUPS_PARAMS),
        ("slide_switches", SENSOR_PARAMS, (4,)),
        ("lift_switches", SENSOR_PARAMS, (2,)),
        ("claw_pressure", CLAW_PRESSURE_PARAMS),
        ("seedling_beam", BEAM_PARAMS),
        ("cup_filled", CUP_SENSOR_PARAMS),
        ("watches_yield", "i8"),
        ("down_m", "f8"),
        ("frees_above_m", "f8"),
        ("grips_below_m", "f8"),
        ("holds_above_pa", "f8"),
    ]
)
"""Parameters of an arm. `watches_yield` is 1 if claw pressure switch, beam or cup sensor is wired; they are not
evaluated otherwise. `down_m` is the position of the lift at its lower limit."""

POSITIONS = (
    "slide_m",
    "lift_m",
    "claws_m",
    "spreader_m",
    "chain_m",
    "chain_m_s",
    "stirred",
    "freed_s",
    "slips",
    "clamp_pa",
)
"""Outputs of `advance` for each arm; the travel of the trays, m, follows those of both arms."""

MACHINE = np.dtype([("arms", ARM, (2,)), ("conveyor", CONVEYOR), ("air", AIR)])
"""State of the complete machine."""

MACHINE_PARAMS = np.dtype(
    [("gas", GAS), ("arms", ARM_PARAMS, (2,)), ("conveyor", CONVEYOR_PARAMS), ("air", AIR_PARAMS)]
)


@compiled_and_cached
def advance(machine: Any, params: Any, coils: Any, fed: bool, first_step: int, steps: int, positions: Any) -> None:
    """Advance by several steps with constant coils.

    Args:
        machine: One `MACHINE` record.
        params: One `MACHINE_PARAMS` record.
        coils: Coil levels, True if energised: those of the left and right arm in the order of `ARM_COILS`, then run
            and direction of the conveyor.
        fed: True if the safety relay energises the dump valve.
        first_step: Number of the first step; the step at plant time 0 is 0.
        steps: Number of steps; their length is in `params`.
        positions: Output array: final positions in the order of `POSITIONS` for each arm, then the travel of the trays.
    """
    m, gas, air_params = machine[0], params[0].gas, params[0].air
    air = m.air
    left_rests = right_rests = (False, False, False)
    left, right = _arm_levels(coils, 0), _arm_levels(coils, len(ARM_COILS))
    for step in range(steps):
        at_s = (first_step + step) * gas.step_s
        step_supply(air.network, air_params.network, fed, gas)
        step_conveyor(m.conveyor, params[0].conveyor, coils[_BELT], coils[_BELT + 1], at_s, gas.step_s)
        left_rests = _step_arm(m.arms[0], params[0].arms[0], left, left_rests, air.network, at_s, gas)
        right_rests = _step_arm(m.arms[1], params[0].arms[1], right, right_rests, air.network, at_s, gas)
        _settle_arm(m.arms[0], params[0].arms[0], left_rests, gas)
        _settle_arm(m.arms[1], params[0].arms[1], right_rests, gas)
        settle_air(air, air_params, at_s + gas.step_s, gas)
    for side in range(2):
        arm, first = m.arms[side], len(POSITIONS) * side
        positions[first] = arm.slide.position_m
        positions[first + 1] = arm.lift.position_m
        positions[first + 2] = arm.claws.position_m
        positions[first + 3] = arm.spreader.travel_m
        positions[first + 4] = arm.cups.chain_m
        positions[first + 5] = arm.cups.speed_m_s
        positions[first + 6] = arm.stirred
        positions[first + 7] = arm.freed_s
        positions[first + 8] = arm.slips
        positions[first + 9] = arm.clamp_pa
        if params[0].arms[side].watches_yield:
            _step_yield_sensors(arm, params[0].arms[side], (first_step + steps) * gas.step_s)
    positions[2 * len(POSITIONS)] = m.conveyor.trays_m


@compiled
def _step_yield_sensors(arm: Any, params: Any, now_s: float) -> None:
    """Update the sensors of held and planted rows at the end of the last step, with the contents as last set."""
    gauge_pa = arm.claws.minus.chamber.pressure_pa - ATMOSPHERE_PA
    step_claw_pressure(arm.claw_pressure, params.claw_pressure, gauge_pa, now_s)
    rise_m = params.down_m - arm.lift.position_m
    step_beam(arm.seedling_beam, params.seedling_beam, arm.slide.position_m, rise_m, now_s)
    step_cup_sensor(arm.cup_filled, params.cup_filled, arm.cups.chain_m, arm.cups.speed_m_s, now_s)


@compiled
def _arm_levels(coils: Any, first: int) -> tuple[bool, bool, bool, bool, bool, bool, bool, bool]:
    """Return the coil levels of an arm as a tuple: an array as an argument costs two atomic operations per call."""
    return (
        coils[first],
        coils[first + 1],
        coils[first + 2],
        coils[first + 3],
        coils[first + 4],
        coils[first + 5],
        coils[first + 6],
        coils[first + 7],
    )


@compiled
def _step_arm(
    arm: Any, params: Any, coils: Any, rested: tuple[bool, bool, bool], supply: Any, at_s: float, gas: Any
) -> tuple[bool, bool, bool]:
    """Advance an arm by one time step.

    Args:
        arm: The arm.
        params: Its parameters.
        coils: Its coil levels in the order of `ARM_COILS`.
        rested: True for lift, slide and claws if they were at rest in the last step with the same coils and parameters.
        supply: Compressed-air supply.
        at_s: Start of the step, s.
        gas: Gas model.

    Returns:
        True for lift, slide and claws if they are at rest in this step.
    """
    step_s, main, outside = gas.step_s, supply.manifold, supply.outside
    x_m, y_m, opening_m, travel_m = (
        arm.slide.position_m,
        arm.lift.position_m,
        arm.claws.position_m,
        arm.spreader.travel_m,
    )
    lift_rests = _step_cylinder(arm.lift, params.lift, coils[0], coils[1], rested[0], main, outside, gas)
    slide_rests = _step_cylinder(arm.slide, params.slide, coils[2], coils[3], rested[1], main, outside, gas)
    claws_rest = _step_cylinder(
        arm.claws, params.claws, coils[6], coils[7], rested[2], supply.claw_manifold, outside, gas
    )
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
    stirs = x_m != arm.slide.position_m or y_m != arm.lift.position_m
    if stirs or opening_m != now_m or travel_m != arm.spreader.travel_m:
        arm.stirred += 1
    return lift_rests, slide_rests, claws_rest


@compiled
def _step_cylinder(
    c: Any, params: Any, plus: bool, minus: bool, rested: bool, manifold: Any, outside: Any, gas: Any
) -> bool:
    """Advance a cylinder by one time step unless it is at rest; return True if it is.

    `rested` is True if it was at rest in the last step, with the same coil levels and parameters.
    """
    rests = remains_at_rest(c, manifold) if rested else is_at_rest(c, params, plus, minus, manifold)
    if not rests:
        step_cylinder(c, params, plus, minus, manifold, outside, gas)
    return rests


@compiled
def _settle_arm(arm: Any, params: Any, rests: tuple[bool, bool, bool], gas: Any) -> None:
    """Finish a step of an arm."""
    if not rests[0]:
        settle_cylinder(arm.lift, params.lift, gas)
    if not rests[1]:
        settle_cylinder(arm.slide, params.slide, gas)
    if not rests[2]:
        settle_cylinder(arm.claws, params.claws, gas)
    _update_clamp(arm, params)


@compiled
def _update_clamp(arm: Any, params: Any) -> None:
    """Update the pressure that holds the fingers closed, and count each loss of it while they are closed."""
    arm.clamp_pa = arm.claws.minus.chamber.pressure_pa - arm.claws.plus.chamber.pressure_pa
    # losing the force while opening is intended; an aborted opening still drops the seedlings
    opens = arm.claws.valve.target > 0.0
    if arm.claws.position_m > params.grips_below_m:
        arm.clamped = 0
    elif not opens:
        holds = 1 if arm.clamp_pa >= params.holds_above_pa else 0
        if arm.clamped and not holds:
            arm.slips += 1
        arm.clamped = holds


@compiled
def _any_busy(switches: Any) -> bool:
    """Return True if the output of any switch is being delayed or is bouncing."""
    busy = 0
    for switch in switches:
        busy += switch.busy
    return busy != 0


@compiled_and_cached
def read_sensors(machine: Any, params: Any, terminals: Any, inverted: Any, image: Any) -> None:
    """Read all wired sensors.

    Args:
        machine: One `MACHINE` record.
        params: One `MACHINE_PARAMS` record.
        terminals: X number of every sensor in the order of `SENSORS`; -1 if it is not wired.
        inverted: True for every sensor whose wire is inverted.
        image: Output: raw level by X number.
    """
    m, p = machine[0], params[0]
    for side in range(2):
        arm, arm_params = m.arms[side], p.arms[side]
        first = len(ARM_SENSORS) * side
        for number in range(2):
            _write_terminal(
                arm.lift_switches[number], arm_params.lift_switches[number], first + number, terminals, inverted, image
            )
            _write_terminal(
                arm.spreader.switches[number],
                arm_params.spreader.switches[number],
                first + 6 + number,
                terminals,
                inverted,
                image,
            )
        for number in range(4):
            _write_terminal(
                arm.slide_switches[number],
                arm_params.slide_switches[number],
                first + 2 + number,
                terminals,
                inverted,
                image,
            )
        _write_terminal(arm.cups.pulse, arm_params.cups.pulse, first + 8, terminals, inverted, image)
        _write_terminal(
            arm.claw_pressure.sensor, arm_params.claw_pressure.sensor, first + 9, terminals, inverted, image
        )
        _write_terminal(
            arm.seedling_beam.sensor, arm_params.seedling_beam.sensor, first + 10, terminals, inverted, image
        )
        _write_terminal(arm.cup_filled.sensor, arm_params.cup_filled.sensor, first + 11, terminals, inverted, image)
    _write_terminal(m.conveyor.beam, p.conveyor.beam, _COMMON, terminals, inverted, image)
    _write_terminal(m.air.pressure_ok, p.air.pressure_ok, _COMMON + 1, terminals, inverted, image)
    _write_terminal(m.conveyor.magazine_empty, p.conveyor.magazine_empty, _COMMON + 2, terminals, inverted, image)


@compiled
def _write_terminal(sensor: Any, params: Any, index: int, terminals: Any, inverted: Any, image: Any) -> None:
    """Write the output of a sensor, or its forced level, to its terminal."""
    number = terminals[index]
    if number >= 0:
        on = sensor.output != 0 if params.forced < 0 else params.forced == 1
        image[number] = on != inverted[index]
