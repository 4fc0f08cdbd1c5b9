"""Valves, lines and cylinders of the reference model of the pneumatics; see `chamber_oracle`."""

import math
from dataclasses import dataclass
from typing import Any

from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from tests.plant_sim.pneumatics.chamber_oracle import (
    Chamber,
    both_ways,
    move,
    one_way,
    series,
    tendency,
    weight,
)


@dataclass
class Valve:
    """Valve with two coils."""

    plus_acts: int
    minus_acts: int
    plus_pending_s: float
    minus_pending_s: float
    spool: float
    target: float
    sent: float
    waves: int
    arrives_s: list[float]
    sends: list[float]

    def step(self, params: Any, plus: bool, minus: bool, step_s: float) -> None:
        """Update the pilots, then the changes in the tube, then the spool."""
        self.plus_acts, self.plus_pending_s, late1_s = self._pilot(
            params, plus, self.plus_acts, self.plus_pending_s, step_s
        )
        self.minus_acts, self.minus_pending_s, late2_s = self._pilot(
            params, minus, self.minus_acts, self.minus_pending_s, step_s
        )
        one_sided = self.plus_acts != self.minus_acts
        wish = float(self.plus_acts - self.minus_acts)
        under_way = [(at_s - step_s, end) for at_s, end in zip(self.arrives_s, self.sends, strict=True)][: self.waves]
        if wish != self.sent and (one_sided or not params.latching):
            under_way.append((params.tube_s - max(late1_s, late2_s), wish))
            self.sent = wish
        arrived = [(at_s, end) for at_s, end in under_way if at_s <= 1e-9]
        remaining = under_way[len(arrived) :]
        for changes in (under_way, remaining):  # the elements behind the remaining ones have no meaning
            for number, (at_s, end) in enumerate(changes):
                self.arrives_s[number], self.sends[number] = at_s, end
        under_way = remaining
        self.waves = len(under_way)
        moves_s = step_s
        if arrived:
            self.target = arrived[-1][1]
            moves_s = min(max(-arrived[-1][0], 0.0), step_s)
        if not params.stuck:
            way = moves_s / params.spool_s
            self.spool += min(max(self.target - self.spool, -way), way)

    @staticmethod
    def _pilot(params: Any, coil: bool, acts: int, pending_s: float, step_s: float) -> tuple[int, float, float]:
        """Return level, time for which the coil has differed from it, and time since it switched in this step."""
        if coil == bool(acts):
            return acts, 0.0, 0.0
        pending_s += step_s
        delay_s = params.on_delay_s if coil else params.off_delay_s
        return (int(coil), 0.0, max(pending_s - delay_s, 0.0)) if pending_s > delay_s - 1e-9 else (acts, pending_s, 0.0)


@dataclass
class Nozzles:
    """Valve port and tube in series."""

    valve_m3_s_pa: float
    tube_m3_s_pa: float
    conductance_m3_s_pa: float
    critical_ratio: float


