"""The compressed air of the machine, and its pressure switch."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from plant_sim.devices.sensor import SENSOR, SENSOR_MAKE, Sensor, note_edge, speak
from plant_sim.pneumatics.chamber import fill, surroundings
from plant_sim.pneumatics.compiled import compiled, compiled_and_kept
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, REFERENCE_KG_M3
from plant_sim.pneumatics.supply import SUPPLY, SUPPLY_MAKE, settle_supply
from plant_sim.spec import require, require_within

AIR = np.dtype([("network", SUPPLY), ("pressure_ok", SENSOR)])
AIR_MAKE = np.dtype(
    [("network", SUPPLY_MAKE), ("pressure_ok", SENSOR_MAKE), ("ok_above_pa", "f8"), ("ok_gap_pa", "f8")]
)


@dataclass(frozen=True, slots=True)
class SupplySpec:
    """Compressor, receiver, regulator, dump valve, claw reservoir, pressure switch. Pressures are gauge.

    Attributes:
        pressure_pa: Main regulator, Pa.
        regulator_band_pa: A regulator opens fully over this much below its pressure, Pa.
        regulator_conductance_m3_s_pa: The main regulator, fully open, m3/(s Pa).
        claw_regulator_conductance_m3_s_pa: The regulator of the claws, m3/(s Pa).
        receiver_m3: Receiver, m3.
        header_m3: Pipes behind the regulator, m3.
        manifold_m3: Pipes and valve block behind the dump valve, m3.
        claw_reservoir_m3: Reservoir of the claws behind its check valve, m3.
        claw_manifold_m3: Pipes behind the regulator of the claws, m3.
        compressor_m3_s: Delivery at ANR, m3/s.
        compressor_on_pa: It starts below this pressure in the receiver, Pa.
        compressor_off_pa: It stops above this, Pa.
        dump_delay_s: The dump valve opens this long after the relay has closed, s.
        main_conductance_m3_s_pa: The dump valve, fully open, m3/(s Pa).
        soft_conductance_m3_s_pa: The same while it starts softly, m3/(s Pa).
        soft_until: Share of the pressure before it at which it opens fully.
        vent_conductance_m3_s_pa: Its way out, m3/(s Pa).
        check_conductance_m3_s_pa: Check valve of the claw reservoir, m3/(s Pa).
        check_crack_pa: Its cracking pressure, Pa.
        critical_ratio: Critical pressure ratio of all of these.
        pressure_ok_pa: The pressure switch is on from here up, Pa.
        pressure_ok_gap_pa: It goes off this much lower, Pa.
    """

    pressure_pa: float
    regulator_band_pa: float
    regulator_conductance_m3_s_pa: float
    claw_regulator_conductance_m3_s_pa: float
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
        """Refuse impossible values."""
        require_within(self, 0.05e6, 1.0e6, "pressure_pa", "pressure_ok_pa")
        require_within(self, 1e3, 0.2e6, "regulator_band_pa", "pressure_ok_gap_pa")
        require_within(self, 1e-10, 1e-6, "regulator_conductance_m3_s_pa", "claw_regulator_conductance_m3_s_pa")
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


@compiled
def settle_air(a: Any, make: Any, now_s: float, gas: Any) -> None:
    """Close a step, and let the pressure switch look."""
    settle_supply(a.network, gas)
    gauge_pa = a.network.manifold.pressure_pa - ATMOSPHERE_PA
    least_pa = make.ok_above_pa - make.ok_gap_pa if a.pressure_ok.seen else make.ok_above_pa
    if (gauge_pa >= least_pa) != (a.pressure_ok.seen != 0):
        note_edge(a.pressure_ok, now_s)
    if a.pressure_ok.busy:
        speak(a.pressure_ok, make.pressure_ok, now_s)


@compiled_and_kept
def charge(a: Any, make: Any, volumes_m3: Any, gas: Any) -> None:
    """Put every part under the pressure at which it stands after a while."""
    network, supply = a.network, make.network
    surroundings(network.outside)
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
    settle_supply(network, gas)
    a.pressure_ok.seen = a.pressure_ok.says = 1 if supply.regulated_pa >= make.ok_above_pa else 0


class Supply:
    """A view of the compressed air.

    Attributes:
        pressure_ok: The pressure switch.
    """

    __slots__ = ("_make", "_state", "pressure_ok")

    def __init__(self, spec: SupplySpec, state: Any, make: Any, gas: Any, *, claw_pressure_pa: float) -> None:
        """Build it and charge it.

        Args:
            spec: What it is.
            state: Its record, `AIR`.
            make: Its record, `AIR_MAKE`.
            gas: How air behaves.
            claw_pressure_pa: Regulator of the claws, gauge, Pa.
        """
        self._state = state["network"]
        self._make = make["network"]
        values = {
            "compressor_kg_s": spec.compressor_m3_s * REFERENCE_KG_M3,
            "starts_below_pa": spec.compressor_on_pa,
            "stops_above_pa": spec.compressor_off_pa,
            "regulated_pa": spec.pressure_pa,
            "band_pa": spec.regulator_band_pa,
            "regulator_m3_s_pa": spec.regulator_conductance_m3_s_pa,
            "claw_regulated_pa": claw_pressure_pa,
            "claw_regulator_m3_s_pa": spec.claw_regulator_conductance_m3_s_pa,
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
            self._make[name] = value
        make["ok_above_pa"] = spec.pressure_ok_pa
        make["ok_gap_pa"] = spec.pressure_ok_gap_pa
        make["pressure_ok"]["forced"] = -1
        volumes_m3 = np.array(
            [spec.receiver_m3, spec.header_m3, spec.manifold_m3, spec.claw_reservoir_m3, spec.claw_manifold_m3]
        )
        charge(state, make, volumes_m3, gas)
        self.pressure_ok = Sensor(state["pressure_ok"], make["pressure_ok"])

    @property
    def pressure_pa(self) -> float:
        """Gauge pressure of the manifold that feeds slides and lifts, Pa."""
        return float(self._state["manifold"]["pressure_pa"]) - ATMOSPHERE_PA

    @property
    def claw_pressure_pa(self) -> float:
        """Gauge pressure of the manifold that feeds the claws, Pa."""
        return float(self._state["claw_manifold"]["pressure_pa"]) - ATMOSPHERE_PA
