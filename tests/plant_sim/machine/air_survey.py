"""Random machines, and a survey of their air over strokes, reversals, stops and losses of air."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from plant_sim.common.compiled import compiled, compiled_and_cached
from plant_sim.common.parameter_file import Value
from plant_sim.devices.claws import Claws
from plant_sim.devices.lift import Lift
from plant_sim.devices.pneumatic import Records
from plant_sim.devices.slide import Slide
from plant_sim.devices.supply import Supply
from plant_sim.machine.kernel import MACHINE, MACHINE_PARAMS
from plant_sim.machine.parameters import Machine, MachineError, load_machine
from plant_sim.pneumatics.cylinder import settle_cylinder, step_cylinder
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.pneumatics.supply import settle_supply, step_supply

DEFAULT: Final = load_machine()

VARIED: Final = tuple(
    f"{section}.{key}"
    for section, keys in {
        "air": ("polytropic_exponent", "wall_time_s", "wall_w_m2_k"),
        "supply": tuple(name for name in DEFAULT.supply.__slots__ if name != "soft_until"),
        "valve": DEFAULT.valve.__slots__,
        "check_valve": DEFAULT.check_valve.__slots__,
        "slide": tuple(name for name in DEFAULT.slide.__slots__ if not name.startswith("switch")),
        "slide_port": DEFAULT.slide_port.__slots__,
        "slide_friction": DEFAULT.slide_friction.__slots__,
        "lift": tuple(name for name in DEFAULT.lift.__slots__ if not name.startswith("switch")),
        "lift_port": DEFAULT.lift_port.__slots__,
        "lift_friction": DEFAULT.lift_friction.__slots__,
        "claws": ("bore_m", "stroke_m", "grippers", "moved_kg", "throttle_conductance_m3_s_pa"),
        "claws_port": DEFAULT.claws_port.__slots__,
        "claws_friction": DEFAULT.claws_friction.__slots__,
        "crop": ("claw_pressure_mpa",),
    }.items()
    for key in keys
)
"""Parameters that affect the air."""

STROKES: Final = (
    (2.5, (1, 0, 0), True),
    (2.5, (-1, 0, 0), True),
    (1.5, (0, -1, 0), True),
    (1.5, (0, 1, 0), True),
    (0.6, (0, 0, -1), True),
    (0.6, (0, 0, 1), True),
)
"""Strokes that are timed, each with one cylinder, in the form of `PHASES`."""

PHASES: Final = (
    *STROKES,
    (0.9, (1, -1, -1), True),
    (0.4, (0, 0, 0), True),
    (0.6, (-1, 1, 1), True),
    (0.5, (0, 0, 0), False),
    (0.6, (1, -1, -1), True),
    (0.3, (1, -1, 1), False),
    (1.2, (-1, 1, -1), True),
)
"""Duration, s; signs of the energised coils of slide, lift and claws; True if the relay feeds the dump valve."""

STORES: Final = ("receiver", "header", "manifold", "claw_reservoir", "claw_manifold")


def random_machine(seed: int) -> tuple[Machine, dict[str, Value]]:
    """Return an accepted machine and its parameters that differ from ``machine.yaml``.

    Parameters are changed one after the other by random factors, of which a third are up to 30; a change that is
    rejected is dropped.
    """
    rng = random.Random(seed)
    machine, values = DEFAULT, dict[str, Value]()
    for name in rng.sample(VARIED, rng.randrange(1, 25)):
        section, key = name.split(".")
        widest = 30.0 if rng.random() < 1 / 3 else 3.0
        old = getattr(getattr(machine, section), key)
        new = old * widest ** rng.uniform(-1.0, 1.0)
        try:
            machine = machine.with_values({name: max(1, round(new)) if isinstance(old, int) else new})
        except MachineError:
            continue
        values[name] = getattr(getattr(machine, section), key)
    return machine, values


@dataclass(frozen=True)
class Survey:
    """Extremes of a machine over all phases.

    Attributes:
        kelvin: Lowest and highest temperature of any air outside the cushions, K.
        cushion_kelvin: Lowest and highest temperature of the air in the cushions, K.
        energy_error: Error of the energy balance, relative to the enthalpy of the air drawn in and exhausted.
        over: Highest ratio of a pressure outside the cushions to the pressure that supply and kinetic energy allow,
            with the name of the volume.
        strokes_s: Times from energising the coil until the load enters the range of the switch at its destination, s,
            infinite if it does not; in the order of `STROKES`.
        stops: Number of stops of the load before it arrives, in the same order.
        finite: True if the energy of all air is finite at the end.
    """

    kelvin: tuple[float, float]
    cushion_kelvin: tuple[float, float]
    energy_error: float
    over: tuple[float, str]
    strokes_s: NDArray[np.float64]
    stops: NDArray[np.float64]
    finite: bool

    @property
    def sticks(self) -> NDArray[np.bool_]:
        """True for the strokes in which the load has stuck after its start."""
        return self.stops > 0


class SurveyedArm:
    """One arm and the supply of a machine, driven without switches."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.state, self.params = np.zeros(1, MACHINE), np.zeros(1, MACHINE_PARAMS)
        params, gas = self.params[0], self.params[0]["gas"]
        air = machine.air
        gas["exponent"], gas["wall_s"] = air.stiffness_exponent, air.wall_time_s
        gas["thermal"], gas["wall_w_m2_k"], gas["step_s"] = air.thermal, air.wall_w_m2_k, machine.step_s
        Supply(machine.supply, self.state[0]["air"], params["air"], gas, claw_pressure_pa=machine.claw_pressure_pa)
        records = Records(self.state[0]["arms"][0], params["arms"][0], gas)
        common, held_pa = machine.pneumatics, machine.held_pressure_pa
        Slide(
            machine.slide,
            machine.slide_port,
            machine.slide_friction,
            common,
            records,
            picks_m=machine.picks_m,
            held_pa=held_pa,
            bounce_s=0.0,
        )
        Lift(machine.lift, machine.lift_port, machine.lift_friction, common, records, held_pa=held_pa, bounce_s=0.0)
        Claws(
            machine.claws,
            machine.claws_port,
            machine.claws_friction,
            common,
            records,
            pressure_pa=machine.held_claw_pressure_pa,
        )

    def survey(self) -> Survey:
        """Run all phases and return the extremes."""
        machine = self.machine
        lift, claws = machine.lift, machine.claws
        ends_m = np.array(
            [
                machine.picks_m[2] - machine.slide.switch_band_m,
                machine.slide.switch_band_m,
                lift.switch_band_m,
                lift.stroke_m - lift.switch_band_m,
                0.05 * claws.stroke_m,
                0.95 * claws.stroke_m,
            ]
        )
        strokes_s, stops = np.full(len(STROKES), np.inf), np.zeros(len(STROKES))
        # rows: pressure of plus tube, plus chamber, minus tube, minus chamber; least volumes; fastest kinetic energy
        seen = np.zeros((3, 7))
        seen[:, 4:6] = np.inf
        # lowest and highest temperature outside the cushions, and in them
        stores_pa, kelvin = np.zeros(len(STORES)), np.array([1e9, 0.0, 1e9, 0.0])
        balance_j, through_j = 0.0, 1e-9
        before_j = _balance_j(self.state[0])
        for number, (for_s, signs, fed) in enumerate(PHASES):
            steps = round(for_s * 1e3) * machine.steps_per_ms
            coils = np.array([(sign > 0, sign < 0) for sign in signs])
            _drive(
                self.state, self.params, coils, fed, steps, number, ends_m, strokes_s, stops, seen, stores_pa, kelvin
            )
            exhausted_j = float(self.state[0]["air"]["network"]["outside"]["energy_j"])
            through_j += abs(exhausted_j) + 1004.675 * 293.15 * float(self.state[0]["air"]["network"]["taken_in_kg"])
            balance_j = max(balance_j, abs(_balance_j(self.state[0]) - before_j))
        arms = self.state[0]["arms"][0]
        drawn_kg = sum(float(arms[name][line]["drawn_kg"]) for name in ("slide", "lift", "claws") for line in _LINES)
        through_j = max(through_j, 1004.675 * 293.15 * drawn_kg)
        return Survey(
            (float(kelvin[0]), float(kelvin[1])),
            (float(kelvin[2]), float(kelvin[3])),
            balance_j / through_j,
            self._over(seen, stores_pa),
            strokes_s,
            stops,
            math.isfinite(_balance_j(self.state[0])) and bool(np.isfinite(kelvin).all()),
        )

    def _over(self, seen: NDArray[np.float64], stores_pa: NDArray[np.float64]) -> tuple[float, str]:
        """Return the highest ratio of a pressure to the allowed one."""
        machine, found = self.machine, []
        exponent = machine.air.stiffness_exponent
        main_pa = max(float(stores_pa[STORES.index("manifold")]), ATMOSPHERE_PA + machine.supply.pressure_pa)
        claw_pa = max(float(stores_pa[STORES.index("claw_manifold")]), ATMOSPHERE_PA + machine.claw_pressure_pa)
        worst_main_pa, worst_claw_pa = (
            ATMOSPHERE_PA + machine.supply.pressure_pa,
            ATMOSPHERE_PA + machine.claw_pressure_pa,
        )
        for number, name in enumerate(("slide", "lift", "claws")):
            params, row = self.params[0]["arms"][0][name], seen[number]
            source_pa = claw_pa if name == "claws" else main_pa
            areas = float(params["plus_area_m2"]), float(params["minus_area_m2"])
            rod_n = ATMOSPHERE_PA * (areas[0] - areas[1])
            for end, sign in ((0, 1), (1, -1)):
                own_m2, other_m2 = areas[end], areas[1 - end]
                # force on the piston towards this chamber: air of the other one, weight, atmosphere on the rod
                static_pa = (source_pa * other_m2 + sign * (rod_n - float(params["weight_n"]))) / own_m2
                static_pa = max(static_pa, source_pa)
                allowed_pa = _compressed_pa(static_pa, float(row[4 + end]), float(row[6]), exponent)
                found.append((row[1 + 2 * end] / allowed_pa, f"{name} {_LINES[end]} chamber"))
                found.append((row[2 * end] / max(source_pa, row[1 + 2 * end]), f"{name} {_LINES[end]} tube"))
                if name == "claws":
                    worst_claw_pa = max(worst_claw_pa, row[2 * end])
                else:
                    worst_main_pa = max(worst_main_pa, row[2 * end])
        full_pa = ATMOSPHERE_PA + machine.supply.compressor_off_pa
        allowed = {"header": worst_main_pa, "manifold": worst_main_pa, "claw_manifold": worst_claw_pa}
        for store, pressure_pa in zip(STORES, stores_pa, strict=True):
            found.append((float(pressure_pa) / allowed.get(store, full_pa), store))
        return max(found)


