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
FARTHEST_M = 0.012
"""Largest landing offset in a ramp that the program has not seen; 9.9 mm in 400 drives."""
RESTART_S = 30.0
"""Longest standstill in a story, s."""


class Phase(NamedTuple):
    """Part of a story: a planting frequency and the time for which it is set, s."""

    per_min: float
    for_s: float


def driven(
    story: Iterable[Phase], *, per_min: float, ramp_m_s2: float = RAMP_M_S2, seed: int = 1
) -> tuple[Twin, MotionWatch]:
    """Return a machine that has planted two trays of typical seedlings, or is held, and the landings.

    The story starts after the first throw.
    """
    values = {"cups.planting_frequency_per_min": per_min, "cups.acceleration_m_s2": ramp_m_s2}
    set_points = {"trays_target": 2, "no_cups": 60}
    twin = Twin(seed=seed, trays=2, parameters=MACHINE.with_values(values), set_points=set_points)
    twin.plant.seedlings.make_typical()
    state = twin.machine.tags.machine.state
    watch, at_rest = MotionWatch(), state.equals(State.COMPLETE) | state.equals(State.HELD)
    twin.watch(watch, devices=())
    twin.home(within_ms=60_000)
    twin.start()
    while not watch.rows:
        twin.run_for(100)
        assert twin.now_ms < 180_000, "no throw"
    for phase in story:
        twin.plant.planting_frequency_per_min = phase.per_min
        if twin.runs_until(at_rest, for_ms=round(1_000 * phase.for_s)):
            break
    else:
        twin.plant.planting_frequency_per_min = 60.0
        twin.run_until_state(State.COMPLETE, State.HELD, within_ms=200_000)
    twin.run_for(500)  # the last row lands
    return twin, watch


def told(story: Iterable[Phase], *, per_min: float, ramp_m_s2: float = RAMP_M_S2, seed: int = 1) -> MotionWatch:
    """Return the landings of a story; no seedling may be lost, and no alarm raised that stops work."""
    twin, watch = driven(story, per_min=per_min, ramp_m_s2=ramp_m_s2, seed=seed)
    assert stopped(twin) == []
    counts = twin.plant.counts()
    assert counts.in_cups == counts.total == 144, counts
    assert {row.side for row in watch.rows} == set(SIDES)
    return watch


def stopped(twin: Twin) -> list[str]:
    """Return the alarms that stop work."""
    return [name for name in twin.alarms() if name != "planting_fast"]


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


def random_drive(seed: int) -> tuple[Twin, MotionWatch]:
    """Return a machine after frequencies, ramps up to 30 per minute per second and standstills drawn at random."""
    draws = random.Random(seed)
    ramp_m_s2 = RAMP_M_S2 * draws.choice([1.0, 1.0, 0.5, 0.2])
    return driven(drive(draws), per_min=45.0, ramp_m_s2=ramp_m_s2, seed=seed)


def test_plugs_land_in_their_cups_on_a_random_drive() -> None:
    twin, watch = random_drive(1)
    assert (stopped(twin), twin.plant.counts().in_cups) == ([], 144)
    assert worst_m(watch) < CATCH_M


@pytest.mark.nightly
def test_few_random_drives_lose_a_row_or_hold_the_machine() -> None:
    """The limits are several times the rates of 400 drives, whose causes are known (ADR 34); all else is an error."""
    drives = [random_drive(seed) for seed in range(1, 41)]
    worked = [twin.plant.counts() for twin, _ in drives if twin.state is State.COMPLETE]
    assert len(worked) >= len(drives) - 2
    assert all(each.in_cups + each.T == 144 for each in worked)
    assert sum(twin.plant.counts().T for twin, _ in drives) <= 24
    assert max(worst_m(watch) for _, watch in drives) < FARTHEST_M
    assert {name for twin, _ in drives for name in stopped(twin)} <= {"left: cup counts", "right: cup counts"}


def drive(draws: random.Random) -> Iterator[Phase]:
    for _ in range(60):
        yield Phase(draws.choice([0.0, *(draws.uniform(20.0, 90.0) for _ in range(4))]), draws.uniform(1.0, 12.0))
