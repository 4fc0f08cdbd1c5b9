"""Calibration of the seedling model: constants fitted so that the twin's nominal motion reproduces eq. 5 of the paper.

The pepper paper prints a regression only for the success (eq. 5), that is, 100 % less the sum of the three failure
rates; it describes the curves of the individual rates only in words. The fit uses the regression over the entire design
region and treats the descriptions as soft inequalities; see `statement_residuals`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from plant_sim.crop.expectation import HandlingMotion, Shares, expected
from plant_sim.crop.mechanics import Mechanics, SeedlingSpec
from plant_sim.crop.response import AXIAL_LEVEL, FACTORIAL_RADIUS, natural_factors, success_percent

Array = NDArray[np.float64]
MotionAt = Callable[[Any], HandlingMotion]
"""Function that returns the nominal motion at claw pressures, MPa, with one array row per row of seedlings and one
column per pressure."""

Equation = Callable[[Any, Any, Any], Any]
"""Success, %, as a function of foam thickness (mm), age (d) and claw pressure (MPa)."""
IsFitted = Callable[[Any, Any, Any], Any]
"""Function that returns whether settings (foam thickness, age, claw pressure) take part in a fit."""

FOAMS_MM: Final = np.array([2.5, 5.0, 7.5, 10.0, 12.5, 15.0, 17.5])
AGES_D: Final = np.array([40.0, 43.0, 46.0, 49.0, 52.0, 55.0, 58.0])
PRESSURES_MPA: Final = np.array([0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75])
"""Levels of the single-factor tests. Source: paper, 3.3."""

_EVEN = np.ones(7)
SINGLE_FACTOR: Final = (
    (FOAMS_MM, 52.0 * _EVEN, 0.45 * _EVEN),
    (12.5 * _EVEN, AGES_D, 0.45 * _EVEN),
    (12.5 * _EVEN, 52.0 * _EVEN, PRESSURES_MPA),
)
"""Foam thickness (mm), age (d) and claw pressure (MPa) of the three tests."""

OPTIMUM: Final = (10.0, 51.0, 0.40)
"""Optimum of the paper: foam thickness (mm), age (d) and claw pressure (MPa). Source: paper, 3.5."""

_LEVELS, _LEVELS_OF_THE_FIT = 13, 9
_STATEMENT_WEIGHT, _WEIGHT_LINES, _WEIGHT_OPTIMUM, _WEIGHT_START = 0.75, 0.04, 20.0, 0.02


FITTED: Final[Mapping[str, tuple[float, float]]] = {
    "growth_mm_d": (0.2, 4.0),
    "finger_height_m": (0.085, 0.115),
    "gap_m": (0.006, 0.015),
    "gap_foam": (0.0, 1.0),
    "yield_mm": (8.0, 60.0),
    "yield_exponent": (0.5, 4.0),
    "friction_age": (-0.3, 0.5),
    "friction_age2": (-0.2, 0.2),
    "adhesion_n": (0.8, 6.0),
    "adhesion_sd": (0.2, 0.9),
    "cut_n": (8.0, 30.0),
    "cut_sd": (0.1, 0.6),
    "cut_age": (-0.3, 0.5),
    "cut_age2": (-0.2, 0.2),
    "cut_foam": (0.0, 0.5),
    "endurance": (1.5, 8.0),
    "endurance_sd": (0.2, 0.9),
    "endurance_age": (-0.3, 0.5),
    "endurance_age2": (-0.035, 0.2),
    "contact_foam": (0.2, 1.0),
    "crown_m": (0.0005, 0.008),
    "crown_age": (-0.5, 1.2),
    "crown_age2": (-0.2, 0.2),
    "sway_m": (0.0005, 0.008),
    "sway_force": (0.3, 2.0),
    "stick_m": (0.0005, 0.008),
    "stick_force": (0.0, 2.0),
    "stick_foam": (-0.5, 0.8),
    "stick_age": (-0.3, 1.0),
}
"""Fitted constants with their bounds; other constants of the seedling are those of machine.yaml."""


class SingleFactorCurves(NamedTuple):
    """Expected failures in the three single-factor tests."""

    foam: Shares
    age: Shares
    pressure: Shares


def design_region(levels: int = _LEVELS) -> tuple[Array, Array, Array]:
    """Return a grid of foam thickness (mm), age (d) and claw pressure (MPa) over the design region of eq. 5.

    The region is that of `CropSpec.extrapolates`: no factor exceeds the axial level, and no point is farther from the
    centre than the corners of the factorial.

    Args:
        levels: Levels of each factor.
    """
    level = np.linspace(-AXIAL_LEVEL, AXIAL_LEVEL, levels)
    coded = np.array(np.meshgrid(level, level, level)).reshape(3, -1)
    inside = coded[:, np.linalg.norm(coded, axis=0) <= FACTORIAL_RADIUS + 1e-9]
    x1, x2, x3 = inside
    return natural_factors(x1, x2, x3)


def shares_at(spec: SeedlingSpec, motion: MotionAt, foam_mm: Any, age_d: Any, pressure_mpa: Any) -> Shares:
    """Return the expected failures under nominal motion, averaged over the rows of a trial, one value per setting.

    Args:
        spec: Constants of the seedling.
        motion: Nominal motion by pressure.
        foam_mm: Foam thickness, mm.
        age_d: Age of the seedlings, d.
        pressure_mpa: Claw pressure, MPa.
    """
    shares = expected(Mechanics(spec, foam_mm=np.atleast_1d(foam_mm), age_d=np.atleast_1d(age_d)), motion(pressure_mpa))
    return Shares(*(np.mean(np.atleast_2d(share), axis=0) for share in shares))


def success_at(spec: SeedlingSpec, motion: MotionAt, foam_mm: float, age_d: float, pressure_mpa: float) -> float:
    """Return the expected success at one setting, %; arguments as in `shares_at`."""
    return float(np.squeeze(shares_at(spec, motion, foam_mm, age_d, pressure_mpa).success_percent))


def differences(spec: SeedlingSpec, motion: MotionAt, levels: int = _LEVELS) -> Array:
    """Return the expected success minus the success given by eq. 5 over the design region, percentage points.

    Args:
        spec: Constants of the seedling.
        motion: Nominal motion by pressure.
        levels: Levels of each factor.
    """
    region = design_region(levels)
    return np.asarray(shares_at(spec, motion, *region).success_percent - success_percent(*region))


def courses(spec: SeedlingSpec, motion: MotionAt) -> SingleFactorCurves:
    """Return the expected failures in the single-factor tests of the paper."""
    return SingleFactorCurves(*(shares_at(spec, motion, *setting) for setting in SINGLE_FACTOR))


def statement_residuals(spec: SeedlingSpec, motion: MotionAt) -> Array:
    """Return the deviations from the paper's statements on single factors, percentage points; 0 if a statement is met.

    The thresholds for words such as "high" or "slightly" are assumptions. The statements are from section 3.3 of the
    paper; see docs/sources/machine.md 5.
    """
    foam, age, pressure = courses(spec, motion)
    return 100 * np.concatenate([_foam_residuals(foam), _age_residuals(age), _pressure_residuals(pressure)])


def _foam_residuals(s: Shares) -> Array:
    p, d, t = (np.broadcast_to(each, FOAMS_MM.shape) for each in s[:3])
    return np.concatenate(
        [
            _at_most(p[:3], 0.020),
            _at_least(d[:3], [0.10, 0.05, 0.025]),  # 7.5 mm or less: P low, D high
            _at_least(p[5:], [0.030, 0.080]),
            _at_most(d[5:], [0.010, 0.008]),  # 15 mm or more: P higher, D far lower
            _rising(p[2:], 0.0005),
            _falling(d, 0.001),
            3 * np.maximum(np.abs(t - t.mean()) - 0.010, 0.0),  # T nearly constant
        ]
    )


def _age_residuals(s: Shares) -> Array:
    p, d, t = (np.broadcast_to(each, AGES_D.shape) for each in s[:3])
    return np.concatenate(
        [
            _at_least(p[:2], [0.060, 0.035]),
            _at_least(d[:2], [0.030, 0.020]),  # 43 d or less: P and D high
            _falling(p, 0.001),
            _falling(d, 0.001),
            _at_most(p[6:], 0.030),
            _at_most(d[6:], 0.008),  # decreasing with age
            _at_least(t, 0.004),
        ]
    )


def _pressure_residuals(s: Shares) -> Array:
    d, t, cut, slipped = (np.broadcast_to(each, PRESSURES_MPA.shape) for each in (s.D, s.T, s.cut, s.slipped))
    return np.concatenate(
        [
            _at_least(slipped[:2], [0.080, 0.040]),  # 0.25 MPa or less: plugs stay in their cells
            _at_least(cut[5:], [0.090, 0.150]),  # 0.65 MPa or more: stems are cut
            _rising(-t[:3], [0.030, 0.015]),
            _rising(t[[3, 6]], 0.005),
            _rising(t[5:], 0.002),  # T falls fast, then rises
            _at_most(t[6:] - t[3], 0.040),  # slightly
            _at_most(d, 0.040),
            _rising(d[[3, 6]], 0.003),
            _rising(d[5:], 0.001),  # D rises slightly at the end
        ]
    )


def _at_least(shares: Array, wanted: Any) -> Array:
    missing: Array = np.maximum(np.asarray(wanted) - shares, 0.0)
    return missing


def _at_most(shares: Array, wanted: Any) -> Array:
    excess: Array = np.maximum(shares - np.asarray(wanted), 0.0)
    return excess


def _rising(shares: Array, by: Any) -> Array:
    return 4 * _at_least(np.diff(shares), by)  # the direction of a trend has more weight than its size


def _falling(shares: Array, by: Any) -> Array:
    return _rising(-shares, by)


def middle(spec: SeedlingSpec) -> SeedlingSpec:
    """Return a seedling with each fitted constant at the midpoint of its bounds."""
    return dataclasses.replace(spec, **{name: (low + high) / 2 for name, (low, high) in FITTED.items()})


def everywhere(foam_mm: Any, age_d: Any, pressure_mpa: Any) -> Any:
    """Return that every setting takes part in a fit."""
    return np.isfinite(foam_mm) & np.isfinite(age_d) & np.isfinite(pressure_mpa)


def calibrate(
    start: SeedlingSpec,
    motion: MotionAt,
    *,
    equation: Equation = success_percent,
    is_fitted: IsFitted = everywhere,
    is_line_fitted: IsFitted | None = None,
) -> SeedlingSpec:
    """Fit the seedling to eq. 5 and to the statements, with a small penalty for the distance from the start values.

    Args:
        start: Start values; constants that are not in `FITTED` remain unchanged.
        motion: Nominal motion by pressure.
        equation: Equation to which the success is fitted: eq. 5, or for a hold-out study a refit of it.
        is_fitted: Settings at which it is fitted. The statements, which are words, always take part.
        is_line_fitted: The same for the settings of the single-factor tests and the optimum; None for `is_fitted`.
    """
    is_line_fitted = is_fitted if is_line_fitted is None else is_line_fitted
    region = tuple(each[is_fitted(*design_region(_LEVELS_OF_THE_FIT))] for each in design_region(_LEVELS_OF_THE_FIT))
    kept = [is_line_fitted(*setting) for setting in SINGLE_FACTOR]
    optimum_weight = _WEIGHT_OPTIMUM if is_line_fitted(*OPTIMUM) else 0.0
    names = list(FITTED)
    low, high = np.array(list(FITTED.values())).T
    first = np.clip([getattr(start, name) for name in names], low, high)
    size = high - low

    def spec_of(scaled: Array) -> SeedlingSpec:
        values = low + size * scaled
        return dataclasses.replace(start, **dict(zip(names, values.tolist(), strict=True)))

    def residuals(scaled: Array) -> Array:
        spec = spec_of(scaled)
        off = np.asarray(shares_at(spec, motion, *region).success_percent - equation(*region))
        lines = [
            (course.success_percent - np.clip(equation(*setting), 0, 100))[is_kept]
            for course, setting, is_kept in zip(courses(spec, motion), SINGLE_FACTOR, kept, strict=True)
        ]
        best = success_at(spec, motion, *OPTIMUM) - float(equation(*OPTIMUM))
        return np.concatenate(
            [
                10 * off / np.sqrt(off.size),
                _STATEMENT_WEIGHT * statement_residuals(spec, motion),
                _WEIGHT_LINES * np.concatenate(lines),
                optimum_weight * np.array([best]),
                _WEIGHT_START * (scaled - (first - low) / size),
            ]
        )

    scaled = np.clip((first - low) / size, 0.001, 0.999)
    result = least_squares(residuals, scaled, bounds=(np.zeros_like(scaled), np.ones_like(scaled)), max_nfev=400)
    return spec_of(result.x)
