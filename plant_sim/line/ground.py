"""Ground of a line: speed of the tractor as a function of time, and slip of the ground wheel as a function of travel.

The travel of the tractor is the integral of a piecewise linear speed, so that the travel and its inverse are computed
in closed form. The slip is constant within each patch of soil; the travel of the wheel is piecewise linear in the
travel of the tractor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

MOST_SLIP = 0.9
"""Upper limit of the slip; assumed. A wheel with more slip is considered blocked."""
LEAST_SLIP = -0.5
"""Lower limit of the slip; assumed. A wheel that sinks in, or that rolls over ridges, turns further than the tractor
drives over level ground, so that its slip is negative."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """One section of the path of the tractor.

    Attributes:
        target_m_s: Speed to reach, m/s; 0 to stop.
        for_m: Length, m; None if the duration is given.
        for_s: Duration, s; None if the length is given. The duration of a stop begins at standstill.
        is_ramp: True to reach the speed at the end of the stretch, False to reach it with the default acceleration.
        grade: Rise divided by distance, negative downhill.
    """

    target_m_s: float
    for_m: float | None = None
    for_s: float | None = None
    is_ramp: bool = False
    grade: float = 0.0


@dataclass(frozen=True, slots=True)
class SlipSpec:
    """Slip of the ground wheel, as a fraction of the travelled distance.

    Attributes:
        mean: Mean on level ground.
        sd: Standard deviation between patches of soil.
        patch_m: Length of a patch of soil, over which the slip is constant, m.
        per_grade: Increase of the slip per unit of grade.
    """

    mean: float = 0.0
    sd: float = 0.0
    patch_m: float = 1.0
    per_grade: float = 0.0


class SpeedProfile:
    """Driving speed of a tractor that starts from standstill and repeats its stretches.

    Attributes:
        time_s: Times between which the acceleration is constant, in ascending order, s.
        speed_m_s: Speed at these times, m/s.
        travel_m: Travel at these times, m.
        grades: Start (m), end (m) and grade of every slope.
    """

    def __init__(self, stretches: Sequence[Stretch], *, acceleration_m_s2: float, length_m: float) -> None:
        """Compute the profile.

        Args:
            stretches: Stretches of the drive; they are repeated until the length is reached.
            acceleration_m_s2: Acceleration and deceleration between stretches, m/s2.
            length_m: Smallest travel at the end, m.

        Raises:
            ValueError: The stretches do not move the tractor.
        """
        self._acceleration_m_s2 = acceleration_m_s2
        self._knots: list[tuple[float, float, float]] = [(0.0, 0.0, 0.0)]
        self.grades: list[tuple[float, float, float]] = []
        while self._knots[-1][2] < length_m:
            before_m = self._knots[-1][2]
            for stretch in stretches:
                self._drive(stretch)
            if self._knots[-1][2] <= before_m:
                raise ValueError("the stretches lead nowhere; add one with a speed")
        self.time_s, self.speed_m_s, self.travel_m = np.array(self._knots).T

    def speed_at(self, time_s: ArrayLike) -> Floats:
        """Return the speed at given times, m/s."""
        speed: Floats = np.interp(np.asarray(time_s, dtype=np.float64), self.time_s, self.speed_m_s)
        return speed

    def travel_at(self, time_s: ArrayLike) -> Floats:
        """Return the travel at given times, m; the tractor is stopped after the end of the profile."""
        at = np.minimum(np.asarray(time_s, dtype=np.float64), self.time_s[-1])
        piece = self._piece(self.time_s, at)
        since_s = at - self.time_s[piece]
        travel_m: Floats = self.travel_m[piece] + since_s * (self.speed_m_s[piece] + self.speed_at(at)) / 2
        return travel_m

    def time_at(self, travel_m: ArrayLike) -> Floats:
        """Return the earliest times at which given travels are reached, s.

        Raises:
            ValueError: A travel is beyond the end of the profile.
        """
        at = np.asarray(travel_m, dtype=np.float64)
        if at.size and at.max() > self.travel_m[-1]:
            raise ValueError(f"travel {at.max():g} m is beyond the end of the profile at {self.travel_m[-1]:g} m")
        piece = np.clip(np.searchsorted(self.travel_m, at, side="left") - 1, 0, len(self.travel_m) - 2)
        way_m, speed = at - self.travel_m[piece], self.speed_m_s
        length_m = self.travel_m[piece + 1] - self.travel_m[piece]
        change = (speed[piece + 1] ** 2 - speed[piece] ** 2) / np.maximum(length_m, 1e-300)  # at a stop, `way_m` is 0
        ends_at = np.sqrt(np.maximum(speed[piece] ** 2 + change * way_m, 0.0))
        mean = (speed[piece] + ends_at) / 2
        time_s: Floats = self.time_s[piece] + np.divide(way_m, mean, out=np.zeros_like(way_m), where=mean > 0)
        return time_s

    @staticmethod
    def _piece(knots: Floats, at: Floats) -> NDArray[np.int64]:
        return np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)

    def _drive(self, stretch: Stretch) -> None:
        """Append one stretch."""
        _, start_m_s, start_m = self._knots[-1]
        if stretch.is_ramp:
            mean = (start_m_s + stretch.target_m_s) / 2
            self._append(stretch.for_s if stretch.for_m is None else stretch.for_m / mean, stretch.target_m_s)
        elif stretch.target_m_s == 0.0:
            self._append(start_m_s / self._acceleration_m_s2, 0.0)
            self._append(stretch.for_s, 0.0)
        else:
            self._cruise(stretch)
        if stretch.grade:
            self.grades.append((start_m, self._knots[-1][2], stretch.grade))

    def _cruise(self, stretch: Stretch) -> None:
        """Append a stretch that reaches its speed with the default acceleration, then continues at this speed."""
        start_m_s = self._knots[-1][1]
        change = math.copysign(self._acceleration_m_s2, stretch.target_m_s - start_m_s)
        changing_s = abs(stretch.target_m_s - start_m_s) / self._acceleration_m_s2
        changing_m = changing_s * (start_m_s + stretch.target_m_s) / 2
        if stretch.for_m is None:
            assert stretch.for_s is not None  # noqa: S101 - the reader requires one of the two
            part_s = min(changing_s, stretch.for_s)
            self._append(part_s, start_m_s + change * part_s)
            self._append(stretch.for_s - part_s, self._knots[-1][1])
        elif changing_m > stretch.for_m:
            end_m_s = math.sqrt(start_m_s**2 + 2 * change * stretch.for_m)
            self._append((end_m_s - start_m_s) / change, end_m_s)
        else:
            self._append(changing_s, stretch.target_m_s)
            self._append((stretch.for_m - changing_m) / stretch.target_m_s, stretch.target_m_s)

    def _append(self, for_s: float | None, end_m_s: float) -> None:
        """Append a piece of constant acceleration; a piece without duration is omitted."""
        time_s, speed_m_s, travel_m = self._knots[-1]
        if for_s is not None and time_s + for_s > time_s:
            self._knots.append((time_s + for_s, end_m_s, travel_m + for_s * (speed_m_s + end_m_s) / 2))


def mean_set_speed_m_s(stretches: Sequence[Stretch]) -> float:
    """Return the mean of the set speeds over the travel of all stretches, m/s.

    The mean does not depend on the order of stretches with a speed of their own. The changes of speed between two
    stretches are not considered; a ramp counts with the mean of its two speeds, and a stop, which has no travel, not at
    all.

    >>> mean_set_speed_m_s([Stretch(0.2, for_m=30.0), Stretch(0.0, for_s=9.0), Stretch(0.4, for_m=10.0)])
    0.25
    """
    speed_m_s = next((each.target_m_s for each in reversed(stretches) if each.target_m_s), 0.0)
    means_m_s, lengths_m = [], []
    for stretch in stretches:
        mean_m_s = (speed_m_s + stretch.target_m_s) / 2 if stretch.is_ramp else stretch.target_m_s
        length_m = (stretch.for_s or 0.0) * mean_m_s if stretch.for_m is None else stretch.for_m
        means_m_s.append(mean_m_s * length_m)
        lengths_m.append(length_m)
        speed_m_s = stretch.target_m_s
    return math.fsum(means_m_s) / math.fsum(lengths_m)


class WheelSlip:
    """Travel of a ground wheel that is driven by the soil, reduced by slip.

    The slip of a patch is normally distributed and may be negative, so that its mean is that of the distribution.

    Attributes:
        edges_m: Positions of the tractor between which the slip is constant, in ascending order, m.
        slip: Slip from each of these positions to the next.
        limited: True from each position at which the drawn slip was beyond `LEAST_SLIP` or `MOST_SLIP`.
    """

    def __init__(self, spec: SlipSpec, profile: SpeedProfile, rng: np.random.Generator) -> None:
        """Draw the slip of every patch of soil.

        Args:
            spec: Distribution of the slip.
            profile: Speed profile, which determines the length and the grades.
            rng: Source of the random numbers.
        """
        length_m = float(profile.travel_m[-1])
        patches_m = np.arange(0.0, length_m + spec.patch_m, spec.patch_m)
        drawn = rng.normal(spec.mean, spec.sd, len(patches_m))
        slopes_m = [edge for start, end, _ in profile.grades for edge in (start, end)]
        self.edges_m = np.unique(np.concatenate((patches_m, slopes_m)))
        middles_m = (self.edges_m[:-1] + self.edges_m[1:]) / 2
        slip = drawn[(middles_m / spec.patch_m).astype(np.int64)]
        for start_m, end_m, grade in profile.grades:
            slip[(middles_m > start_m) & (middles_m < end_m)] += spec.per_grade * grade
        self.slip = np.clip(slip, LEAST_SLIP, MOST_SLIP)
        self.limited = self.slip != slip
        self._wheel_m = np.concatenate(([0.0], np.cumsum((1 - self.slip) * np.diff(self.edges_m))))

    def wheel_at(self, travel_m: ArrayLike) -> Floats:
        """Return the travel of the wheel at given travels of the tractor, m."""
        wheel_m: Floats = np.interp(np.asarray(travel_m, dtype=np.float64), self.edges_m, self._wheel_m)
        return wheel_m

    def travel_at(self, wheel_m: ArrayLike) -> Floats:
        """Return the travel of the tractor at given travels of the wheel, m."""
        travel_m: Floats = np.interp(np.asarray(wheel_m, dtype=np.float64), self._wheel_m, self.edges_m)
        return travel_m

    def at(self, travel_m: ArrayLike) -> Floats:
        """Return the slip at given travels of the tractor."""
        piece = np.searchsorted(self.edges_m, np.asarray(travel_m, dtype=np.float64), side="right") - 1
        slip: Floats = self.slip[np.clip(piece, 0, len(self.slip) - 1)]
        return slip
