"""Space of what the paper does not print about a fall on rigid ground, over the ranges of the parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from plant_sim.planter.contact import Disturbance
from plant_sim.planter.parameters import Planter
from plant_sim.planter.scatter import Draw, Ground, Ranges, replaced
from plant_sim.planter.verdict import TILTED_DEG, FallVerdict, margin_of
from plant_sim.study.planter.lodging_fit import Values
from plant_sim.study.planter.verdicts import SimulatedCase

DEVIATIONS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "deviation of the opener": "scatter.opener_deg",
        "place of the block": "scatter.place_m",
        "pitch of the block": "scatter.pitch_deg",
        "roll of the block": "scatter.roll_deg",
        "delay of the second plate": "scatter.uneven_s",
        "slope of the furrow": "scatter.slope_deg",
    }
)
"""Deviations of one fall, with the parameter that states the largest one."""

_SECTIONS: Final = ("chain", "block", "grip", Ground.RIGID.value)


@dataclass(frozen=True)
class VerdictSpace:
    """Space of the falls on rigid ground; its points have one coordinate from 0 to 1 for each name.

    Attributes:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
    """

    planter: Planter
    ranges: Ranges

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters of machine, block and ground with a range, except those of the soil."""
        wide = (name for name, (low, high) in self.ranges.items() if high > low)
        return tuple(sorted(name for name in wide if name.partition(".")[0] in _SECTIONS))

    @property
    def bounds(self) -> tuple[str, ...]:
        """Names of the parameters that state the largest deviations."""
        return tuple(DEVIATIONS.values())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates: parameters, largest deviations, deviations as a share of the largest one."""
        return (*self.parameters, *self.bounds, *DEVIATIONS)

    def coordinate(self, name: str, value: float) -> float:
        """Return the coordinate of a value of a parameter or of a largest deviation."""
        low, high = self.ranges[name]
        return (value - low) / (high - low)

    def nominal(self) -> Values:
        """Return the point of the default parameters without deviations, with the largest possible deviations."""
        values = dict.fromkeys(self.names, 1.0)
        for name in self.parameters:
            section, _, key = name.partition(".")
            values[name] = self.coordinate(name, float(getattr(getattr(self.planter, section), key)))
        for name in DEVIATIONS:
            values[name] = _undisturbed(name)
        return np.array([values[name] for name in self.names])

    def draw_at(self, point: Values) -> Draw:
        """Return the values of a fall at a point."""
        at = dict(zip(self.names, point.tolist(), strict=True))
        drawn = {}
        for name in (*self.parameters, *self.bounds):
            low, high = self.ranges[name]
            drawn[name] = low + at[name] * (high - low)
        planter = replaced(self.planter, drawn)
        opener, place, pitch, roll, uneven, slope = (
            drawn[bound] * _share(name, at[name]) for name, bound in DEVIATIONS.items()
        )
        disturbance = Disturbance(place, pitch_deg=pitch, roll_deg=roll, uneven_s=uneven, slope_deg=slope)
        return Draw(planter, planter.rigid_ground, opener, disturbance, sticks=False)

    def margins(self, case: SimulatedCase, points: Values) -> list[float]:
        """Return the signed distance from the limits of the verdict of a case at every point.

        The distance is positive if the fall has the verdict. A seedling that is upright in the direction of travel
        must be upright across the row as well.

        Args:
            case: Simulated case of the paper.
            points: Points, one per row.
        """
        return [self._margin(case, self.draw_at(point)) for point in points]

    def _margin(self, case: SimulatedCase, drawn: Draw) -> float:
        motion, release_deg = case.motion(drawn.planter), drawn.planter.chain.release_deg
        fall = drawn.fall(motion, release_deg)
        margin = margin_of(case.verdict, fall.tilt_deg, fall.pushed_m)
        if case.verdict is FallVerdict.FORWARD or margin <= 0.0:
            return margin
        return min(margin, 1.0 - abs(drawn.roll_deg(motion, release_deg)) / TILTED_DEG)


def _share(name: str, coordinate: float) -> float:
    """Return a deviation as a share of the largest one: in both directions, except for a delay."""
    return coordinate if name == "delay of the second plate" else 2 * coordinate - 1


def _undisturbed(name: str) -> float:
    """Return the coordinate at which a deviation is 0."""
    return 0.0 if name == "delay of the second plate" else 0.5
