"""Hold-out study: predictions of the pepper models for settings to which they were not fitted.

``python -m scripts.hold_out`` prints the tables of docs/statistics.md. In-sample and out-of-sample figures have columns
of their own, and each row names the data with which the predictions are compared.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from plant_sim.common.polynomial import Polynomial
from plant_sim.crop.response import coded_factors, success_percent
from plant_sim.machine.parameters import load_machine
from plant_sim.study.doe.design import to_natural
from plant_sim.study.doe.regression import fit, point_numbers, terms
from plant_sim.study.doe.weighted import weighted_fit
from plant_sim.study.paper_tables import PEPPER_FACTORS, pepper_experiment
from plant_sim.study.pepper.calibration import calibrate, design_region, everywhere, middle, shares_at
from plant_sim.study.pepper.nominal import NominalMotion, nominal_motion
from plant_sim.study.pepper.paper import TRIAL_SEEDLINGS
from scripts.error_rates import table

Array = NDArray[np.float64]
Fitted = Callable[[Array, Array], Callable[[Array], Array]]
"""Function that fits a model to coded runs and their success, %, and returns its prediction at coded points."""

QUADRATIC: Final = terms(3, "quadratic")
HALVES: Final = {
    f"{name} {side}": (index, sign)
    for index, name in enumerate(("foam", "age", "pressure"))
    for side, sign in (("low", -1), ("high", 1))
}
"""Halves of the region: factor and sign of the half to which a model is fitted."""


def least_squares(coded: Array, success: Array) -> Callable[[Array], Array]:
    """Fit the quadratic by least squares."""
    return fit(coded, success, QUADRATIC).predict


def weighted(coded: Array, success: Array) -> Callable[[Array], Array]:
    """Fit the quadratic with binomial weights."""
    totals = np.full(len(success), float(TRIAL_SEEDLINGS))
    return weighted_fit(coded, success / 100 * totals, totals, QUADRATIC).predict


def seedlings(motion: NominalMotion, coded: Array, success: Array) -> Callable[[Array], Array]:
    """Calibrate the seedlings to the quadratic that is fitted to the runs.

    Args:
        motion: Nominal motion of the machine.
        coded: Coded runs.
        success: Success of the runs, %.
    """
    quadratic = Polynomial(fit(coded, success, QUADRATIC).values)

    def equation(foam_mm: Any, age_d: Any, pressure_mpa: Any) -> Any:
        points = np.column_stack([np.atleast_1d(each) for each in coded_factors(foam_mm, age_d, pressure_mpa)])
        return np.squeeze(quadratic.predict(points))

    spec = calibrate(middle(load_machine().seedling), motion, equation=equation)

    def predict(points: Array) -> Array:
        return np.asarray(shares_at(spec, motion, *to_natural(PEPPER_FACTORS, points).T).success_percent)

    return predict


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def noise_floor() -> float:
    """Return the standard deviation of the centre runs of Table 4, percentage points."""
    experiment = pepper_experiment()
    return float(experiment.responses["S"][(experiment.coded == 0).all(axis=1)].std(ddof=1))


def left_out(model: Fitted, groups: NDArray[np.intp]) -> Array:
    """Return the observed success minus its prediction by a model fitted without the group of the run.

    Args:
        model: The model.
        groups: Group of every run of Table 4; the runs of a group are left out together.
    """
    experiment = pepper_experiment()
    success = experiment.responses["S"]
    off = np.empty_like(success)
    for group in range(int(groups.max()) + 1):
        out = groups == group
        off[out] = success[out] - model(experiment.coded[~out], success[~out])(experiment.coded[out])
    return off


def half_by_table_4(model: Fitted, index: int, sign: int) -> tuple[float, float]:
    """Return the deviations of a model fitted to one half of Table 4: in this half and in the other one.

    Args:
        model: The model.
        index: Factor that divides the region; its middle level belongs to the half of the fit.
        sign: Sign of the factor in the half of the fit.
    """
    experiment = pepper_experiment()
    success, inside = experiment.responses["S"], sign * experiment.coded[:, index] >= 0
    predict = model(experiment.coded[inside], success[inside])
    off = success - predict(experiment.coded)
    return rms(off[inside]), rms(off[~inside])


def half_by_equation_5(
    motion: NominalMotion, index: int, sign: int, *, are_lines_held_out: bool
) -> tuple[float, float]:
    """Return the deviations of seedlings calibrated in one half of the region of equation 5, as `half_by_table_4`.

    Args:
        motion: Nominal motion of the machine.
        index: Factor that divides the region.
        sign: Sign of the factor in the half of the fit.
        are_lines_held_out: False if equation 5 takes part in the fit at the settings of the single-factor tests and at
            the optimum also in the other half.
    """

    def is_fitted(*natural: Any) -> Any:
        return sign * coded_factors(*natural)[index] >= -1e-9

    is_line_fitted = is_fitted if are_lines_held_out else everywhere
    spec = calibrate(middle(load_machine().seedling), motion, is_fitted=is_fitted, is_line_fitted=is_line_fitted)
    region = design_region()
    off = np.asarray(shares_at(spec, motion, *region).success_percent - success_percent(*region))
    inside = is_fitted(*region)
    return rms(off[inside]), rms(off[~inside])


def main() -> None:
    """Print the tables."""
    experiment, motion = pepper_experiment(), nominal_motion(load_machine())
    floor = f"{noise_floor():.2f}"
    each_run, points = np.arange(len(experiment.coded)), point_numbers(experiment.coded)
    models: dict[str, Fitted] = {
        "quadratic, least squares": least_squares,
        "quadratic, weighted": weighted,
        "seedlings, calibrated to the quadratic": partial(seedlings, motion),
    }
    rows: list[tuple[str, ...]] = []
    for name, model in models.items():
        inside = rms(experiment.responses["S"] - model(experiment.coded, experiment.responses["S"])(experiment.coded))
        run = f"{rms(left_out(model, each_run)):.2f}" if model in (least_squares, weighted) else "-"
        rows.append((name, "Table 4", f"{inside:.2f}", run, f"{rms(left_out(model, points)):.2f}", floor))
    heading = ("model", "reference", "in-sample", "out of sample: a run", "out of sample: a point", "noise floor")
    sys.stdout.write(table(heading, rows) + "\n\n")
    rows = []
    for half, (index, sign) in HALVES.items():
        for name in ("quadratic, least squares", "quadratic, weighted"):
            found = half_by_table_4(models[name], index, sign)
            rows.append((half, name, "Table 4", *(f"{each:.2f}" for each in found), floor))
        for are_lines_held_out, name in ((True, "seedlings"), (False, "seedlings, lines and optimum fitted")):
            found = half_by_equation_5(motion, index, sign, are_lines_held_out=are_lines_held_out)
            rows.append((half, name, "equation 5", *(f"{each:.2f}" for each in found), floor))
    heading = ("fitted half", "model", "reference", "in-sample", "extrapolated to the other half", "noise floor")
    sys.stdout.write(table(heading, rows) + "\n")


if __name__ == "__main__":
    main()
