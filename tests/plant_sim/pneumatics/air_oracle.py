"""Reference model of the pneumatics in plain Python: slow, readable, and independent of the compiled code.

Equations and their order within a step are those of `plant_sim.pneumatics`, but the algebra is not optimised: where the
compiled code saves a division or a power, this model uses the textbook form. Only physical constants are shared. Every
state has the fields of its compiled record in the same order, so that `read` can convert records and the results of
`values` can be compared.

Source of the equations: docs/sources/plant.md 1 and 3.4, and the docstrings of `plant_sim.pneumatics`.
"""

import math
from dataclasses import dataclass, fields
from types import SimpleNamespace
from typing import Any, TypeVar, get_type_hints

from plant_sim.pneumatics.flow import (
    ATMOSPHERE_PA,
    GAS_CONSTANT,
    HEAT_P,
    HEAT_V,
    LAMINAR_RATIO,
    REFERENCE_K,
    REFERENCE_KG_M3,
)

T = TypeVar("T")


def read_params(record: Any) -> Any:
    """Convert a compiled parameter record to a plain read-only object."""
    fields_of = {name: record[name] for name in record.dtype.names}
    return SimpleNamespace(
        **{name: read_params(value) if value.dtype.names else value.item() for name, value in fields_of.items()}
    )


def read(kind: type[T], record: Any) -> T:
    """Create an object with the values of a compiled record.

    Args:
        kind: One of the classes of this module.
        record: Structured scalar with the same field names.
    """
    hints = get_type_hints(kind)
    return kind(
        **{
            name: read(hints[name], record[name]) if record.dtype[name].names else record[name].item()
            for name in record.dtype.names
        }
    )


def values(state: Any) -> list[float]:
    """Return all numbers of a state, depth first, in the order of its fields."""
    parts = (getattr(state, field.name) for field in fields(state))
    return [number for part in parts for number in ([part] if isinstance(part, int | float) else values(part))]


@dataclass
class Chamber:
    """Volume of air."""

    mass_kg: float
    temperature_k: float
    volume_m3: float
    pressure_pa: float
    stiffness: float
    density_kg_m3: float
    energy_j: float

    def gain(self, mass_kg: float, heat_j: float) -> None:
        """Add or remove air with its enthalpy."""
        self.mass_kg += mass_kg
        self.pressure_pa += mass_kg * self.stiffness
        self.energy_j += heat_j

    def resize(self, volume_m3: float, gas: Any) -> None:
        """Change the volume: integrate dp/dV = -n p/V by the trapezoidal rule, and account for the work done."""
        n, before_pa, grown_m3 = gas.exponent, self.pressure_pa, volume_m3 - self.volume_m3
        if grown_m3 == 0.0:
            return
        strain = grown_m3 / (self.volume_m3 + volume_m3)
        self.pressure_pa = before_pa * (1 - n * strain) / (1 + n * strain)
        self.energy_j -= (before_pa + self.pressure_pa) / 2 * grown_m3
        self.volume_m3 = volume_m3
        self.stiffness = n * self.pressure_pa / self.mass_kg

    def settle(self, gas: Any) -> None:
        """Complete a step: compute the new temperature and the resulting pressure."""
        density_kg_m3 = self.mass_kg / self.volume_m3
        if gas.thermal:
            walls_m2 = (36 * math.pi) ** (1 / 3) * self.volume_m3 ** (2 / 3)
            walls_j_k = gas.wall_w_m2_k * walls_m2 * gas.step_s
            heat_j_k = self.mass_kg * HEAT_V
            self.temperature_k = (self.energy_j + walls_j_k * REFERENCE_K) / (heat_j_k + walls_j_k)
        else:
            change = density_kg_m3 - self.density_kg_m3
            mean_kg_m3 = (density_kg_m3 + self.density_kg_m3) / 2
            half = (gas.exponent - 1) * change / mean_kg_m3 / 2
            polytropic_k = self.temperature_k * (1 + half) / (1 - half)
            # implicit Euler of dT/dt = (wall - T) / wall_s
            share = gas.step_s / gas.wall_s
            self.temperature_k = (polytropic_k + share * REFERENCE_K) / (1 + share)
        self.density_kg_m3 = density_kg_m3
        self.pressure_pa = density_kg_m3 * GAS_CONSTANT * self.temperature_k
        self.stiffness = gas.exponent * GAS_CONSTANT * self.temperature_k / self.volume_m3
        self.energy_j = self.mass_kg * HEAT_V * self.temperature_k


