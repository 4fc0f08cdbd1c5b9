"""The air of the machine once more, in plain Python: slow, readable, and written apart from the compiled code.

Same equations and same order within a step as `plant_sim.pneumatics`, other algebra: where the
compiled code saves a division or a power, this says what is meant. Only constants of nature are
shared. Every state here has the fields of its compiled record in the same order, so that `read`
makes one from the other and `values` lines both up.

Source of the equations: PLANT.md 1 and 3.4, and the docstrings of `plant_sim.pneumatics`.
"""

import math
from dataclasses import dataclass, fields
from functools import cache
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


def read(kind: type[T], record: Any) -> T:
    """Make an object with the values of a compiled record.

    Args:
        kind: One of the classes of this module.
        record: Structured scalar with the same field names.
    """
    hints = _hints(kind)
    return kind(
        **{
            name: read(hints[name], record[name]) if record.dtype[name].names else record[name].item()
            for name in record.dtype.names
        }
    )


def values(state: Any) -> list[float]:
    """All numbers of a state, depth first, in the order of its fields."""
    flat: list[float] = []
    for field in fields(state):
        value = getattr(state, field.name)
        if isinstance(value, int | float):
            flat.append(value)
        else:
            flat.extend(values(value))
    return flat


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


@dataclass
class Gas:
    """How air behaves in every chamber, and the length of a step."""

    exponent: float
    wall_s: float
    thermal: int
    wall_w_m2_k: float
    step_s: float


@dataclass
class Chamber:
    """A volume of air."""

    mass_kg: float
    temperature_k: float
    volume_m3: float
    pressure_pa: float
    stiffness: float
    density_kg_m3: float
    energy_j: float

    def gain(self, mass_kg: float, heat_j: float) -> None:
        """Take in air with its enthalpy, or give it off."""
        self.mass_kg += mass_kg
        self.pressure_pa += mass_kg * self.stiffness
        self.energy_j += heat_j

    def resize(self, volume_m3: float, gas: Gas) -> None:
        """Move the piston: dp/dV = -n p/V by the trapezoidal rule, and the work that this takes."""
        n, before_pa, grown_m3 = gas.exponent, self.pressure_pa, volume_m3 - self.volume_m3
        if grown_m3 == 0.0:
            return
        strain = grown_m3 / (self.volume_m3 + volume_m3)
        self.pressure_pa = before_pa * (1 - n * strain) / (1 + n * strain)
        self.energy_j -= (before_pa + self.pressure_pa) / 2 * grown_m3
        self.volume_m3 = volume_m3
        self.stiffness = n * self.pressure_pa / self.mass_kg

    def settle(self, gas: Gas) -> None:
        """Close a step: what temperature the air has now, and hence what pressure."""
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
    """Flow as a part of the choked flow, and its slope over the ratio of the pressures; subsonic part only."""
    past = (ratio - critical) / (1 - critical)
    part = math.sqrt(1 - past**2)
    return part, -past / (part * (1 - critical))


def transfer(up: Chamber, down: Chamber, up_pa: float, conductance: float, critical: float, step_s: float) -> float:
    """Let air through a restriction (ISO 6358): one Newton step towards the pressures after it."""
    gain = conductance * REFERENCE_KG_M3 * math.sqrt(REFERENCE_K / up.temperature_k)
    down_pa = down.pressure_pa
    ratio = down_pa / up_pa
    if ratio >= LAMINAR_RATIO:
        slope = gain * shape(LAMINAR_RATIO, critical)[0] / (1 - LAMINAR_RATIO)
        kg_s, by_up, by_down = slope * (up_pa - down_pa), slope, -slope
    else:
        part, bend = (1.0, 0.0) if ratio <= critical else shape(ratio, critical)
        kg_s, by_up, by_down = gain * up_pa * part, gain * (part - ratio * bend), gain * bend
    mass_kg = step_s * kg_s / (1 + step_s * (by_up * up.stiffness - by_down * down.stiffness))
    heat_j = mass_kg * HEAT_P * up.temperature_k
    up.gain(-mass_kg, -heat_j)
    down.gain(mass_kg, heat_j)
    return mass_kg


