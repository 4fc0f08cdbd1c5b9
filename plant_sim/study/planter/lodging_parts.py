"""Parts of the report of the study ``planter-lodging``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import chi2

from controller.common.document.parts import Cell, Heading, Part, Picture, Table
from plant_sim.common.figure_style import COLOURS, QUIET, drawing
from plant_sim.common.proportion import Proportion
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter
from plant_sim.planter.quality import STATED_CODE, codes, injury_share, lodging_share
from plant_sim.study.doe.regression import fit, terms
from plant_sim.study.paper_tables import cabbage_experiment, cabbage_settings
from plant_sim.study.planter.lodging_fit import LodgingConstants, Predictor, Values, rms
from plant_sim.study.planter.lodging_model import LodgingModel
from plant_sim.study.planter.lodging_trials import OptimumCheck, SeedlingCount, pooled

RUN_SEEDLINGS: Final = (120, 360, 2200)
"""Numbers of seedlings per run for which the effect is reported."""
FIELD_SEEDLINGS: Final = 360
"""Number of seedlings of the field test, three trials of 120. Source: cabbage paper, 4."""

_KM_H = 3.6


def lodging_parts(
    planter: Planter,
    models: Mapping[str, LodgingModel],
    in_use: LodgingConstants,
    in_use_percent: Values,
    blocks: int,
) -> list[Part]:
    """Return the report parts on the fit of lodging."""
    model = models["reconciled"]
    observed = model.experiment.responses["Y1"]
    rows: list[tuple[Cell, ...]] = [
        (name, 100 * each.lodging.stick_share, each.lodging.stick_exponent, 1000 * each.lodging.clearance_m)
        for name, each in models.items()
    ]
    rows.append(("planter.yaml", 100 * in_use.stick_share, in_use.stick_exponent, 1000 * in_use.clearance_m))
    held = ~model.fitted
    return [
        "What was fitted to what: the constants of lodging and injury, also those of planter.yaml, are fitted to "
        f"{int(model.fitted.sum())} of the {len(observed)} runs of Table 2, and equations 10 and 11 to all of them. "
        "Errors in the held-back runs are out of sample for the mechanics and in-sample for the equations.",
        "Cabbage blocks of 40 mm only: neither the equations nor the fitted constants apply to plugs of pepper "
        "seedlings.",
        Heading("Lodging"),
        "A block lodges if it sticks to a plate, which swings and tips it across the row (assumption; share a₀ "
        f"(F / {planter.scatter.stick_n:g} N)^p), or if the simulated fall tips it. Falls: {blocks} random blocks at "
        "each distinct setting, the same at all settings, with full contact on soil. Three constants are fitted by "
        f"least squares to {int(model.fitted.sum())} runs of Table 2, the corners and five centres; "
        f"{int(held.sum())} runs, the axial ones and the other centres, are held back. The settings are those of the "
        "reconciled table in both cases. The standard deviation of the clearance, "
        f"{1000 * planter.scatter.clearance_sd_m:g} mm, is assumed.",
        Table("lodging-constants", "Fitted constants", ("data", "a₀, %", "p", "mean clearance, mm"), tuple(rows)),
        *(
            _error_table(f"lodging-errors-{name}", f"Lodging, {name} data", "Y1", each, each.lodging_by)
            for name, each in models.items()
        ),
        f"With the rounded constants of planter.yaml the error is {rms((in_use_percent - observed)[model.fitted]):.2f} "
        f"points in the fitted and {rms((in_use_percent - observed)[held]):.2f} in the held-back runs, reconciled. The "
        f"pure error of the centres is {_centre_sd(model):.2f} points. {_ranking(model)}",
        _run_table(planter, model),
        Picture("lodging-runs", "Observed lodging and the mechanics", _chart(model, "Y1", "lodging")),
        *_effects(model, "Y1", "lodging", model.lodging_by[0]),
        f"Of the predicted lodging, the falls account for at most {model.tipped_percent.max():.2f} points (standard "
        f"error due to the number of blocks {model.tipped_error.max():.2f} or less), at the highest speed; the "
        "remainder is the assumed sticking. Without the falls, the error is that of the row 'sticking alone'.",
    ]


def injury_parts(planter: Planter, models: Mapping[str, LodgingModel]) -> list[Part]:
    """Return the report parts on the fit of injury."""
    model, grip, scatter = models["reconciled"], planter.grip, planter.scatter
    rows: list[tuple[Cell, ...]] = [
        (name, each.injury.strength_n, each.injury.strength_sd_n) for name, each in models.items()
    ]
    rows.append(("planter.yaml", scatter.strength_n, scatter.strength_sd_n))
    centre = planter.with_values({"grip.clamp_n": scatter.stick_n}).grip
    return [
        Heading("Injury"),
        f"The printed range of the peak forces, {grip.crush_low_n:g} to {grip.crush_high_n:g} N, taken literally as "
        f"the strength of the blocks, would crush {100 * centre.crushed_share():.0f} % of them at the centre of the "
        f"test, {scatter.stick_n:g} N, where the bench has "
        f"{model.experiment.responses['Y2'][(model.experiment.coded == 0).all(axis=1)].mean():.2f} %; the paper uses "
        "the same range for the clamp force. Instead, the clamp force at which a block is injured is assumed to be "
        "normally distributed, with mean and standard deviation fitted to the same runs. They describe the tail only: "
        "the mean is far beyond all tested forces.",
        Table("injury-constants", "Fitted constants", ("data", "mean, N", "standard deviation, N"), tuple(rows), 1),
        *(
            _error_table(f"injury-errors-{name}", f"Injury, {name} data", "Y2", each, each.injury_by)
            for name, each in models.items()
        ),
        Picture("injury-runs", "Observed injury and the law of strength", _chart(model, "Y2", "injury")),
        *_effects(model, "Y2", "injury", model.injury_by[0]),
    ]


def seedling_parts(model: LodgingModel, run_seedlings: int) -> list[Part]:
    """Return the report parts on the number of seedlings in a run, which is not published."""
    observed = model.experiment.responses["Y1"]
    centre = observed[(model.experiment.coded == 0).all(axis=1)] / 100
    mean, sd = float(centre.mean()), float(centre.std(ddof=1))
    needed = mean * (1 - mean) / sd**2
    mechanics, printed = model.lodging_by[0], model.lodging_by[-1]
    rows: list[tuple[Cell, ...]] = []
    for seedlings in sorted({*RUN_SEEDLINGS, run_seedlings}):
        low, high = Proportion(round(mean * seedlings), seedlings).interval_percent
        spread = 100 * np.sqrt(mean * (1 - mean) / seedlings)
        fitted, held = (_chi_square(mechanics, model, seedlings, runs) for runs in (model.fitted, ~model.fitted))
        by_equation = _chi_square(printed, model, seedlings, ~model.fitted)
        p_held = float(chi2.sf(held, int((~model.fitted).sum())))
        rows.append((seedlings, float(spread), low, high, fitted, held, p_held, by_equation))
    heading = (
        "seedlings per run",
        "binomial SD, points",
        "from, %",
        "to, %",
        "χ² fitted",
        "χ² held back",
        "P held back",
        "χ² of eq. 10, in-sample",
    )
    return [
        Heading("Number of seedlings"),
        "The paper does not state the number of seedlings of a run. The centres have a mean lodging of "
        f"{100 * mean:.2f} % and a standard deviation of {100 * sd:.2f} points; independent seedlings would need "
        f"{needed:.0f} per run for so small a scatter. With fewer, the centres agree better than chance allows.",
        Table(
            "seedlings",
            "Effect of the assumed number: scatter and 95 % interval at the centre, χ² of the mechanics for lodging",
            heading,
            tuple(rows),
        ),
        f"χ² compares {int(model.fitted.sum())} fitted runs (3 constants) and {int((~model.fitted).sum())} held-back "
        "runs. A small P rejects the mechanics if the runs have that many seedlings.",
    ]


def check_parts(check: OptimumCheck) -> list[Part]:
    """Return the report parts on the claimed optimum."""
    predicted, bench, field = (each.responses for each in cabbage_settings())
    shares = 100 * lodging_share(*check.setting).value, 100 * injury_share(*check.setting).value
    trials, total = len(check.mechanics), pooled(check.mechanics).seedlings
    rows = [
        _expected_row("paper, claimed", predicted["Y1"], predicted["Y2"]),
        _expected_row("equations 10 and 11", *shares),
        _expected_row("mechanics", *check.expected),
        _paper_row("paper, bench", bench, total),
        _paper_row("paper, field", field, FIELD_SEEDLINGS),
        _row("trials of the mechanics", check.mechanics),
        _row("trials of the equations", check.equations),
    ]
    code = codes(*check.setting)[2]
    return [
        Heading("Check at the claimed optimum"),
        f"Setting: {check.setting.speed_km_h:g} km/h, {check.setting.frequency_per_min:g} plants per minute, "
        f"{check.setting.force_n:g} N; {trials} trials of {total // trials} seedlings (assumed). Every "
        "simulated seedling is counted, by the mechanics with a fall of its own. Intervals: exact 95 % "
        "(Clopper-Pearson); those of the paper's figures follow from the number of seedlings, which is stated for the "
        "field only. Erratum: the force has a code of "
        f"{code:.3f}, outside the range of -{STATED_CODE:g} to {STATED_CODE:g} stated for the optimum; the equations "
        "give other values than those claimed.",
        "No condition of the field is modelled. A second set of trials of the same model with another seed would not "
        "be a field test, so that the model says nothing about the difference between bench and field.",
        Table(
            "check",
            "Lodging and injury at the claimed optimum, %",
            ("source", "seedlings", "lodging", "from", "to", "injury", "from ", "to "),
            tuple(rows),
        ),
        Table("trials", "Single trials, %", ("trial", "seedlings", "lodging", "injury"), _trial_rows(check)),
        _overlap(check, {"bench": bench, "field": field}),
    ]


def _ranking(model: LodgingModel) -> str:
    """Return a comparison of the mechanical model with other predictors in the held-back runs."""
    observed, held = model.experiment.responses["Y1"], ~model.fitted
    mechanics, _, mean, linear, _ = (rms((each.percent - observed)[held]) for each in model.lodging_by)
    better = "better" if mechanics < linear else "worse"
    return (
        f"In the held-back runs, the mechanics is {'better' if mechanics < mean else 'worse'} than the mean of the "
        f"fitted runs ({mechanics:.2f} against {mean:.2f} points) and {better} than a linear polynomial of the same "
        f"runs ({linear:.2f})."
    )


def _centre_sd(model: LodgingModel) -> float:
    is_centre = (model.experiment.coded == 0).all(axis=1)
    return float(model.experiment.responses["Y1"][is_centre].std(ddof=1))


def _error_table(name: str, caption: str, response: str, model: LodgingModel, by: Sequence[Predictor]) -> Table:
    """Return a table of the errors of several predictors."""
    observed = model.experiment.responses[response]
    is_centre = (model.experiment.coded == 0).all(axis=1)
    parts = (model.fitted, ~model.fitted, ~model.fitted & ~is_centre, ~model.fitted & is_centre)
    rows: list[tuple[Cell, ...]] = []
    for each in by:
        fitted, *held = (rms((each.percent - observed)[part]) for part in parts)
        # the equation of the paper, the last predictor, was fitted to the runs that are held back here
        errors = (fitted, None, None, None, held[0]) if each is by[-1] else (fitted, *held, None)
        rows.append((each.name, each.constants or "-", *errors))
    heading = (
        *("predictor", "constants", "fitted, in-sample", "held back", "of which axial", "of which centres"),
        "the same runs, in-sample",
    )
    return Table(name, f"{caption}: root mean square error, points", heading, tuple(rows))


def _run_table(planter: Planter, model: LodgingModel) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for run, (speed_km_h, frequency_per_min, force_n) in enumerate(model.natural.tolist()):
        motion = Motion(planter.chain, speed_m_s=speed_km_h / _KM_H, frequency_per_min=frequency_per_min)
        use = "fitted" if model.fitted[run] else "held back"
        by = (float(each.percent[run]) for each in (model.lodging_by[0], model.lodging_by[-1]))
        observed = float(model.experiment.responses["Y1"][run])
        tipped = float(model.tipped_percent[run])
        rows.append((run + 1, speed_km_h, frequency_per_min, force_n, motion.ratio, use, observed, *by, tipped))
    heading = (
        "run",
        "km/h",
        "1/min",
        "force, N",
        "λ",
        "use",
        "observed",
        "mechanics",
        "eq. 10",
        "tipped by the fall",
    )
    return Table("lodging-runs-table", "Lodging of every run, reconciled data, %", heading, tuple(rows))


def _effects(model: LodgingModel, response: str, name: str, mechanics: Predictor) -> list[Part]:
    """Return a comparison of the observed effects of the factors with those of the mechanical model."""
    coded = cabbage_experiment("reconciled").coded
    columns = [
        fit(coded, percent, terms(coded.shape[1], "linear")).values
        for percent in (model.experiment.responses[response], mechanics.percent)
    ]
    factors = ("speed", "frequency", "force")
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (factor, *(column[f"X{index}"] for column in columns)) for index, factor in enumerate(factors, start=1)
    )
    observed, simulated = (column["X2"] for column in columns)
    return [
        Table(
            f"{name}-effects",
            f"Linear effect of one coded step on {name}, all runs, reconciled data, points",
            ("factor", "observed", mechanics.name),
            rows,
        ),
        f"Not explained: {name} rises with the planting frequency by {observed:.2f} points per step on the bench, "
        f"by {simulated:.2f} in the {mechanics.name}.",
    ]


def _chi_square(predictor: Predictor, model: LodgingModel, seedlings: int, runs: NDArray[np.bool_]) -> float:
    """Return the sum of the squared differences divided by the binomial variance of the prediction."""
    expected, observed = predictor.percent[runs] / 100, model.experiment.responses["Y1"][runs] / 100
    return float(np.sum((observed - expected) ** 2 / (expected * (1 - expected) / seedlings)))


def _expected_row(source: str, lodging: float, injury: float) -> tuple[Cell, ...]:
    return (source, None, lodging, None, None, injury, None, None)


def _paper_row(source: str, responses: Mapping[str, float], seedlings: int) -> tuple[Cell, ...]:
    cells: list[Cell] = [source, seedlings]
    for name in ("Y1", "Y2"):
        cells += [responses[name], *Proportion(round(responses[name] / 100 * seedlings), seedlings).interval_percent]
    return tuple(cells)


def _row(source: str, trials: Sequence[SeedlingCount]) -> tuple[Cell, ...]:
    total = pooled(trials)
    return (source, total.seedlings, *total.percent())


def _trial_rows(check: OptimumCheck) -> tuple[tuple[Cell, ...], ...]:
    return tuple(
        (
            f"{number}, {name}",
            trial.seedlings,
            100 * trial.lodged / trial.seedlings,
            100 * trial.injured / trial.seedlings,
        )
        for name, trials in (("mechanics", check.mechanics), ("equations", check.equations))
        for number, trial in enumerate(trials, start=1)
    )


def _overlap(check: OptimumCheck, measured: Mapping[str, Mapping[str, float]]) -> str:
    """Return a sentence on whether the paper's results are inside the interval of the simulated trials."""
    total = pooled(check.mechanics)
    _, low, high, _, injury_low, injury_high = total.percent()
    inside = [
        f"{name} of the {place}, {value:g} %, is {'inside' if ends[0] <= value <= ends[1] else 'outside'}"
        for place, responses in measured.items()
        for name, value, ends in (
            ("lodging", responses["Y1"], (low, high)),
            ("injury", responses["Y2"], (injury_low, injury_high)),
        )
    ]
    return (
        f"Interval of the {total.seedlings} simulated seedlings of the mechanics: {'; '.join(inside)}. Intervals of "
        "this width cannot distinguish the claimed from the measured figures."
    )


def _chart(model: LodgingModel, response: str, name: str) -> Figure:
    by = model.lodging_by if response == "Y1" else model.injury_by
    observed, mechanics = model.experiment.responses[response], by[0]
    ends = [0.0, float(max(observed.max(), mechanics.percent.max())) + 0.5]
    with drawing():
        figure = Figure(figsize=(4.2, 3.8), layout="constrained")
        axes = figure.add_subplot()
        axes.plot(ends, ends, color=QUIET, linewidth=0.8)
        for runs, label, colour, sign in (
            (model.fitted, "fitted", COLOURS["left"], "o"),
            (~model.fitted, "held back", COLOURS["right"], "s"),
        ):
            axes.plot(mechanics.percent[runs], observed[runs], sign, color=colour, markersize=4, label=label)
        axes.set_xlabel(f"{name} by the {mechanics.name}, %")
        axes.set_ylabel(f"observed {name}, %")
        axes.set_aspect("equal", adjustable="box")
        axes.legend(fontsize=7)
    return figure