@dataclass
class Line:
    """Line from a valve port to a chamber."""

    tube: Chamber
    chamber: Chamber
    cushion: Chamber
    nozzles: Nozzles
    drawn_kg: float
    piloted: int

    def step(
        self,
        params: Any,
        valve: Any,
        spool: float,
        pilot_pa: float,
        volume_m3: float,
        manifold: Chamber,
        outside: Chamber,
        gas: Any,
    ) -> None:
        """Step the piston, the valve, the pilot, the check valve with the throttle, and the leak, in this order."""
        tube, chamber, critical = self.tube, self.chamber, params.critical_ratio
        chamber.resize(volume_m3, gas)
        behind_pa = params.pilot_ratio * (chamber.pressure_pa - ATMOSPHERE_PA)
        opens_pa = ATMOSPHERE_PA + max(behind_pa, params.pilot_least_pa)
        self.piloted = int(not params.checked or pilot_pa >= opens_pa)
        # over the first half of the spool travel from the middle the exhaust closes, then the supply opens
        feeds = spool > 0.5
        opening = min(abs(2 * spool - 1), 1.0)
        source = manifold if feeds else outside
        self._combine((valve.conductance_m3_s_pa * opening, valve.critical_ratio), params, source)
        given_kg = self._pass(params, source, gas)
        self.drawn_kg += given_kg if feeds else 0.0
        both_ways(chamber, outside, params.leak_m3_s_pa, critical, gas)
        tube.settle(params.tube_wall, gas)
        chamber.settle(params.chamber_wall, gas)
        if self.cushion.volume_m3 > 0:
            self.cushion.settle(params.cushion_wall, gas)

    def _combine(self, port: tuple[float, float], params: Any, source: Chamber) -> None:
        """Combine valve port and tube in the order of the flow."""
        tube = (params.tube_m3_s_pa, params.tube_ratio)
        inward = source.pressure_pa >= self.tube.pressure_pa
        both = series(port, tube) if inward else series(tube, port)
        self.nozzles = Nozzles(port[0] if inward else -port[0], tube[0], *both)

    def move_plunger(self, params: Any, cushion_m: float, from_end_m: float, volume_m3: float, gas: Any) -> float:
        """Close or open the cushion; return the volume left for the chamber."""
        chamber, cushion = self.chamber, self.cushion
        was_closed, closes = cushion.volume_m3 > 0, from_end_m < cushion_m
        if not was_closed and not closes:
            return volume_m3
        closed_m3: float = params.cushion_m3 + params.cushion_m2 * from_end_m
        if not was_closed:
            share = closed_m3 / volume_m3
            cushion.pressure_pa, cushion.temperature_k = chamber.pressure_pa, chamber.temperature_k
            cushion.density_kg_m3 = chamber.density_kg_m3
            for name in ("mass_kg", "volume_m3", "energy_j"):
                setattr(cushion, name, share * getattr(chamber, name))
                setattr(chamber, name, (1 - share) * getattr(chamber, name))
            cushion.stiffness = gas.exponent * cushion.pressure_pa / cushion.mass_kg
            chamber.stiffness = gas.exponent * chamber.pressure_pa / chamber.mass_kg
        cushion.resize(closed_m3, gas)
        if closes:
            return volume_m3 - closed_m3
        chamber.resize(volume_m3 - closed_m3, gas)
        both_kg, both_m3 = chamber.mass_kg + cushion.mass_kg, chamber.volume_m3 + cushion.volume_m3
        mass_k = chamber.mass_kg * chamber.temperature_k + cushion.mass_kg * cushion.temperature_k
        work_j = chamber.pressure_pa * chamber.volume_m3 + cushion.pressure_pa * cushion.volume_m3
        loose_m3 = chamber.mass_kg / chamber.density_kg_m3 + cushion.mass_kg / cushion.density_kg_m3
        chamber.temperature_k, chamber.pressure_pa = mass_k / both_kg, work_j / both_m3
        chamber.density_kg_m3 = both_kg / loose_m3
        chamber.energy_j += cushion.energy_j
        chamber.mass_kg, chamber.volume_m3 = both_kg, both_m3
        chamber.stiffness = gas.exponent * chamber.pressure_pa / both_kg
        cushion.mass_kg = cushion.volume_m3 = cushion.energy_j = cushion.pressure_pa = cushion.stiffness = 0.0
        return volume_m3

    def pass_needle(self, params: Any, gas: Any) -> None:
        """Let air out of the cushion through the needle, or in past the seal."""
        if self.cushion.volume_m3 > 0:
            leaves = self.cushion.pressure_pa > self.chamber.pressure_pa
            opening = params.needle_m3_s_pa if leaves else params.free_m3_s_pa
            both_ways(self.cushion, self.chamber, opening, params.critical_ratio, gas)

    def push_n(self, params: Any, area_m2: float) -> float:
        """Return the force of the air on the piston, N."""
        closed_m2 = params.cushion_m2 if self.cushion.volume_m3 > 0 else 0.0
        return (area_m2 - closed_m2) * self.chamber.pressure_pa + closed_m2 * self.cushion.pressure_pa

    def _pass(self, params: Any, source: Chamber, gas: Any) -> float:
        """Compute valve and throttle flows in one joint Newton step; return the mass drawn from the source."""
        tube, chamber, critical, step_s = self.tube, self.chamber, params.critical_ratio, gas.step_s
        valve_c, valve_b = self.nozzles.conductance_m3_s_pa, self.nozzles.critical_ratio
        (q1, up1, down1), ends1 = _between(source, tube, 0.0, valve_c, valve_b)
        if tube.pressure_pa > chamber.pressure_pa:
            onward = params.free_m3_s_pa
            crack_pa = 0.0 if self.piloted else params.crack_pa
        else:
            onward = params.throttle_m3_s_pa if self.piloted else params.slip_m3_s_pa
            crack_pa = 0.0
        (q2, up2, down2), ends2 = _between(tube, chamber, crack_pa, onward, critical)
        k1 = (source if q1 >= 0 else tube).temperature_k if gas.thermal else None
        k2 = (tube if q2 >= 0 else chamber).temperature_k if gas.thermal else None
        # m1 = dt (q1 + w1 (up1 dp_source + down1 dp_tube)), m2 = dt (q2 + w2 (up2 dp_tube + down2 dp_chamber))
        turns1 = step_s * (up1 * source.rise(k1) - down1 * tube.rise(k1))
        turns2 = step_s * (up2 * tube.rise(k2) - down2 * chamber.rise(k2))
        w1, w2 = weight(turns1), weight(turns2)
        own1, own2 = 1 / step_s + w1 * turns1 / step_s, 1 / step_s + w2 * turns2 / step_s
        mixed1, mixed2 = w1 * down1 * tube.rise(k2), w2 * up2 * tube.rise(k1)
        common = own1 * own2 + mixed1 * mixed2
        m1, m2 = (q1 * own2 - mixed1 * q2) / common, (q2 * own1 + mixed2 * q1) / common
        tube_pa = tube.pressure_pa + tube.rise(k1) * m1 - tube.rise(k2) * m2
        after1_pa = source.pressure_pa - source.rise(k1) * m1 - tube_pa
        after2_pa = tube_pa - chamber.pressure_pa - chamber.rise(k2) * m2
        crosses1 = ends1 * after1_pa < 0 and min(abs(ends1), abs(after1_pa)) > 0.01 * source.pressure_pa
        crosses2 = ends2 * after2_pa < 0 and min(abs(ends2), abs(after2_pa)) > 0.01 * tube.pressure_pa
        if not crosses1 and not crosses2 and m2 * q2 >= 0:
            flows = [(source, tube, m1), (tube, chamber, m2)]
            for a, b, mass_kg in flows if m2 > 0 else reversed(flows):
                move(a, b, mass_kg, gas)
            return float(m1)
        m1 = both_ways(source, tube, valve_c, valve_b, gas)
        if q2 > 0:
            one_way(tube, chamber, crack_pa, onward, critical, gas)
        elif q2 < 0:
            one_way(chamber, tube, 0.0, onward, critical, gas)
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


