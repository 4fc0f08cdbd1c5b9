"""Study ``pepper-rsm`` on the twin: orthogonal test of the pepper paper ([P], sections 3.4 and 3.5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.common.document.parts import Cell, Heading, Part, Table, counted
from plant_sim.common.paper_sheet import sheet
from plant_sim.crop.response import CropSpec
from plant_sim.study.doe.design import to_coded, to_natural
from plant_sim.study.doe.optimum import best, best_location_interval
from plant_sim.study.doe.regression import terms
from plant_sim.study.doe.weighted import Model, WeightedFit, weighted_fit
from plant_sim.study.paper_tables import PEPPER_FACTORS, pepper_experiment, pepper_optimum, printed_anova
from plant_sim.study.pepper.experiment import (
    LEFT_OUT,
    PooledResult,
    cautions,
    incomplete_count,
    point_of,
    run_record,
    setting_of,
)
from plant_sim.study.pepper.losses import losses_parts
from plant_sim.study.pepper.paper import HIGH, LOW, RESPONSE, equation_5, refit
from plant_sim.study.report.fit_parts import (
    SHARE_LIMITS,
    anova_table,
    doubts,
    fit_pictures,
    fit_record,
    optimum_table,
    runs_table,
)
from plant_sim.study.report.origin import changed_keys, origin_parts
from plant_sim.study.report.study import Study
from plant_sim.study.report.weighted_parts import effects_table, weighted_parts
from plant_sim.study.runner import RunOptions, incomplete_trials
from plant_sim.twin.repeats import SHARES


def rsm_study(options: RunOptions) -> Study:
    """Return the study: the design of Table 4, regression, optimum and verification.

    Raises:
        StudyError: A setting is invalid, or none of its trials completes.
    """
    experiment, claim = pepper_experiment(), pepper_optimum()
    natural = to_natural(PEPPER_FACTORS, experiment.coded)
    settings = [setting_of(each, options.machine) for each in (*natural, claim.natural)]
    trials = options.run(settings)
    *reports, verification = trials
    points = [
        point_of(CropSpec(*map(float, each)), each_reports) for each, each_reports in zip(natural, reports, strict=True)
    ]
    pooled = point_of(CropSpec(*map(float, claim.natural)), verification)
    completed = [[report for report in each if report.completed] for each in reports]
    coded = np.repeat(experiment.coded, [len(each) for each in completed], axis=0)
    each_trial = [report for each in completed for report in each]
    twin = weighted_fit(
        coded,
        np.array([report.in_cups for report in each_trial]),
        np.array([report.seedlings for report in each_trial]),
        terms(len(PEPPER_FACTORS), "quadratic"),
    )
    optimum = _Optimum.of(twin)
    checks = np.array([report.S for report in verification if report.completed])
    parts = [
        *origin_parts(options.machine, options.machine_file),
        f"The paper's design (Table 4) run on the twin: {len(points)} runs of "
        f"{counted(options.trials, 'trial')} with {options.seedlings} seedlings each.",
        *cautions(settings[:-1], options),
        *incomplete_trials(trials, LEFT_OUT),
        *doubts("S", twin, is_simulated=True),
        *optimum.doubts(),
        *_run_parts(experiment.coded, experiment.responses["S"], points),
        *_fit_parts(twin),
        *_best_parts(twin, optimum),
        *losses_parts(coded, each_trial),
        *_check_parts(checks, pooled),
    ]
    record = {
        "data": "twin",
        "changed_parameters": changed_keys(options.machine),
        "incomplete_trials": incomplete_count(trials),
        "runs": [run_record(*each) for each in zip(points, settings[:-1], reports, strict=True)],
        "twin": fit_record(twin),
        "refit": fit_record(refit()),
        "paper": {"coefficients": dict(equation_5().coefficients)},
        "optimum": {**_setting_record(optimum.coded, twin), **optimum.record()},
        "paper_optimum": _setting_record(best(refit(), LOW, HIGH)[0], refit()),
        "verification": {
            **run_record(pooled, settings[-1], verification),
            "S": checks.tolist(),
            "mean": float(checks.mean()),
            "paper": sheet("pepper-verification").numbers("S").tolist(),
        },
    }
    return Study(
        name="pepper-rsm",
        title="Pepper seedlings: the paper's orthogonal test on the twin",
        command=options.command("pepper-rsm"),
        parts=tuple(parts),
        record=record,
    )


@dataclass(frozen=True)
class _Optimum:
    """Best setting of the twin with its confidence intervals.

    Attributes:
        coded: Best setting, coded.
        success: Fitted S at the setting, %, not limited to 0 to 100.
        expected: 95 % prediction interval for one further trial at the setting, %, limited to 0 to 100.
        location: 95 % confidence interval for each coded factor of the setting.
    """

    coded: NDArray[np.float64]
    success: float
    expected: tuple[float, float]
    location: tuple[NDArray[np.float64], NDArray[np.float64]]

    @classmethod
    def of(cls, twin: WeightedFit) -> _Optimum:
        """Return the optimum of a fit."""
        coded, success = best(twin, LOW, HIGH)
        low, high = np.clip(np.concatenate(twin.prediction_interval(coded)), *SHARE_LIMITS).tolist()
        return cls(coded, success, (low, high), best_location_interval(twin, LOW, HIGH))

    def doubts(self) -> list[str]:
        """Return a caveat if the fitted success exceeds 100 %."""
        if self.success <= SHARE_LIMITS[1]:
            return []
        return [
            f"At its best setting the quadratic model gives S {self.success:.1f} %, which is impossible: the scatter "
            "of runs with so few seedlings is too large, or the model is too simple. Disregard the location and value "
            "of this optimum."
        ]

    def text(self) -> str:
        """Return the intervals of the optimum as text."""
        ends = zip(*(to_natural(PEPPER_FACTORS, end) for end in self.location), strict=True)
        location = ", ".join(
            f"{factor.name} {low:.4g} to {high:.4g} {factor.unit}"
            for factor, (low, high) in zip(PEPPER_FACTORS, ends, strict=True)
        )
        return (
            f"A further trial at the best setting of the twin is expected between {self.expected[0]:.1f} and "
            f"{self.expected[1]:.1f} % (95 % prediction interval, limited to 0 to 100 %). The 95 % confidence "
            f"intervals of the best setting are {location} (each factor separately, within the search box; Monte Carlo "
            "with the covariance of the coefficients)."
        )

    def record(self) -> dict[str, object]:
        """Return the intervals for the JSON record."""
        low, high = (to_natural(PEPPER_FACTORS, end).tolist() for end in self.location)
        return {"prediction_interval_95": list(self.expected), "place_interval_95": {"low": low, "high": high}}


def _run_parts(coded: NDArray[np.float64], printed: NDArray[np.float64], points: Sequence[PooledResult]) -> list[Part]:
    columns = {
        "S, paper": printed,
        "S by equation 5": np.array([each.by_equation_5 for each in points]),
        **{f"{name}, twin": np.array([each.shares[name] for each in points]) for name in SHARES},
    }
    return [
        Heading("Runs"),
        runs_table("runs", "Success and failures, %", PEPPER_FACTORS, coded, columns, digits=1),
    ]


def _fit_parts(twin: WeightedFit) -> list[Part]:
    columns = {"paper": equation_5().coefficients, "refit of Table 4": refit().values, "twin": twin.values}
    caption = f"Coefficients of {RESPONSE}, coded factors; error and interval of the twin's"
    return [
        Heading("Model"),
        effects_table("coefficients", caption, columns, twin, is_simulated=True),
        *weighted_parts("success", twin, response=RESPONSE, is_simulated=True),
        anova_table(
            "anova",
            "Analysis of variance by least squares as printed: [P] Table 5 and the refit of Table 4, which treat the "
            "shares as equally precise",
            {"paper": printed_anova("pepper-table-5"), "refit": refit().anova},
        ),
    ]


def _best_parts(twin: WeightedFit, best_of_twin: _Optimum) -> list[Part]:
    optimum = best_of_twin.coded
    claimed = to_coded(PEPPER_FACTORS, np.array(pepper_optimum().natural))
    of_paper, _ = best(refit(), LOW, HIGH)
    marks = {"best of the twin": optimum, "rounded by the paper": claimed}
    off = to_natural(PEPPER_FACTORS, optimum) - to_natural(PEPPER_FACTORS, of_paper)
    return [
        Heading("Optimum"),
        optimum_table(
            "optimum",
            "Best setting with every factor from -1 to 1",
            PEPPER_FACTORS,
            response=RESPONSE,
            points={**marks, "best of the refit": of_paper},
            surfaces={"twin": twin, "refit": refit(), "equation 5": equation_5()},
        ),
        *best_of_twin.doubts(),
        best_of_twin.text(),
        f"The twin's optimum differs from that of the refit by {off[0]:+.2f} mm, {off[1]:+.2f} d and "
        f"{off[2]:+.3f} MPa.",
        *fit_pictures("success", twin, PEPPER_FACTORS, response=RESPONSE, marks=marks, held=optimum),
    ]


def _check_parts(checks: NDArray[np.float64], pooled: PooledResult) -> list[Part]:
    paper = sheet("pepper-verification").numbers("S")
    low, high = pooled.intervals["S"]
    foam_mm, age_d, pressure_mpa = pooled.levels
    setting = f"{foam_mm:g} mm, {age_d:g} d, {pressure_mpa:.2f} MPa"
    rows: list[tuple[Cell, ...]] = [
        (
            str(number + 1),
            float(paper[number]) if number < len(paper) else None,
            float(checks[number]) if number < len(checks) else None,
        )
        for number in range(max(len(paper), len(checks)))
    ]
    rows.append(("mean", float(paper.mean()), float(checks.mean())))
    return [
        Heading("Verification"),
        Table("verification", f"Trials at {setting}: S, %", ("trial", "paper", "twin"), tuple(rows)),
        f"All seedlings of the twin's trials: S {pooled.shares['S']:.2f} %, 95 % binomial {low:.2f} to "
        f"{high:.2f}; equation 5 gives {pooled.by_equation_5:.2f}.",
    ]


def _setting_record(coded: NDArray[np.float64], fitted: Model) -> dict[str, object]:
    return {
        "coded": coded.tolist(),
        "natural": to_natural(PEPPER_FACTORS, coded).tolist(),
        "S": float(fitted.predict(coded)[0]),
    }
