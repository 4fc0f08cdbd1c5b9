"""Compressed-air supply of the machine, and its pressure switch."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled, compiled_and_cached
from plant_sim.common.limits import require, require_within
from plant_sim.devices.sensor import SENSOR, SENSOR_PARAMS, Sensor, record_edge, update_output
from plant_sim.pneumatics.chamber import fill, set_ambient
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, REFERENCE_KG_M3
from plant_sim.pneumatics.supply import SUPPLY, SUPPLY_PARAMS, settle_supply

STORES = ("receiver", "header", "manifold", "claw_reservoir", "claw_manifold")
"""Volumes of the supply, in the order in which `charge` takes them."""

_SLENDERNESS = 3.0
"""Length of a vessel or pipe block of the supply, in diameters. Assumed."""

AIR = np.dtype([("network", SUPPLY), ("pressure_ok", SENSOR)])
AIR_PARAMS = np.dtype(
    [("network", SUPPLY_PARAMS), ("pressure_ok", SENSOR_PARAMS), ("ok_above_pa", "f8"), ("ok_gap_pa", "f8")]
)


@dataclass(frozen=True, slots=True)
class SupplySpec:
    """Parameters of compressor, receiver, regulators, dump valve, reservoir and pressure switch.

    All pressures are gauge pressures.

    Attributes:
        pressure_pa: Set pressure of the main regulator, Pa.
        regulator_band_pa: Pressure below the set pressure at which a regulator is fully open, Pa.
        regulator_conductance_m3_s_pa: Sonic conductance of the main regulator, fully open, m3/(s Pa).
        claw_regulator_conductance_m3_s_pa: Sonic conductance of the claw regulator, fully open, m3/(s Pa).
        relief_conductance_m3_s_pa: Sonic conductance of the relief of either regulator, fully open, m3/(s Pa); 0 for
            regulators that do not relieve. It opens from `regulator_band_pa` above the set pressure.
        receiver_m3: Volume of the receiver, m3.
        header_m3: Volume of the pipes behind the main regulator, m3.
        manifold_m3: Volume of pipes and valve block behind the dump valve, m3.
        claw_reservoir_m3: Volume of the claw reservoir behind its check valve, m3.
        claw_manifold_m3: Volume of the pipes behind the claw regulator, m3.
        compressor_m3_s: Compressor delivery at ANR, m3/s.
        compressor_on_pa: Receiver pressure below which the compressor starts, Pa.
        compressor_off_pa: Receiver pressure above which it stops, Pa.
        dump_delay_s: Delay from relay closing to dump valve opening, s.
        main_conductance_m3_s_pa: Sonic conductance of the dump valve, fully open, m3/(s Pa).
        soft_conductance_m3_s_pa: Sonic conductance of the dump valve during soft start, m3/(s Pa).
        soft_until: Ratio of downstream to upstream pressure at which the dump valve opens fully.
        vent_conductance_m3_s_pa: Sonic conductance of the exhaust of the dump valve, m3/(s Pa).
        check_conductance_m3_s_pa: Sonic conductance of the check valve of the claw reservoir, m3/(s Pa).
        check_crack_pa: Cracking pressure of this check valve, Pa.
        critical_ratio: Critical pressure ratio of all these components.
        pressure_ok_pa: Pressure at which the pressure switch turns on, Pa.
        pressure_ok_gap_pa: Hysteresis of the pressure switch, Pa.
    """

    pressure_pa: float
    regulator_band_pa: float
    regulator_conductance_m3_s_pa: float
    claw_regulator_conductance_m3_s_pa: float
    relief_conductance_m3_s_pa: float
    receiver_m3: float
    header_m3: float
    manifold_m3: float
    claw_reservoir_m3: float
    claw_manifold_m3: float
    compressor_m3_s: float
    compressor_on_pa: float
    compressor_off_pa: float
    dump_delay_s: float
    main_conductance_m3_s_pa: float
    soft_conductance_m3_s_pa: float
    soft_until: float
    vent_conductance_m3_s_pa: float
    check_conductance_m3_s_pa: float
    check_crack_pa: float
    critical_ratio: float
    pressure_ok_pa: float
    pressure_ok_gap_pa: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.05e6, 1.0e6, "pressure_pa", "pressure_ok_pa")
        require_within(self, 1e3, 0.2e6, "regulator_band_pa", "pressure_ok_gap_pa")
        require_within(self, 1e-10, 1e-6, "regulator_conductance_m3_s_pa", "claw_regulator_conductance_m3_s_pa")
        require_within(self, 0.0, 1e-6, "relief_conductance_m3_s_pa")
        require_within(self, 1e-10, 1e-6, "main_conductance_m3_s_pa", "soft_conductance_m3_s_pa")
        require_within(self, 1e-10, 1e-6, "vent_conductance_m3_s_pa", "check_conductance_m3_s_pa")
        require_within(self, 1e-3, 1.0, "receiver_m3")
        require_within(self, 1e-5, 0.1, "header_m3", "manifold_m3", "claw_reservoir_m3", "claw_manifold_m3")
        require_within(self, 0.0, 0.1, "compressor_m3_s")
        require_within(self, 0.1e6, 1.5e6, "compressor_on_pa", "compressor_off_pa")
        require_within(self, 0.0, 1.0, "dump_delay_s", "soft_until")
        require_within(self, 0.0, 1e5, "check_crack_pa")
        require_within(self, 0.05, 0.6, "critical_ratio")
        require(self.compressor_on_pa < self.compressor_off_pa, "compressor_off_pa", "must exceed compressor_on_pa")
        require(self.pressure_pa < self.compressor_on_pa, "pressure_pa", "must be less than compressor_on_pa")


def vessel_wall_m2(volume_m3: float) -> float:
    """Return the wall area of a closed cylindrical vessel, m2.

    The receiver of 24 l, 217 mm in diameter and 651 mm long:

    >>> round(vessel_wall_m2(0.024), 3)
    0.517
    """
    diameter_m: float = (4 * volume_m3 / (math.pi * _SLENDERNESS)) ** (1 / 3)
    return math.pi * diameter_m**2 * (_SLENDERNESS + 0.5)


@compiled
def settle_air(a: Any, params: Any, now_s: float, gas: Any) -> None:
    """Finish a step and update the pressure switch."""
    settle_supply(a.network, params.network, gas)
    gauge_pa = a.network.manifold.pressure_pa - ATMOSPHERE_PA
    least_pa = params.ok_above_pa - params.ok_gap_pa if a.pressure_ok.detected else params.ok_above_pa
    if (gauge_pa >= least_pa) != (a.pressure_ok.detected != 0):
        record_edge(a.pressure_ok, now_s)
    if a.pressure_ok.busy:
        update_output(a.pressure_ok, params.pressure_ok, now_s)


@compiled_and_cached
def charge(a: Any, params: Any, volumes_m3: Any, gas: Any) -> None:
    """Initialise every volume to its steady-state pressure; `volumes_m3` are in the order of `STORES`."""
    network, supply = a.network, params.network
    set_ambient(network.outside)
    full_pa = ATMOSPHERE_PA + 0.5 * (supply.starts_below_pa + supply.stops_above_pa)
    main_pa = ATMOSPHERE_PA + supply.regulated_pa
    fill(network.receiver, volumes_m3[0], full_pa, gas)
    fill(network.header, volumes_m3[1], main_pa, gas)
    fill(network.manifold, volumes_m3[2], main_pa, gas)
    fill(network.claw_reservoir, volumes_m3[3], full_pa - supply.crack_pa, gas)
    claw_pa = min(ATMOSPHERE_PA + supply.claw_regulated_pa, full_pa - supply.crack_pa)
    fill(network.claw_manifold, volumes_m3[4], claw_pa, gas)
    network.fed_s = 1e3
    network.soft_started = 1
    settle_supply(network, supply, gas)
    a.pressure_ok.detected = a.pressure_ok.output = 1 if supply.regulated_pa >= params.ok_above_pa else 0


class Supply:
    """View of the compressed-air supply.

    Attributes:
        pressure_ok: Pressure switch.
    """

    __slots__ = ("_params", "_state", "pressure_ok")

    def __init__(self, spec: SupplySpec, state: Any, params: Any, gas: Any, *, claw_pressure_pa: float) -> None:
        """Initialise the supply in the charged state.

        Args:
            spec: Parameters of the supply.
            state: Its state record, `AIR`.
            params: Its parameter record, `AIR_PARAMS`.
            gas: Gas model.
            claw_pressure_pa: Set pressure of the claw regulator, gauge, Pa.
        """
        self._state = state["network"]
        self._params = params["network"]
        values = {
            "compressor_kg_s": spec.compressor_m3_s * REFERENCE_KG_M3,
            "starts_below_pa": spec.compressor_on_pa,
            "stops_above_pa": spec.compressor_off_pa,
            "regulated_pa": spec.pressure_pa,
            "band_pa": spec.regulator_band_pa,
            "regulator_m3_s_pa": spec.regulator_conductance_m3_s_pa,
            "claw_regulated_pa": claw_pressure_pa,
            "claw_regulator_m3_s_pa": spec.claw_regulator_conductance_m3_s_pa,
            "relief_m3_s_pa": spec.relief_conductance_m3_s_pa,
            "dump_delay_s": spec.dump_delay_s,
            "main_m3_s_pa": spec.main_conductance_m3_s_pa,
            "soft_m3_s_pa": spec.soft_conductance_m3_s_pa,
            "soft_until": spec.soft_until,
            "vent_m3_s_pa": spec.vent_conductance_m3_s_pa,
            "check_m3_s_pa": spec.check_conductance_m3_s_pa,
            "crack_pa": spec.check_crack_pa,
            "critical_ratio": spec.critical_ratio,
        }
        for name, value in values.items():
            self._params[name] = value
        volumes_m3 = {name: getattr(spec, f"{name}_m3") for name in STORES}
        for name, volume_m3 in volumes_m3.items():
            self._params[f"{name}_wall"]["m2"] = vessel_wall_m2(volume_m3)
        params["ok_above_pa"] = spec.pressure_ok_pa
        params["ok_gap_pa"] = spec.pressure_ok_gap_pa
        params["pressure_ok"]["forced"] = -1
        charge(state, params, np.array(list(volumes_m3.values())), gas)
        self.pressure_ok = Sensor(state["pressure_ok"], params["pressure_ok"])

    @property
    def pressure_pa(self) -> float:
        """Gauge pressure of the manifold for slides and lifts, Pa."""
        return float(self._state["manifold"]["pressure_pa"]) - ATMOSPHERE_PA

    @property
    def claw_pressure_pa(self) -> float:
        """Gauge pressure of the manifold for the claws, Pa."""
        return float(self._state["claw_manifold"]["pressure_pa"]) - ATMOSPHERE_PA
