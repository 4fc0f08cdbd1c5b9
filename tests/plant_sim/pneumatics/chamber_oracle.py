"""Chambers and flows of the reference model of the pneumatics, in plain Python: slow, readable, and independent.

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
            name: read(hints[name], record[name]) if record.dtype[name].names else record[name].tolist()
            for name in record.dtype.names
        }
    )


def values(state: Any) -> list[float]:
    """Return all numbers of a state, depth first, in the order of its fields."""
    parts = state if isinstance(state, list) else [getattr(state, field.name) for field in fields(state)]
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
    heat_j: float
    work_j: float

    def gain(self, mass_kg: float, heat_j: float, kelvin: float | None = None) -> None:
        """Add or remove air with its enthalpy; `kelvin` is its temperature if the pressure depends on it."""
        self.mass_kg += mass_kg
        self.pressure_pa += mass_kg * self.rise(kelvin)
        self.energy_j += heat_j

    def rise(self, kelvin: float | None) -> float:
        """Return the pressure rise per mass of air of a temperature, Pa/kg; None if it does not matter."""
        return self.stiffness * (1.0 if kelvin is None else kelvin / self.temperature_k)

    def resize(self, volume_m3: float, gas: Any) -> None:
        """Change the volume: integrate dp/dV = -n p/V by the trapezoidal rule, and account for the work done."""
        n, before_pa, grown_m3 = gas.exponent, self.pressure_pa, volume_m3 - self.volume_m3
        if grown_m3 == 0.0:
            return
        strain = grown_m3 / (self.volume_m3 + volume_m3)
        self.pressure_pa = before_pa * (1 - n * strain) / (1 + n * strain)
        done_j = (before_pa + self.pressure_pa) / 2 * grown_m3
        self.energy_j -= done_j
        self.work_j += done_j
        self.volume_m3 = volume_m3
        self.stiffness = n * self.pressure_pa / self.mass_kg

    def settle(self, wall: Any, gas: Any) -> None:
        """Complete a step: compute the new temperature and the resulting pressure."""
        density_kg_m3 = self.mass_kg / self.volume_m3
        if gas.thermal:
            walls_j_k = gas.wall_w_m2_k * (wall.m2 + wall.per_m3 * self.volume_m3) * gas.step_s
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
        before_j, self.energy_j = self.energy_j, self.mass_kg * HEAT_V * self.temperature_k
        self.heat_j += self.energy_j - before_j


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


def move(a: Chamber, b: Chamber, mass_kg: float, gas: Any) -> None:
    """Transfer air and its heat from `a` to `b`, or from `b` to `a` if the mass is negative.

    According to the energy balance, the air has the temperature that the upstream chamber has after the transfer:
    T' = E / (m' cv + mass cp), from E - mass cp T' = m' cv T'.
    """
    if mass_kg < 0:
        move(b, a, -mass_kg, gas)
        return
    kelvin = a.temperature_k
    if gas.thermal and a.stiffness > 0:
        kelvin = a.energy_j / ((a.mass_kg - mass_kg) * HEAT_V + mass_kg * HEAT_P)
    own_k = a.temperature_k if gas.thermal else None
    b.gain(mass_kg, mass_kg * HEAT_P * kelvin, own_k)
    a.gain(-mass_kg, -mass_kg * HEAT_P * kelvin)


def weight(turns: float) -> float:
    """Return the weight of the end of the step: 1/2 for slow changes, 1 for fast ones."""
    return 1 - 1 / (2 + turns)


def transfer(up: Chamber, down: Chamber, up_pa: float, conductance: float, critical: float, gas: Any) -> float:
    """Pass air through one restriction in one Newton step, limited to the mass that makes both pressures equal."""
    kg_s, by_up, by_down = tendency(up, down, up_pa, conductance, critical)
    rise = down.rise(up.temperature_k if gas.thermal else None)
    turns = gas.step_s * (by_up * up.stiffness - by_down * rise)
    mass_kg: float = gas.step_s * kg_s / (1 + weight(turns) * turns)
    levels_kg = (up_pa - down.pressure_pa) / (up.stiffness + rise)
    if gas.thermal:
        mass_kg = min(mass_kg, levels_kg)
    elif mass_kg > 0.2 * levels_kg:
        most_kg = levels_kg
        if down.stiffness > 0:
            # mass that fills the chamber to that pressure along p ~ m^n
            exponent = down.stiffness * down.mass_kg / down.pressure_pa
            full = (down.pressure_pa + down.stiffness * levels_kg) / down.pressure_pa
            most_kg = down.mass_kg * (full ** (1 / exponent) - 1)
        mass_kg = min(mass_kg, most_kg)
    move(up, down, mass_kg, gas)
    return mass_kg


def both_ways(a: Chamber, b: Chamber, conductance: float, critical: float, gas: Any) -> float:
    """Pass air towards the lower pressure; return the mass that left `a`, kg."""
    if conductance <= 0.0:
        return 0.0
    if a.pressure_pa >= b.pressure_pa:
        return transfer(a, b, a.pressure_pa, conductance, critical, gas)
    return -transfer(b, a, b.pressure_pa, conductance, critical, gas)


def one_way(a: Chamber, b: Chamber, crack_pa: float, conductance: float, critical: float, gas: Any) -> None:
    """Pass air from `a` to `b` through a check valve."""
    if conductance > 0.0 and a.pressure_pa - crack_pa > b.pressure_pa:
        transfer(a, b, a.pressure_pa - crack_pa, conductance, critical, gas)


def series(first: tuple[float, float], second: tuple[float, float]) -> tuple[float, float]:
    """Return conductance and critical ratio of two restrictions (C, b) in the order of the flow.

    With x = p_between / p_up, the choked flow satisfies C1 shape(x) = C2 x; it is found by bisection. The critical
    ratio is that of the ellipse through the flow at the middle between x and 1.
    """
    (c1, b1), (c2, b2) = first, second
    if c1 <= 0 or c2 <= 0:
        return 0.0, b1

    def passes(x: float) -> float:
        return c1 * (1.0 if x <= b1 else shape(x, b1)[0])

    if c2 * b1 >= c1:
        between, choked = b1, c1
    else:
        low, high = b1, 1.0
        for _ in range(200):
            between = (low + high) / 2
            low, high = (between, high) if passes(between) > c2 * between else (low, between)
        choked = c2 * between
    x = (1 + between) / 2
    flow = passes(x)
    overall = x * (b2 + (1 - b2) * math.sqrt(max(1 - (flow / (c2 * x)) ** 2, 0)))
    past = math.sqrt(max(1 - (flow / choked) ** 2, 0))
    return choked, max((overall - past) / (1 - past), 0)
