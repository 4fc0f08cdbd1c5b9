"""A test bench for cylinders and their air: coils go in step by step, every state of every step comes out."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.io_map import DEFAULT_IO_MAP, load_io_map
from plant_sim.parameters import Value, load_machine
from plant_sim.plant import Plant
from plant_sim.pneumatics.chamber import GAS, exchange, fill, resize, settle, surroundings
from plant_sim.pneumatics.compiled import compiled_and_kept
from plant_sim.pneumatics.cylinder import CYLINDER, CYLINDER_MAKE, rests, step_cylinder
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.pneumatics.supply import SUPPLY, SUPPLY_MAKE, settle_supply, step_supply

IO_MAP = load_io_map(DEFAULT_IO_MAP)
MACHINE = load_machine()

#: Place of each cylinder of an arm on the bench.
SLIDE, LIFT, CLAWS = range(3)

#: Coils of one cylinder.
PLUS, MINUS, OFF = (True, False), (False, True), (False, False)

#: A wall so slow that air exchanges no heat with it, s.
NO_HEAT_S = 1e12


@dataclass(frozen=True)
class Trace:
    """What was seen.

    Attributes:
        cylinders: Records `CYLINDER`, one row a step seen, one column a cylinder.
        supply: Records `SUPPLY`, one a step seen.
    """

    cylinders: NDArray[Any]
    supply: NDArray[Any]


class Bench:
    """A supply and some cylinders.

    Attributes:
        gas: Record `GAS` in an array of one, as all of these.
        supply: Record `SUPPLY`.
        supply_make: Record `SUPPLY_MAKE`.
        cylinders: Records `CYLINDER`.
        makes: Records `CYLINDER_MAKE`.
        ideal: Whether the manifold keeps its pressure whatever is drawn from it.
    """

    def __init__(self, cylinders: int, *, ideal: bool, step_s: float = 0.001) -> None:
        self.gas = np.zeros(1, GAS)
        self.gas[0] = (1.2, MACHINE.air.wall_time_s, 0, 0.0, step_s)
        self.supply, self.supply_make = np.zeros(1, SUPPLY), np.zeros(1, SUPPLY_MAKE)
        self.cylinders, self.makes = np.zeros(cylinders, CYLINDER), np.zeros(cylinders, CYLINDER_MAKE)
        self.ideal = ideal
        surroundings(self.supply[0]["outside"])
        surroundings(self.supply[0]["manifold"])

    @property
    def step_s(self) -> float:
        """Length of a step, s."""
        return float(self.gas[0]["step_s"])

    def feed(self, gauge_pa: float) -> None:
        """Set the pressure of an ideal manifold."""
        surroundings(self.supply[0]["manifold"])
        self.supply[0]["manifold"]["pressure_pa"] = ATMOSPHERE_PA + gauge_pa

    def run(self, for_s: float, coils: Any = OFF, *, fed: Any = True, every: int = 1, skip_rest: bool = False) -> Trace:
        """Drive the coils.

        Args:
            for_s: For how long, s.
            coils: Levels (plus, minus) for all, or one pair a cylinder, or those for each step.
            fed: Whether the relay holds the dump valve, or that for each step.
            every: How many steps from one that is seen to the next.
            skip_rest: Whether cylinders at rest are left out, as the kernel does.
        """
        steps, count = round(for_s / self.step_s), len(self.cylinders)
        every_coil = np.ascontiguousarray(np.broadcast_to(np.asarray(coils, np.bool_), (steps, count, 2)))
        every_fed = np.ascontiguousarray(np.broadcast_to(np.asarray(fed, np.bool_), (steps,)))
        flat_cylinders, flat_supply = self.cylinders.view("f8"), self.supply.view("f8")
        seen_cylinders = np.empty((steps // every, flat_cylinders.size))
        seen_supply = np.empty((steps // every, flat_supply.size))
        _drive(
            self.supply, self.supply_make, self.cylinders, self.makes, self.gas, every_coil, every_fed, self.ideal,
            skip_rest, flat_cylinders, flat_supply, seen_cylinders, seen_supply, every,
        )  # fmt: skip
        return Trace(seen_cylinders.view(CYLINDER), seen_supply.view(SUPPLY)[:, 0])

    def air_kg(self) -> float:
        """All air there is, kg: in every chamber, and what went out less what came in."""
        network, lines = self.supply[0], [self.cylinders["plus"], self.cylinders["minus"]]
        inside = sum(float(line[part]["mass_kg"].sum()) for line in lines for part in ("tube", "chamber"))
        names = ("receiver", "header", "manifold", "claw_reservoir", "claw_manifold", "outside")
        return inside + sum(float(network[name]["mass_kg"]) for name in names)


@compiled_and_kept
def _drive(
    supply: Any, supply_make: Any, cylinders: Any, makes: Any, gas: Any, coils: Any, fed: Any, ideal: bool,
    skip_rest: bool, flat_cylinders: Any, flat_supply: Any, seen_cylinders: Any, seen_supply: Any, every: int,
) -> None:  # fmt: skip
    """Step as the kernel does: supply, cylinders, then the supply settles. The third cylinder takes claw air."""
    s, air = supply[0], gas[0]
    for step in range(len(fed)):
        if not ideal:
            step_supply(s, supply_make[0], fed[step], air)
        for number in range(len(cylinders)):
            manifold = s.claw_manifold if number == 2 else s.manifold
            c, make, plus, minus = cylinders[number], makes[number], coils[step, number, 0], coils[step, number, 1]
            if not (skip_rest and rests(c, make, plus, minus, manifold)):
                step_cylinder(c, make, plus, minus, manifold, s.outside, air)
        if not ideal:
            settle_supply(s, air)
        if (step + 1) % every == 0:
            row = (step + 1) // every - 1
            seen_cylinders[row] = flat_cylinders
            seen_supply[row] = flat_supply


def machine_bench(values: dict[str, Value] | None = None, *, step_s: float = 0.001) -> Bench:
    """Slide, lift and claws of one arm with the supply of the machine, as a normal stop leaves them.

    Args:
        values: Parameters that differ from those of ``machine.yaml``, by dotted name.
        step_s: Length of a step, s.
    """
    plant = Plant(IO_MAP, MACHINE.with_values(values or {}), seed=1)
    state, make = plant.state[0], plant.make[0]
    bench = Bench(3, ideal=False, step_s=step_s)
    bench.gas[0] = make["gas"]
    bench.gas[0]["step_s"] = step_s
    bench.supply[0], bench.supply_make[0] = state["air"]["network"], make["air"]["network"]
    for number, name in enumerate(("slide", "lift", "claws")):
        bench.cylinders[number], bench.makes[number] = state["arms"][0][name], make["arms"][0][name]
    return bench


def textbook_bench(
    bore_m: float,
    rod_m: float = 0.0,
    *,
    stroke_m: float = 1.0,
    load_kg: float = 10.0,
    throttle_m3_s_pa: float = 1e-7,
    step_s: float = 0.001,
) -> Bench:
    """One rigid cylinder without friction, with wide valves and lines, at an ideal manifold; vented, at 0.

    Args:
        bore_m: Bore, m.
        rod_m: Diameter of the rod, m.
        stroke_m: Stroke, m.
        load_kg: What moves, kg.
        throttle_m3_s_pa: Meter-out throttles, m3/(s Pa).
        step_s: Length of a step, s.
    """
    bench = Bench(1, ideal=True, step_s=step_s)
    make = bench.makes[0]
    make["stroke_m"], make["load_kg"], make["cushion_share"] = stroke_m, load_kg, 1.0
    make["plus_area_m2"] = np.pi / 4 * bore_m**2
    make["minus_area_m2"] = np.pi / 4 * (bore_m**2 - rod_m**2)
    make["friction"]["stribeck_m_s"] = 0.05
    valve = make["valve"]
    valve["spool_s"], valve["conductance_m3_s_pa"], valve["critical_ratio"] = 0.004, 1e-7, 0.3
    for line in (make["plus"], make["minus"]):
        line["tube_m3_s_pa"], line["tube_m3"], line["dead_m3"] = 1e-6, 20e-6, 40e-6
        line["free_m3_s_pa"], line["throttle_m3_s_pa"], line["critical_ratio"] = 1e-7, throttle_m3_s_pa, 0.3
    put(bench, 0, 0.0, ATMOSPHERE_PA, ATMOSPHERE_PA)
    return bench


def put(bench: Bench, number: int, position_m: float, plus_pa: float, minus_pa: float) -> None:
    """Put a cylinder at rest somewhere, its chambers at absolute pressures, its tubes vented."""
    c, make, gas = bench.cylinders[number], bench.makes[number], bench.gas[0]
    c["position_m"] = c["piston_m"] = position_m
    c["speed_m_s"] = c["piston_m_s"] = c["magnet_n"] = 0.0
    c["decoupled"] = 0
    ahead_m = float(make["stroke_m"]) - position_m
    for line, area_m2, long_m, pressure_pa in (
        ("plus", make["plus_area_m2"], position_m, plus_pa),
        ("minus", make["minus_area_m2"], ahead_m, minus_pa),
    ):
        fill(c[line]["chamber"], float(make[line]["dead_m3"]) + float(area_m2) * long_m, pressure_pa, gas)
        fill(c[line]["tube"], float(make[line]["tube_m3"]), ATMOSPHERE_PA, gas)


@compiled_and_kept
def squeeze(chamber: Any, gas: Any, volumes_m3: Any) -> None:
    """Take a closed chamber (array of one) through volumes, one a step."""
    for volume_m3 in volumes_m3:
        resize(chamber[0], volume_m3, gas[0])
        settle(chamber[0], gas[0])


@compiled_and_kept
def join(
    chambers: Any, gas: Any, conductance_m3_s_pa: float, critical_ratio: float, steps: int, endless: bool, seen_pa: Any
) -> None:
    """Let two chambers exchange air; the first is never used up if endless. `seen_pa` takes both pressures a step."""
    a, b, air = chambers[0], chambers[1], gas[0]
    for step in range(steps):
        exchange(a, b, conductance_m3_s_pa, critical_ratio, air.step_s)
        if not endless:
            settle(a, air)
        settle(b, air)
        seen_pa[step, 0] = a.pressure_pa
        seen_pa[step, 1] = b.pressure_pa
