"""Study ``plan``: trials that a difference needs, and the runs of a design with the power of its tests."""

from __future__ import annotations

from collections.abc import Sequence

from controller.common.document.parts import Cell, Heading, Part, Table, counted
from plant_sim.study.analyse.model import Order, model_terms
from plant_sim.study.doe.design import Factor, to_natural
from plant_sim.study.doe.power import (
    ShareComparison,
    effect_powers,
    error_degrees,
    lack_of_fit_power,
    missing_power,
    share_sd,
)
from plant_sim.study.doe.standard_designs import RunPlan
from plant_sim.study.errors import StudyError
from plant_sim.study.plan.request import CORRELATIONS, PlanOptions, factors_of, run_plan
from plant_sim.study.report.study import Study


def plan_study(options: PlanOptions, command: str, *, order: Order = "quadratic") -> Study:
    """Plan an experiment; nothing is run.

    Args:
        options: Request.
        command: Command that reproduces the study.
        order: Model that the design is to identify.

    Raises:
        StudyError: An option is missing or invalid, or the design cannot identify the model.
    """
    if options.difference is None and options.design is None:
        raise StudyError("plan: nothing to plan; specify --difference 93,95 or --design NAME with --factors, or both")
    parts: list[Part] = ["Nothing was run. Tests are two-sided at the 5 % level."]
    record: dict[str, object] = {"power": options.power, "seedlings": options.seedlings, "seed": options.seed}
    if options.difference is not None:
        comparison, record["comparison"] = _comparison(options, options.difference)
        parts += comparison
    if options.design is not None:
        factors = factors_of(options.factors)
        plan = run_plan(options, len(factors))
        powers, record["design_power"] = _power(options, factors, plan, order)
        parts += [*_design(options, factors, plan), *powers, _trial_sheet(factors, plan)]
        record["trials"] = [
            {"block": int(block), "coded": coded.tolist()} for block, coded in zip(plan.blocks, plan.coded, strict=True)
        ]
    return Study("plan", "Plan of an experiment", command, tuple(parts), record)


def _correlations(options: PlanOptions) -> tuple[float, ...]:
    return CORRELATIONS if options.correlation is None else (options.correlation,)


def _comparison(options: PlanOptions, pair: tuple[float, float]) -> tuple[list[Part], list[dict[str, object]]]:
    """Return the table of the trials that a comparison of two shares needs, and its record."""
    rows: list[tuple[Cell, ...]] = []
    for correlation in _correlations(options):
        each = ShareComparison(*pair, options.seedlings, correlation)
        by_count, by_trial = each.trials_by_count(options.power), each.trials_by_trial(options.power)
        rows.append((f"{correlation:g}", each.design_effect, by_count, by_trial))
    names = ("correlation", "design_effect", "trials_by_count", "trials_by_trial")
    first, second = (f"{100 * share:g}" for share in pair)
    parts: list[Part] = [
        Heading(f"Trials to tell {first} from {second} %"),
        Table(
            "comparison",
            f"Trials of {options.seedlings} seedlings on each side for a power of {100 * options.power:g} %",
            ("correlation in a trial", "design effect", "trials, known scatter", "trials, scatter estimated"),
            tuple(rows),
        ),
        f"Seedlings of one trial fail together; the design effect 1 + (m - 1) correlation, m = {options.seedlings}, "
        "multiplies the variance. Known scatter compares the pooled counts with that design effect. Scatter estimated "
        "compares the shares of the trials by Student's t test, as an analysis must if the correlation is not known.",
    ]
    return parts, [dict(zip(names, row, strict=True)) for row in rows]


def _design(options: PlanOptions, factors: Sequence[Factor], plan: RunPlan) -> list[Part]:
    blocks = int(plan.blocks.max())
    rows = tuple(
        (f"X{number}", each.name, each.unit, f"{each.natural(-1):.6g}", f"{each.natural(1):.6g}")
        for number, each in enumerate(factors, 1)
    )
    text = f"{counted(len(plan.coded), 'trial')} in {counted(blocks, 'block')}, in random order within each block"
    return [
        Heading(f"Design {options.design}"),
        f"{text} (seed {options.seed}). Keep this order: a trend during the day is otherwise taken for an effect. If a "
        "factor is not set anew for each trial, number its whole plots in a column of their own.",
        Table("factors", "Factors with their coded levels -1 and 1", ("term", "factor", "unit", "-1", "1"), rows),
    ]


