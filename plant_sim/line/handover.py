"""Handover as a design: the speeds at which the chutes lose at most a stated share of the plugs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from plant_sim.line.file import ChuteEntry, LineFile
from plant_sim.line.ground import SpeedProfile, Stretch
from plant_sim.line.planting import Course, drop_through_chute
from plant_sim.line.row import FedRow
from plant_sim.line.run import design_frequency_hz, drive_of, phase_cycles

_KM_H: Final = 3.6
_FASTEST: Final = 4.0
"""Largest frequency that is examined, as a multiple of the design frequency."""
_STEPS: Final = 2_000
_BESIDE: Final = 0.03
"""Distance of the check runs from an end of the band, as a fraction of its speed."""
_CHECKED_CUPS: Final = 2_000
_STARTING_CYCLES: Final = 20.0
_CHECK_STREAM: Final = 3
"""Stream of the random numbers of the check runs; the streams of a run are 0 to 2."""


class CheckedSpeed(NamedTuple):
    """Run at a constant speed beside an end of the band.

    Attributes:
        speed_m_s: Ground speed, m/s.
        is_inside: True inside the band.
        lost: Lost plugs.
        cups: Plugs that left their cups.
    """

    speed_m_s: float
    is_inside: bool
    lost: int
    cups: int

    def record(self) -> dict[str, object]:
        """Return the run as a JSON object."""
        return {"speed_m_s": self.speed_m_s, "inside": self.is_inside, "lost": self.lost, "of": self.cups}

    def text(self) -> str:
        """Return the run as text."""
        return f"{100 * self.lost / self.cups:.1f} % at {_KM_H * self.speed_m_s:.2f} km/h"


@dataclass(frozen=True, slots=True)
class HandoverBand:
    """Range of constant ground speeds at which the chutes lose at most a stated share of the plugs.

    Attributes:
        design_hz: Planting frequency at which a plug with the mean transit time arrives in the middle of the catch
            window, 1/s.
        phase_cycles: Planting cycles from the cup above the chute to the middle of the catch window.
        is_given: True if the line file states the phase or the frequency, False if it follows from the ground.
        most_lost: Largest share of lost plugs.
        low_m_s: Lower end, m/s; 0 if the handover holds down to a standstill, NaN if it holds at no speed.
        high_m_s: Upper end, m/s; infinity if it is beyond the examined speeds.
        checks: Runs just inside and just outside each end.
    """

    design_hz: float
    phase_cycles: float
    is_given: bool
    most_lost: float
    low_m_s: float
    high_m_s: float
    checks: tuple[CheckedSpeed, ...] = ()

    @property
    def holds(self) -> bool:
        """True if there is a speed at which the handover holds."""
        return not math.isnan(self.low_m_s)

    def record(self) -> dict[str, object]:
        """Return the band as a JSON object."""
        return {
            "design_frequency_per_min": 60 * self.design_hz,
            "phase_cycles": self.phase_cycles,
            "given": self.is_given,
            "most_lost": self.most_lost,
            "low_m_s": self.low_m_s if self.holds else None,
            "high_m_s": self.high_m_s if math.isfinite(self.high_m_s) else None,
            "checks": [check.record() for check in self.checks],
        }

    def lines(self) -> list[str]:
        """Return the band as lines of text."""
        origin = "as given" if self.is_given else "derived from the mean set speed over the ground"
        design = (
            f"phase of the chutes {100 * self.phase_cycles:.1f} % of a cycle, design frequency "
            f"{60 * self.design_hz:.1f}/min, {origin}"
        )
        limit = f"at most {100 * self.most_lost:g} % lost, at a constant speed"
        if not self.holds:
            return [design, f"handover holds at no speed ({limit})"]
        low = f"{_KM_H * self.low_m_s:.2f}" if self.low_m_s else "0"
        high = f"{_KM_H * self.high_m_s:.2f}" if math.isfinite(self.high_m_s) else "all examined speeds above"
        band = f"handover holds from {low} to {high} km/h ({limit})"
        return [design, f"{band}; runs beside the ends lost {', '.join(each.text() for each in self.checks) or 'none'}"]


def lost_share(chute: ChuteEntry, phase: float, frequency_hz: float, *, slip_sd: float = 0.0) -> float:
    """Return the share of the plugs that the planters do not catch at a constant planting frequency.

    Transit time and frequency are normally distributed. A plug is caught if it arrives in the catch window of any
    planter.

    Args:
        chute: Parameters of the chute.
        phase: Planting cycles from the cup above the chute to the middle of the catch window.
        frequency_hz: Mean planting frequency, 1/s.
        slip_sd: Standard deviation of the frequency due to slip, as a fraction of it.
    """
    sd_s = max(math.hypot(chute.scatter, chute.transit * slip_sd), 1e-12)
    to_middle, half = phase - chute.phase_error, chute.window / 2
    latest = math.ceil((chute.transit + 9 * sd_s) * frequency_hz - to_middle + half)
    middles = to_middle + np.arange(math.floor(-to_middle - half), latest + 1)
    starts_s, ends_s = (middles - half) / frequency_hz, (middles + half) / frequency_hz
    starts_s = np.where(starts_s <= 0.0, -np.inf, starts_s)  # a transit time is never below 0
    caught = ndtr((ends_s - chute.transit) / sd_s) - ndtr((starts_s - chute.transit) / sd_s)
    return 1.0 - float(caught[ends_s >= 0.0].sum())


def handover_band(line: LineFile, *, seed: int) -> HandoverBand | None:
    """Return the band of speeds in which the handover holds, around the design frequency; None without a chute.

    The band is computed from the scatter of transit time and slip, then checked by runs beside its ends.

    Args:
        line: The line.
        seed: Seed of the runs.
    """
    chute = line.chute
    if chute is None:
        return None
    phase, design_hz = phase_cycles(line), design_frequency_hz(line)
    slip_mean, slip_sd = _slip(line)

    def excess(frequency_hz: float) -> float:
        return lost_share(chute, phase, frequency_hz, slip_sd=slip_sd / (1 - slip_mean)) - chute.most_lost

    low_hz, high_hz = _ends(excess, design_hz)
    metres_per_cycle = line.spacing * (1 - line.drive.set_for_slip) / (1 - slip_mean)
    low_m_s, high_m_s = metres_per_cycle * low_hz, metres_per_cycle * high_hz
    beside = [(low_m_s, 1 + _BESIDE), (low_m_s, 1 - _BESIDE), (high_m_s, 1 - _BESIDE), (high_m_s, 1 + _BESIDE)]
    rng = np.random.default_rng([seed, _CHECK_STREAM])
    checks = tuple(
        _checked(line, chute, end_m_s * factor, is_inside=number in (0, 2), rng=rng)
        for number, (end_m_s, factor) in enumerate(beside)
        if 0.0 < end_m_s < math.inf
    )
    is_given = chute.phase is not None or chute.design_frequency is not None
    return HandoverBand(design_hz, phase, is_given, chute.most_lost, low_m_s, high_m_s, checks)


def _ends(excess: Callable[[float], float], design_hz: float) -> tuple[float, float]:
    """Return the ends of the range nearest to the design frequency in which a function is at most 0, 1/s."""
    grid_hz = design_hz * np.linspace(0.0, _FASTEST, _STEPS + 1)[1:]
    holds = np.array([excess(each) <= 0.0 for each in grid_hz.tolist()])
    if not holds.any():
        return math.nan, math.nan
    candidates = np.flatnonzero(holds)
    first = last = int(candidates[np.argmin(np.abs(grid_hz[candidates] - design_hz))])
    while first > 0 and holds[first - 1]:
        first -= 1
    while last < len(grid_hz) - 1 and holds[last + 1]:
        last += 1
    low_hz = 0.0 if first == 0 else float(brentq(excess, grid_hz[first - 1], grid_hz[first]))
    high_hz = math.inf if last == len(grid_hz) - 1 else float(brentq(excess, grid_hz[last], grid_hz[last + 1]))
    return low_hz, high_hz


def _slip(line: LineFile) -> tuple[float, float]:
    """Return mean and standard deviation of the slip that acts on the drive."""
    slip = line.ground.slip
    return (0.0, 0.0) if slip is None or line.drive.lag is not None else (slip.mean, slip.sd)


def _checked(
    line: LineFile, chute: ChuteEntry, speed_m_s: float, *, is_inside: bool, rng: np.random.Generator
) -> CheckedSpeed:
    """Return a run of the chute at a constant speed, with the slip of the ground."""
    acceleration_m_s2 = line.ground.acceleration
    starting_m = speed_m_s**2 / (2 * acceleration_m_s2) + 10 * (line.drive.lag or 0.0) * speed_m_s
    first_cycle = _STARTING_CYCLES + math.ceil(starting_m / line.spacing)
    length_m = 1.5 * (first_cycle + _CHECKED_CUPS) * line.spacing / (1 - _slip(line)[0])
    stretch = Stretch(speed_m_s, for_m=length_m)
    profile = SpeedProfile([stretch], acceleration_m_s2=acceleration_m_s2, length_m=length_m)
    course = Course(profile, drive_of(line, profile, rng), length_m)
    ones = np.ones(_CHECKED_CUPS, dtype=np.int64)
    fed = FedRow(ones, np.zeros_like(ones), first_cycle)
    dropped = drop_through_chute(chute, fed, course, phase_cycles=phase_cycles(line), rng=rng)
    return CheckedSpeed(speed_m_s, is_inside, dropped.lost, int(dropped.arrivals.sum()))
