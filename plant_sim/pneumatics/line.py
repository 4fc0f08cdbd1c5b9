"""From a port of the valve to a chamber of the cylinder: tube, throttle, pilot check valve."""

from typing import Any

import numpy as np

from plant_sim.pneumatics.chamber import CHAMBER, check, exchange, move, resize, settle, tendency
from plant_sim.pneumatics.compiled import compiled
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, REFERENCE_K, in_series
from plant_sim.pneumatics.valve import exhaust_opening, supply_opening

#: State: the tube, the chamber behind it, the air the valve let in so far, and whether the pilot
#: holds the check valve open.
LINE = np.dtype([("tube", CHAMBER), ("chamber", CHAMBER), ("drawn_kg", "f8"), ("piloted", "i8")])

#: Restrictions. `free` is the way in past the throttle, `throttle` the way out (meter-out), both with
#: the check valve in series. With `checked` 0 there is no check valve. `slip` leaks past its seat,
#: `leak` from the chamber to the surroundings (both faults). The chamber's volume is `dead_m3` plus
#: the piston's.
LINE_MAKE = np.dtype(
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


_STILL_PA = 20.0
_STILL_K = 0.1


@compiled
def line_rests(n: Any, make: Any, spool: float, manifold: Any) -> bool:
    """Whether no air moves in a line and none is warmer or colder than the walls."""
    tube, chamber = n.tube, n.chamber
    if make.leak_m3_s_pa > 0.0 or make.slip_m3_s_pa > 0.0:
        return False
    if abs(chamber.temperature_k - REFERENCE_K) > _STILL_K or abs(tube.temperature_k - REFERENCE_K) > _STILL_K:
        return False
    source_pa = manifold.pressure_pa if spool > 0.0 else ATMOSPHERE_PA
    if abs(tube.pressure_pa - source_pa) > _STILL_PA:
        return False
    if make.checked:
        return bool(spool == 0.0 and n.piloted == 0 and chamber.pressure_pa > tube.pressure_pa)
    return bool(abs(chamber.pressure_pa - tube.pressure_pa) <= _STILL_PA)


@compiled
def step_line(
    n: Any,
    make: Any,
    valve_make: Any,
    spool: float,
    pilot_pa: float,
    out_share: float,
    volume_m3: float,
    manifold: Any,
    outside: Any,
    gas: Any,
) -> None:
    """Let time pass.

    Args:
        n: The line.
        make: Its restrictions.
        valve_make: The valve's.
        spool: Spool of the valve, +1 feeds this line.
        pilot_pa: Pressure in the tube of the opposite line, Pa.
        out_share: What a cushion leaves of the throttle, 0 to 1.
        volume_m3: New volume of the chamber, m3.
        manifold: Chamber the valve is fed from.
        outside: The surroundings.
        gas: How air behaves.
    """
    step_s = gas.step_s
    tube, chamber, critical = n.tube, n.chamber, make.critical_ratio
    resize(chamber, volume_m3, gas)
    gauge_pa = chamber.pressure_pa - ATMOSPHERE_PA
    least_pa = max(make.pilot_ratio * gauge_pa, make.pilot_least_pa)
    n.piloted = 1 if make.checked == 0 or pilot_pa - ATMOSPHERE_PA >= least_pa else 0
    crack_pa, onward = 0.0 if n.piloted else make.crack_pa, make.free_m3_s_pa
    if tube.pressure_pa <= chamber.pressure_pa:
        crack_pa, onward = 0.0, make.throttle_m3_s_pa * out_share if n.piloted else make.slip_m3_s_pa
    opening = supply_opening(spool)
    if opening > 0.0:
        through = in_series(valve_make.conductance_m3_s_pa * opening, make.tube_m3_s_pa)
        n.drawn_kg += _through(n, manifold, through, valve_make.critical_ratio, crack_pa, onward, critical, step_s)
    else:
        through = in_series(valve_make.conductance_m3_s_pa * exhaust_opening(spool), make.tube_m3_s_pa)
        _through(n, outside, through, valve_make.critical_ratio, crack_pa, onward, critical, step_s)
    exchange(chamber, outside, make.leak_m3_s_pa, critical, step_s)
    settle(tube, gas)
    settle(chamber, gas)


@compiled
def _through(
    n: Any, source: Any, valve_m3_s_pa: float, valve_critical: float, crack_pa: float, onward_m3_s_pa: float,
    onward_critical: float, step_s: float,
) -> float:  # fmt: skip
    """Let air through the valve and on to the chamber (or back) at once; return what the source gave, kg.

    Both flows are linearly implicit in all three pressures together. One after the other, the tube's pressure would
    stand too high, or too low, by what one of them brings in a step.
    """
    tube, chamber = n.tube, n.chamber
    in_kg_s, in_grows, in_falls = tendency(source, tube, 0.0, valve_m3_s_pa, valve_critical)
    on_kg_s, on_grows, on_falls = tendency(tube, chamber, crack_pa, onward_m3_s_pa, onward_critical)
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
    settles = _settles(source.pressure_pa, tube.pressure_pa, source_pa, tube_pa)
    settles = settles and _settles(tube.pressure_pa, chamber.pressure_pa, tube_pa, chamber_pa)
    if settles and on_kg * on_kg_s >= 0.0:
        move(source, tube, in_kg)
        move(tube, chamber, on_kg)
        return in_kg
    # a pressure would run past another: one after the other, each up to where both are equal
    in_kg = exchange(source, tube, valve_m3_s_pa, valve_critical, step_s)
    if on_kg_s > 0.0:
        check(tube, chamber, crack_pa, onward_m3_s_pa, onward_critical, step_s)
    elif on_kg_s < 0.0:
        check(chamber, tube, 0.0, onward_m3_s_pa, onward_critical, step_s)
    return in_kg


@compiled
def _settles(one_pa: float, other_pa: float, one_after_pa: float, other_after_pa: float) -> bool:
    """Whether two pressures do not run past one another, unless one of the differences is slight."""
    slight_pa = 0.01 * one_pa
    apart_pa, after_pa = one_pa - other_pa, one_after_pa - other_after_pa
    return apart_pa * after_pa >= 0.0 or abs(apart_pa) <= slight_pa or abs(after_pa) <= slight_pa
