"""The whole machine's motion, compiled: one call advances everything that moves by a number of steps."""

from typing import Any

import numpy as np

from plant_sim.devices.conveyor import CONVEYOR, CONVEYOR_MAKE, step_conveyor
from plant_sim.devices.cups import CUPS, CUPS_MAKE, step_cups
from plant_sim.devices.sensor import SENSOR, SENSOR_MAKE, step_switch
from plant_sim.devices.spreader import SPREADER, SPREADER_MAKE, step_spreader
from plant_sim.devices.supply import AIR, AIR_MAKE, settle_air
from plant_sim.pneumatics.chamber import GAS
from plant_sim.pneumatics.compiled import compiled, compiled_and_kept
from plant_sim.pneumatics.cylinder import CYLINDER, CYLINDER_MAKE, rests, step_cylinder
from plant_sim.pneumatics.supply import step_supply

#: The coils of an arm in the order in which the kernel takes them.
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

#: The sensors of an arm in the order in which the kernel reads them.
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
)

#: All sensors in the order in which the kernel reads them.
SENSORS = (
    *(f"{side}.{tag}" for side in ("left", "right") for tag in ARM_SENSORS),
    "tray_front_edge",
    "air_pressure_ok",
    "magazine_empty",
)

_BELT = 2 * len(ARM_COILS)  # first coil, and first sensor, of what both arms share
_COMMON = 2 * len(ARM_SENSORS)

#: State of an arm. `stirred` counts the steps in which anything moved; `freed_s` and `gripped_s` are when
#: the claws last opened so far that they touch nothing, and closed so far that they grip. `clamp_pa` presses the
#: fingers together; `clamped` is 1 while closed fingers have the force to hold, `slips` counts how often they lost it.
ARM = np.dtype(
    [
        ("slide", CYLINDER),
        ("lift", CYLINDER),
        ("claws", CYLINDER),
        ("spreader", SPREADER),
        ("cups", CUPS),
        ("slide_switches", SENSOR, (4,)),
        ("lift_switches", SENSOR, (2,)),
        ("stirred", "i8"),
        ("freed_s", "f8"),
        ("gripped_s", "f8"),
        ("clamp_pa", "f8"),
        ("clamped", "i8"),
        ("slips", "i8"),
    ]
)

ARM_MAKE = np.dtype(
    [
        ("slide", CYLINDER_MAKE),
        ("lift", CYLINDER_MAKE),
        ("claws", CYLINDER_MAKE),
        ("spreader", SPREADER_MAKE),
        ("cups", CUPS_MAKE),
        ("slide_switches", SENSOR_MAKE, (4,)),
        ("lift_switches", SENSOR_MAKE, (2,)),
        ("frees_above_m", "f8"),
        ("grips_below_m", "f8"),
        ("holds_above_pa", "f8"),
    ]
)