def shape(ratio: float, critical: float) -> tuple[float, float]:
    """Return the subsonic flow as a fraction of the choked flow, and its slope with respect to the pressure ratio."""
    past = (ratio - critical) / (1 - critical)
    part = math.sqrt(1 - past**2)
    return part, -past / (part * (1 - critical))


def tendency(
    up: Chamber, down: Chamber, up_pa: float, conductance: float, critical: float
) -> tuple[float, float, float]:
    """Return the flow through a restriction (ISO 6358), kg/s, and its slopes with respect to both pressures."""
    gain = conductance * REFERENCE_KG_M3 * math.sqrt(REFERENCE_K / up.temperature_k)
    down_pa = down.pressure_pa
    ratio = down_pa / up_pa
    if ratio >= LAMINAR_RATIO:
        slope = gain * shape(LAMINAR_RATIO, critical)[0] / (1 - LAMINAR_RATIO)
        return slope * (up_pa - down_pa), slope, -slope
    part, bend = (1.0, 0.0) if ratio <= critical else shape(ratio, critical)
    return gain * up_pa * part, gain * (part - ratio * bend), gain * bend


def move(a: Chamber, b: Chamber, mass_kg: float) -> None:
    """Transfer air and its heat from `a` to `b`, or from `b` to `a` if the mass is negative."""
    heat_j = mass_kg * HEAT_P * (a if mass_kg > 0 else b).temperature_k
    a.gain(-mass_kg, -heat_j)
    b.gain(mass_kg, heat_j)


def transfer(up: Chamber, down: Chamber, up_pa: float, conductance: float, critical: float, step_s: float) -> float:
    """Pass air through one restriction in one Newton step, limited to the mass that makes both pressures equal."""
    kg_s, by_up, by_down = tendency(up, down, up_pa, conductance, critical)
    mass_kg = step_s * kg_s / (1 + step_s * (by_up * up.stiffness - by_down * down.stiffness))
    levels_kg = (up_pa - down.pressure_pa) / (up.stiffness + down.stiffness)
    if mass_kg > 0.2 * levels_kg:
        most_kg = levels_kg
        if down.stiffness > 0:
            # mass that fills the chamber to that pressure along p ~ m^n
            exponent = down.stiffness * down.mass_kg / down.pressure_pa
            full = (down.pressure_pa + down.stiffness * levels_kg) / down.pressure_pa
            most_kg = down.mass_kg * (full ** (1 / exponent) - 1)
        mass_kg = min(mass_kg, most_kg)
    move(up, down, mass_kg)
    return mass_kg


def both_ways(a: Chamber, b: Chamber, conductance: float, critical: float, step_s: float) -> float:
    """Pass air towards the lower pressure; return the mass that left `a`, kg."""
    if conductance <= 0.0:
        return 0.0
    if a.pressure_pa >= b.pressure_pa:
        return transfer(a, b, a.pressure_pa, conductance, critical, step_s)
    return -transfer(b, a, b.pressure_pa, conductance, critical, step_s)


def one_way(a: Chamber, b: Chamber, crack_pa: float, conductance: float, critical: float, step_s: float) -> None:
    """Pass air from `a` to `b` through a check valve."""
    if conductance > 0.0 and a.pressure_pa - crack_pa > b.pressure_pa:
        transfer(a, b, a.pressure_pa - crack_pa, conductance, critical, step_s)


