"""Constants of the mechanical model of lodging and injury, fitted to part of Table 2 of the cabbage paper.

A block lodges if it sticks to a plate or if the simulated fall tips it. It is injured if the clamp force exceeds its
strength, which is normally distributed. The constants are fitted to the corner runs and some of the centre runs; the
axial runs and the other centre runs are held back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from plant_sim.planter.ground import ScatterSpec
from plant_sim.study.doe.regression import fit, terms
from plant_sim.study.paper_tables import CABBAGE_FACTORS, Experiment
from plant_sim.study.planter.tipping import DEEPEST_M, Tipping

FITTED_CENTRES: Final = 5
"""Number of centre runs used for the fit; the others are held back."""

Values = NDArray[np.float64]


class LodgingConstants(NamedTuple):
    """Fitted constants of lodging.

    Attributes:
        stick_share: Share of the blocks that stick to a plate at the centre level of the clamp force.
        stick_exponent: Exponent of the clamp force in this share.
        clearance_m: Mean clearance between the tip and the bottom of the furrow, m.
    """

    stick_share: float
    stick_exponent: float
    clearance_m: float


class InjuryConstants(NamedTuple):
    """Fitted constants of injury.

    Attributes:
        strength_n: Mean strength of a block: the clamp force at which it is injured, N.
        strength_sd_n: Standard deviation of the strength, N.
    """

    strength_n: float
    strength_sd_n: float


@dataclass(frozen=True)
class Predictor:
    """Prediction of one response for every run.

    Attributes:
        name: Name of the predictor in the report.
        constants: Number of constants fitted by the study.
        percent: Prediction of every run, %.
    """

    name: str
    constants: int
    percent: Values


def fitted_runs(experiment: Experiment) -> NDArray[np.bool_]:
    """Return a mask of the fitted runs: the corners and the first `FITTED_CENTRES` centres."""
    is_corner = (np.abs(experiment.coded) == 1.0).all(axis=1)
    is_centre = (experiment.coded == 0.0).all(axis=1)
    fitted: NDArray[np.bool_] = is_corner | (is_centre & (np.cumsum(is_centre) <= FITTED_CENTRES))
    return fitted


def rms(difference: Values) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(difference))))


def lodging_percent(tipping: Tipping, force_n: Values, constants: LodgingConstants, scatter: ScatterSpec) -> Values:
    """Return the lodging of every run according to the mechanical model, %.

    Args:
        tipping: Simulated falls, one setting per run.
        force_n: Clamp force of every run, N.
        constants: Constants of lodging.
        scatter: Scatter of the clearance, and the force to which the share of sticking blocks applies.
    """
    share, exponent = float(constants.stick_share), float(constants.stick_exponent)
    law = replace(scatter, stick_share=share, stick_exponent=exponent)
    sticks = np.array([law.stick_share_at(each) for each in force_n.tolist()])
    tips = tipping.share(constants.clearance_m, scatter.clearance_sd_m)
    percent: Values = 100 * (sticks + (1 - sticks) * tips)
    return percent


def fit_lodging(
    tipping: Tipping, force_n: Values, observed_percent: Values, fitted: NDArray[np.bool_], scatter: ScatterSpec
) -> LodgingConstants:
    """Fit the constants of lodging by least squares.

    Args:
        tipping: Simulated falls, one setting per run.
        force_n: Clamp force of every run, N.
        observed_percent: Observed lodging of every run, %.
        fitted: Mask of the fitted runs.
        scatter: Scatter of the clearance, and the force to which the share of sticking blocks applies.
    """

    def residuals(scaled: Values) -> Values:
        constants = LodgingConstants(scaled[0], scaled[1], scaled[2])
        return (lodging_percent(tipping, force_n, constants, scatter) - observed_percent)[fitted]

    low, high = (0.0, -20.0, scatter.clearance_sd_m), (1.0, 20.0, DEEPEST_M - scatter.clearance_sd_m)
    starts = [(0.05, 3.0, clearance_m) for clearance_m in np.linspace(0.010, 0.030, 5)]
    return LodgingConstants(*_best(residuals, starts, low, high, scale=(0.01, 1.0, 0.001)))


def injury_percent(force_n: Values, constants: InjuryConstants, scatter: ScatterSpec) -> Values:
    """Return the injury of every run according to the law of strength of `ScatterSpec`, %.

    Args:
        force_n: Clamp force of every run, N.
        constants: Constants of injury.
        scatter: Specification in which the constants replace those of the strength.
    """
    mean_n, sd_n = float(constants.strength_n), float(constants.strength_sd_n)
    law = replace(scatter, strength_n=mean_n, strength_sd_n=sd_n)
    return 100 * np.array([law.injured_share_at(each) for each in force_n.tolist()])


def fit_injury(
    force_n: Values, observed_percent: Values, fitted: NDArray[np.bool_], scatter: ScatterSpec
) -> InjuryConstants:
    """Fit the constants of injury by least squares.

    Args:
        force_n: Clamp force of every run, N.
        observed_percent: Observed injury of every run, %.
        fitted: Mask of the fitted runs.
        scatter: Specification in which the constants replace those of the strength.
    """

    def residuals(scaled: Values) -> Values:
        constants = InjuryConstants(scaled[0], scaled[1])
        return (injury_percent(force_n, constants, scatter) - observed_percent)[fitted]

    starts = [(200.0, 50.0), (300.0, 100.0)]
    return InjuryConstants(*_best(residuals, starts, (100.0, 1.0), (2000.0, 1000.0), scale=(10.0, 10.0)))


def comparisons(experiment: Experiment, response: str, fitted: NDArray[np.bool_], printed: Values) -> list[Predictor]:
    """Return predictors that do not use the mechanical model.

    Args:
        experiment: Experiment.
        response: Name of the response.
        fitted: Mask of the fitted runs.
        printed: Prediction of every run from the printed equation, %.
    """
    observed, coded = experiment.responses[response], experiment.coded
    linear = fit(coded[fitted], observed[fitted], terms(len(CABBAGE_FACTORS), "linear"))
    mean = np.full(len(observed), observed[fitted].mean())
    return [
        Predictor("mean of the fitted runs", 1, mean),
        Predictor("linear polynomial of the fitted runs", 4, linear.predict(coded)),
        Predictor("equation of the paper, fitted by its authors to all runs", 0, printed),
    ]


def _best(
    residuals: Callable[[Values], Values],
    starts: Sequence[tuple[float, ...]],
    low: tuple[float, ...],
    high: tuple[float, ...],
    *,
    scale: tuple[float, ...],
) -> list[float]:
    """Return the constants with the smallest sum of squares among the fits from several starting points."""
    results = [
        least_squares(residuals, start, bounds=(low, high), x_scale=scale, diff_step=1e-4, xtol=1e-12, ftol=1e-12)
        for start in starts
    ]
    best: list[float] = min(results, key=lambda result: result.cost).x.tolist()
    return best
