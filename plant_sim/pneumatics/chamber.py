"""Air volumes. The air mass is a state variable, so mass is conserved exactly."""

from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled, compiled_and_cached, inlined
from plant_sim.common.lanes import lanes, select, unpacked
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, GAS_CONSTANT, HEAT_P, HEAT_V, REFERENCE_K, flow, flows

CHAMBER = np.dtype(
    [
        ("mass_kg", "f8"),
        ("temperature_k", "f8"),
        ("volume_m3", "f8"),
        ("pressure_pa", "f8"),
        ("stiffness", "f8"),
        ("density_kg_m3", "f8"),
        ("energy_j", "f8"),
        ("heat_j", "f8"),
        ("work_j", "f8"),
    ]
)
"""State of a chamber.

`stiffness` is the pressure rise per kilogram of air at the temperature of the chamber, Pa/kg; `energy_j` is the
internal energy. `heat_j` and `work_j` are the heat received from the wall and the work done on the piston since the
start.
"""

GAS = np.dtype([("exponent", "f8"), ("wall_s", "f8"), ("thermal", "i8"), ("wall_w_m2_k", "f8"), ("step_s", "f8")])
"""Gas model common to all chambers.

With `thermal` 0 the temperature follows the density with the polytropic `exponent` and relaxes to the wall temperature
with the time constant `wall_s`; the heat is what closes the energy balance. With `thermal` 1 the temperature follows
the energy balance, with the heat transfer coefficient `wall_w_m2_k`.
"""

WALL = np.dtype([("m2", "f8"), ("per_m3", "f8")])
"""Area of the wall of a chamber, m2: that at volume 0, plus its increase per volume, m2/m3."""

_ROUNDING = 1e-12
"""Upper limit of the rounding error of a `_nonlinear_share`, times the relative pressure rise."""


@compiled_and_cached
def fill(c: Any, volume_m3: float, pressure_pa: float, gas: Any) -> None:
    """Set a chamber to a pressure at ambient temperature."""
    c.volume_m3 = volume_m3
    c.temperature_k = REFERENCE_K
    c.pressure_pa = pressure_pa
    c.mass_kg = pressure_pa * volume_m3 / (GAS_CONSTANT * REFERENCE_K)
    c.density_kg_m3 = c.mass_kg / volume_m3
    c.stiffness = gas.exponent * GAS_CONSTANT * REFERENCE_K / volume_m3
    c.energy_j = c.mass_kg * HEAT_V * REFERENCE_K
    c.heat_j = c.work_j = 0.0


@compiled_and_cached
def set_ambient(c: Any) -> None:
    """Initialise a chamber as the ambient air: constant pressure, and balances of mass and energy that start at 0."""
    c.volume_m3 = 1.0
    c.temperature_k = REFERENCE_K
    c.pressure_pa = ATMOSPHERE_PA
    c.mass_kg = 0.0
    # no amount of air changes the ambient pressure
    c.stiffness = 0.0
    c.energy_j = c.heat_j = c.work_j = 0.0
    c.density_kg_m3 = ATMOSPHERE_PA / (GAS_CONSTANT * REFERENCE_K)


@compiled
def exchange(a: Any, b: Any, conductance_m3_s_pa: float, critical_ratio: float, gas: Any) -> float:
    """Exchange air through a restriction between two chambers for one step; return the mass that left `a`, kg.

    The flow is linearly implicit in both pressures and limited to the mass that equalises them. It therefore settles
    without overshoot for any volume, and mass is conserved. Source: docs/sources/plant.md 3.3, 3.4.
    """
    if conductance_m3_s_pa <= 0.0:
        return 0.0
    if a.pressure_pa < b.pressure_pa:
        return -_pass(b, a, b.pressure_pa, conductance_m3_s_pa, critical_ratio, gas)
    return _pass(a, b, a.pressure_pa, conductance_m3_s_pa, critical_ratio, gas)