_LINES: Final = ("plus", "minus")


def _compressed_pa(static_pa: float, least_m3: float, energy_j: float, exponent: float) -> float:
    """Return the pressure to which kinetic energy and a constant pressure compress air into its least volume.

    From the static pressure, the air takes up the kinetic energy and the work of the static pressure on it.
    """
    if not math.isfinite(least_m3):
        return static_pa
    n = max(exponent, 1.0 + 1e-6)
    low, high = 1.0, 1e4
    for _ in range(60):
        ratio = math.sqrt(low * high)
        first_m3 = least_m3 * ratio ** (1 / n)
        taken_j = static_pa * (ratio * least_m3 - first_m3) / (n - 1) - static_pa * (first_m3 - least_m3)
        low, high = (ratio, high) if taken_j < energy_j else (low, ratio)
    return static_pa * low


def _balance_j(machine: Any) -> float:
    """Return the energy of all air, less heat received plus work done, J; outside air by its enthalpy."""
    network, arm = machine["air"]["network"], machine["arms"][0]
    chambers = [network[name] for name in STORES]
    chambers += [
        arm[name][line][part]
        for name in ("slide", "lift", "claws")
        for line in _LINES
        for part in ("tube", "chamber", "cushion")
    ]
    inside = sum(float(c["energy_j"]) - float(c["heat_j"]) + float(c["work_j"]) for c in chambers)
    return inside + float(network["outside"]["energy_j"])


