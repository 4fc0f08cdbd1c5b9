"""Compressed air: compressor and receiver, regulator, dump valve with soft start, and the claws' own store."""

from typing import Any

import numpy as np

from plant_sim.pneumatics.chamber import CHAMBER, check, exchange, settle
from plant_sim.pneumatics.compiled import compiled
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, HEAT_P, REFERENCE_K, REFERENCE_KG_M3

#: State. receiver -> regulator -> header -> dump valve -> manifold (slides and lifts), and
#: receiver -> check valve -> claw reservoir -> claw regulator -> claw manifold. Of the `outside` only the
#: mass changes: what the machine blew out less what the compressor took in. `fed_s` is for how long the
#: relay has held the dump valve.
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

#: What it is. Pressures are gauge. `compressor_kg_s` 0 while it has failed; `leak` from the manifold and
#: `slip` past the seat of the claws' check valve are faults.
SUPPLY_MAKE = np.dtype(
    [
        ("compressor_kg_s", "f8"),
        ("starts_below_pa", "f8"),
        ("stops_above_pa", "f8"),
        ("regulated_pa", "f8"),
        ("band_pa", "f8"),
        ("regulator_m3_s_pa", "f8"),
        ("claw_regulated_pa", "f8"),
        ("claw_regulator_m3_s_pa", "f8"),
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
    ]
)


@compiled
def step_supply(s: Any, make: Any, fed: bool, gas: Any) -> None:
    """Let time pass.

    Args:
        s: The supply.
        make: What it is.
        fed: Whether the safety relay holds the dump valve; without it the manifold is vented.
        gas: How air behaves.
    """
    step_s, critical = gas.step_s, make.critical_ratio
    _compress(s, make, step_s)
    _regulate(s.receiver, s.header, make.regulated_pa, make.band_pa, make.regulator_m3_s_pa, critical, step_s)
    check(s.receiver, s.claw_reservoir, make.crack_pa, make.check_m3_s_pa, critical, step_s)
    check(s.claw_reservoir, s.receiver, 0.0, make.slip_m3_s_pa, critical, step_s)
    _regulate(
        s.claw_reservoir,
        s.claw_manifold,
        make.claw_regulated_pa,
        make.band_pa,
        make.claw_regulator_m3_s_pa,
        critical,
        step_s,
    )
    s.fed_s = s.fed_s + step_s if fed else 0.0
    if s.fed_s > make.dump_delay_s:
        if s.manifold.pressure_pa >= make.soft_until * s.header.pressure_pa:
            s.soft_started = 1
        through = make.main_m3_s_pa if s.soft_started else make.soft_m3_s_pa
        exchange(s.header, s.manifold, through, critical, step_s)
    else:
        s.soft_started = 0
        exchange(s.manifold, s.outside, make.vent_m3_s_pa, critical, step_s)
    exchange(s.manifold, s.outside, make.leak_m3_s_pa, critical, step_s)


@compiled
def settle_supply(s: Any, gas: Any) -> None:
    """Close a step, after everything that is fed has taken its air."""
    settle(s.receiver, gas)
    settle(s.header, gas)
    settle(s.manifold, gas)
    settle(s.claw_reservoir, gas)
    settle(s.claw_manifold, gas)


@compiled
def _compress(s: Any, make: Any, step_s: float) -> None:
    gauge_pa = s.receiver.pressure_pa - ATMOSPHERE_PA
    if gauge_pa < make.starts_below_pa:
        s.compressor_runs = 1
    elif gauge_pa > make.stops_above_pa:
        s.compressor_runs = 0
    if s.compressor_runs:
        mass_kg = make.compressor_kg_s * step_s
        s.outside.mass_kg -= mass_kg
        s.taken_in_kg += mass_kg
        s.receiver.mass_kg += mass_kg
        s.receiver.pressure_pa += s.receiver.stiffness * mass_kg
        s.receiver.energy_j += HEAT_P * REFERENCE_K * mass_kg  # it is cooled behind the compressor


@compiled
def _regulate(
    a: Any, b: Any, gauge_pa: float, band_pa: float, conductance_m3_s_pa: float, critical: float, step_s: float
) -> None:
    """Let air from `a` to `b` up to a pressure; the valve opens fully over a band below it."""
    lacking_pa = gauge_pa + ATMOSPHERE_PA - b.pressure_pa
    if lacking_pa <= 0.0:
        return
    # within a step it may not open so far that it overshoots
    fills_m3_s_pa = lacking_pa / (b.stiffness * step_s * REFERENCE_KG_M3 * a.pressure_pa)
    through = min(conductance_m3_s_pa * min(lacking_pa / band_pa, 1.0), fills_m3_s_pa)
    check(a, b, 0.0, through, critical, step_s)