def rubbed_n_s(friction: Any, free_n_s: float, speed_m_s: float, kg: float, step_s: float, brake_n: float) -> float:
    """Return the speed at which a momentum ends after friction, found by bisection.

    The residual momentum is (kg + dt B) v + dt (Fc + brake + (Fs - Fc) / (1 + v / vs)). Beyond the minimum of this
    function it increases with the speed; if it exceeds the given momentum there, or a load at rest does not overcome
    static friction, the load stops.
    """
    inertia_kg, falls_n_s = kg + step_s * friction.viscous_n_s_m, step_s * (friction.static_n - friction.coulomb_n)
    left_n_s = abs(free_n_s) - step_s * (friction.coulomb_n + brake_n)
    if left_n_s <= 0 or (left_n_s <= falls_n_s and speed_m_s * free_n_s <= 0):
        return 0.0
    vs = friction.stribeck_m_s
    lowest_m_s = max(math.sqrt(falls_n_s * vs / inertia_kg) - vs, 0.0)

    def uses_n_s(v: float) -> float:
        return float(inertia_kg * v + falls_n_s / (1 + v / vs))

    low, high = lowest_m_s, left_n_s / inertia_kg
    if uses_n_s(low) > left_n_s:
        return 0.0
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if uses_n_s(middle) < left_n_s else (low, middle)
    return math.copysign((low + high) / 2, free_n_s)


