"""From a port of the valve to a chamber of the cylinder: tube, throttle, pilot check valve."""

from typing import Any

import numpy as np

from plant_sim.pneumatics.chamber import CHAMBER, check, exchange, resize, settle
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
    through = valve_make.conductance_m3_s_pa * supply_opening(spool)
    if through > 0.0:
        through = in_series(through, make.tube_m3_s_pa)
        n.drawn_kg += exchange(manifold, tube, through, valve_make.critical_ratio, step_s)
    through = valve_make.conductance_m3_s_pa * exhaust_opening(spool)
    if through > 0.0:
        exchange(tube, outside, in_series(through, make.tube_m3_s_pa), valve_make.critical_ratio, step_s)
    gauge_pa = chamber.pressure_pa - ATMOSPHERE_PA
    least_pa = max(make.pilot_ratio * gauge_pa, make.pilot_least_pa)
    n.piloted = 1 if make.checked == 0 or pilot_pa - ATMOSPHERE_PA >= least_pa else 0
    if tube.pressure_pa > chamber.pressure_pa:
        check(tube, chamber, 0.0 if n.piloted else make.crack_pa, make.free_m3_s_pa, critical, step_s)
    elif n.piloted:
        check(chamber, tube, 0.0, make.throttle_m3_s_pa * out_share, critical, step_s)
    else:
        check(chamber, tube, 0.0, make.slip_m3_s_pa, critical, step_s)
    exchange(chamber, outside, make.leak_m3_s_pa, critical, step_s)
    settle(tube, gas)
    settle(chamber, gas)