#: What `advance` tells of each arm, then of the trays: their way, m.
SIGHT = (
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

#: Everything that moves, and everything that decides how.
MACHINE = np.dtype([("arms", ARM, (2,)), ("conveyor", CONVEYOR), ("air", AIR)])
MACHINE_MAKE = np.dtype([("gas", GAS), ("arms", ARM_MAKE, (2,)), ("conveyor", CONVEYOR_MAKE), ("air", AIR_MAKE)])


@compiled_and_kept
def advance(machine: Any, make: Any, coils: Any, fed: bool, first: int, steps: int, sight: Any) -> None:
    """Let time pass under constant coils.

    Args:
        machine: One record `MACHINE`.
        make: One record `MACHINE_MAKE`.
        coils: True where energised: those of the left arm and of the right as `ARM_COILS`, then run and
            direction of the conveyor.
        fed: Whether the safety relay holds the dump valve.
        first: Number of the first step; that of plant time 0 is 0.
        steps: How many steps of the length in `make`.
        sight: Filled: where everything is at the end, as `SIGHT`.
    """
    m, gas, air_make = machine[0], make[0].gas, make[0].air
    air = m.air
    for step in range(steps):
        at_s = (first + step) * gas.step_s
        step_supply(air.network, air_make.network, fed, gas)
        step_conveyor(m.conveyor, make[0].conveyor, coils[_BELT], coils[_BELT + 1], at_s, gas.step_s)
        for side in range(2):
            _step_arm(
                m.arms[side],
                make[0].arms[side],
                coils[len(ARM_COILS) * side : len(ARM_COILS) * (side + 1)],
                air.network,
                at_s,
                gas,
            )
        settle_air(air, air_make, at_s + gas.step_s, gas)
    for side in range(2):
        arm, place = m.arms[side], len(SIGHT) * side
        sight[place] = arm.slide.position_m
        sight[place + 1] = arm.lift.position_m
        sight[place + 2] = arm.claws.position_m
        sight[place + 3] = arm.spreader.travel_m
        sight[place + 4] = arm.cups.chain_m
        sight[place + 5] = arm.cups.speed_m_s
        sight[place + 6] = arm.stirred
        sight[place + 7] = arm.freed_s
        sight[place + 8] = arm.slips
        sight[place + 9] = arm.clamp_pa
    sight[2 * len(SIGHT)] = m.conveyor.trays_m


@compiled
def _step_arm(arm: Any, make: Any, coils: Any, supply: Any, at_s: float, gas: Any) -> None:
    step_s = gas.step_s
    x_m, y_m, opening_m, travel_m = (
        arm.slide.position_m,
        arm.lift.position_m,
        arm.claws.position_m,
        arm.spreader.travel_m,
    )
    if not rests(arm.lift, make.lift, coils[0], coils[1], supply.manifold):
        step_cylinder(arm.lift, make.lift, coils[0], coils[1], supply.manifold, supply.outside, gas)
    if not rests(arm.slide, make.slide, coils[2], coils[3], supply.manifold):
        step_cylinder(arm.slide, make.slide, coils[2], coils[3], supply.manifold, supply.outside, gas)
    if not rests(arm.claws, make.claws, coils[6], coils[7], supply.claw_manifold):
        step_cylinder(arm.claws, make.claws, coils[6], coils[7], supply.claw_manifold, supply.outside, gas)
    step_spreader(arm.spreader, make.spreader, coils[5], coils[4], at_s, step_s)
    step_cups(arm.cups, make.cups, at_s, step_s)
    if x_m != arm.slide.position_m or _any_busy(arm.slide_switches):
        for number in range(4):
            step_switch(
                arm.slide_switches[number], make.slide_switches[number], x_m, arm.slide.position_m, at_s, step_s
            )
    if y_m != arm.lift.position_m or _any_busy(arm.lift_switches):
        for number in range(2):
            step_switch(arm.lift_switches[number], make.lift_switches[number], y_m, arm.lift.position_m, at_s, step_s)
    now_m = arm.claws.position_m
    if opening_m < make.frees_above_m <= now_m:
        arm.freed_s = at_s + step_s * (make.frees_above_m - opening_m) / (now_m - opening_m)
    if opening_m > make.grips_below_m >= now_m:
        arm.gripped_s = at_s + step_s * (opening_m - make.grips_below_m) / (opening_m - now_m)
    _feel(arm, make)
    stirs = x_m != arm.slide.position_m or y_m != arm.lift.position_m
    if stirs or opening_m != now_m or travel_m != arm.spreader.travel_m:
        arm.stirred += 1


@compiled
def _feel(arm: Any, make: Any) -> None:
    """Whether the fingers hold, or have lost the force they had."""
    arm.clamp_pa = arm.claws.minus.chamber.pressure_pa - arm.claws.plus.chamber.pressure_pa
    opens = arm.claws.valve.target > 0.0  # then they are to lose it; an opening broken off still loses what they held
    if arm.claws.position_m > make.grips_below_m:
        arm.clamped = 0
    elif not opens:
        holds = 1 if arm.clamp_pa >= make.holds_above_pa else 0
        if arm.clamped and not holds:
            arm.slips += 1
        arm.clamped = holds


@compiled
def _any_busy(switches: Any) -> bool:
    """Whether a switch does not yet, or not steadily, say what it sees."""
    busy = 0
    for switch in switches:
        busy += switch.busy
    return busy != 0


@compiled_and_kept
def look(machine: Any, make: Any, terminals: Any, inverted: Any, image: Any) -> None:
    """Read every sensor that is wired.

    Args:
        machine: One record `MACHINE`.
        make: One record `MACHINE_MAKE`.
        terminals: X number of every sensor, in the order of `SENSORS`; -1 where it is not wired.
        inverted: Whether its wire tells the opposite.
        image: Filled: raw level by X number.
    """
    m, made = machine[0], make[0]
    for side in range(2):
        arm, arm_make = m.arms[side], made.arms[side]
        first = len(ARM_SENSORS) * side
        for number in range(2):
            _tell(arm.lift_switches[number], arm_make.lift_switches[number], first + number, terminals, inverted, image)
            _tell(
                arm.spreader.switches[number],
                arm_make.spreader.switches[number],
                first + 6 + number,
                terminals,
                inverted,
                image,
            )
        for number in range(4):
            _tell(
                arm.slide_switches[number],
                arm_make.slide_switches[number],
                first + 2 + number,
                terminals,
                inverted,
                image,
            )
        _tell(arm.cups.pulse, arm_make.cups.pulse, first + 8, terminals, inverted, image)
    _tell(m.conveyor.beam, made.conveyor.beam, _COMMON, terminals, inverted, image)
    _tell(m.air.pressure_ok, made.air.pressure_ok, _COMMON + 1, terminals, inverted, image)
    _tell(m.conveyor.magazine_empty, made.conveyor.magazine_empty, _COMMON + 2, terminals, inverted, image)


@compiled
def _tell(sensor: Any, make: Any, index: int, terminals: Any, inverted: Any, image: Any) -> None:
    """Put what a sensor says, or is forced to say, on its terminal."""
    number = terminals[index]
    if number >= 0:
        on = sensor.says != 0 if make.forced < 0 else make.forced == 1
        image[number] = on != inverted[index]