@dataclass
class Cylinder:
    """Cylinder with its valve, its lines and its load."""

    position_m: float
    speed_m_s: float
    piston_m: float
    piston_m_s: float
    magnet_n: float
    decoupled: int
    braked: int
    brake_s: float
    fastest_m_s: float
    valve: Valve
    plus: Line
    minus: Line

    def step(self, params: Any, plus: bool, minus: bool, manifold: Chamber, outside: Chamber, gas: Any) -> None:
        """Step the valve, then the motion under the previous pressures, then the air."""
        self.valve.step(params.valve, plus, minus, gas.step_s)
        if params.brake_n > 0:
            self._brake(params, manifold, gas.step_s)
        push_n = self.plus.push_n(params.plus, params.plus_area_m2)
        push_n -= self.minus.push_n(params.minus, params.minus_area_m2)
        push_n -= ATMOSPHERE_PA * (params.plus_area_m2 - params.minus_area_m2)
        if params.magnet_holds_n > 0:
            self._move_two(params, push_n, gas.step_s)
        else:
            self._move_one(params, push_n + params.weight_n, gas.step_s)
        self.fastest_m_s = max(self.fastest_m_s, abs(self.speed_m_s))
        spool, pilot_plus_pa, pilot_minus_pa = self.valve.spool, self.minus.tube.pressure_pa, self.plus.tube.pressure_pa
        left_m = params.stroke_m - self.piston_m
        plus_m3 = params.plus.dead_m3 + params.plus_area_m2 * self.piston_m
        minus_m3 = params.minus.dead_m3 + params.minus_area_m2 * left_m
        if params.cushion_m > 0:
            plus_m3 = self.plus.move_plunger(params.plus, params.cushion_m, self.piston_m, plus_m3, gas)
            minus_m3 = self.minus.move_plunger(params.minus, params.cushion_m, left_m, minus_m3, gas)
            self.plus.pass_needle(params.plus, gas)
            self.minus.pass_needle(params.minus, gas)
        self.plus.step(params.plus, params.valve, spool, pilot_plus_pa, plus_m3, manifold, outside, gas)
        self.minus.step(params.minus, params.valve, -spool, pilot_minus_pa, minus_m3, manifold, outside, gas)

    def _brake(self, params: Any, manifold: Chamber, step_s: float) -> None:
        """Release the brake while a pilot is on and there is air; engage it some time after both pilots go off."""
        acts = self.valve.plus_acts or self.valve.minus_acts
        self.brake_s = params.brake_delay_s if acts else max(self.brake_s - step_s, 0.0)
        lacks_air = manifold.pressure_pa < ATMOSPHERE_PA + params.brake_bites_pa
        self.braked = int(lacks_air or not self.brake_s)

    def _move_one(self, params: Any, force_n: float, step_s: float) -> None:
        """Move load and piston as one body between elastic or rigid stops."""
        mass_kg = params.load_kg + params.piston_kg
        speed_m_s = 0.0
        if not params.blocked:
            stop_n, damping = self._bumper(params, step_s)
            free_n_s = mass_kg * self.speed_m_s + step_s * (force_n + stop_n)
            speed_m_s = rubbed_n_s(
                params.friction, free_n_s, self.speed_m_s, mass_kg + step_s * damping, step_s, self._braking_n(params)
            )
            if stop_n != 0 and abs(speed_m_s) < 1e-6:
                speed_m_s = 0.0
        place_m = self.position_m + step_s * speed_m_s
        over_m = params.overtravel_m
        self.position_m, self.speed_m_s = _stop(place_m, speed_m_s, -over_m, params.stroke_m + over_m)
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
            # own*vp - mixed*vl = piston, -mixed*vp + other*vl = load -+ friction, with vp eliminated
            load_m_s = rubbed_n_s(
                params.friction,
                load_n_s + mixed / own * piston_n_s,
                self.speed_m_s,
                other - mixed**2 / own,
                step_s,
                self._braking_n(params),
            )
        piston_m_s = (piston_n_s + mixed * load_m_s) / own
        self.magnet_n = spring_n + damping * (piston_m_s - load_m_s)
        place_m, piston_m = self.position_m + step_s * load_m_s, self.piston_m + step_s * piston_m_s
        over_m = params.overtravel_m
        self.position_m, self.speed_m_s = _stop(place_m, load_m_s, 0.0, params.stroke_m)
        self.piston_m, self.piston_m_s = _stop(piston_m, piston_m_s, -over_m, params.stroke_m + over_m)

    def _braking_n(self, params: Any) -> float:
        """Return the force of the engaged brake."""
        return float(params.brake_n) if self.braked else 0.0

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
