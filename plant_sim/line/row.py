"""Rows of plants as arrays with one element for each cup or planter released over the row."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.line.ground import Floats

Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Missing(enum.IntEnum):
    """Cause of a missing plant; the letters are those of the pepper paper."""

    NONE = 0
    P = 1
    """Lost while picking."""
    D = 2
    """Lost while carrying."""
    T = 3
    """Lost while throwing: the seedling fell outside its cup or into another one."""
    MISSED_CUP = 4
    """No seedling was offered while the cup or the planter passed."""
    HANDOVER = 5
    """Lost between conveyor or cup and planter."""
    RELEASE = 6
    """Not released by the planter or the nozzle."""

    @property
    def label(self) -> str:
        """Name in the results: the letter of the paper, or words joined by underscores."""
        return self.name if len(self.name) == 1 else self.name.lower()


class TractorMotion(enum.IntEnum):
    """Motion of the tractor while a plug falls through the chute."""

    STEADY = 0
    """At a constant speed."""
    CHANGES = 1
    """At a speed that changes."""
    STOPS = 2
    """To a standstill, or during one."""


class HandoverCount(NamedTuple):
    """Handovers through the chute during one kind of motion of the tractor.

    Attributes:
        tractor: Motion of the tractor.
        seedlings: Seedlings that left their cups.
        lost: Those of them that no planter has caught.
    """

    tractor: TractorMotion
    seedlings: int
    lost: int


CAUSES: Final = tuple(cause for cause in Missing if cause is not Missing.NONE)

NO_PLANT: Final = -1
"""Value of `PlantRow.stand` where there is no plant."""


@dataclass(frozen=True)
class FedRow:
    """Cups of one row in order, or successive planters of a line without cups.

    Attributes:
        seedlings: Number of seedlings in each cup: 0, 1 or 2.
        cause: Cause of each empty cup; `Missing.NONE` for the others.
        first_cycle: Planting cycles of the drive at which the first cup is at the planting position.
    """

    seedlings: Integers
    cause: Integers
    first_cycle: float


@dataclass(frozen=True)
class PlantRow:
    """One row of plants; all arrays have one element for each released cup.

    Attributes:
        cup: Number of the cup or the planter in the row, from 0.
        time_s: Time of the release since the start of the tractor, s.
        travel_m: Travel of the machine at the release, from the first release of the row, m.
        speed_m_s: Ground speed at the release, m/s.
        ratio: Characteristic ratio lambda at the release; NaN without a chain planter, infinite at standstill.
        seedlings: Number of plants at the position; 2 or more for a double.
        missing: Cause of the missing plant; `Missing.NONE` if there is a plant.
        position_m: Position of the plants along the row, m; NaN without a plant.
        depth_m: Depth of the bottom of the plug below the soil surface, m; NaN without a plant.
        tilt_deg: Tilt of the plant, forward positive, degrees; NaN without a plant or if not modelled.
        stand: `plant_sim.planter.verdict.Stand` of the plant; `NO_PLANT` without a plant.
        scraped: True if the planter touched the plant after its release.
        injured: True for an injured plant; None if injury is not modelled.
        injury_within: True within the levels of the bench test on injury, or if injury is not modelled.
        within: True if lambda and frequency are within the range of the fall table; False for an extrapolated fall.
        in_transit: Number of cups or planters that have left the feed but have not been released.
        seedlings_in_transit: Number of seedlings in them.
        seedlings_lost: Number of seedlings lost between the feed and the soil.
        phase: Deviation of each arrival from the middle of the catch window, in planting cycles; empty without a chute.
        handovers: Handovers of the released cups by the motion of the tractor; empty without a chute.
        frequency_within: True if the planting frequency is one at which the falls were simulated; None without a chain
            planter.
    """

    cup: Integers
    time_s: Floats
    travel_m: Floats
    speed_m_s: Floats
    ratio: Floats
    seedlings: Integers
    missing: Integers
    position_m: Floats
    depth_m: Floats
    tilt_deg: Floats
    stand: Integers
    scraped: Flags
    injured: Flags | None
    within: Flags
    injury_within: Flags
    in_transit: int
    seedlings_in_transit: int
    seedlings_lost: int
    phase: Floats
    handovers: tuple[HandoverCount, ...] = ()
    frequency_within: Flags | None = None

    @property
    def planted(self) -> Flags:
        """True for each position with at least one plant."""
        return self.seedlings > 0

    @property
    def released(self) -> int:
        """Number of released cups or planters."""
        return len(self.cup)

    @property
    def single(self) -> int:
        """Number of positions with one plant."""
        return int(np.count_nonzero(self.seedlings == 1))

    @property
    def double(self) -> int:
        """Number of positions with two plants or more."""
        return int(np.count_nonzero(self.seedlings > 1))

    @property
    def causes(self) -> dict[Missing, int]:
        """Number of missing plants by cause."""
        counts = np.bincount(self.missing, minlength=len(Missing))
        return {cause: int(counts[cause]) for cause in CAUSES}

    @property
    def plants_m(self) -> Floats:
        """Positions of all plants in ascending order, m; the position of a double is repeated for each plant."""
        return np.sort(np.repeat(self.position_m, self.seedlings))