@compiled
def check(a: Any, b: Any, crack_pa: float, conductance_m3_s_pa: float, critical_ratio: float, gas: Any) -> float:
    """Pass air from `a` to `b` through a check valve with a cracking pressure for one step; return the mass, kg."""
    if conductance_m3_s_pa <= 0.0 or a.pressure_pa - crack_pa <= b.pressure_pa:
        return 0.0
    return _pass(a, b, a.pressure_pa - crack_pa, conductance_m3_s_pa, critical_ratio, gas)


@compiled
def _pass(up: Any, down: Any, up_pa: float, conductance_m3_s_pa: float, critical_ratio: float, gas: Any) -> float:
    kg_s, grows, falls = flow(up_pa, down.pressure_pa, conductance_m3_s_pa, critical_ratio, up.temperature_k)
    down_stiffness = down.stiffness * _warmth(up.temperature_k, down.temperature_k, gas)
    turns = gas.step_s * (grows * up.stiffness + falls * down_stiffness)
    mass_kg: float = gas.step_s * kg_s * implicit_factor(turns)
    # the mass that equalises the pressures: a step may reach it but not pass it (docs/sources/plant.md 3.3)
    levels_kg = (up_pa - down.pressure_pa) / (up.stiffness + down_stiffness)
    if gas.thermal != 0:
        mass_kg = min(mass_kg, levels_kg)
    # the share exceeds 0.2 for every pressure rise that occurs, so most steps compute neither a bound nor a power
    elif mass_kg > 0.2 * levels_kg and not _is_below_any_share(down, mass_kg, levels_kg):
        mass_kg = min(mass_kg, levels_kg * _nonlinear_share(down, levels_kg))
    move(up, down, mass_kg, gas)
    return mass_kg


@inlined
def implicit_share(turns: Any) -> Any:
    """Return the weight of the end of the step in a linearly implicit flow.

    `turns` is the relative change of the flow in a step if the pressures followed it explicitly. The weight is a half,
    of second order in the step, for slow changes, and tends to 1 for fast ones, which must not overshoot. It is not
    less than that of an exponential decay, 1 / (1 - exp(-turns)) - 1 / turns.
    """
    return (1.0 + turns) / (2.0 + turns)


@inlined
def implicit_factor(turns: float) -> float:
    """Return the mean of a flow in a step relative to its start: 1 / (1 + implicit_share(turns) turns)."""
    return (2.0 + turns) / (2.0 + turns * (2.0 + turns))


@inlined
def _is_below_any_share(c: Any, mass_kg: float, levels_kg: float) -> bool:
    """Return True if a mass is certainly below `levels_kg` times its `_nonlinear_share`, without computing a power.

    By Taylor's theorem, the share is at least 1 - grows / 2 for any exponent. Its rounding error is at most
    2^-53 (1 + exponent) 2 / grows, which is less than `_ROUNDING` / grows for exponents up to 1000; that of air is 1.2.
    """
    grows = c.stiffness * levels_kg / c.pressure_pa
    return bool(0.0 < grows < 1.0) and bool(
        (levels_kg - mass_kg) * grows > levels_kg * (0.5 * grows * grows + _ROUNDING)
    )


@compiled
def _nonlinear_share(c: Any, mass_kg: float) -> float:
    """Return the fraction of `mass_kg` that gives the pressure rise predicted from the initial stiffness."""
    grows = c.stiffness * mass_kg / c.pressure_pa
    if grows <= 0.0:
        return 1.0
    exponent = c.stiffness * c.mass_kg / c.pressure_pa
    share: float = ((1.0 + grows) ** (1.0 / exponent) - 1.0) * exponent / grows
    return share


@inlined
def move(a: Any, b: Any, mass_kg: float, gas: Any) -> None:
    """Transfer air with its enthalpy from `a` to `b`; a negative mass is transferred from `b` to `a`.

    Where air passes through several chambers in a step, the transfers must be made in the direction of the flow.
    """
    if gas.thermal == 0:
        heat_j = HEAT_P * mass_kg * (a.temperature_k if mass_kg > 0.0 else b.temperature_k)
        a.mass_kg -= mass_kg
        a.pressure_pa -= a.stiffness * mass_kg
        a.energy_j -= heat_j
        b.mass_kg += mass_kg
        b.pressure_pa += b.stiffness * mass_kg
        b.energy_j += heat_j
    elif mass_kg > 0.0:
        _move_implicitly(a, b, mass_kg)
    else:
        _move_implicitly(b, a, -mass_kg)