def both_ways(a: Chamber, b: Chamber, conductance: float, critical: float, step_s: float) -> float:
    """Let air flow to where the pressure is lower; return the mass that left `a`, kg."""
    if conductance <= 0.0:
        return 0.0
    if a.pressure_pa >= b.pressure_pa:
        return transfer(a, b, a.pressure_pa, conductance, critical, step_s)
    return -transfer(b, a, b.pressure_pa, conductance, critical, step_s)


def one_way(a: Chamber, b: Chamber, crack_pa: float, conductance: float, critical: float, step_s: float) -> None:
    """Let air flow from `a` to `b` through a check valve."""
    if conductance > 0.0 and a.pressure_pa - crack_pa > b.pressure_pa:
        transfer(a, b, a.pressure_pa - crack_pa, conductance, critical, step_s)


def series(one: float, other: float) -> float:
    """Conductance of two restrictions one behind the other."""
    return 1 / math.sqrt(1 / one**2 + 1 / other**2)


@dataclass
class ValveMake:
    """What a valve is."""

    on_delay_s: float
    off_delay_s: float
    spool_s: float
    conductance_m3_s_pa: float
    critical_ratio: float
    latching: int
    stuck: int


@dataclass
class Valve:
    """A valve with two coils."""

    plus_acts: int
    minus_acts: int
    plus_pending_s: float
    minus_pending_s: float
    spool: float
    target: float

    def step(self, make: ValveMake, plus: bool, minus: bool, step_s: float) -> None:
        """Let the pilots, then the spool, follow the coils."""
        self.plus_acts, self.plus_pending_s = self._pilot(make, plus, self.plus_acts, self.plus_pending_s, step_s)
        self.minus_acts, self.minus_pending_s = self._pilot(make, minus, self.minus_acts, self.minus_pending_s, step_s)
        one_sided = self.plus_acts != self.minus_acts
        if one_sided:
            self.target = 1.0 if self.plus_acts else -1.0
        elif not make.latching:
            self.target = 0.0
        if not make.stuck:
            way = step_s / make.spool_s
            self.spool += min(max(self.target - self.spool, -way), way)

    @staticmethod
    def _pilot(make: ValveMake, coil: bool, acts: int, pending_s: float, step_s: float) -> tuple[int, float]:
        if coil == bool(acts):
            return acts, 0.0
        pending_s += step_s
        delay_s = make.on_delay_s if coil else make.off_delay_s
        return (int(coil), 0.0) if pending_s > delay_s - 1e-9 else (acts, pending_s)


@dataclass
class LineMake:
    """What a line is."""

    tube_m3_s_pa: float
    tube_m3: float
    dead_m3: float
    free_m3_s_pa: float
    throttle_m3_s_pa: float
    critical_ratio: float
    checked: int
    crack_pa: float
    pilot_ratio: float
    pilot_least_pa: float
    slip_m3_s_pa: float
    leak_m3_s_pa: float


@dataclass
class Line:
    """From a port of the valve to a chamber."""

    tube: Chamber
    chamber: Chamber
    drawn_kg: float
    piloted: int

    def step(
        self, make: LineMake, valve: ValveMake, spool: float, pilot_pa: float, out_share: float, volume_m3: float,
        manifold: Chamber, outside: Chamber, gas: Gas,
    ) -> None:  # fmt: skip
        """Piston, valve, pilot, check valve and throttle, leak: in this order."""
        tube, chamber, step_s, critical = self.tube, self.chamber, gas.step_s, make.critical_ratio
        chamber.resize(volume_m3, gas)
        # over the half of the spool's way from the middle the exhaust closes, then the supply opens
        fed = valve.conductance_m3_s_pa * min(max(2 * spool - 1, 0.0), 1.0)
        vented = valve.conductance_m3_s_pa * min(max(1 - 2 * spool, 0.0), 1.0)
        if fed > 0:
            self.drawn_kg += both_ways(manifold, tube, series(fed, make.tube_m3_s_pa), valve.critical_ratio, step_s)
        if vented > 0:
            both_ways(tube, outside, series(vented, make.tube_m3_s_pa), valve.critical_ratio, step_s)
        behind_pa = make.pilot_ratio * (chamber.pressure_pa - ATMOSPHERE_PA)
        opens_pa = ATMOSPHERE_PA + max(behind_pa, make.pilot_least_pa)
        self.piloted = int(not make.checked or pilot_pa >= opens_pa)
        if tube.pressure_pa > chamber.pressure_pa:
            crack_pa = 0.0 if self.piloted else make.crack_pa
            one_way(tube, chamber, crack_pa, make.free_m3_s_pa, critical, step_s)
        else:
            out = make.throttle_m3_s_pa * out_share if self.piloted else make.slip_m3_s_pa
            one_way(chamber, tube, 0.0, out, critical, step_s)
        both_ways(chamber, outside, make.leak_m3_s_pa, critical, step_s)
        tube.settle(gas)
        chamber.settle(gas)


