"""Test rig for cylinders and their air: inputs are the coil levels, outputs the states of every step."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.common.compiled import compiled_and_cached
from plant_sim.common.lanes import lanes, pair, unpacked
from plant_sim.common.parameter_file import Value
from plant_sim.devices.pneumatic import place_cylinder, vent_tubes
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.pneumatics.chamber import GAS, exchange, fill, resize, set_ambient, settle
from plant_sim.pneumatics.cylinder import CYLINDER, CYLINDER_PARAMS, is_at_rest, settle_cylinder, step_cylinder
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, flow, flows, in_series
from plant_sim.pneumatics.supply import SUPPLY, SUPPLY_PARAMS, settle_supply, step_supply

IO_MAP = load_io_map(DEFAULT_IO_MAP)
MACHINE = load_machine()

SLIDE, LIFT, CLAWS = range(3)
"""Index of each cylinder of an arm on the rig."""

PLUS, MINUS, OFF = (True, False), (False, True), (False, False)
"""Coil levels of one cylinder."""

NO_HEAT_S = 1e12
"""Wall time constant for which air exchanges practically no heat, s."""


@dataclass(frozen=True)
class Trace:
    """Recorded states.

    Attributes:
        cylinders: `CYLINDER` records, one row per recorded step and one column per cylinder.
        supply: `SUPPLY` records, one per recorded step.
    """

    cylinders: NDArray[Any]
    supply: NDArray[Any]


class Rig:
    """Supply with some cylinders.

    Attributes:
        gas: `GAS` record, as an array of one element.
        supply: `SUPPLY` record, as an array of one element.
        supply_params: `SUPPLY_PARAMS` record, as an array of one element.
        cylinders: `CYLINDER` records, one per cylinder.
        all_params: `CYLINDER_PARAMS` records, one per cylinder.
        ideal: True if the manifold pressure is constant regardless of consumption.
    """

    def __init__(self, cylinders: int, *, ideal: bool, step_s: float = 0.001) -> None:
        self.gas = np.zeros(1, GAS)
        self.gas[0] = (1.2, MACHINE.air.wall_time_s, 0, 0.0, step_s)
        self.supply, self.supply_params = np.zeros(1, SUPPLY), np.zeros(1, SUPPLY_PARAMS)
        self.cylinders, self.all_params = np.zeros(cylinders, CYLINDER), np.zeros(cylinders, CYLINDER_PARAMS)
        self.ideal = ideal
        set_ambient(self.supply[0]["outside"])
        set_ambient(self.supply[0]["manifold"])

    @property
    def step_s(self) -> float:
        """Length of a step, s."""
        return float(self.gas[0]["step_s"])

    def feed(self, gauge_pa: float) -> None:
        """Set the pressure of an ideal manifold."""
        set_ambient(self.supply[0]["manifold"])
        self.supply[0]["manifold"]["pressure_pa"] = ATMOSPHERE_PA + gauge_pa

    def run(self, for_s: float, coils: Any = OFF, *, fed: Any = True, every: int = 1, skip_rest: bool = False) -> Trace:
        """Drive the coils and return the recorded states.

        Args:
            for_s: Duration, s.
            coils: Levels (plus, minus) for all cylinders, one pair per cylinder, or pairs for each step.
            fed: True if the relay energises the dump valve; one value or one per step.
            every: Number of steps per recorded step.
            skip_rest: True to skip cylinders at rest, as the kernel does.
        """
        steps, count = round(for_s / self.step_s), len(self.cylinders)
        every_coil = np.ascontiguousarray(np.broadcast_to(np.asarray(coils, np.bool_), (steps, count, 2)))
        every_fed = np.ascontiguousarray(np.broadcast_to(np.asarray(fed, np.bool_), (steps,)))
        flat_cylinders, flat_supply = self.cylinders.view("f8"), self.supply.view("f8")
        seen_cylinders = np.empty((steps // every, flat_cylinders.size))
        seen_supply = np.empty((steps // every, flat_supply.size))
        _drive(
            self.supply,
            self.supply_params,
            self.cylinders,
            self.all_params,
            self.gas,
            every_coil,
            every_fed,
            self.ideal,
            skip_rest,
            flat_cylinders,
            flat_supply,
            seen_cylinders,
            seen_supply,
            every,
        )
        return Trace(seen_cylinders.view(CYLINDER), seen_supply.view(SUPPLY)[:, 0])

    def air_kg(self) -> float:
        """Total air mass, kg: in every chamber, plus exhausted air less intake."""
        network, lines = self.supply[0], [self.cylinders["plus"], self.cylinders["minus"]]
        inside = sum(float(line[part]["mass_kg"].sum()) for line in lines for part in ("tube", "chamber", "cushion"))
        names = ("receiver", "header", "manifold", "claw_reservoir", "claw_manifold", "outside")
        return inside + sum(float(network[name]["mass_kg"]) for name in names)


@compiled_and_cached
def _drive(
    supply: Any,
    supply_params: Any,
    cylinders: Any,
    all_params: Any,
    gas: Any,
    coils: Any,
    fed: Any,
    ideal: bool,
    skip_rest: bool,
    flat_cylinders: Any,
    flat_supply: Any,
    seen_cylinders: Any,
    seen_supply: Any,
    every: int,
) -> None:
    """Step the supply and the cylinders as the kernel does, then settle the supply; cylinder 3 uses claw air."""
    s, air = supply[0], gas[0]
    for step in range(len(fed)):
        if not ideal:
            step_supply(s, supply_params[0], fed[step], air)
        for number in range(len(cylinders)):
            manifold = s.claw_manifold if number == 2 else s.manifold
            c, params, plus, minus = (
                cylinders[number],
                all_params[number],
                coils[step, number, 0],
                coils[step, number, 1],
            )
            if not (skip_rest and is_at_rest(c, params, plus, minus, manifold)):
                step_cylinder(c, params, plus, minus, manifold, s.outside, air)
                settle_cylinder(c, params, air)
        if not ideal:
            settle_supply(s, supply_params[0], air)
        if (step + 1) % every == 0:
            row = (step + 1) // every - 1
            seen_cylinders[row] = flat_cylinders
            seen_supply[row] = flat_supply


def machine_bench(values: dict[str, Value] | None = None, *, step_s: float | None = None) -> Rig:
    """Return slide, lift and claws of one arm with the supply of the machine, in the state after a normal stop.

    Args:
        values: Parameters that differ from ``machine.yaml``, by dotted name.
        step_s: Length of a step, s; None for that of the machine.
    """
    machine = MACHINE.with_values(values or {})
    plant = Plant(IO_MAP, machine, seed=1)
    step_s = machine.step_s if step_s is None else step_s
    state, params = plant.state[0], plant.params[0]
    rig = Rig(3, ideal=False, step_s=step_s)
    rig.gas[0] = params["gas"]
    rig.gas[0]["step_s"] = step_s
    rig.supply[0], rig.supply_params[0] = state["air"]["network"], params["air"]["network"]
    for number, name in enumerate(("slide", "lift", "claws")):
        rig.cylinders[number], rig.all_params[number] = state["arms"][0][name], params["arms"][0][name]
    return rig


def textbook_bench(
    bore_m: float,
    rod_m: float = 0.0,
    *,
    stroke_m: float = 1.0,
    load_kg: float = 10.0,
    throttle_m3_s_pa: float = 1e-7,
    step_s: float = 0.001,
) -> Rig:
    """Return a rig with an ideal supply, wide lines and one rigid, frictionless cylinder, vented and at position 0.

    Args:
        bore_m: Bore, m.
        rod_m: Diameter of the rod, m.
        stroke_m: Stroke, m.
        load_kg: Moving mass, kg.
        throttle_m3_s_pa: Conductance of the meter-out throttles, m3/(s Pa).
        step_s: Length of a step, s.
    """
    rig = Rig(1, ideal=True, step_s=step_s)
    params = rig.all_params[0]
    params["stroke_m"], params["load_kg"] = stroke_m, load_kg
    params["plus_area_m2"] = np.pi / 4 * bore_m**2
    params["minus_area_m2"] = np.pi / 4 * (bore_m**2 - rod_m**2)
    params["friction"]["stribeck_m_s"] = 0.05
    valve = params["valve"]
    valve["spool_s"], valve["conductance_m3_s_pa"], valve["critical_ratio"] = 0.004, 1e-7, 0.3
    for line in (params["plus"], params["minus"]):
        line["tube_m3_s_pa"], line["tube_m3"], line["dead_m3"] = 1e-6, 20e-6, 40e-6
        line["tube_ratio"] = 0.3
        line["free_m3_s_pa"], line["throttle_m3_s_pa"], line["critical_ratio"] = 1e-7, throttle_m3_s_pa, 0.3
    put(rig, 0, 0.0, ATMOSPHERE_PA, ATMOSPHERE_PA)
    return rig


def put(rig: Rig, number: int, position_m: float, plus_pa: float, minus_pa: float) -> None:
    """Set a cylinder to a position at rest, with absolute chamber pressures and vented tubes."""
    c, params, gas = rig.cylinders[number], rig.all_params[number], rig.gas[0]
    place_cylinder(c, params, position_m, ATMOSPHERE_PA, gas)
    vent_tubes(c, params, gas)
    for line, pressure_pa in (("plus", plus_pa), ("minus", minus_pa)):
        for part in ("chamber", "cushion"):
            if c[line][part]["volume_m3"] > 0.0:
                fill(c[line][part], float(c[line][part]["volume_m3"]), pressure_pa, gas)


@compiled_and_cached
def flow_through(
    up_pa: float, down_pa: float, conductance_m3_s_pa: float, critical_ratio: float, up_k: float
) -> tuple[float, float, float]:
    """Return `flow`, which Python cannot call."""
    return flow(up_pa, down_pa, conductance_m3_s_pa, critical_ratio, up_k)


@compiled_and_cached
def four_flows(
    up_pa: float, down_pa: Any, conductance_m3_s_pa: float, critical_ratio: float, up_k: float, results: Any
) -> None:
    """Compute `flows` to four downstream pressures; `results` has a row for each and the columns of `flow`."""
    one = pair(1.0, 1.0)
    kg_s, grows, falls = flows(
        up_pa * one,
        lanes(down_pa[0], down_pa[1], down_pa[2], down_pa[3]),
        conductance_m3_s_pa * one,
        critical_ratio * one,
        up_k * one,
    )
    results[0, 0], results[1, 0], results[2, 0], results[3, 0] = unpacked(kg_s)
    results[0, 1], results[1, 1], results[2, 1], results[3, 1] = unpacked(grows)
    results[0, 2], results[1, 2], results[2, 2], results[3, 2] = unpacked(falls)


@compiled_and_cached
def nozzles_in_series(first_m3_s_pa: float, first_ratio: float, second_m3_s_pa: float, second_ratio: float) -> Any:
    """Return `in_series`, which Python cannot call."""
    return in_series(first_m3_s_pa, first_ratio, second_m3_s_pa, second_ratio)


@compiled_and_cached
def squeeze(chamber: Any, gas: Any, walls: Any, volumes_m3: Any) -> None:
    """Change the volume of a closed chamber (array of one) to each of the given volumes, one per step."""
    for volume_m3 in volumes_m3:
        resize(chamber[0], volume_m3, gas[0])
        settle(chamber[0], walls[0], gas[0])


@compiled_and_cached
def join(
    chambers: Any,
    gas: Any,
    walls: Any,
    conductance_m3_s_pa: float,
    critical_ratio: float,
    steps: int,
    endless: bool,
    seen_pa: Any,
) -> None:
    """Exchange air between two chambers; if `endless`, the first is constant. `seen_pa` records both pressures."""
    a, b, air, wall = chambers[0], chambers[1], gas[0], walls[0]
    for step in range(steps):
        exchange(a, b, conductance_m3_s_pa, critical_ratio, air)
        if not endless:
            settle(a, wall, air)
        settle(b, wall, air)
        seen_pa[step, 0] = a.pressure_pa
        seen_pa[step, 1] = b.pressure_pa