@compiled
def _move_implicitly(up: Any, down: Any, mass_kg: float) -> None:
    """Transfer air whose temperature is that of the upstream chamber after the transfer.

    The temperatures of both chambers remain positive and bounded by those of the air they receive, however many times
    the content of a chamber flows through it in a step.
    """
    heat_j = HEAT_P * mass_kg
    if up.stiffness > 0.0:
        # temperature after the transfer: the solution T of energy - HEAT_P moved T = HEAT_V remaining T
        heat_j *= up.energy_j / (HEAT_V * (up.mass_kg - mass_kg) + HEAT_P * mass_kg)
    else:
        heat_j *= up.temperature_k  # the ambient air
    down.pressure_pa += down.stiffness * mass_kg * up.temperature_k / down.temperature_k
    down.mass_kg += mass_kg
    down.energy_j += heat_j
    up.pressure_pa -= up.stiffness * mass_kg
    up.mass_kg -= mass_kg
    up.energy_j -= heat_j


@inlined
def _warmth(up_k: Any, own_k: Any, gas: Any) -> Any:
    """Return the factor by which the temperature of the air it receives changes the stiffness of a chamber.

    According to the energy balance, the pressure rise is proportional to the enthalpy received. A polytropic change
    depends only on the density.
    """
    return up_k / own_k if gas.thermal != 0 else 1.0


@inlined
def flows_and_slopes(
    a_pa: Any, b_pa: Any, a_k: Any, b_k: Any, crack_pa: Any, conductance_m3_s_pa: Any, critical_ratio: Any
) -> tuple[Any, Any, Any]:
    """Return four flows from chambers a to chambers b, kg/s, and their derivatives, kg/(s Pa).

    All arguments and results are lanes. The derivatives are those with respect to the pressures of a and of b, the
    latter with its sign reversed. A flow from b to a is negative. From a to b, a restriction opens only above its
    cracking pressure.

    Args:
        a_pa: Pressures of a, Pa.
        b_pa: Pressures of b, Pa.
        a_k: Temperatures of a, K.
        b_k: Temperatures of b, K.
        crack_pa: Cracking pressures, Pa.
        conductance_m3_s_pa: Sonic conductances, m3/(s Pa).
        critical_ratio: Critical pressure ratios.
    """
    opened_pa = a_pa - crack_pa
    onward = opened_pa > b_pa
    kg_s, grows, falls = flows(
        select(onward, opened_pa, b_pa),
        select(onward, b_pa, a_pa),
        conductance_m3_s_pa,
        critical_ratio,
        select(onward, a_k, b_k),
    )
    shut = (conductance_m3_s_pa <= 0.0) | ((opened_pa <= b_pa) & (a_pa >= b_pa))
    return (
        select(shut, 0.0, select(onward, kg_s, -kg_s)),
        select(shut, 0.0, select(onward, grows, falls)),
        select(shut, 0.0, select(onward, falls, grows)),
    )


@inlined
def resize(c: Any, volume_m3: float, gas: Any) -> None:
    """Change the volume of a chamber by moving its piston."""
    if volume_m3 == c.volume_m3:
        return
    before_m3 = c.volume_m3
    # implicit midpoint rule of dp/p = -n dV/V: moving the piston back restores the pressure (docs/sources/plant.md 1.2)
    half = 0.5 * gas.exponent * (before_m3 - volume_m3)
    middle_m3 = 0.5 * (before_m3 + volume_m3)
    pressure_pa = c.pressure_pa * (middle_m3 + half) / (middle_m3 - half)
    work_j = 0.5 * (c.pressure_pa + pressure_pa) * (volume_m3 - before_m3)
    c.energy_j -= work_j
    c.work_j += work_j
    c.pressure_pa = pressure_pa
    c.volume_m3 = volume_m3
    c.stiffness = gas.exponent * pressure_pa / c.mass_kg