@dataclass
class Friction:
    """Friction of a seal."""

    coulomb_n: float
    static_n: float
    stribeck_m_s: float
    viscous_n_s_m: float

    def dry_n(self, speed_m_s: float) -> float:
        """The part that does not grow with speed."""
        extra_n = self.static_n - self.coulomb_n
        return self.coulomb_n + extra_n / (1 + (speed_m_s / self.stribeck_m_s) ** 2)


@dataclass
class CylinderMake:
    """What a cylinder is."""

    stroke_m: float
    plus_area_m2: float
    minus_area_m2: float
    load_kg: float
    piston_kg: float
    weight_n: float
    cushion_m: float
    cushion_share: float
    bumper_m: float
    bumper_n_m: float
    bumper_n_s_m: float
    magnet_holds_n: float
    magnet_n_m: float
    magnet_n_s_m: float
    recouples_m_s: float
    overtravel_m: float
    brake_n: float
    brake_bites_pa: float
    blocked: int
    friction: Friction
    valve: ValveMake
    plus: LineMake
    minus: LineMake


@dataclass
class Cylinder:
    """A cylinder with its valve, its lines and its load."""

    position_m: float
    speed_m_s: float
    piston_m: float
    piston_m_s: float
    magnet_n: float
    decoupled: int
    valve: Valve
    plus: Line
    minus: Line

    def step(self, make: CylinderMake, plus: bool, minus: bool, manifold: Chamber, outside: Chamber, gas: Gas) -> None:
        """Valve, then motion under the pressures of before, then the air."""
        self.valve.step(make.valve, plus, minus, gas.step_s)
        push_n = make.plus_area_m2 * (self.plus.chamber.pressure_pa - ATMOSPHERE_PA)
        push_n -= make.minus_area_m2 * (self.minus.chamber.pressure_pa - ATMOSPHERE_PA)
        if make.magnet_holds_n > 0:
            self._move_two(make, push_n, gas.step_s)
        else:
            self._move_one(make, push_n + make.weight_n, gas.step_s)
        spool, pilot_plus_pa, pilot_minus_pa = self.valve.spool, self.minus.tube.pressure_pa, self.plus.tube.pressure_pa
        left_m = make.stroke_m - self.position_m
        plus_share = make.cushion_share if self.position_m < make.cushion_m else 1.0
        minus_share = make.cushion_share if left_m < make.cushion_m else 1.0
        plus_m3 = make.plus.dead_m3 + make.plus_area_m2 * self.piston_m
        minus_m3 = make.minus.dead_m3 + make.minus_area_m2 * (make.stroke_m - self.piston_m)
        self.plus.step(make.plus, make.valve, spool, pilot_plus_pa, plus_share, plus_m3, manifold, outside, gas)
        self.minus.step(make.minus, make.valve, -spool, pilot_minus_pa, minus_share, minus_m3, manifold, outside, gas)

    def _move_one(self, make: CylinderMake, force_n: float, step_s: float) -> None:
        """Load and piston are one body, which friction slows and at most stops."""
        mass_kg = make.load_kg + make.piston_kg
        speed_m_s = 0.0
        if not make.blocked:
            impulse_n_s = mass_kg * self.speed_m_s + step_s * force_n
            rest_n_s = abs(impulse_n_s) - step_s * self._resists_n(make)
            if rest_n_s > 0:
                speed_m_s = math.copysign(rest_n_s, impulse_n_s) / (mass_kg + step_s * make.friction.viscous_n_s_m)
        place_m = self.position_m + step_s * speed_m_s
        self.position_m, self.speed_m_s = _stop(place_m, speed_m_s, 0.0, make.stroke_m)
        self.piston_m, self.piston_m_s = self.position_m, self.speed_m_s

    def _move_two(self, make: CylinderMake, push_n: float, step_s: float) -> None:
        """Piston and load are two, with a magnet between: both speeds at the end of the step."""
        self._couple(make)
        coupled = not self.decoupled
        spring_n = make.magnet_n_m * (self.piston_m - self.position_m) if coupled else 0.0
        damping = make.magnet_n_s_m + step_s * make.magnet_n_m if coupled else 0.0
        rubber_n, rubber_damping = self._bumper(make, step_s)
        piston_n_s = make.piston_kg * self.piston_m_s + step_s * (push_n - spring_n)
        load_n_s = make.load_kg * self.speed_m_s + step_s * (spring_n + rubber_n)
        own = make.piston_kg + step_s * damping
        other = make.load_kg + step_s * (damping + rubber_damping)
        mixed = step_s * damping
        load_m_s = 0.0
        if not make.blocked:
            # Cramer's rule for own*vp - mixed*vl = piston, -mixed*vp + other*vl = load -+ friction
            free_n_s = load_n_s * own + mixed * piston_n_s
            left_n_s = abs(free_n_s) - own * step_s * self._resists_n(make)
            if left_n_s > 0:
                rubbing = other + step_s * make.friction.viscous_n_s_m
                load_m_s = math.copysign(left_n_s, free_n_s) / (own * rubbing - mixed**2)
        piston_m_s = (piston_n_s + mixed * load_m_s) / own
        self.magnet_n = spring_n + damping * (piston_m_s - load_m_s)
        place_m, piston_m = self.position_m + step_s * load_m_s, self.piston_m + step_s * piston_m_s
        over_m = make.overtravel_m
        self.position_m, self.speed_m_s = _stop(place_m, load_m_s, 0.0, make.stroke_m)
        self.piston_m, self.piston_m_s = _stop(piston_m, piston_m_s, -over_m, make.stroke_m + over_m)

    def _resists_n(self, make: CylinderMake) -> float:
        """Seal and brake; a brake that neither tube lifts bites."""
        lifts_pa = max(self.plus.tube.pressure_pa, self.minus.tube.pressure_pa) - ATMOSPHERE_PA
        brake_n = 0.0 if lifts_pa >= make.brake_bites_pa else make.brake_n
        return make.friction.dry_n(self.speed_m_s) + brake_n

    def _couple(self, make: CylinderMake) -> None:
        """The magnet lets go beyond its force, and catches what passes slowly within reach."""
        in_reach = abs(self.piston_m - self.position_m) * make.magnet_n_m <= make.magnet_holds_n
        if not self.decoupled:
            self.decoupled = int(not in_reach)
        elif in_reach and abs(self.piston_m_s - self.speed_m_s) <= make.recouples_m_s:
            self.decoupled = 0

    def _bumper(self, make: CylinderMake, step_s: float) -> tuple[float, float]:
        """Force of the rubber at the start of the step, and what speed takes from it."""
        for way, depth_m in (
            (1, make.bumper_m - self.position_m),
            (-1, self.position_m - (make.stroke_m - make.bumper_m)),
        ):
            if depth_m >= 0 and make.bumper_n_m > 0:
                rubber_n, lost_n = make.bumper_n_m * depth_m, make.bumper_n_s_m * way * self.speed_m_s
                damping = make.bumper_n_s_m if rubber_n > lost_n else 0.0  # what leaves faster is let go, not held
                return way * rubber_n, damping + step_s * make.bumper_n_m
        return 0.0, 0.0


