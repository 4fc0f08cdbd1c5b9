"""Reanalysis of the printed pepper trial: Table 4 compared with the paper's equation, table and optimum.

Figures are from [P], sections 3.4 and 3.5; computed figures are marked as such.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from controller.common.document.parts import Heading, Part, Table
from plant_sim.common.paper_sheet import equation, sheet
from plant_sim.common.polynomial import Polynomial
from plant_sim.study.doe.design import orthogonal_axial, to_coded, to_natural
from plant_sim.study.doe.optimum import best, best_location_interval
from plant_sim.study.doe.regression import Fit, fit, terms
from plant_sim.study.doe.weighted import WeightedFit, weighted_fit
from plant_sim.study.paper_tables import PEPPER_FACTORS, Experiment, pepper_experiment, pepper_optimum, printed_anova
from plant_sim.study.report.fit_parts import (
    anova_table,
    coding_table,
    coefficient_table,
    doubts,
    fit_pictures,
    fit_record,
    optimum_table,
    runs_table,
)
from plant_sim.study.report.study import Study
from plant_sim.study.report.weighted_parts import effects_table, weighted_parts

TRIAL_SEEDLINGS: Final = 144
"""Number of seedlings in a trial: two full trays. Source: [P] section 3.2."""
RESPONSE: Final = "S, %"

LOW: Final = (-1.0, -1.0, -1.0)
HIGH: Final = (1.0, 1.0, 1.0)
"""Search range of the paper: every factor from -1 to 1."""

_PRINTED_HALF_STEP = 0.05
"""Maximum rounding error of a success rate printed with one decimal, percentage points."""


def refit() -> Fit:
    """Return the full quadratic model fitted to Table 4."""
    experiment = pepper_experiment()
    return fit(experiment.coded, experiment.responses["S"], terms(len(experiment.factors), "quadratic"))


def weighted_refit() -> WeightedFit:
    """Return the full quadratic model fitted to Table 4 as counts of trials of two trays."""
    experiment = pepper_experiment()
    totals = np.full(len(experiment.coded), float(TRIAL_SEEDLINGS))
    counts = experiment.responses["S"] / 100 * totals
    return weighted_fit(experiment.coded, counts, totals, terms(len(experiment.factors), "quadratic"))


def equation_5() -> Polynomial:
    """Return equation 5 as printed."""
    return Polynomial(equation("pepper-equation-5", "S"))


def binomial_sd_percent(success_percent: float, seedlings: int = TRIAL_SEEDLINGS) -> float:
    """Return the standard deviation of one trial's success rate due to chance alone, percentage points.

    Args:
        success_percent: Expected success, %.
        seedlings: Number of seedlings in the trial.

    >>> round(binomial_sd_percent(94.6), 1)
    1.9
    """
    return float(100 * stats.binom.std(seedlings, success_percent / 100) / seedlings)


def trial_shares(success_percent: NDArray[np.float64], seedlings: int = TRIAL_SEEDLINGS) -> int:
    """Count the printed success rates that match a whole number of seedlings after rounding to one decimal.

    Args:
        success_percent: Printed success rates, %.
        seedlings: Seedlings per trial.
    """
    nearest = 100 * np.round(success_percent * seedlings / 100) / seedlings
    return int(np.count_nonzero(np.abs(success_percent - nearest) <= _PRINTED_HALF_STEP + 1e-9))


def paper_study() -> Study:
    """Return the study ``pepper-rsm --data paper``."""
    experiment, fitted, printed, weighted = pepper_experiment(), refit(), equation_5(), weighted_refit()
    optimum, _ = best(fitted, LOW, HIGH)
    parts = [
        "What was fitted to what: equation 5, the least squares refit and the weighted fit are all fitted to the "
        f"{len(fitted.response)} runs of Table 4, so their agreement with these runs is in-sample. The predicted R² "
        "leaves runs out, and the verification trials are data that none of them has seen. The weighted fit is the "
        "analysis; least squares stays beside it, as printed.",
        *doubts("S, weighted", weighted),
        *_design_parts(experiment, fitted),
        *_weighted_parts(weighted, fitted, printed),
        *_model_parts(fitted, printed),
        *_optimum_parts(fitted, printed, optimum, weighted),
        *_verification_parts(),
    ]
    return Study(
        name="pepper-rsm",
        title="Pepper seedlings: repeated analysis of the paper's orthogonal test",
        command="python -m plant_sim study pepper-rsm --data paper",
        parts=tuple(parts),
        record={**_record(fitted, printed, optimum), "weighted": fit_record(weighted)},
    )


def _design_parts(experiment: Experiment, fitted: Fit) -> list[Part]:
    coding = sheet("pepper-table-3")
    levels = coding.points("foam_mm", "age_d", "pressure_mpa")
    observed, predicted = fitted.response, fitted.predict(fitted.coded)
    centres = int(np.count_nonzero((experiment.coded == 0).all(axis=1)))
    axial = float(experiment.coded.max())
    orthogonal = orthogonal_axial(len(experiment.factors), centres)
    return [
        Heading("Experiment"),
        f"A central composite design of {len(observed)} runs. With {centres} centre runs, its axial level {axial:g} "
        f"makes the squared terms uncorrelated ({orthogonal:.3f}); the natural levels are rounded.",
        coding_table("coding", "Coding of the factors ([P] Table 3)", PEPPER_FACTORS, coding.numbers("code"), levels),
        runs_table(
            "runs",
            "Runs ([P] Table 4) and predictions of the refit",
            PEPPER_FACTORS,
            experiment.coded,
            {RESPONSE: observed, "refit": predicted, "difference": observed - predicted},
        ),
        f"A trial has {TRIAL_SEEDLINGS} seedlings, but only {trial_shares(observed)} of the {len(observed)} printed "
        "success rates correspond to a whole number of seedlings: the others cannot be single trials of "
        f"{TRIAL_SEEDLINGS} rounded to one decimal.",
    ]


def _weighted_parts(weighted: WeightedFit, fitted: Fit, printed: Polynomial) -> list[Part]:
    columns = {"equation 5": printed.coefficients, "least squares": fitted.values, "weighted": weighted.values}
    caption = f"Coefficients of {RESPONSE}, coded factors; error, interval and P of the weighted fit"
    return [
        Heading("Weighted fit"),
        f"The share of each run is taken as that of one trial of {TRIAL_SEEDLINGS} seedlings. Other numbers of "
        "seedlings, equal in all runs, change only the dispersion.",
        *weighted_parts("success", weighted, response=RESPONSE, is_simulated=False),
        effects_table("weighted-coefficients", caption, columns, weighted, is_simulated=False),
    ]


def _model_parts(fitted: Fit, printed: Polynomial) -> list[Part]:
    table_5 = printed_anova("pepper-table-5")
    table_5_by_source = {row.source: row for row in table_5}
    off = max(abs(fitted.values[term] - value) for term, value in printed.coefficients.items())
    lack, pure = fitted.row("lack of fit"), fitted.row("pure error")
    printed_lack, printed_pure = table_5_by_source["lack of fit"], table_5_by_source["pure error"]
    return [
        Heading("Least squares, as printed"),
        f"The refit reproduces equation 5 to within {off:.3f} in every coefficient; R² = {fitted.r2:.4f}, "
        f"adjusted {fitted.adjusted_r2:.4f}.",
        coefficients({"paper": printed.coefficients, "refit": fitted.values}, fitted),
        anova_table(
            "anova", "Analysis of variance: [P] Table 5 and the refit", {"paper": table_5, "refit": fitted.anova}
        ),
        f"Lack of fit: P = {lack.p:.4f} here, {printed_lack.p} printed. The sums of squares of Table 5 come from "
        f"unrounded data: rounding to one decimal alone can change the pure error of the centre runs, "
        f"{pure.sum_of_squares:.2f} here, by {pure_error_slack(fitted):.2f}, and the printed "
        f"{printed_pure.sum_of_squares:.2f} is within that range. In both cases the lack of fit is not significant.",
    ]


def coefficients(columns: Mapping[str, Mapping[str, float]], fitted: Fit) -> Table:
    """Return a table that compares the coefficients of S, for example those of the paper, the refit and the twin.

    Args:
        columns: Coefficients by term, for each column heading.
        fitted: The fit whose standard errors and P values are shown.
    """
    caption = f"Coefficients of {RESPONSE}, coded factors; standard error and P of the {list(columns)[-1]}"
    return coefficient_table("coefficients", caption, columns, fit=fitted)


def pure_error_slack(fitted: Fit) -> float:
    """Return the largest change that rounding to one decimal can cause in the sum of squares of the centre runs."""
    centre = fitted.response[(fitted.coded == 0).all(axis=1)]
    return float(np.sum(2 * np.abs(centre - centre.mean()) * _PRINTED_HALF_STEP))


def _optimum_parts(fitted: Fit, printed: Polynomial, optimum: NDArray[np.float64], weighted: WeightedFit) -> list[Part]:
    claim = pepper_optimum()
    claimed = to_coded(PEPPER_FACTORS, np.array(claim.natural))
    best_printed, _ = best(printed, LOW, HIGH)
    low, high = fitted.prediction_interval(optimum)
    best_weighted, _ = best(weighted, LOW, HIGH)
    least, most = weighted.prediction_interval(best_weighted)
    ends = zip(*(to_natural(PEPPER_FACTORS, end) for end in best_location_interval(weighted, LOW, HIGH)), strict=True)
    location = ", ".join(
        f"{factor.name} {start:.4g} to {stop:.4g} {factor.unit}"
        for factor, (start, stop) in zip(PEPPER_FACTORS, ends, strict=True)
    )
    rounded = float(printed.predict(claimed)[0])
    marks = {"best of the refit": optimum, "rounded by the paper": claimed}
    points = {"best of the weighted fit": best_weighted, **marks, "best of equation 5": best_printed}
    return [
        Heading("Optimum"),
        optimum_table(
            "optimum",
            "Best setting with every factor from -1 to 1",
            PEPPER_FACTORS,
            response=RESPONSE,
            points=points,
            surfaces={"refit": fitted, "equation 5": printed, "weighted": weighted},
        ),
        f"By the weighted fit, a further trial at its best setting is expected between {least[0]:.1f} and "
        f"{most[0]:.1f} % (95 % prediction interval, limited to 0 to 100 %); the 95 % confidence intervals of the best "
        f"setting are {location} (each factor separately, within the search box).",
        f"The paper rounds the setting and states {claim.responses['S']:.1f} % for it; equation 5 gives "
        f"{rounded:.2f} %. By least squares, a further run at the best setting of the refit is expected between "
        f"{low[0]:.1f} and {high[0]:.1f} % (95 % prediction interval, not limited to 100 %).",
        *fit_pictures(
            "success", fitted, PEPPER_FACTORS, response=RESPONSE, marks=marks, held=optimum, weighted=weighted
        ),
    ]


def _verification_parts() -> list[Part]:
    values = sheet("pepper-verification").numbers("S")
    claimed = pepper_optimum().responses["S"]
    scatter = _verification(values, claimed)
    rows = (
        *((str(number), float(value)) for number, value in enumerate(values, start=1)),
        ("mean", float(values.mean())),
    )
    return [
        Heading("Verification"),
        Table("verification", "Trials at the rounded setting ([P] section 3.5)", ("trial", RESPONSE), rows, 2),
        f"The mean is {scatter['mean']:.2f} %. If the true value is {claimed:.1f} %, the mean of five such trials "
        f"deviates at least this much in {100 * scatter['mean_p']:.0f} of 100 cases (t-test), so the prediction is not "
        "contradicted.",
        f"The result of one trial of {TRIAL_SEEDLINGS} seedlings has a binomial standard deviation of "
        f"{scatter['binomial_sd']:.1f} percentage points, so a single trial is weak evidence. The standard deviation "
        f"of the five values is only {scatter['sd']:.2f} percentage points. Five single trials agree this well in only "
        f"{100 * scatter['scatter_p']:.1f} of 100 cases (χ² test), and {len(values) - trial_shares(values)} of the "
        f"{len(values)} values do not correspond to a whole number of seedlings: they cannot be single trials of "
        f"{TRIAL_SEEDLINGS} rounded to one decimal.",
    ]


def _verification(values: NDArray[np.float64], claimed: float) -> dict[str, float]:
    """Compare the scatter of the verification trials with binomial scatter."""
    sd = float(values.std(ddof=1))
    by_chance = binomial_sd_percent(float(values.mean()))
    degrees = len(values) - 1
    return {
        "mean": float(values.mean()),
        "sd": sd,
        "binomial_sd": by_chance,
        "mean_p": float(stats.ttest_1samp(values, claimed).pvalue),
        "scatter_p": float(stats.chi2.cdf(degrees * (sd / by_chance) ** 2, degrees)),
    }


def _record(fitted: Fit, printed: Polynomial, optimum: NDArray[np.float64]) -> dict[str, object]:
    claim = pepper_optimum()
    claimed = to_coded(PEPPER_FACTORS, np.array(claim.natural))
    values = sheet("pepper-verification").numbers("S")
    low, high = fitted.prediction_interval(optimum)
    return {
        "data": "paper",
        "runs": len(fitted.response),
        "factors": [factor.label for factor in PEPPER_FACTORS],
        "paper": {
            "coefficients": dict(printed.coefficients),
            "anova": {row.source: row._asdict() for row in printed_anova("pepper-table-5")},
        },
        "refit": fit_record(fitted),
        "optimum": {
            "coded": optimum.tolist(),
            "natural": to_natural(PEPPER_FACTORS, optimum).tolist(),
            "S": float(fitted.predict(optimum)[0]),
            "prediction_interval_95": [float(low[0]), float(high[0])],
        },
        "paper_optimum": {
            "natural": list(claim.natural),
            "S": claim.responses["S"],
            "S_by_equation_5": float(printed.predict(claimed)[0]),
            "S_by_refit": float(fitted.predict(claimed)[0]),
        },
        "verification": {"S": values.tolist(), **_verification(values, claim.responses["S"])},
    }
