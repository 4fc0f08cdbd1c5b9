"""The pepper paper's experiments on the twin: the three single-factor tests and the orthogonal test.

Every figure of the paper is of [P], section 3.3 to 3.5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from plant_sim.bench.repeats import SHARES, Pool, pool
from plant_sim.bench.report import TrialReport
from plant_sim.bench.study.design import to_coded, to_natural
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.factors import Setting, ratings_exceeded
from plant_sim.bench.study.fit_parts import anova_table, fit_pictures, fit_record, optimum_table, p_text, runs_table
from plant_sim.bench.study.optimum import best
from plant_sim.bench.study.paper import (
    PEPPER_FACTORS,
    pepper_experiment,
    pepper_optimum,
    printed_anova,
    sheet,
)
from plant_sim.bench.study.parts import Cell, Heading, Part, Picture, Table, counted
from plant_sim.bench.study.pepper_paper import HIGH, LOW, RESPONSE, coefficients, equation_5, refit
from plant_sim.bench.study.pepper_words import SENTENCES
from plant_sim.bench.study.regression import Fit, fit, terms
from plant_sim.bench.study.report import Study, drawing
from plant_sim.bench.study.runner import RunOptions, incomplete_trials
from plant_sim.crop.response import CropSpec, success_percent
from plant_sim.parameters import Machine
from plant_sim.scope.style import COLOURS, QUIET

NAMES: Final = ("crop.foam_thickness_mm", "crop.seedling_age_d", "crop.claw_pressure_mpa")
"""The factors of the paper as parameters of the machine, in its order."""

_RECEIVER_MARGIN_PA = 0.05e6
_LEFT_OUT: Final = "they are left out"
_AXES: Final = {"foam": "foam thickness, mm", "age": "age of the seedlings, d", "pressure": "claw pressure, MPa"}
_LINES: Final = {"F_p": COLOURS["left"], "F_d": COLOURS["right"], "F_t": COLOURS["supply"]}


@dataclass(frozen=True, slots=True)
class Point:
    """What the trials at one setting gave together.

    Attributes:
        crop: Foam, mm, age, d, and claw pressure, MPa.
        pool: Those that completed.
    """

    crop: CropSpec
    pool: Pool

    @property
    def shares(self) -> Mapping[str, float]:
        """S, F_p, F_d and F_t of all seedlings together, %."""
        return self.pool.shares

    @property
    def intervals(self) -> Mapping[str, tuple[float, float]]:
        """Their 95 % binomial intervals, %."""
        return self.pool.intervals

    @property
    def by_equation_5(self) -> float:
        """S by equation 5, not limited to 0 to 100, %."""
        crop = self.crop
        return success_percent(crop.foam_thickness_mm, crop.seedling_age_d, crop.claw_pressure_mpa)


def point_of(crop: CropSpec, reports: Sequence[TrialReport]) -> Point:
    """Take the trials at a setting together that completed.

    Args:
        crop: The setting.
        reports: Its trials.

    Raises:
        StudyError: none of them completed.
    """
    completed = [report for report in reports if report.completed]
    if not completed:
        first = reports[0]
        raise StudyError(f"seed {first.seed}: neither this nor any other trial of its setting completed "
                         f"({first.reason}); give a machine that works")  # fmt: skip
    return Point(crop, pool(completed))


def setting_of(natural: Sequence[float], machine: Machine) -> Setting:
    """Return the setting of a foam, mm, an age, d, and a claw pressure, MPa.

    Where the receiver of the machine does not hold the claw pressure, the compressor is set higher, as the paper's
    must have been, which went up to 0.75 MPa.

    Args:
        natural: Foam, age and pressure.
        machine: The machine.
    """
    values = dict(zip(NAMES, map(float, natural), strict=True))
    claws_pa = 1e6 * values[NAMES[2]]
    if claws_pa > machine.supply.compressor_on_pa - _RECEIVER_MARGIN_PA:
        values["supply.compressor_on_pa"] = claws_pa + _RECEIVER_MARGIN_PA
        values["supply.compressor_off_pa"] = claws_pa + 3 * _RECEIVER_MARGIN_PA
    return Setting(values)


def single_study(options: RunOptions) -> Study:
    """Return the study ``pepper-single``: each factor of the paper by itself.

    Raises:
        StudyError: a setting is impossible or none of its trials completes.
    """
    levels = sheet("pepper-single-factor")
    natural = levels.points("foam_mm", "age_d", "pressure_mpa")
    settings = [setting_of(each, options.machine) for each in natural]
    reports = options.run(settings)
    tests: dict[str, list[Point]] = {name: [] for name in _AXES}
    for name, each, trials in zip(levels.texts("factor"), natural, reports, strict=True):
        tests[name].append(point_of(CropSpec(*map(float, each)), trials))
    parts: list[Part] = [
        f"{counted(options.trials, 'trial')} of {options.seedlings} seedlings at each level, on the twin. The paper "
        "prints the results as pictures only and describes them in words.",
        *_cautions(settings, options),
        *incomplete_trials(reports, _LEFT_OUT),
    ]
    for place, (name, points) in enumerate(tests.items()):
        parts += [
            Heading(_AXES[name].partition(",")[0].capitalize()),
            _single_table(name, points, place),
            Picture(f"single-{name}", f"Failures and success over {_AXES[name]}; bars: 95 % binomial.",
                    _single_figure(name, points, place)),
            _words_table(name, points),
        ]  # fmt: skip
    parts.append(_what_equation_5_implies(tests["age"]))
    record = {
        name: [{**_natural_record(each), **each.shares, "intervals": dict(each.intervals),
                "S_by_equation_5": each.by_equation_5} for each in points]
        for name, points in tests.items()
    } | {"incomplete_trials": _incomplete(reports)}  # fmt: skip
    return Study(
        name="pepper-single",
        title="Pepper seedlings: each factor by itself",
        command=options.command("pepper-single"),
        parts=tuple(parts),
        record=record,
    )


def _incomplete(reports: Sequence[Sequence[TrialReport]]) -> int:
    return sum(not report.completed for trials in reports for report in trials)


def _cautions(settings: Sequence[Setting], options: RunOptions) -> list[Part]:
    beyond = sum(setting.machine(options.machine).crop.extrapolates for setting in settings)
    told = ratings_exceeded(settings, options.machine)
    parts: list[Part] = []
    if beyond:
        parts.append(
            f"{beyond} of {len(settings)} settings lie outside the paper's orthogonal test, where equation 5 and the "
            "calibration of the seedling extrapolate."
        )
    raised = sum("supply.compressor_on_pa" in setting.values for setting in settings)
    if raised:
        parts.append(
            f"At {raised} settings the compressor is set higher, or the receiver would not hold the claw pressure."
        )
    if told:
        parts.append("Outside the makers' ratings: " + "; ".join(told) + ".")
    return parts


def _level(point: Point, place: int) -> float:
    crop = point.crop
    return (crop.foam_thickness_mm, crop.seedling_age_d, crop.claw_pressure_mpa)[place]


def _natural_record(point: Point) -> dict[str, float]:
    return {name.partition(".")[2]: _level(point, place) for place, name in enumerate(NAMES)}


def _single_table(name: str, points: Sequence[Point], place: int) -> Table:
    heading = (_AXES[name], "F_p, %", "F_d, %", "F_t, %", "S, %", "S from", "to", "S by equation 5", "extrapolated")
    rows: list[tuple[Cell, ...]] = []
    for point in points:
        shares, (low, high) = point.shares, point.intervals["S"]
        rows.append((
            f"{_level(point, place):g}", shares["F_p"], shares["F_d"], shares["F_t"], shares["S"], low, high,
            point.by_equation_5, "yes" if point.crop.extrapolates else "no",
        ))  # fmt: skip
    return Table(f"single-{name}", f"Failures over {_AXES[name]}", heading, tuple(rows), 1)


def _single_figure(name: str, points: Sequence[Point], place: int) -> Figure:
    levels = [_level(point, place) for point in points]
    with drawing():
        figure = Figure(figsize=(7.0, 3.2), layout="constrained")
        failures, success = figure.subplots(1, 2)
        for share, colour in _LINES.items():
            failures.errorbar(levels, [each.shares[share] for each in points], _bars(points, share), color=colour,
                              marker="o", markersize=4, capsize=2, label=share)  # fmt: skip
        failures.set(xlabel=_AXES[name], ylabel="failures, %", ylim=(0, None))
        failures.legend()
        success.errorbar(levels, [each.shares["S"] for each in points], _bars(points, "S"), color=COLOURS["left"],
                         marker="o", markersize=4, capsize=2, label="twin")  # fmt: skip
        success.plot(levels, [each.by_equation_5 for each in points], "--", color=QUIET, label="equation 5")
        success.set(xlabel=_AXES[name], ylabel="S, %")
        success.legend()
    return figure


def _bars(points: Sequence[Point], share: str) -> NDArray[np.float64]:
    """Distances from each share down and up to the ends of its interval, 2 rows."""
    ends = [(each.shares[share] - each.intervals[share][0], each.intervals[share][1] - each.shares[share])
            for each in points]  # fmt: skip
    bars: NDArray[np.float64] = np.maximum(np.array(ends).T, 0.0)
    return bars


def _words_table(name: str, points: Sequence[Point]) -> Table:
    """What the paper says of a factor, and what the twin gives for it."""
    course = tuple(point.pool for point in points)
    rows: list[tuple[Cell, ...]] = []
    for each in SENTENCES[name]:
        shown = ", ".join(f"{point.shares[each.share]:.1f}" for point in points)
        rows.append((each.words, each.meaning, f"{each.share} {shown}", each.verdict(course)))
    caption = (
        "What the paper says in words, and what these trials give; undecided: so few seedlings do not tell "
        "(95 % for all comparisons of a line together)"
    )
    return Table(f"words-{name}", caption, ("paper", "taken as", "twin, %, level by level", "holds"), tuple(rows))


def _what_equation_5_implies(points: Sequence[Point]) -> str:
    at = {each.crop.seedling_age_d: each for each in points}
    young, old = at[52.0], at[58.0]
    lost = young.by_equation_5 - old.by_equation_5
    picked = sum(old.shares[name] - young.shares[name] for name in ("F_p", "F_d"))
    return (
        f"From 52 to 58 d equation 5 loses {lost:.1f} points, while the paper says that pick and carry failures fall. "
        f"Both can only be true if throw failures rise by more than that: on the twin F_p and F_d together change by "
        f"{picked:+.1f} points and F_t by {old.shares['F_t'] - young.shares['F_t']:+.1f}."
    )


def rsm_study(options: RunOptions) -> Study:
    """Return the study ``pepper-rsm`` on the twin: Table 4's design, its regression, optimum and verification.

    Raises:
        StudyError: a setting is impossible or none of its trials completes.
    """
    experiment, claim = pepper_experiment(), pepper_optimum()
    natural = to_natural(PEPPER_FACTORS, experiment.coded)
    trials = options.run([setting_of(each, options.machine) for each in (*natural, claim.natural)])
    *reports, verification = trials
    points = [point_of(CropSpec(*map(float, each)), own) for each, own in zip(natural, reports, strict=True)]
    pooled = point_of(CropSpec(*map(float, claim.natural)), verification)
    success = np.array([each.shares["S"] for each in points])
    twin = fit(experiment.coded, success, terms(len(PEPPER_FACTORS), "quadratic"))
    optimum, _ = best(twin, LOW, HIGH)
    checks = np.array([report.S for report in verification if report.completed])
    parts = [
        f"The paper's design (Table 4) run on the twin: {len(points)} runs of "
        f"{counted(options.trials, 'trial')} with {options.seedlings} seedlings each.",
        *_cautions([setting_of(each, options.machine) for each in natural], options),
        *incomplete_trials(trials, _LEFT_OUT),
        *_run_parts(experiment.coded, experiment.responses["S"], points),
        *_fit_parts(twin),
        *_best_parts(twin, optimum),
        *_check_parts(checks, pooled),
    ]
    record = {
        "data": "twin",
        "incomplete_trials": _incomplete(trials),
        "runs": [{**_natural_record(each), **each.shares} for each in points],
        "twin": fit_record(twin),
        "refit": fit_record(refit()),
        "paper": {"coefficients": dict(equation_5().coefficients)},
        "optimum": _setting_record(optimum, twin),
        "paper_optimum": _setting_record(best(refit(), LOW, HIGH)[0], refit()),
        "verification": {"S": checks.tolist(), "mean": float(checks.mean()),
                         "paper": sheet("pepper-verification").numbers("S").tolist()},
    }  # fmt: skip
    return Study(
        name="pepper-rsm",
        title="Pepper seedlings: the paper's orthogonal test on the twin",
        command=options.command("pepper-rsm"),
        parts=tuple(parts),
        record=record,
    )


def _run_parts(coded: NDArray[np.float64], printed: NDArray[np.float64], points: Sequence[Point]) -> list[Part]:
    columns = {
        "S, paper": printed,
        "S by equation 5": np.array([each.by_equation_5 for each in points]),
        **{f"{name}, twin": np.array([each.shares[name] for each in points]) for name in SHARES},
    }
    return [
        Heading("The runs"),
        runs_table("runs", "Success and failures, %", PEPPER_FACTORS, coded, columns, digits=1),
    ]


def _fit_parts(twin: Fit) -> list[Part]:
    lack_p = p_text(twin.row("lack of fit").p) or "not to be had, as all centre runs agree"
    return [
        Heading("The model"),
        f"R² of the twin's regression {twin.r2:.3f} (paper's data {refit().r2:.3f}); "
        f"lack of fit P {lack_p}.",
        coefficients({"paper": equation_5().coefficients, "refit": refit().values, "twin": twin.values}, twin),
        anova_table(
            "anova", "Analysis of variance: [P] Table 5, the refit of Table 4, and the twin",
            {"paper": printed_anova("pepper-table-5"), "refit": refit().anova, "twin": twin.anova},
        ),
    ]  # fmt: skip


def _best_parts(twin: Fit, optimum: NDArray[np.float64]) -> list[Part]:
    claimed = to_coded(PEPPER_FACTORS, np.array(pepper_optimum().natural))
    of_paper, _ = best(refit(), LOW, HIGH)
    marks = {"best of the twin": optimum, "rounded by the paper": claimed}
    off = to_natural(PEPPER_FACTORS, optimum) - to_natural(PEPPER_FACTORS, of_paper)
    return [
        Heading("The optimum"),
        optimum_table(
            "optimum", "Best setting with every factor from -1 to 1", PEPPER_FACTORS, response=RESPONSE,
            points={**marks, "best of the refit": of_paper},
            surfaces={"twin": twin, "refit": refit(), "equation 5": equation_5()},
        ),
        f"The twin's optimum lies {off[0]:+.2f} mm, {off[1]:+.2f} d and {off[2]:+.3f} MPa from that of the refit.",
        *fit_pictures("success", twin, PEPPER_FACTORS, response=RESPONSE, marks=marks, held=optimum),
    ]  # fmt: skip


def _check_parts(checks: NDArray[np.float64], pooled: Point) -> list[Part]:
    paper = sheet("pepper-verification").numbers("S")
    low, high = pooled.intervals["S"]
    crop = pooled.crop
    setting = f"{crop.foam_thickness_mm:g} mm, {crop.seedling_age_d:g} d, {crop.claw_pressure_mpa:.2f} MPa"
    rows: list[tuple[Cell, ...]] = [
        (str(number + 1), float(paper[number]) if number < len(paper) else None,
         float(checks[number]) if number < len(checks) else None)
        for number in range(max(len(paper), len(checks)))
    ]  # fmt: skip
    rows.append(("mean", float(paper.mean()), float(checks.mean())))
    return [
        Heading("The verification"),
        Table("verification", f"Trials at {setting}: S, %", ("trial", "paper", "twin"), tuple(rows)),
        f"All seedlings of the twin's trials together: S {pooled.shares['S']:.2f} %, 95 % binomial {low:.2f} to "
        f"{high:.2f}; equation 5 gives {pooled.by_equation_5:.2f}.",
    ]


def _setting_record(coded: NDArray[np.float64], fitted: Fit) -> dict[str, object]:
    return {
        "coded": coded.tolist(),
        "natural": to_natural(PEPPER_FACTORS, coded).tolist(),
        "S": float(fitted.predict(coded)[0]),
    }
