"""Comparison of the compiled pneumatics with the reference model: equal states after every step for any coil levels.

The relative tolerance is 1e-8: the algebra differs, so every step has a different rounding error of about 1e-16, which
grows to at most 2e-10 within 4000 steps, and to 2.4e-9 in the speed of a piston that has just begun to move (measured;
it depends on the processor). Near zero an absolute tolerance of 1e-8 of the typical magnitude applies: a femtometre
between piston and load changes the magnet force by 1e-10 N.
"""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from tests.plant_sim.pneumatics.air_oracle import Cylinder
from tests.plant_sim.pneumatics.chamber_oracle import read, read_params, values
from tests.plant_sim.pneumatics.pneumatics_rig import CLAWS, LIFT, SLIDE, Rig, Trace, machine_bench, put
from tests.plant_sim.pneumatics.supply_oracle import Supply
from tests.sampling import first_of

REL = 1e-8

COMMON = {"_kg": 1e-6, "_k": 1.0, "_m3": 1e-6, "_pa": 1e5, "_m_s": 0.1, "_m": 0.01, "_n": 100.0, "_j": 1.0}
"""Typical magnitude of a quantity by the suffix of its name; the absolute tolerance is `REL` times this value."""

FAULTS: dict[str, tuple[int, tuple[str, ...], float]] = {
    "slide blocked": (SLIDE, ("blocked",), 1),
    "lift blocked": (LIFT, ("blocked",), 1),
    "slide valve stuck": (SLIDE, ("valve", "stuck"), 1),
    "claw valve stuck": (CLAWS, ("valve", "stuck"), 1),
    "slide check slips": (SLIDE, ("plus", "slip_m3_s_pa"), 2e-10),
    "lift check slips": (LIFT, ("minus", "slip_m3_s_pa"), 2e-10),
    "slide leaks": (SLIDE, ("minus", "leak_m3_s_pa"), 5e-10),
    "claws leak": (CLAWS, ("plus", "leak_m3_s_pa"), 5e-10),
    "slide binds": (SLIDE, ("friction", "coulomb_n"), 150.0),
    "tube kinked": (LIFT, ("plus", "tube_m3_s_pa"), 1e-9),
}
"""Faults as injected into the plant: (cylinder, path in its parameters, value)."""


