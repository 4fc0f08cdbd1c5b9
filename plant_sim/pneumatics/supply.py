"""Compressed-air supply: compressor, receiver, regulator, dump valve with soft start, and claw reservoir."""

from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled
from plant_sim.pneumatics.chamber import CHAMBER, WALL, check, exchange, implicit_factor, settle, settle_four
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, HEAT_P, REFERENCE_K, REFERENCE_KG_M3

SUPPLY = np.dtype(
    [
        ("receiver", CHAMBER),
        ("header", CHAMBER),
        ("manifold", CHAMBER),
        ("claw_reservoir", CHAMBER),
        ("claw_manifold", CHAMBER),
        ("outside", CHAMBER),
        ("compressor_runs", "i8"),
        ("soft_started", "i8"),
        ("fed_s", "f8"),
        ("taken_in_kg", "f8"),
    ]
)
"""State.

The air flows receiver -> regulator -> header -> dump valve -> manifold (slides and lifts), and receiver -> check valve
-> claw reservoir -> claw regulator -> claw manifold. `outside` is the ambient air; only its mass changes, by the
exhausted air less the compressor intake. `fed_s` is the time for which the relay has energised the dump valve.
"""

SUPPLY_PARAMS = np.dtype(
    [
        ("compressor_kg_s", "f8"),
        ("starts_below_pa", "f8"),
        ("stops_above_pa", "f8"),
        ("regulated_pa", "f8"),
        ("band_pa", "f8"),
        ("regulator_m3_s_pa", "f8"),
        ("claw_regulated_pa", "f8"),
        ("claw_regulator_m3_s_pa", "f8"),
        ("relief_m3_s_pa", "f8"),
        ("dump_delay_s", "f8"),
        ("main_m3_s_pa", "f8"),
        ("soft_m3_s_pa", "f8"),
        ("soft_until", "f8"),
        ("vent_m3_s_pa", "f8"),
        ("check_m3_s_pa", "f8"),
        ("crack_pa", "f8"),
        ("critical_ratio", "f8"),
        ("slip_m3_s_pa", "f8"),
        ("leak_m3_s_pa", "f8"),
        ("receiver_wall", WALL),
        ("header_wall", WALL),
        ("manifold_wall", WALL),
        ("claw_reservoir_wall", WALL),
        ("claw_manifold_wall", WALL),
    ]
)
"""Parameters.

Pressures are gauge pressures. `relief_m3_s_pa` is the relief of both regulators to the ambient air. `compressor_kg_s`
is 0 after a compressor failure. `leak_m3_s_pa` from the manifold and
`slip_m3_s_pa` past the seat of the claw check valve are faults.
"""


@compiled
def step_supply(s: Any, params: Any, fed: bool, gas: Any) -> None:
    """Advance by one time step.

    Args:
        s: The supply.
        params: Its parameters.
        fed: True if the safety relay energises the dump valve; otherwise the manifold is vented.
        gas: Gas model.
    """
    step_s, critical = gas.step_s, params.critical_ratio
    _compress(s, params, step_s)
    _regulate(s.receiver, s.header, s.outside, params, params.regulated_pa, params.regulator_m3_s_pa, gas)
    # the claws keep their air when the receiver is empty, so that nothing gripped is dropped
    check(s.receiver, s.claw_reservoir, params.crack_pa, params.check_m3_s_pa, critical, gas)
    check(s.claw_reservoir, s.receiver, 0.0, params.slip_m3_s_pa, critical, gas)
    _regulate(
        s.claw_reservoir,
        s.claw_manifold,
        s.outside,
        params,
        params.claw_regulated_pa,
        params.claw_regulator_m3_s_pa,
        gas,
    )
    s.fed_s = s.fed_s + step_s if fed else 0.0
    if s.fed_s > params.dump_delay_s:
        # latched until the supply is cut: a later drop of the pressure does not throttle a working machine
        if s.manifold.pressure_pa >= params.soft_until * s.header.pressure_pa:
            s.soft_started = 1
        through = params.main_m3_s_pa if s.soft_started else params.soft_m3_s_pa
        exchange(s.header, s.manifold, through, critical, gas)
    else:
        s.soft_started = 0
        exchange(s.manifold, s.outside, params.vent_m3_s_pa, critical, gas)
    exchange(s.manifold, s.outside, params.leak_m3_s_pa, critical, gas)


@compiled
def settle_supply(s: Any, params: Any, gas: Any) -> None:
    """Finish a step after all consumers have drawn their air."""
    if gas.thermal == 0:
        settle_four(s.receiver, s.header, s.manifold, s.claw_reservoir, gas)
    else:
        settle(s.receiver, params.receiver_wall, gas)
        settle(s.header, params.header_wall, gas)
        settle(s.manifold, params.manifold_wall, gas)
        settle(s.claw_reservoir, params.claw_reservoir_wall, gas)
    settle(s.claw_manifold, params.claw_manifold_wall, gas)


@compiled
def _compress(s: Any, params: Any, step_s: float) -> None:
    gauge_pa = s.receiver.pressure_pa - ATMOSPHERE_PA
    if gauge_pa < params.starts_below_pa:
        s.compressor_runs = 1
    elif gauge_pa > params.stops_above_pa:
        s.compressor_runs = 0
    if s.compressor_runs:
        mass_kg = params.compressor_kg_s * step_s
        s.outside.mass_kg -= mass_kg
        s.taken_in_kg += mass_kg
        s.receiver.mass_kg += mass_kg
        s.receiver.pressure_pa += s.receiver.stiffness * mass_kg
        heat_j = HEAT_P * REFERENCE_K * mass_kg  # an aftercooler cools the air to ambient temperature
        s.receiver.energy_j += heat_j
        s.outside.energy_j -= heat_j


@compiled
def _regulate(a: Any, b: Any, outside: Any, params: Any, gauge_pa: float, conductance_m3_s_pa: float, gas: Any) -> None:
    """Pass air from `a` to `b` up to a set pressure, and from `b` to the ambient air if the pressure is too high.

    The regulator is fully open `band_pa` or more below the set pressure. Its relief begins to open `band_pa` above the
    set pressure, and is fully open at twice that.
    """
    lacking_pa = gauge_pa + ATMOSPHERE_PA - b.pressure_pa
    if lacking_pa <= 0.0:
        opening = min((-lacking_pa - params.band_pa) / params.band_pa, 1.0)
        if opening > 0.0:
            exchange(b, outside, params.relief_m3_s_pa * opening, params.critical_ratio, gas)
        return
    # the opening follows the pressure implicitly, so that it does not overshoot within the step
    turns = gas.step_s * conductance_m3_s_pa * REFERENCE_KG_M3 * a.pressure_pa * b.stiffness / params.band_pa
    through = conductance_m3_s_pa * min(lacking_pa / params.band_pa * implicit_factor(turns), 1.0)
    check(a, b, 0.0, through, params.critical_ratio, gas)
