"""Kernel compared with its plain form, bit by bit, on random machines with random faults and outputs."""

from __future__ import annotations

import math
import random
from typing import Any

import numpy as np
import pytest

from controller.program.states import State
from plant_sim.common.compiled import compiled_and_cached
from plant_sim.faults import FAULTS, Fault
from plant_sim.machine import plant as plant_module
from plant_sim.machine.kernel import ARM_COILS, advance
from plant_sim.pneumatics.chamber import CHAMBER, GAS, exchange, fill
from plant_sim.twin.lock_step import Twin
from tests.plant_sim.machine.plain_kernel import advance_plainly
from tests.plant_sim.machine.plain_kernel import exchange as plain_exchange
from tests.plant_sim.machine.plant_rig import MACHINE, Rig
from tests.sampling import first_of

VARIED = (
    "air.wall_time_s",
    "claws_port.dead_volume_m3",
    "claws_port.tube_length_m",
    "cups.planting_frequency_per_min",
    "lift_port.tube_length_m",
    "lift_port.valve_conductance_m3_s_pa",
    "slide_port.dead_volume_m3",
    "slide_port.fitting_conductance_m3_s_pa",
    "slide_port.tube_length_m",
    "supply.claw_manifold_m3",
    "supply.claw_reservoir_m3",
    "supply.critical_ratio",
    "supply.header_m3",
    "supply.main_conductance_m3_s_pa",
    "supply.manifold_m3",
    "supply.receiver_m3",
    "supply.regulator_conductance_m3_s_pa",
)
"""Parameters varied by a random factor."""

OPPOSITE = tuple(
    (f"{side}.{one}", f"{side}.{other}")
    for side in ("left", "right")
    for one, other in zip(ARM_COILS[::2], ARM_COILS[1::2], strict=True)
)
"""Pairs of coils that drive a part in opposite directions."""

SHORT = tuple(range(4))
LONG = tuple(range(100, 200))


class Comparison:
    """Replacement of `advance` that also computes every call in plain form.

    Attributes:
        calls: Number of calls compared.
    """

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, state: Any, params: Any, coils: Any, fed: bool, first: int, steps: int, positions: Any) -> None:
        expected = state.copy()
        advance_plainly(expected, params, coils, fed, first, steps)
        advance(state, params, coils, fed, first, steps, positions)
        assert state.tobytes() == expected.tobytes(), f"differs within {steps} steps from step {first}"
        self.calls += 1


@compiled_and_cached
def exchange_in_both_forms(chambers: Any, conductance_m3_s_pa: float, gas: Any) -> None:
    """Exchange air between the first two chambers as the kernel does, and between the others in plain form."""
    exchange(chambers[0], chambers[1], conductance_m3_s_pa, 0.3, gas[0])
    plain_exchange(chambers[2], chambers[3], conductance_m3_s_pa, 0.3, gas[0])


@pytest.fixture
def comparison(monkeypatch: pytest.MonkeyPatch) -> Comparison:
    comparison = Comparison()
    monkeypatch.setattr(plant_module, "advance", comparison)
    return comparison


def random_machine(rng: random.Random) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name in rng.sample(VARIED, 5):
        section, field = name.split(".")
        values[name] = getattr(getattr(MACHINE, section), field) * rng.uniform(0.75, 1.3)
    if rng.random() < 0.3:
        values["air.thermal"] = True
    if rng.random() < 0.2:
        values["slide.brake_n"] = 0.0
    return values


def random_size(rng: random.Random, kind_name: str) -> float | None:
    size = FAULTS[kind_name].size
    if size is None:
        return None
    if size.low > 0.0 and size.high > 1e3 * size.low:
        return math.exp(rng.uniform(math.log(size.low), math.log(size.high)))
    return rng.uniform(size.low, size.high)


def random_faults(rng: random.Random, rig: Rig, span_ms: int) -> list[Fault]:
    """Return up to four faults of different parts."""
    faults: list[Fault] = []
    for name in rng.sample(sorted(FAULTS), rng.randrange(5)):
        if FAULTS[name].permanent:
            continue
        start_ms = rng.randrange(span_ms)
        target = rng.choice(sorted(FAULTS[name].parts(rig.plant)))
        fault = Fault(name, target, start_ms, start_ms + rng.randrange(50, span_ms), random_size(rng, name))
        if not any(fault.overlaps(other) for other in faults):
            faults.append(fault)
    return faults


