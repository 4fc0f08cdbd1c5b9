"""Planting devices: the nozzle of the base machine, and the chain planter with an optional chute above it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from plant_sim.line.drive import Drive
from plant_sim.line.file import ChuteEntry, NozzleEntry
from plant_sim.line.ground import Floats, SpeedProfile
from plant_sim.line.injury import CabbageInjury
from plant_sim.line.row import NO_PLANT, FedRow, Flags, HandoverCount, Integers, Missing, PlantRow, TractorMotion
from plant_sim.planter.falls import Falls, FallTable
from plant_sim.planter.verdict import Stand

CARRIED_CYCLES: Final = 3.0
"""Planting cycles from gripping to release: half of the six planters of the chain; assumed."""
_STEADY_M_S: Final = 1e-9


@dataclass(frozen=True)
class ChainPlanter:
    """Chain planter of a line.

    Attributes:
        table: Fall table, which contains the parameters of the planter.
        clamp_n: Clamp force, N.
        unreleased: Share of the blocks that are not released.
        injury: Injury of the blocks; None if it is not modelled.
    """

    table: FallTable
    clamp_n: float
    unreleased: float = 0.0
    injury: CabbageInjury | None = None

    @property
    def pitch_m(self) -> float:
        """Distance between two planters along the chain, m."""
        return self.table.planter.chain.pitch_m

    def draw(self, ratio: Floats, rng: np.random.Generator, *, frequency_per_min: ArrayLike) -> Falls:
        """Return one fall for each ratio lambda at the planting frequency of each block, or of all blocks, 1/min."""
        return self.table.draw(ratio, rng, frequency_per_min=frequency_per_min, clamp_n=self.clamp_n)


class Transport(NamedTuple):
    """Blocks in the planters, after the handover.

    Attributes:
        seedlings: Number of blocks in each planter.
        cause: `Missing` of each empty planter.
        lost: Blocks lost at the handover.
        phase: Deviation of each arrival from the middle of the catch window, in planting cycles; empty without a chute.
        arrivals: Seedlings of each cup that has passed the chute, in order.
        lost_of: Those of them that no planter has caught.
        tractor: `TractorMotion` while they fell.
    """

    seedlings: Integers
    cause: Integers
    lost: int
    phase: Floats
    arrivals: Integers = np.empty(0, dtype=np.int64)
    lost_of: Integers = np.empty(0, dtype=np.int64)
    tractor: Integers = np.empty(0, dtype=np.int64)

    def handovers(self, cups: int) -> tuple[HandoverCount, ...]:
        """Return the handovers of the first cups by the motion of the tractor; empty without a chute."""
        if not len(self.arrivals):
            return ()
        arrivals, lost, tractor = self.arrivals[:cups], self.lost_of[:cups], self.tractor[:cups]
        return tuple(
            HandoverCount(each, int(arrivals[tractor == each].sum()), int(lost[tractor == each].sum()))
            for each in TractorMotion
        )


@dataclass(frozen=True)
class Course:
    """Drive and ground of a run.

    Attributes:
        profile: Speed profile.
        drive: Drive of cups and planters.
        metres: Length of each row, m.
    """

    profile: SpeedProfile
    drive: Drive
    metres: float


class Releases(NamedTuple):
    """Releases of one row, in order.

    Attributes:
        number: Number of releases in the row; later cups are in transit.
        time_s: Time of each release, s.
        origin_m: Travel of the machine at the first release, m.
        travel_m: Travel from the first release to each release, m.
        speed_m_s: Ground speed at each release, m/s.
    """

    number: int
    time_s: Floats
    origin_m: float
    travel_m: Floats
    speed_m_s: Floats


def releases(course: Course, first_cycle: float, cups: int) -> Releases:
    """Return the releases of successive cups until the end of the row.

    Args:
        course: Drive and ground.
        first_cycle: Cycles of the drive at the first release.
        cups: Number of cups.
    """
    cycles = first_cycle + np.arange(cups)
    time_s = course.drive.time_at(cycles[cycles <= course.drive.end_cycles])
    travel_m = course.profile.travel_at(time_s)
    origin_m = float(travel_m[0]) if len(travel_m) else 0.0
    inside = travel_m <= origin_m + course.metres
    time_s, travel_m = time_s[inside], travel_m[inside]
    return Releases(len(time_s), time_s, origin_m, travel_m - origin_m, course.profile.speed_at(time_s))


def plant_by_nozzle(entry: NozzleEntry, fed: FedRow, course: Course, rng: np.random.Generator) -> PlantRow:
    """Return the row planted by a nozzle, into which each cup drops its seedling at a fixed phase.

    The seedling reaches the soil after the fall time, at the current position of the nozzle plus a random deviation.

    Args:
        entry: Parameters of the nozzle.
        fed: Cups of the row.
        course: Drive and ground.
        rng: Source of the random numbers.
    """
    at = releases(course, fed.first_cycle, len(fed.seedlings))
    after = _released(fed, at.number, entry.unreleased, rng)
    planted = after.seedlings > 0
    landed_m = course.profile.travel_at(at.time_s + entry.fall) - at.origin_m
    position_m = landed_m + rng.normal(0.0, entry.scatter, at.number)
    depth_m = rng.normal(entry.depth, entry.depth_scatter, at.number)
    drawn = rng.random(at.number)
    stand = np.where(drawn < entry.lodged, Stand.LODGED, Stand.UPRIGHT)
    stand = np.where((drawn >= entry.lodged) & (drawn < entry.lodged + entry.tilted), Stand.TILTED, stand)
    every = np.ones(at.number, dtype=np.bool_)
    return _row(
        at,
        fed,
        after,
        ratio=np.full(at.number, np.nan),
        position_m=np.where(planted, position_m, np.nan),
        depth_m=np.where(planted, depth_m, np.nan),
        tilt_deg=np.full(at.number, np.nan),
        stand=np.where(planted, stand, NO_PLANT),
        scraped=~every,
        injured=planted & (rng.random(at.number) < entry.injured),
        within=every,
        injury_within=every,
        phase=np.empty(0),
    )


def drop_through_chute(
    entry: ChuteEntry, fed: FedRow, course: Course, *, phase_cycles: float, rng: np.random.Generator
) -> Transport:
    """Return the blocks that the planters catch from the cups above them.

    A plug that arrives outside the window of a planter is lost; a plug that arrives in the window of another planter is
    caught by that planter. While the tractor is stopped, no cup passes the chute; a plug that is still falling when the
    drive stops arrives at the phase at which the planters stand.

    Args:
        entry: Parameters of the chute.
        fed: Cups of the row; `first_cycle` is the cycle at which the first cup is over the chute.
        course: Drive and ground.
        phase_cycles: Planting cycles from the cup above the chute to the middle of the catch window.
        rng: Source of the random numbers.
    """
    cycles = fed.first_cycle + np.arange(len(fed.seedlings))
    cycles = cycles[cycles <= course.drive.end_cycles]
    time_s = course.drive.time_at(cycles)
    transit_s = np.maximum(rng.normal(entry.transit, entry.scatter, len(cycles)), 0.0)
    passed = course.drive.cycles_at(time_s + transit_s) - cycles
    phase = passed - phase_cycles + entry.phase_error
    filled = fed.seedlings[: len(cycles)]
    shift = np.rint(phase).astype(np.int64)
    target = np.arange(len(cycles)) + shift
    caught = (np.abs(phase - shift) <= entry.window / 2) & (target >= 0) & (target < len(fed.seedlings))
    seedlings = np.zeros_like(fed.seedlings)
    np.add.at(seedlings, target[caught], filled[caught])
    cause = np.where(seedlings > 0, Missing.NONE, np.where(fed.seedlings > 0, Missing.HANDOVER, fed.cause))
    lost_of = np.where(caught, 0, filled)
    tractor = _tractor(course.profile, time_s, entry.transit)
    return Transport(seedlings, cause.astype(np.int64), int(lost_of.sum()), phase[filled > 0], filled, lost_of, tractor)


def _tractor(profile: SpeedProfile, time_s: Floats, for_s: float) -> Integers:
    """Return the `TractorMotion` in a period after each time."""
    before_m_s, after_m_s = profile.speed_at(time_s), profile.speed_at(time_s + for_s)
    changes = np.abs(after_m_s - before_m_s) > _STEADY_M_S
    motion = np.where(changes, TractorMotion.CHANGES, TractorMotion.STEADY)
    return np.where(after_m_s <= _STEADY_M_S, TractorMotion.STOPS, motion).astype(np.int64)


def plant_by_chain(
    transport: Transport,
    first_cycle: float,
    course: Course,
    *,
    planter: ChainPlanter,
    rng: np.random.Generator,
) -> PlantRow:
    """Return the row planted by a chain planter.

    Args:
        transport: Blocks in the planters.
        first_cycle: Cycles of the drive at the first release.
        course: Drive and ground.
        planter: The planter.
        rng: Source of the random numbers.
    """
    at = releases(course, first_cycle, len(transport.seedlings))
    fed = FedRow(transport.seedlings, transport.cause, first_cycle)
    after = _released(fed, at.number, planter.unreleased, rng)
    planted = after.seedlings > 0
    ratio = planter.pitch_m * course.drive.per_m_at(at.time_s)
    per_min = 60 * course.drive.rate_at(at.time_s)
    simulated_per_min = planter.table.grid.frequencies_per_min
    fall = planter.draw(ratio, rng, frequency_per_min=per_min)
    injured, injury_within = _injuries(planter, at, planted, course, rng)
    return _row(
        at,
        fed,
        after._replace(lost=after.lost + transport.lost),
        ratio=ratio,
        position_m=np.where(planted, at.travel_m + fall.along_m, np.nan),
        depth_m=np.where(planted, fall.depth_m, np.nan),
        tilt_deg=np.where(planted, fall.tilt_deg, np.nan),
        stand=np.where(planted, fall.stand, NO_PLANT),
        scraped=planted & fall.scraped,
        injured=injured,
        within=~planted | fall.within,
        injury_within=injury_within,
        phase=transport.phase,
        handovers=transport.handovers(at.number),
        frequency_within=~planted | ((per_min >= simulated_per_min[0]) & (per_min <= simulated_per_min[-1])),
    )


def _injuries(
    planter: ChainPlanter, at: Releases, planted: Flags, course: Course, rng: np.random.Generator
) -> tuple[Flags | None, Flags]:
    """Return which plants are injured (None if not modelled), and which are within the levels of the bench test."""
    drawn = rng.random(at.number)
    if planter.injury is None:
        return None, np.ones(at.number, dtype=np.bool_)
    shares = planter.injury.shares(at.speed_m_s, 60 * course.drive.rate_at(at.time_s))
    return planted & (drawn < shares.value), ~planted | shares.within


class _Released(NamedTuple):
    """Seedlings and causes after the release, and the number of seedlings lost until then."""

    seedlings: Integers
    missing: Integers
    lost: int


def _row(at: Releases, fed: FedRow, after: _Released, **plants: Any) -> PlantRow:
    """Return a row from its releases, the cups before and after the release, and the arrays of the plants."""
    later = fed.seedlings[at.number :]
    return PlantRow(
        cup=np.arange(at.number),
        time_s=at.time_s,
        travel_m=at.travel_m,
        speed_m_s=at.speed_m_s,
        seedlings=after.seedlings,
        missing=after.missing,
        in_transit=len(later),
        seedlings_in_transit=int(later.sum()),
        seedlings_lost=after.lost,
        **plants,
    )


def _released(fed: FedRow, number: int, share: float, rng: np.random.Generator) -> _Released:
    """Return the first `number` cups after their release; a share of the releases fails."""
    seedlings, missing = fed.seedlings[:number], fed.cause[:number]
    fails = (rng.random(number) < share) & (seedlings > 0)
    cause = np.where(fails, Missing.RELEASE, missing).astype(np.int64)
    return _Released(np.where(fails, 0, seedlings), cause, int(seedlings[fails].sum()))