class Twin:
    """Arm with its supply, in both implementations."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.gas = read_params(rig.gas[0])
        self.supply = read(Supply, rig.supply[0])
        self.cylinders = [read(Cylinder, record) for record in rig.cylinders]

    def run(self, steps: int, coils: tuple[bool, ...], *, fed: bool = True, every: int = 5) -> None:
        """Step both implementations with the same coils and compare their complete states every few steps."""
        trace = self.rig.run(steps * self.rig.step_s, np.reshape(coils, (3, 2)), fed=fed, every=every)
        all_params = [read_params(record) for record in self.rig.all_params]
        supply_params = read_params(self.rig.supply_params[0])
        supply = self.supply
        for step in range(steps):
            supply.step(supply_params, fed, self.gas)
            manifolds = (supply.manifold, supply.manifold, supply.claw_manifold)
            for number, cylinder in enumerate(self.cylinders):
                plus, minus = coils[2 * number : 2 * number + 2]
                cylinder.step(all_params[number], plus, minus, manifolds[number], supply.outside, self.gas)
            supply.settle(supply_params, self.gas)
            if (step + 1) % every == 0:
                self._compare(trace, (step + 1) // every - 1)

    def _compare(self, trace: Trace, row: int) -> None:
        records: list[tuple[str, Any, Any]] = [("supply", self.supply, trace.supply[row])]
        records += [(f"cylinder {n}", c, trace.cylinders[row, n]) for n, c in enumerate(self.cylinders)]
        for name, plain, record in records:
            for path, expected, got in zip(paths(record.dtype), values(plain), flat(record.item()), strict=True):
                if ".nozzles." in path:  # the direction of no flow between equal pressures is a matter of rounding
                    continue
                common = next((size for end, size in COMMON.items() if path.endswith(end)), 1.0)
                same = math.isclose(expected, got, rel_tol=REL, abs_tol=REL * common)
                assert same, f"{name}, {path}: plain {expected!r}, compiled {got!r} at row {row}"


def flat(item: Any) -> list[float]:
    return [n for part in item for n in (flat(part) if isinstance(part, tuple | list | np.ndarray) else [part])]


def paths(dtype: np.dtype[Any]) -> list[str]:
    return [
        f"{name}.{path}" if path else name
        for name in dtype.names or ()
        for path in (paths(dtype[name]) or [""] * math.prod(dtype[name].shape))
    ]


def random_coils(rng: np.random.Generator) -> tuple[bool, ...]:
    return tuple(bool(level) for level in rng.random(6) < 0.45)


@pytest.mark.parametrize(
    ("seed", "step_s", "thermal", "count"),
    first_of(
        [(2, 0.001, 1, 800), *((*each, 2_000) for each in ((2, 0.001, 1), (3, 0.005, 0), (1, 0.001, 0), (4, 2e-4, 0)))]
    ),
)
def test_both_implementations_agree_under_random_coils(seed: int, step_s: float, thermal: int, count: int) -> None:
    """The test runs its steps in 10 segments; in about one segment in six, the relay de-energises the dump valve."""
    rng = np.random.default_rng(seed)
    rig = machine_bench({"air.thermal": bool(thermal)}, step_s=step_s)
    twin = Twin(rig)
    for steps in rng.multinomial(count // 10, [0.1] * 10) * 10:
        twin.run(int(steps), random_coils(rng), fed=bool(rng.random() > 1 / 6))


@pytest.mark.nightly
@settings(max_examples=8, derandomize=True)
@given(
    segments=st.lists(
        st.tuples(st.integers(1, 25), st.tuples(*[st.booleans()] * 6), st.booleans()), min_size=1, max_size=6
    ),
    faults=st.sets(st.sampled_from(sorted(FAULTS)), max_size=4),
    pressure_pa=st.sampled_from([0.2e6, 0.5e6, 0.64e6]),
)
def test_both_implementations_agree_with_any_fault(
    segments: list[tuple[int, tuple[bool, ...], bool]], faults: set[str], pressure_pa: float
) -> None:
    rig = machine_bench({"supply.pressure_pa": pressure_pa})
    for name in faults:
        number, way, value = FAULTS[name]
        target: Any = rig.all_params[number]
        for part in way[:-1]:
            target = target[part]
        target[way[-1]] = value
    twin = Twin(rig)
    for tens, coils, fed in segments:
        twin.run(10 * tens, coils, fed=fed)


@pytest.mark.nightly
def test_both_implementations_agree_on_decoupling_and_recoupling() -> None:
    """A carriage blocked at 0.3 m decouples at 0.8 MPa; it recouples only if the piston passes it slowly."""
    rig = machine_bench(
        {"supply.pressure_pa": 0.8e6, "supply.compressor_on_pa": 0.9e6, "supply.compressor_off_pa": 1e6}, step_s=0.001
    )
    put(rig, SLIDE, 0.3, ATMOSPHERE_PA, ATMOSPHERE_PA)
    rig.all_params[SLIDE]["recouples_m_s"] = 0.10
    rig.all_params[SLIDE]["blocked"] = 1
    twin = Twin(rig)
    twin.run(2000, (True, False) * 3)
    assert twin.cylinders[SLIDE].decoupled
    rig.all_params[SLIDE]["blocked"] = 0
    twin.run(4500, (False, True) * 3, every=20)
    assert twin.cylinders[SLIDE].decoupled
    assert twin.cylinders[SLIDE].piston_m < 0.0
    twin.run(4500, (True, False) * 3, every=20)
    rig.all_params[SLIDE]["plus"]["throttle_m3_s_pa"] = 0.4e-9
    twin.run(5000, (False, True) * 3)
    assert not twin.cylinders[SLIDE].decoupled


@pytest.mark.nightly
def test_both_implementations_agree_on_supply_faults() -> None:
    """The compressor fails, the manifold leaks, and the claw check valve leaks; then the compressor is restored."""
    rig = machine_bench({"supply.receiver_m3": 0.002})
    twin = Twin(rig)
    params = rig.supply_params[0]
    compressor_kg_s = float(params["compressor_kg_s"])
    params["compressor_kg_s"], params["leak_m3_s_pa"] = 0.0, 3e-8
    twin.run(800, (False,) * 6)
    params["slip_m3_s_pa"] = 1e-9
    twin.run(800, (True, False) * 3)
    assert twin.supply.header.pressure_pa < ATMOSPHERE_PA + 0.3e6
    params["compressor_kg_s"], params["leak_m3_s_pa"] = compressor_kg_s, 0.0
    twin.run(800, (False, True) * 3)
    assert twin.supply.compressor_runs