def drive_at_random(rng: random.Random, rig: Rig, span_ms: int) -> None:
    """Switch coils, the conveyor, the emergency stop and the tractor at random times."""
    on: set[str] = set()
    while rig.plant.time_ms < span_ms:
        for pair in OPPOSITE:
            if rng.random() < 0.3:
                on -= set(pair)
                on |= set(rng.choice([(), pair[:1], pair[1:], pair[:1], pair[1:], pair]))
        on = {tag for tag in on if not tag.startswith("tray")}
        on |= {tag for tag in ("tray_run", "tray_forward") if rng.random() < 0.5}
        if rng.random() < 0.06:
            rig.plant.box.emergency_stop = not rig.plant.box.emergency_stop
        if rng.random() < 0.05:
            rig.left.cups.planting_frequency_per_min = rng.uniform(0.0, 100.0)
        rig.run(rng.choice([10, 30, 100, 300, 1_000, 3_000]), *sorted(on))


def drive_random_machine(seed: int, span_ms: int) -> Rig:
    rng = random.Random(seed)
    rig = Rig(random_machine(rng), seed=seed)
    for fault in random_faults(rng, rig, span_ms):
        rig.plant.faults.add(fault)
    rig.plant.box.emergency_stop = rng.random() < 0.2
    drive_at_random(rng, rig, span_ms)
    return rig


@pytest.mark.parametrize(
    ("exponent", "count"), first_of([(each, count) for count in (4_000, 20_000) for each in (1.0, 1.2, 1.4)], 3)
)
def test_exchanges_limited_by_equal_pressures(exponent: float, count: int) -> None:
    """From slight to extreme flows, the limit of an exchange is omitted only where it has no effect."""
    rng = random.Random(1)
    gas = np.zeros(1, GAS)
    gas["exponent"], gas["step_s"] = exponent, 0.001
    limited = 0
    for _ in range(count):
        chambers = np.zeros(4, CHAMBER)
        up_pa = 10.0 ** rng.uniform(5.0, 6.0)
        for chamber, pressure_pa in zip(
            chambers, (up_pa, up_pa * (1.0 - 10.0 ** rng.uniform(-12.0, -0.05))), strict=False
        ):
            fill(chamber, 10.0 ** rng.uniform(-6.0, -1.0), pressure_pa, gas[0])
        chambers[2:] = chambers[:2]
        exchange_in_both_forms(chambers, 10.0 ** rng.uniform(-12.0, -4.0), gas)
        assert chambers[:2].tobytes() == chambers[2:].tobytes()
        limited += abs(float(chambers[0]["pressure_pa"] / chambers[1]["pressure_pa"]) - 1.0) < 0.01
    assert limited > count / 20


@pytest.mark.parametrize("seed", first_of(SHORT))
def test_random_machines(comparison: Comparison, seed: int) -> None:
    rig = drive_random_machine(seed, 8_000)
    assert comparison.calls >= 800
    assert np.isfinite(rig.plant.state["arms"]["lift"]["position_m"]).all()


@pytest.mark.nightly
@pytest.mark.parametrize("seed", LONG)
def test_many_random_machines(comparison: Comparison, seed: int) -> None:
    drive_random_machine(seed, 60_000)
    assert comparison.calls >= 6_000


@pytest.mark.parametrize("for_ms", first_of([36_000, 200_000]))
def test_a_trial(comparison: Comparison, for_ms: int) -> None:
    """A trial of six rows of seedlings, from homing to the last release; by default to the first release."""
    twin = Twin(seed=1, trays=1, set_points={"trays_target": 1}, step_by_step=True)
    twin.home()
    twin.start()
    twin.runs_until(twin.machine.tags.machine.state.equals(State.COMPLETE), for_ms=for_ms)
    assert twin.plant.counts().in_cups > 0
    assert comparison.calls >= 0.1 * twin.now_ms