def series(one: float, other: float) -> float:
    """Return the conductance of two restrictions in series."""
    return 1 / math.sqrt(1 / one**2 + 1 / other**2)


@dataclass
class Valve:
    """Valve with two coils."""

    plus_acts: int
    minus_acts: int
    plus_pending_s: float
    minus_pending_s: float
    spool: float
    target: float

    def step(self, params: Any, plus: bool, minus: bool, step_s: float) -> None:
        """Update the pilots, then the spool."""
        self.plus_acts, self.plus_pending_s = self._pilot(params, plus, self.plus_acts, self.plus_pending_s, step_s)
        self.minus_acts, self.minus_pending_s = self._pilot(
            params, minus, self.minus_acts, self.minus_pending_s, step_s
        )
        one_sided = self.plus_acts != self.minus_acts
        if one_sided:
            self.target = 1.0 if self.plus_acts else -1.0
        elif not params.latching:
            self.target = 0.0
        if not params.stuck:
            way = step_s / params.spool_s
            self.spool += min(max(self.target - self.spool, -way), way)

    @staticmethod
    def _pilot(params: Any, coil: bool, acts: int, pending_s: float, step_s: float) -> tuple[int, float]:
        if coil == bool(acts):
            return acts, 0.0
        pending_s += step_s
        delay_s = params.on_delay_s if coil else params.off_delay_s
        return (int(coil), 0.0) if pending_s > delay_s - 1e-9 else (acts, pending_s)


@dataclass
class Line:
    """Line from a valve port to a chamber."""

    tube: Chamber
    chamber: Chamber
    drawn_kg: float
    piloted: int

    def step(
        self,
        params: Any,
        valve: Any,
        spool: float,
        pilot_pa: float,
        out_share: float,
        volume_m3: float,
        manifold: Chamber,
        outside: Chamber,
        gas: Any,
    ) -> None:
        """Step the piston, the valve, the pilot, the check valve with the throttle, and the leak, in this order."""
        tube, chamber, step_s, critical = self.tube, self.chamber, gas.step_s, params.critical_ratio
        chamber.resize(volume_m3, gas)
        behind_pa = params.pilot_ratio * (chamber.pressure_pa - ATMOSPHERE_PA)
        opens_pa = ATMOSPHERE_PA + max(behind_pa, params.pilot_least_pa)
        self.piloted = int(not params.checked or pilot_pa >= opens_pa)
        # over the first half of the spool travel from the middle the exhaust closes, then the supply opens
        feeds = spool > 0.5
        opening = min(abs(2 * spool - 1), 1.0)
        valve_c = series(valve.conductance_m3_s_pa * opening, params.tube_m3_s_pa) if opening > 0 else 0.0
        given_kg = self._pass(params, manifold if feeds else outside, valve_c, valve.critical_ratio, out_share, step_s)
        self.drawn_kg += given_kg if feeds else 0.0
        both_ways(chamber, outside, params.leak_m3_s_pa, critical, step_s)
        tube.settle(gas)
        chamber.settle(gas)

    def _pass(
        self, params: Any, source: Chamber, valve_c: float, valve_b: float, out_share: float, step_s: float
    ) -> float:
        """Compute valve and throttle flows in one joint Newton step; return the mass drawn from the source."""
        tube, chamber, critical = self.tube, self.chamber, params.critical_ratio
        (q1, up1, down1), ends1 = _between(source, tube, 0.0, valve_c, valve_b)
        if tube.pressure_pa > chamber.pressure_pa:
            onward = params.free_m3_s_pa
            crack_pa = 0.0 if self.piloted else params.crack_pa
        else:
            onward = params.throttle_m3_s_pa * out_share if self.piloted else params.slip_m3_s_pa
            crack_pa = 0.0
        (q2, up2, down2), ends2 = _between(tube, chamber, crack_pa, onward, critical)
        # m1 = dt (q1 + up1 dp_source + down1 dp_tube), m2 = dt (q2 + up2 dp_tube + down2 dp_chamber)
        own1 = 1 / step_s + up1 * source.stiffness - down1 * tube.stiffness
        own2 = 1 / step_s + up2 * tube.stiffness - down2 * chamber.stiffness
        mixed1, mixed2 = down1 * tube.stiffness, up2 * tube.stiffness
        common = own1 * own2 + mixed1 * mixed2
        m1, m2 = (q1 * own2 - mixed1 * q2) / common, (q2 * own1 + mixed2 * q1) / common
        tube_pa = tube.pressure_pa + tube.stiffness * (m1 - m2)
        after1_pa = source.pressure_pa - source.stiffness * m1 - tube_pa
        after2_pa = tube_pa - chamber.pressure_pa - chamber.stiffness * m2
        crosses1 = ends1 * after1_pa < 0 and min(abs(ends1), abs(after1_pa)) > 0.01 * source.pressure_pa
        crosses2 = ends2 * after2_pa < 0 and min(abs(ends2), abs(after2_pa)) > 0.01 * tube.pressure_pa
        if not crosses1 and not crosses2 and m2 * q2 >= 0:
            move(source, tube, m1)
            move(tube, chamber, m2)
            return m1
        m1 = both_ways(source, tube, valve_c, valve_b, step_s)
        if q2 > 0:
            one_way(tube, chamber, crack_pa, onward, critical, step_s)
        elif q2 < 0:
            one_way(chamber, tube, 0.0, onward, critical, step_s)
        return m1