def _scatters(options: PlanOptions) -> list[tuple[str, float]]:
    """Return the standard deviations of a trial for which the power is tabulated, with their headings."""
    if options.sd is not None:
        return [(f"SD {options.sd:g}", options.sd)]
    if options.difference is None:
        return []
    mean = sum(options.difference) / 2
    scatters = []
    for correlation in _correlations(options):
        sd = 100 * share_sd(mean, options.seedlings, correlation)
        scatters.append((f"correlation {correlation:g}, SD {sd:.2f}", sd))
    return scatters


def _power(
    options: PlanOptions, factors: Sequence[Factor], plan: RunPlan, order: Order
) -> tuple[list[Part], dict[str, object] | None]:
    """Return the power of the tests of every term and of lack of fit, and its record."""
    effect = options.effect
    if effect is None and options.difference is not None:
        effect = 100 * abs(options.difference[0] - options.difference[1])
    scatters = _scatters(options)
    if effect is None or not scatters:
        return ["No power is stated; specify --effect with --sd, or --difference."], None
    terms = model_terms(plan.coded, order)
    degrees = error_degrees(plan, terms)
    # `analyse` tests counts against the pure error, and values against the residual
    own = degrees.residual if options.sd is not None else degrees.pure
    if own == 0:
        return ["No power is stated: counts are tested against repeated trials, of which the design has none."], None
    coefficient = effect / 2
    columns = [effect_powers(plan, terms, coefficient=coefficient, sd=sd, degrees=own) for _, sd in scatters]
    rows: list[tuple[Cell, ...]] = [(term, *(f"{100 * each[term]:.0f}" for each in columns)) for term in terms]
    lack = degrees.residual - degrees.pure
    if degrees.pure > 0 and lack > 0:
        for number in range(1, len(factors) + 1):
            found = [
                lack_of_fit_power(plan, terms, number, coefficient=coefficient, sd=sd, degrees=degrees)
                for _, sd in scatters
            ]
            shown = ("not visible" if each is None else f"{100 * each:.0f}" for each in found)
            rows.append((f"lack of fit, {missing_power(terms, number)} missing", *shown))
        note = (
            f"The error of the terms has {own} degrees of freedom, the test of lack of fit {lack} and {degrees.pure}. "
            "A missing power is not visible if the model takes it up at the points of the design."
        )
    else:
        note = (
            f"The error of the terms has {own} degrees of freedom. There is no test of lack of fit, which requires "
            "repeated trials and more points than coefficients."
        )
    caption = (
        f"Power, %, of the {order} model to detect a coefficient of {effect / 2:g} "
        f"(a change by {effect:g} from level -1 to 1), for SD of one trial"
    )
    table = Table("power", caption, ("test", *(name for name, _ in scatters)), tuple(rows))
    record = {name: each for (name, _), each in zip(scatters, columns, strict=True)}
    return [table, note], {"effect": effect, "terms": record}


def _trial_sheet(factors: Sequence[Factor], plan: RunPlan) -> Table:
    """Return the sheet of the trials, whose last column is filled in and read by ``study analyse``."""
    natural = to_natural(factors, plan.coded)
    has_blocks = int(plan.blocks.max()) > 1
    rows: list[tuple[Cell, ...]] = []
    for number, (block, point) in enumerate(zip(plan.blocks.tolist(), natural, strict=True), 1):
        levels = (f"{level:.6g}" for level in point)
        rows.append((number, *((f"B{block}",) if has_blocks else ()), *levels, None))
    units = (each.name if each.unit == "-" else f"{each.name} ({each.unit})" for each in factors)
    heading = ("order", *(("block",) if has_blocks else ()), *units, "response")
    caption = "Trials in the order to run them; fill in the response and read the CSV with study analyse"
    return Table("trials", caption, heading, tuple(rows))
