"""Mechanical model of lodging and injury, fitted to one data set, and other predictors for comparison."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plant_sim.common.paper_sheet import equation
from plant_sim.common.polynomial import Polynomial
from plant_sim.planter.parameters import Planter
from plant_sim.study.paper_tables import Experiment, cabbage_experiment
from plant_sim.study.planter.lodging_fit import (
    InjuryConstants,
    LodgingConstants,
    Predictor,
    Values,
    comparisons,
    fit_injury,
    fit_lodging,
    fitted_runs,
    injury_percent,
    lodging_percent,
)
from plant_sim.study.planter.tipping import Tipping


@dataclass(frozen=True)
class LodgingModel:
    """Mechanical model fitted to one data set.

    Attributes:
        experiment: Data set.
        fitted: Mask of the fitted runs.
        natural: Speed, km/h, frequency, 1/min, and force, N, of every run.
        lodging: Constants of lodging.
        injury: Constants of injury.
        lodging_by: Predictions of lodging, the mechanical model first.
        injury_by: Predictions of injury, the mechanical model first.
        tipped_percent: Share of the blocks tipped by the fall in every run, %.
        tipped_error: Standard error of this share due to the number of blocks, percentage points.
    """

    experiment: Experiment
    fitted: NDArray[np.bool_]
    natural: Values
    lodging: LodgingConstants
    injury: InjuryConstants
    lodging_by: list[Predictor]
    injury_by: list[Predictor]
    tipped_percent: Values
    tipped_error: Values


def lodging_model(planter: Planter, tipping: Tipping, experiment: Experiment, natural: Values) -> LodgingModel:
    """Fit the mechanical model to a data set.

    Args:
        planter: Parameters of the planter.
        tipping: Simulated falls, one setting per run.
        experiment: Data set.
        natural: Speed, km/h, frequency, 1/min, and force, N, of every run.
    """
    fitted, force_n, scatter = fitted_runs(experiment), natural[:, 2], planter.scatter
    lodging_observed, injury_observed = experiment.responses["Y1"], experiment.responses["Y2"]
    lodging = fit_lodging(tipping, force_n, lodging_observed, fitted, scatter)
    none = Tipping(tipping.clearance_m, np.zeros_like(tipping.lodged))
    sticking = fit_lodging(none, force_n, lodging_observed, fitted, scatter)
    injury = fit_injury(force_n, injury_observed, fitted, scatter)
    coded = cabbage_experiment("reconciled").coded
    printed = [
        Polynomial(equation(f"cabbage-equation-{number}", name)).predict(coded)
        for number, name in ((10, "Y1"), (11, "Y2"))
    ]
    return LodgingModel(
        experiment,
        fitted,
        natural,
        lodging,
        injury,
        [
            Predictor("mechanics", 3, lodging_percent(tipping, force_n, lodging, scatter)),
            Predictor("sticking alone", 2, lodging_percent(none, force_n, sticking, scatter)),
            *comparisons(experiment, "Y1", fitted, printed[0]),
        ],
        [
            Predictor("law of strength", 2, injury_percent(force_n, injury, scatter)),
            *comparisons(experiment, "Y2", fitted, printed[1]),
        ],
        100 * tipping.share(lodging.clearance_m, scatter.clearance_sd_m),
        100 * tipping.standard_error(lodging.clearance_m, scatter.clearance_sd_m),
    )
