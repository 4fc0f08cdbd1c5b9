"""Drives of cups and planters by a ground wheel or a motor: planting cycles as a function of time.

One cycle releases one plant in each row. The rate of cycles per metre is the reciprocal of the plant spacing; for a
chain planter, the characteristic ratio lambda is the chain pitch divided by the spacing.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plant_sim.line.ground import Floats, SpeedProfile, WheelSlip

_HALVINGS = 60
"""Number of bisections of an interval; the result then has the precision of a double."""


class Drive(Protocol):
    """Drive of the planting cycles; the cycle count is 0 at time 0 and never decreases."""

    @property
    def end_cycles(self) -> float:
        """Cycles at the end of the speed profile."""

    def cycles_at(self, time_s: ArrayLike) -> Floats:
        """Return the number of cycles at given times."""

    def time_at(self, cycles: ArrayLike) -> Floats:
        """Return the earliest times at which given numbers of cycles are reached, s."""

    def rate_at(self, time_s: ArrayLike) -> Floats:
        """Return the cycles per second at given times, 1/s."""

    def per_m_at(self, time_s: ArrayLike) -> Floats:
        """Return the cycles per metre of travel at given times, 1/m; infinite while a motor turns at standstill."""


class WheelDrive:
    """Drive by a ground wheel through a fixed gear: the cycles per metre depend on the slip only.

    Attributes:
        slip: Slip of the wheel.
    """

    def __init__(self, profile: SpeedProfile, slip: WheelSlip, *, per_wheel_m: float) -> None:
        """Initialise the drive.

        Args:
            profile: Speed profile of the tractor.
            slip: Slip of the wheel.
            per_wheel_m: Cycles per metre of travel of the wheel, 1/m.
        """
        self._profile = profile
        self.slip = slip
        self._per_wheel_m = per_wheel_m

    @property
    def end_cycles(self) -> float:
        """Cycles at the end of the speed profile."""
        return float(self.cycles_at(self._profile.time_s[-1]))

    def cycles_at(self, time_s: ArrayLike) -> Floats:
        """Return the number of cycles at given times."""
        return self._per_wheel_m * self.slip.wheel_at(self._profile.travel_at(time_s))

    def time_at(self, cycles: ArrayLike) -> Floats:
        """Return the earliest times at which given numbers of cycles are reached, s."""
        wheel_m = np.asarray(cycles, dtype=np.float64) / self._per_wheel_m
        return self._profile.time_at(self.slip.travel_at(wheel_m))

    def rate_at(self, time_s: ArrayLike) -> Floats:
        """Return the cycles per second at given times, 1/s."""
        return self._profile.speed_at(time_s) * self.per_m_at(time_s)

    def per_m_at(self, time_s: ArrayLike) -> Floats:
        """Return the cycles per metre of travel at given times, 1/m."""
        return self._per_wheel_m * (1 - self.slip.at(self._profile.travel_at(time_s)))


class MotorDrive:
    """Drive by a motor whose speed follows the measured ground speed with a first-order lag."""

    def __init__(self, profile: SpeedProfile, *, per_m: float, lag_s: float) -> None:
        """Initialise the drive at standstill.

        Args:
            profile: Speed profile of the tractor.
            per_m: Set-point, cycles per metre of travel, 1/m.
            lag_s: Time constant, s, more than 0.
        """
        self._profile = profile
        self._per_m = per_m
        self._lag_s = lag_s
        time_s, speed_m_s = profile.time_s, profile.speed_m_s
        self._slope = per_m * np.diff(speed_m_s) / np.diff(time_s)
        self._wanted = per_m * speed_m_s
        rates, cycles = [0.0], [0.0]
        for wanted, slope, for_s in zip(self._wanted.tolist(), self._slope.tolist(), np.diff(time_s), strict=False):
            rate, turned = _response(wanted, slope, rates[-1], lag_s, for_s)
            rates.append(float(rate))
            cycles.append(cycles[-1] + float(turned))
        self._rate, self._cycles = np.array(rates), np.array(cycles)

    @property
    def end_cycles(self) -> float:
        """Cycles at the end of the speed profile."""
        return float(self._cycles[-1])

    def cycles_at(self, time_s: ArrayLike) -> Floats:
        """Return the number of cycles at given times."""
        return self._at(time_s)[1]

    def rate_at(self, time_s: ArrayLike) -> Floats:
        """Return the cycles per second at given times, 1/s."""
        return self._at(time_s)[0]

    def time_at(self, cycles: ArrayLike) -> Floats:
        """Return the earliest times at which given numbers of cycles are reached, s."""
        wanted = np.asarray(cycles, dtype=np.float64)
        if wanted.size and wanted.max() > self.end_cycles:
            raise ValueError(f"{wanted.max():g} cycles are beyond the end of the profile at {self.end_cycles:g}")
        piece = np.clip(np.searchsorted(self._cycles, wanted, side="left") - 1, 0, len(self._slope) - 1)
        low, high = np.zeros_like(wanted), np.diff(self._profile.time_s)[piece]
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            is_before = self._within(piece, middle)[1] < wanted
            low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
        reached_s: Floats = self._profile.time_s[piece] + high
        return reached_s

    def per_m_at(self, time_s: ArrayLike) -> Floats:
        """Return the cycles per metre of travel at given times, 1/m; infinite while the tractor is stopped."""
        rate, speed_m_s = self.rate_at(time_s), self._profile.speed_at(time_s)
        return np.divide(rate, speed_m_s, out=np.full_like(rate, np.inf), where=speed_m_s > 0)

    def _at(self, time_s: ArrayLike) -> tuple[Floats, Floats]:
        at = np.asarray(time_s, dtype=np.float64)
        piece = np.clip(np.searchsorted(self._profile.time_s, at, side="right") - 1, 0, len(self._slope) - 1)
        return self._within(piece, at - self._profile.time_s[piece])

    def _within(self, piece: NDArray[np.int64], for_s: Floats) -> tuple[Floats, Floats]:
        """Return rate and cycles at a given time after the start of a piece."""
        rate, turned = _response(self._wanted[piece], self._slope[piece], self._rate[piece], self._lag_s, for_s)
        return np.asarray(rate), np.asarray(self._cycles[piece] + turned)


def _response(wanted: Any, slope: Any, rate: Any, lag_s: float, for_s: Any) -> tuple[Any, Any]:
    """Return rate and cycles of a first-order lag with a linearly changing set-point.

    Args:
        wanted: Set-point at the start, 1/s.
        slope: Change of the set-point, 1/s2.
        rate: Rate at the start, 1/s.
        lag_s: Time constant, s.
        for_s: Time, s.
    """
    steady = wanted - slope * lag_s
    decayed = np.exp(-for_s / lag_s)
    turned = steady * for_s + slope * for_s**2 / 2 + (rate - steady) * lag_s * (1 - decayed)
    return steady + slope * for_s + (rate - steady) * decayed, turned