def _stop(place_m: float, speed_m_s: float, low_m: float, high_m: float) -> tuple[float, float]:
    """Place and speed; an end stop takes the speed towards it."""
    if place_m <= low_m:
        return low_m, max(speed_m_s, 0.0)
    if place_m >= high_m:
        return high_m, min(speed_m_s, 0.0)
    return place_m, speed_m_s


@dataclass
class SupplyMake:
    """What a supply is."""

    compressor_kg_s: float
    starts_below_pa: float
    stops_above_pa: float
    regulated_pa: float
    band_pa: float
    regulator_m3_s_pa: float
    claw_regulated_pa: float
    claw_regulator_m3_s_pa: float
    dump_delay_s: float
    main_m3_s_pa: float
    soft_m3_s_pa: float
    soft_until: float
    vent_m3_s_pa: float
    check_m3_s_pa: float
    crack_pa: float
    critical_ratio: float
    slip_m3_s_pa: float
    leak_m3_s_pa: float


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

    def step(self, make: SupplyMake, fed: bool, gas: Gas) -> None:
        """From the compressor to the manifolds."""
        step_s, critical = gas.step_s, make.critical_ratio
        self._compress(make, step_s)
        main_pa, claw_pa = make.regulated_pa + ATMOSPHERE_PA, make.claw_regulated_pa + ATMOSPHERE_PA
        _regulate(self.receiver, self.header, main_pa, make.regulator_m3_s_pa, make, step_s)
        one_way(self.header, self.claw_reservoir, make.crack_pa, make.check_m3_s_pa, critical, step_s)
        one_way(self.claw_reservoir, self.header, 0.0, make.slip_m3_s_pa, critical, step_s)
        _regulate(self.claw_reservoir, self.claw_manifold, claw_pa, make.claw_regulator_m3_s_pa, make, step_s)
        self.fed_s = self.fed_s + step_s if fed else 0.0
        if self.fed_s > make.dump_delay_s:
            if self.manifold.pressure_pa >= make.soft_until * self.header.pressure_pa:
                self.soft_started = 1
            opening = make.main_m3_s_pa if self.soft_started else make.soft_m3_s_pa
            both_ways(self.header, self.manifold, opening, critical, step_s)
        else:
            self.soft_started = 0
            both_ways(self.manifold, self.outside, make.vent_m3_s_pa, critical, step_s)
        both_ways(self.manifold, self.outside, make.leak_m3_s_pa, critical, step_s)

    def settle(self, gas: Gas) -> None:
        """Close a step, after the cylinders have taken their air."""
        for chamber in (self.receiver, self.header, self.manifold, self.claw_reservoir, self.claw_manifold):
            chamber.settle(gas)

    def _compress(self, make: SupplyMake, step_s: float) -> None:
        gauge_pa = self.receiver.pressure_pa - ATMOSPHERE_PA
        if gauge_pa < make.starts_below_pa:
            self.compressor_runs = 1
        elif gauge_pa > make.stops_above_pa:
            self.compressor_runs = 0
        mass_kg = make.compressor_kg_s * step_s * self.compressor_runs
        self.outside.mass_kg -= mass_kg
        self.taken_in_kg += mass_kg
        self.receiver.gain(mass_kg, mass_kg * HEAT_P * REFERENCE_K)


def _regulate(a: Chamber, b: Chamber, wanted_pa: float, conductance: float, make: SupplyMake, step_s: float) -> None:
    """Open in proportion to what is lacking, but let no more choked air in than that within a step."""
    lacking_pa = wanted_pa - b.pressure_pa
    if lacking_pa > 0:
        opening = conductance * min(1.0, lacking_pa / make.band_pa)
        lacking_kg = lacking_pa / b.stiffness
        most = lacking_kg / step_s / (REFERENCE_KG_M3 * a.pressure_pa)
        one_way(a, b, 0.0, min(opening, most), make.critical_ratio, step_s)