def _between(
    a: Chamber, b: Chamber, crack_pa: float, conductance: float, critical: float
) -> tuple[tuple[float, float, float], float]:
    """Return the flow from `a` to `b` with its slopes with respect to both pressures, and the pressure difference."""
    apart_pa = a.pressure_pa - b.pressure_pa
    if conductance <= 0 or 0 <= apart_pa <= crack_pa:
        return (0.0, 0.0, 0.0), apart_pa
    if apart_pa > 0:
        return tendency(a, b, a.pressure_pa - crack_pa, conductance, critical), apart_pa
    kg_s, by_up, by_down = tendency(b, a, b.pressure_pa, conductance, critical)
    return (-kg_s, -by_down, -by_up), apart_pa


def dry_n(friction: Any, speed_m_s: float) -> float:
    """Return the friction without its viscous part."""
    more: float = 1 / (1 + (speed_m_s / friction.stribeck_m_s) ** 2)
    return float(more * friction.static_n + (1 - more) * friction.coulomb_n)


@dataclass
class Cylinder:
    """Cylinder with its valve, its lines and its load."""

    position_m: float
    speed_m_s: float
    piston_m: float
    piston_m_s: float
    magnet_n: float
    decoupled: int
    valve: Valve
    plus: Line
    minus: Line

    def step(self, params: Any, plus: bool, minus: bool, manifold: Chamber, outside: Chamber, gas: Any) -> None:
        """Step the valve, then the motion under the previous pressures, then the air."""
        self.valve.step(params.valve, plus, minus, gas.step_s)
        push_n = params.plus_area_m2 * (self.plus.chamber.pressure_pa - ATMOSPHERE_PA)
        push_n -= params.minus_area_m2 * (self.minus.chamber.pressure_pa - ATMOSPHERE_PA)
        if params.magnet_holds_n > 0:
            self._move_two(params, push_n, gas.step_s)
        else:
            self._move_one(params, push_n + params.weight_n, gas.step_s)
        spool, pilot_plus_pa, pilot_minus_pa = self.valve.spool, self.minus.tube.pressure_pa, self.plus.tube.pressure_pa
        left_m = params.stroke_m - self.position_m
        plus_share = params.cushion_share if self.position_m < params.cushion_m else 1.0
        minus_share = params.cushion_share if left_m < params.cushion_m else 1.0
        plus_m3 = params.plus.dead_m3 + params.plus_area_m2 * self.piston_m
        minus_m3 = params.minus.dead_m3 + params.minus_area_m2 * (params.stroke_m - self.piston_m)
        self.plus.step(params.plus, params.valve, spool, pilot_plus_pa, plus_share, plus_m3, manifold, outside, gas)
        self.minus.step(
            params.minus, params.valve, -spool, pilot_minus_pa, minus_share, minus_m3, manifold, outside, gas
        )

    def _move_one(self, params: Any, force_n: float, step_s: float) -> None:
        """Move load and piston as one body; friction can stop it but not reverse it."""
        mass_kg = params.load_kg + params.piston_kg
        speed_m_s = 0.0
        if not params.blocked:
            impulse_n_s = mass_kg * self.speed_m_s + step_s * force_n
            rest_n_s = abs(impulse_n_s) - step_s * self._resists_n(params)
            if rest_n_s > 0:
                speed_m_s = math.copysign(rest_n_s, impulse_n_s) / (mass_kg + step_s * params.friction.viscous_n_s_m)
        place_m = self.position_m + step_s * speed_m_s
        self.position_m, self.speed_m_s = _stop(place_m, speed_m_s, 0.0, params.stroke_m)
        self.piston_m, self.piston_m_s = self.position_m, self.speed_m_s

    def _move_two(self, params: Any, push_n: float, step_s: float) -> None:
        """Move load and piston coupled by a magnet; solve for both speeds at the end of the step."""
        self._couple(params)
        coupled = not self.decoupled
        spring_n = params.magnet_n_m * (self.piston_m - self.position_m) if coupled else 0.0
        damping = params.magnet_n_s_m + step_s * params.magnet_n_m if coupled else 0.0
        rubber_n, rubber_damping = self._bumper(params, step_s)
        piston_n_s = params.piston_kg * self.piston_m_s + step_s * (push_n - spring_n)
        load_n_s = params.load_kg * self.speed_m_s + step_s * (spring_n + rubber_n)
        own = params.piston_kg + step_s * damping
        other = params.load_kg + step_s * (damping + rubber_damping)
        mixed = step_s * damping
        load_m_s = 0.0
        if not params.blocked:
            # Cramer's rule for own*vp - mixed*vl = piston, -mixed*vp + other*vl = load -+ friction
            free_n_s = load_n_s * own + mixed * piston_n_s
            left_n_s = abs(free_n_s) - own * step_s * self._resists_n(params)
            if left_n_s > 0:
                rubbing = other + step_s * params.friction.viscous_n_s_m
                load_m_s = math.copysign(left_n_s, free_n_s) / (own * rubbing - mixed**2)
        piston_m_s = (piston_n_s + mixed * load_m_s) / own
        self.magnet_n = spring_n + damping * (piston_m_s - load_m_s)
        place_m, piston_m = self.position_m + step_s * load_m_s, self.piston_m + step_s * piston_m_s
        over_m = params.overtravel_m
        self.position_m, self.speed_m_s = _stop(place_m, load_m_s, 0.0, params.stroke_m)
        self.piston_m, self.piston_m_s = _stop(piston_m, piston_m_s, -over_m, params.stroke_m + over_m)

    def _resists_n(self, params: Any) -> float:
        """Return seal friction plus brake force; the brake engages if neither tube releases it."""
        lifts_pa = max(self.plus.tube.pressure_pa, self.minus.tube.pressure_pa) - ATMOSPHERE_PA
        brake_n: float = params.brake_n if lifts_pa < params.brake_bites_pa else 0.0
        return brake_n + dry_n(params.friction, self.speed_m_s)

    def _couple(self, params: Any) -> None:
        """Decouple the magnet beyond its force, and recouple it at low relative speed within reach."""
        in_reach = abs(self.piston_m - self.position_m) * params.magnet_n_m <= params.magnet_holds_n
        if not self.decoupled:
            self.decoupled = int(not in_reach)
        elif in_reach and abs(self.piston_m_s - self.speed_m_s) <= params.recouples_m_s:
            self.decoupled = 0

    def _bumper(self, params: Any, step_s: float) -> tuple[float, float]:
        """Return the bumper force at the start of the step, and the decrease of this force per unit of speed."""
        for way, depth_m in (
            (1, params.bumper_m - self.position_m),
            (-1, self.position_m - (params.stroke_m - params.bumper_m)),
        ):
            if depth_m >= 0 and params.bumper_n_m > 0:
                rubber_n, lost_n = params.bumper_n_m * depth_m, params.bumper_n_s_m * way * self.speed_m_s
                damping = params.bumper_n_s_m if rubber_n > lost_n else 0.0  # a bumper never pulls
                return way * rubber_n, damping + step_s * params.bumper_n_m
        return 0.0, 0.0


