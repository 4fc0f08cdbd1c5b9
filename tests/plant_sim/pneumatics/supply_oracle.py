"""Compressed-air supply of the reference model of the pneumatics; see `chamber_oracle`."""

from dataclasses import dataclass
from typing import Any

from plant_sim.pneumatics.flow import ATMOSPHERE_PA, HEAT_P, REFERENCE_K, REFERENCE_KG_M3
from tests.plant_sim.pneumatics.chamber_oracle import Chamber, both_ways, one_way, weight


@dataclass
class Supply:
    """Compressor, receiver, regulators, dump valve, claw reservoir."""

    receiver: Chamber
    header: Chamber
    manifold: Chamber
    claw_reservoir: Chamber
    claw_manifold: Chamber
    outside: Chamber
    compressor_runs: int
    soft_started: int
    fed_s: float
    taken_in_kg: float

    def step(self, params: Any, fed: bool, gas: Any) -> None:
        """Step all parts of the supply, from the compressor to the manifolds."""
        critical = params.critical_ratio
        self._compress(params, gas.step_s)
        main_pa, claw_pa = params.regulated_pa + ATMOSPHERE_PA, params.claw_regulated_pa + ATMOSPHERE_PA
        self._regulate(self.receiver, self.header, main_pa, params.regulator_m3_s_pa, params, gas)
        one_way(self.receiver, self.claw_reservoir, params.crack_pa, params.check_m3_s_pa, critical, gas)
        one_way(self.claw_reservoir, self.receiver, 0.0, params.slip_m3_s_pa, critical, gas)
        self._regulate(self.claw_reservoir, self.claw_manifold, claw_pa, params.claw_regulator_m3_s_pa, params, gas)
        self.fed_s = self.fed_s + gas.step_s if fed else 0.0
        if self.fed_s > params.dump_delay_s:
            if self.manifold.pressure_pa >= params.soft_until * self.header.pressure_pa:
                self.soft_started = 1
            opening = params.main_m3_s_pa if self.soft_started else params.soft_m3_s_pa
            both_ways(self.header, self.manifold, opening, critical, gas)
        else:
            self.soft_started = 0
            both_ways(self.manifold, self.outside, params.vent_m3_s_pa, critical, gas)
        both_ways(self.manifold, self.outside, params.leak_m3_s_pa, critical, gas)

    def settle(self, params: Any, gas: Any) -> None:
        """Complete a step after the cylinders have drawn their air."""
        self.receiver.settle(params.receiver_wall, gas)
        self.header.settle(params.header_wall, gas)
        self.manifold.settle(params.manifold_wall, gas)
        self.claw_reservoir.settle(params.claw_reservoir_wall, gas)
        self.claw_manifold.settle(params.claw_manifold_wall, gas)

    def _regulate(self, a: Chamber, b: Chamber, wanted_pa: float, conductance: float, params: Any, gas: Any) -> None:
        """Open in proportion to the pressure deficit, expected in part at the end of the step; or relieve an excess."""
        lacking_pa = wanted_pa - b.pressure_pa
        if lacking_pa > 0:
            turns = gas.step_s * conductance * REFERENCE_KG_M3 * a.pressure_pa * b.stiffness / params.band_pa
            opening = min(1.0, lacking_pa / params.band_pa / (1 + weight(turns) * turns))
            one_way(a, b, 0.0, conductance * opening, params.critical_ratio, gas)
        elif -lacking_pa > params.band_pa:
            opening = min(1.0, -lacking_pa / params.band_pa - 1)
            both_ways(b, self.outside, params.relief_m3_s_pa * opening, params.critical_ratio, gas)

    def _compress(self, params: Any, step_s: float) -> None:
        gauge_pa = self.receiver.pressure_pa - ATMOSPHERE_PA
        if gauge_pa < params.starts_below_pa:
            self.compressor_runs = 1
        elif gauge_pa > params.stops_above_pa:
            self.compressor_runs = 0
        mass_kg = params.compressor_kg_s * step_s * self.compressor_runs
        self.outside.mass_kg -= mass_kg
        self.taken_in_kg += mass_kg
        heat_j = mass_kg * HEAT_P * REFERENCE_K
        self.outside.energy_j -= heat_j
        self.receiver.gain(mass_kg, heat_j)