@compiled
def settle(c: Any, wall: Any, gas: Any) -> None:
    """Finish a step: update temperature, pressure and stiffness from mass, volume and energy."""
    density_kg_m3 = c.mass_kg / c.volume_m3
    if gas.thermal == 0:
        temperature_k = _polytropic_k(c.temperature_k, c.density_kg_m3, density_kg_m3, gas)
    else:
        wall_j_k = gas.wall_w_m2_k * (wall.m2 + wall.per_m3 * c.volume_m3) * gas.step_s
        # implicit in the temperature, so that an almost empty chamber does not overshoot the wall
        temperature_k = (c.energy_j + wall_j_k * REFERENCE_K) / (c.mass_kg * HEAT_V + wall_j_k)
    c.temperature_k = temperature_k
    c.density_kg_m3 = density_kg_m3
    c.pressure_pa = density_kg_m3 * GAS_CONSTANT * temperature_k
    c.stiffness = gas.exponent * GAS_CONSTANT * temperature_k / c.volume_m3
    energy_j = c.mass_kg * HEAT_V * temperature_k
    c.heat_j += energy_j - c.energy_j
    c.energy_j = energy_j


@inlined
def settle_four(a: Any, b: Any, c: Any, d: Any, gas: Any) -> None:
    """Finish a step of four chambers with polytropic air, as `settle` does for each of them."""
    mass_kg = lanes(a.mass_kg, b.mass_kg, c.mass_kg, d.mass_kg)
    volume_m3 = lanes(a.volume_m3, b.volume_m3, c.volume_m3, d.volume_m3)
    before_k = lanes(a.temperature_k, b.temperature_k, c.temperature_k, d.temperature_k)
    before_kg_m3 = lanes(a.density_kg_m3, b.density_kg_m3, c.density_kg_m3, d.density_kg_m3)
    before_j = lanes(a.energy_j, b.energy_j, c.energy_j, d.energy_j)
    density_kg_m3 = mass_kg / volume_m3
    temperature_k = _polytropic_k(before_k, before_kg_m3, density_kg_m3, gas)
    pressure_pa = density_kg_m3 * GAS_CONSTANT * temperature_k
    stiffness = gas.exponent * GAS_CONSTANT * temperature_k / volume_m3
    energy_j = mass_kg * HEAT_V * temperature_k
    heat_j = lanes(a.heat_j, b.heat_j, c.heat_j, d.heat_j) + (energy_j - before_j)
    a.temperature_k, b.temperature_k, c.temperature_k, d.temperature_k = unpacked(temperature_k)
    a.density_kg_m3, b.density_kg_m3, c.density_kg_m3, d.density_kg_m3 = unpacked(density_kg_m3)
    a.pressure_pa, b.pressure_pa, c.pressure_pa, d.pressure_pa = unpacked(pressure_pa)
    a.stiffness, b.stiffness, c.stiffness, d.stiffness = unpacked(stiffness)
    a.energy_j, b.energy_j, c.energy_j, d.energy_j = unpacked(energy_j)
    a.heat_j, b.heat_j, c.heat_j, d.heat_j = unpacked(heat_j)


@inlined
def _polytropic_k(before_k: Any, before_kg_m3: Any, density_kg_m3: Any, gas: Any) -> Any:
    """Return the temperature after a change of density and the heat exchange with the wall during a step."""
    # (rho/rho_before)^(n-1) as a quotient: second-order accurate, and cheaper than a power
    turn = (gas.exponent - 1.0) * (density_kg_m3 - before_kg_m3) / (density_kg_m3 + before_kg_m3)
    temperature_k = before_k * (1.0 + turn) / (1.0 - turn)
    return temperature_k + (REFERENCE_K - temperature_k) * gas.step_s / (gas.wall_s + gas.step_s)