@compiled_and_cached
def _drive(
    machine: Any,
    all_params: Any,
    coils: Any,
    fed: bool,
    steps: int,
    phase: int,
    ends_m: Any,
    strokes_s: Any,
    stops: Any,
    seen: Any,
    stores_pa: Any,
    kelvin: Any,
) -> None:
    """Step supply and cylinders with constant coils and update all extremes."""
    s, arm = machine[0].air.network, machine[0].arms[0]
    params, gas = all_params[0].arms[0], all_params[0].gas
    supply_params = all_params[0].air.network
    for step in range(steps):
        moved = (arm.slide.speed_m_s != 0.0, arm.lift.speed_m_s != 0.0, arm.claws.speed_m_s != 0.0)
        before_m = (arm.slide.position_m, arm.lift.position_m, arm.claws.position_m)
        step_supply(s, supply_params, fed, gas)
        step_cylinder(arm.lift, params.lift, coils[1, 0], coils[1, 1], s.manifold, s.outside, gas)
        step_cylinder(arm.slide, params.slide, coils[0, 0], coils[0, 1], s.manifold, s.outside, gas)
        step_cylinder(arm.claws, params.claws, coils[2, 0], coils[2, 1], s.claw_manifold, s.outside, gas)
        settle_cylinder(arm.lift, params.lift, gas)
        settle_cylinder(arm.slide, params.slide, gas)
        settle_cylinder(arm.claws, params.claws, gas)
        settle_supply(s, supply_params, gas)
        _watch_store(s.receiver, stores_pa, 0, kelvin)
        _watch_store(s.header, stores_pa, 1, kelvin)
        _watch_store(s.manifold, stores_pa, 2, kelvin)
        _watch_store(s.claw_reservoir, stores_pa, 3, kelvin)
        _watch_store(s.claw_manifold, stores_pa, 4, kelvin)
        _watch(arm.slide, params.slide, seen[0], kelvin)
        _watch(arm.lift, params.lift, seen[1], kelvin)
        _watch(arm.claws, params.claws, seen[2], kelvin)
        if phase < len(ends_m) and strokes_s[phase] > 1e9:
            after_m = (arm.slide.position_m, arm.lift.position_m, arm.claws.position_m)
            at_m, from_m, to_m = ends_m[phase], before_m[phase // 2], after_m[phase // 2]
            if moved[phase // 2] and from_m == to_m:
                stops[phase] += 1
            if (from_m < at_m) != (to_m < at_m):
                strokes_s[phase] = gas.step_s * (step + (at_m - from_m) / (to_m - from_m))


@compiled
def _watch_store(c: Any, stores_pa: Any, number: int, kelvin: Any) -> None:
    stores_pa[number] = max(stores_pa[number], c.pressure_pa)
    _watch_kelvin(c, kelvin, 0)


@compiled
def _watch_kelvin(c: Any, kelvin: Any, first: int) -> None:
    if not c.temperature_k >= kelvin[first]:
        kelvin[first] = c.temperature_k
    if not c.temperature_k <= kelvin[first + 1]:
        kelvin[first + 1] = c.temperature_k


@compiled
def _watch(c: Any, params: Any, seen: Any, kelvin: Any) -> None:
    seen[0] = max(seen[0], c.plus.tube.pressure_pa)
    seen[1] = max(seen[1], c.plus.chamber.pressure_pa)
    seen[2] = max(seen[2], c.minus.tube.pressure_pa)
    seen[3] = max(seen[3], c.minus.chamber.pressure_pa)
    seen[4] = min(seen[4], c.plus.chamber.volume_m3)
    seen[5] = min(seen[5], c.minus.chamber.volume_m3)
    kinetic_j = 0.5 * params.load_kg * c.speed_m_s**2 + 0.5 * params.piston_kg * c.piston_m_s**2
    seen[6] = max(seen[6], kinetic_j)
    _watch_kelvin(c.plus.tube, kelvin, 0)
    _watch_kelvin(c.plus.chamber, kelvin, 0)
    _watch_kelvin(c.minus.tube, kelvin, 0)
    _watch_kelvin(c.minus.chamber, kelvin, 0)
    if c.plus.cushion.volume_m3 > 0.0:
        _watch_kelvin(c.plus.cushion, kelvin, 2)
    if c.minus.cushion.volume_m3 > 0.0:
        _watch_kelvin(c.minus.cushion, kelvin, 2)
