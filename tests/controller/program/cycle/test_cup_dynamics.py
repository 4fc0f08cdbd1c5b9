"""Landing of the plugs while the planting frequency is constant or changes by up to 30 per minute per second.

The catch window of a cup is 8.5 mm to either side. The complete grid runs nightly, a fixed sample by default.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator
from itertools import permutations, product
from typing import NamedTuple

import pytest

from controller.program.states import State
from controller.program.tags import SIDES
from plant_sim.machine.parameters import load_machine
from plant_sim.study.row_motion import MotionWatch
from plant_sim.twin.lock_step import Twin
from tests.sampling import first_of, one_in

MACHINE = load_machine()
CATCH_M = MACHINE.cups.catch_m
CONSTANT_M = 0.004
"""Largest landing offset at a constant frequency: 1.2 mm for two flags, 10 to 20 ms for scans and timers at 90 mm/s."""
RAMP_M_S2 = 0.030
"""Permitted change of the chain speed: 30 cups per minute per second at a pitch of 60 mm."""
RESTART_S = 30.0
"""Longest standstill in a story, s."""


class Phase(NamedTuple):
    """Part of a story: a planting frequency and the time for which it is set, s."""

    per_min: float
    for_s: float


def told(story: Iterable[Phase], *, per_min: float, ramp_m_s2: float = RAMP_M_S2, seed: int = 1) -> MotionWatch:
    """Return the landings of two trays of typical seedlings; the story starts after the first throw.

    No seedling may be lost, and no alarm raised that stops work.
    """
    values = {"cups.planting_frequency_per_min": per_min, "cups.acceleration_m_s2": ramp_m_s2}
    set_points = {"trays_target": 2, "no_cups": 60}
    twin = Twin(seed=seed, trays=2, parameters=MACHINE.with_values(values), set_points=set_points)
    twin.plant.seedlings.make_typical()
    watch, complete = MotionWatch(), twin.machine.tags.machine.state.equals(State.COMPLETE)
    twin.watch(watch, devices=())
    twin.home(within_ms=60_000)
    twin.start()
    while not watch.rows:
        twin.run_for(100)
        assert twin.now_ms < 180_000, "no throw"
    for phase in story:
        twin.plant.planting_frequency_per_min = phase.per_min
        if twin.runs_until(complete, for_ms=round(1_000 * phase.for_s)):
            break
    if twin.state is not State.COMPLETE:
        twin.plant.planting_frequency_per_min = 60.0
        twin.run_until_state(State.COMPLETE, within_ms=200_000)
    twin.run_for(500)  # the last row lands
    stopped = [name for name in twin.alarms() if name != "planting_fast"]
    assert stopped == []
    counts = twin.plant.counts()
    assert counts.in_cups == counts.total == 144, counts
    assert {row.side for row in watch.rows} == set(SIDES)
    return watch


def worst_m(watch: MotionWatch) -> float:
    return max(abs(row.throw_along_m) for row in watch.rows)


@pytest.mark.parametrize("per_min", one_in(8, [float(per_min) for per_min in range(20, 95, 5)]))
def test_plugs_land_in_their_cups_at_every_permitted_frequency(per_min: float) -> None:
    watch = told([], per_min=per_min) if per_min == 60.0 else told([Phase(per_min, 600.0)], per_min=per_min)
    assert len(watch.rows) == 12
    assert worst_m(watch) < CONSTANT_M


LEVELS = [float(per_min) for per_min in range(20, 100, 10)]


@pytest.mark.parametrize(("one", "other"), first_of(permutations(LEVELS, 2)))
def test_plugs_land_in_their_cups_in_ramps_between_two_frequencies(one: float, other: float) -> None:
    """Each phase lasts 5 to 9 cups and no whole number of them, so that the ramps begin anywhere in a cup."""
    draws = random.Random(f"{one} {other}")
    story = [Phase(per_min, draws.uniform(5, 9) * 60 / per_min) for _ in range(30) for per_min in (other, one)]
    assert worst_m(told(story, per_min=one)) < CATCH_M


@pytest.mark.parametrize(("seed", "per_min"), first_of([(4, 80.0), *product(range(5, 11), LEVELS)]))
def test_plugs_land_in_their_cups_when_the_tractor_stops_and_starts_again(seed: int, per_min: float) -> None:
    """In story 4 at 80 per minute, the flag that times a release is much shorter than the one before."""
    draws = random.Random(f"{seed} {per_min}")
    story = [
        phase
        for _ in range(30)
        for phase in (
            Phase(0.0, draws.choice([0.5, 1.0, 2.0, draws.uniform(3.0, RESTART_S)])),
            Phase(per_min, draws.uniform(6, 12) * 60 / per_min),
        )
    ]
    assert worst_m(told(story, per_min=per_min)) < CATCH_M


@pytest.mark.parametrize("seed", first_of(range(1, 41)))
def test_plugs_land_in_their_cups_on_a_random_drive(seed: int) -> None:
    """Frequencies, ramps up to 30 per minute per second, and standstills are drawn at random."""
    draws = random.Random(seed)
    ramp_m_s2 = RAMP_M_S2 * draws.choice([1.0, 1.0, 0.5, 0.2])
    assert worst_m(told(drive(draws), per_min=45.0, ramp_m_s2=ramp_m_s2, seed=seed)) < CATCH_M


def drive(draws: random.Random) -> Iterator[Phase]:
    for _ in range(60):
        yield Phase(draws.choice([0.0, *(draws.uniform(20.0, 90.0) for _ in range(4))]), draws.uniform(1.0, 12.0))