def _stop(place_m: float, speed_m_s: float, low_m: float, high_m: float) -> tuple[float, float]:
    """Return position and speed; an end stop absorbs the speed towards it."""
    if place_m <= low_m:
        return low_m, max(speed_m_s, 0.0)
    if place_m >= high_m:
        return high_m, min(speed_m_s, 0.0)
    return place_m, speed_m_s


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
        step_s, critical = gas.step_s, params.critical_ratio
        self._compress(params, step_s)
        main_pa, claw_pa = params.regulated_pa + ATMOSPHERE_PA, params.claw_regulated_pa + ATMOSPHERE_PA
        _regulate(self.receiver, self.header, main_pa, params.regulator_m3_s_pa, params, step_s)
        one_way(self.receiver, self.claw_reservoir, params.crack_pa, params.check_m3_s_pa, critical, step_s)
        one_way(self.claw_reservoir, self.receiver, 0.0, params.slip_m3_s_pa, critical, step_s)
        _regulate(self.claw_reservoir, self.claw_manifold, claw_pa, params.claw_regulator_m3_s_pa, params, step_s)
        self.fed_s = self.fed_s + step_s if fed else 0.0
        if self.fed_s > params.dump_delay_s:
            if self.manifold.pressure_pa >= params.soft_until * self.header.pressure_pa:
                self.soft_started = 1
            opening = params.main_m3_s_pa if self.soft_started else params.soft_m3_s_pa
            both_ways(self.header, self.manifold, opening, critical, step_s)
        else:
            self.soft_started = 0
            both_ways(self.manifold, self.outside, params.vent_m3_s_pa, critical, step_s)
        both_ways(self.manifold, self.outside, params.leak_m3_s_pa, critical, step_s)

    def settle(self, gas: Any) -> None:
        """Complete a step after the cylinders have drawn their air."""
        for chamber in (self.receiver, self.header, self.manifold, self.claw_reservoir, self.claw_manifold):
            chamber.settle(gas)

    def _compress(self, params: Any, step_s: float) -> None:
        gauge_pa = self.receiver.pressure_pa - ATMOSPHERE_PA
        if gauge_pa < params.starts_below_pa:
            self.compressor_runs = 1
        elif gauge_pa > params.stops_above_pa:
            self.compressor_runs = 0
        mass_kg = params.compressor_kg_s * step_s * self.compressor_runs
        self.outside.mass_kg -= mass_kg
        self.taken_in_kg += mass_kg
        self.receiver.gain(mass_kg, mass_kg * HEAT_P * REFERENCE_K)


def _regulate(a: Chamber, b: Chamber, wanted_pa: float, conductance: float, params: Any, step_s: float) -> None:
    """Open the regulator in proportion to the pressure deficit, limited to the flow that eliminates it in a step."""
    lacking_pa = wanted_pa - b.pressure_pa
    if lacking_pa > 0:
        opening = conductance * min(1.0, lacking_pa / params.band_pa)
        lacking_kg = lacking_pa / b.stiffness
        most = lacking_kg / step_s / (REFERENCE_KG_M3 * a.pressure_pa)
        one_way(a, b, 0.0, min(opening, most), params.critical_ratio, step_s)
