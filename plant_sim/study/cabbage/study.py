"""Reanalysis of the cabbage trial, based on the table as printed or with its reconciled cells.

Figures are from [K], sections 3 and 4; computed figures are marked as such. Errors in the paper are shown as errata,
with the printed and the computed figure.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.common.document.parts import Cell, Heading, Part, Picture, Table
from plant_sim.common.paper_sheet import sheet
from plant_sim.study.cabbage.fits import (
    RUN_SEEDLINGS,
    Response,
    equation_agreement,
    reproduces,
    responses,
    table_3_agreement,
)
from plant_sim.study.doe.design import full_factorial, orthogonal_axial, rotatable_axial, to_coded, to_natural
from plant_sim.study.doe.optimum import Front, best, pareto
from plant_sim.study.paper_tables import (
    CABBAGE_FACTORS,
    CabbageData,
    Experiment,
    cabbage_experiment,
    cabbage_settings,
    corrections,
    printed_anova,
)
from plant_sim.study.report.fit_parts import (
    anova_table,
    coding_table,
    coefficient_table,
    doubts,
    fit_pictures,
    fit_record,
    optimum_table,
    p_text,
    runs_table,
)
from plant_sim.study.report.study import Study
from plant_sim.study.report.surface import pareto_front
from plant_sim.study.report.weighted_parts import effects_table, weighted_parts

LOW: Final = (-1.0, -1.0, -1.0)
HIGH: Final = (1.0, 1.0, 1.0)
"""Search range of the paper: every factor from -1 to 1 (equation 12)."""

_FRONT_POINTS = 41
_FRONT_LISTED = 5
"""Interval between the points of the front that are listed in the table."""
_CLOUD_LEVELS = 9


def cabbage_study(data: CabbageData) -> Study:
    """Return the study ``cabbage-rsm``.

    Args:
        data: ``printed`` for the printed Table 2, ``reconciled`` for the corrected one.

    Raises:
        StudyError: The data set is unknown.
    """
    experiment = cabbage_experiment(data)
    both = responses(experiment)
    front = pareto(both[0].reduced, both[1].reduced, LOW, HIGH, _FRONT_POINTS)
    weighted = pareto(both[0].weighted_reduced, both[1].weighted_reduced, LOW, HIGH, _FRONT_POINTS)
    parts: list[Part] = [
        "What was fitted to what: equations 10 and 11, the least squares refits and the weighted fits are all fitted "
        "to the runs of Table 2, so their agreement with these runs is in-sample; the predicted R² leaves runs out. "
        "The weighted fits are the analysis; least squares stays beside them, as printed.",
        *(doubt for each in both for doubt in doubts(f"{each.name}, full quadratic", each.weighted)),
        *(doubt for each in both for doubt in doubts(f"{each.name}, reduced model", each.weighted_reduced)),
        *_design_parts(experiment, data),
        *_summary_parts(both, data),
    ]
    for response in both:
        parts += _response_parts(response)
    parts += [*_optimum_parts(both), *_front_parts(both, front, weighted)]
    return Study(
        name="cabbage-rsm",
        title=f"Cabbage blocks: repeated analysis of the paper's bench test, {data} data",
        command=f"python -m plant_sim study cabbage-rsm --data {data}",
        parts=tuple(parts),
        record=_record(both, front, weighted, data),
    )


def _design_parts(experiment: Experiment, data: CabbageData) -> list[Part]:
    coding = sheet("cabbage-table-1")
    codes, levels = coding.numbers("code"), coding.points("speed_km_h", "frequency_per_min", "force_n")
    coded = experiment.coded
    axial, centres = float(coded[:, 0].max()), int(np.count_nonzero((coded == 0).all(axis=1)))
    k = len(experiment.factors)
    return [
        Heading("Experiment"),
        coding_table("coding", "Coding of the factors ([K] Table 1, as printed)", CABBAGE_FACTORS, codes, levels),
        f"Erratum: Table 1 prints the axial code as {codes.max():g}, whereas Table 2 uses {axial:g}, which makes the "
        f"design rotatable ({rotatable_axial(k):.3f}). The axial speed and force of Table 1 are closer to "
        f"{orthogonal_axial(k, centres):.3f}, which makes the squared terms uncorrelated; the axial frequency, an "
        "integer, corresponds to 2.",
        runs_table(
            "runs",
            f"Runs ([K] Table 2, {data}); each the mean of three trials",
            CABBAGE_FACTORS,
            coded,
            {f"{name}, %": values for name, values in experiment.responses.items()},
        ),
        _corrections_table(),
        _reconciliation(data),
    ]


def _corrections_table() -> Table:
    rows = tuple((each.run, each.column, each.printed, each.reconciled) for each in corrections())
    caption = "Corrections of Table 2 that reproduce Table 3 (computed, not printed)"
    return Table("corrections", caption, ("run", "column", "printed", "reconciled"), rows, 3)


def _reconciliation(data: CabbageData) -> str:
    erratum = "Erratum: Table 2 as printed does not reproduce Table 3 or equations 10 and 11."
    if data == "printed":
        return (
            f"{erratum} This report uses the printed table, so the figures below differ from the paper's; "
            "--data reconciled uses the cells above."
        )
    return f"{erratum} This report uses the reconciled cells above; --data printed uses the printed ones."


def _summary_parts(both: tuple[Response, Response], data: CabbageData) -> list[Part]:
    rows: list[tuple[Cell, ...]] = []
    for each in both:
        table_3 = {row.source: row for row in printed_anova(each.anova_sheet)}
        model, lack = each.full.row("model"), each.full.row("lack of fit")
        cells, terms_kept = table_3_agreement(each), equation_agreement(each)
        rows += [
            (f"{each.name}: R²", f"{each.r2:.4f}", f"{each.full.r2:.4f}"),
            (f"{each.name}: F of the model", _f_text(table_3["model"].f), _f_text(model.f)),
            (f"{each.name}: F of the lack of fit", _f_text(table_3["lack of fit"].f), _f_text(lack.f)),
            (f"{each.name}: P of the lack of fit", table_3["lack of fit"].p, p_text(lack.p)),
            (f"{each.name}: cells of Table 3 that agree to the printed digits", None, f"{cells.same} of {cells.of}"),
            (f"{each.name}: largest deviation of the other cells", None, f"{cells.worst_percent:.2f} %"),
            (
                f"{each.name}: coefficients of eq. {each.number} that agree to the printed digits",
                None,
                f"{terms_kept.same} of {terms_kept.of}",
            ),
        ]
    return [
        Heading("Agreement with the paper's analysis"),
        Table("summary", f"The paper and the {data} data", ("figure", "paper", "this data"), tuple(rows)),
        _verdict(both, data),
    ]


def _f_text(f: float | None) -> str | None:
    return None if f is None else f"{f:.2f}"


def _verdict(both: tuple[Response, Response], data: CabbageData) -> str:
    missing = [each.name for each in both if not reproduces(each)]
    if missing:
        return f"No: the {data} data do not reproduce the paper's table and equation of {' and '.join(missing)}."
    return (
        f"Yes: the {data} data reproduce R², the F value of the model and every coefficient to the printed digits. The "
        "few cells of Table 3 that differ do so in their last digits, as is expected if the paper used unrounded means."
    )


def _response_parts(response: Response) -> list[Part]:
    name = response.name.lower()
    paper = f"eq. {response.number}"
    optimum, _ = best(response.reduced, LOW, HIGH, maximise=False)
    claimed = to_coded(CABBAGE_FACTORS, np.array(cabbage_settings()[0].natural))
    caption = f"Analysis of variance of {response.label}: [K] Table 3 and the full quadratic of this data"
    return [
        Heading(response.label.removesuffix(", %")),
        anova_table(
            f"{name}-anova",
            caption,
            {"paper": printed_anova(response.anova_sheet), "this data": response.full.anova},
            digits=4,
        ),
        coefficient_table(
            f"{name}-coefficients",
            f"Coefficients of {response.label}; reduced: the terms of the equation only, with standard error and P",
            {paper: response.printed.coefficients, "reduced": response.reduced.values, "full": response.full.values},
            fit=response.reduced,
        ),
        f"Weighted fit, with the share of each run taken as that of {RUN_SEEDLINGS} seedlings (three trials of 120, "
        "assumed). Other numbers, equal in all runs, change only the dispersion.",
        *weighted_parts(name, response.weighted, response=response.label, is_simulated=False),
        effects_table(
            f"{name}-weighted-coefficients",
            f"Weighted coefficients of {response.label}: full quadratic with its error, interval and P; reduced: the "
            "terms of the equation only",
            {"reduced": response.weighted_reduced.values, "full": response.weighted.values},
            response.weighted,
            is_simulated=False,
        ),
        f"R² of the reduced model is {response.reduced.r2:.4f}; the paper's {response.r2:.4f} is that of the full one.",
        *fit_pictures(
            name,
            response.reduced,
            CABBAGE_FACTORS,
            response=response.label,
            marks={"smallest in the box": optimum, "claimed setting": claimed},
            held=optimum,
            weighted=response.weighted_reduced,
        ),
    ]


def _points() -> dict[str, NDArray[np.float64]]:
    """Return the coded settings to compare, by name."""
    claimed = to_coded(CABBAGE_FACTORS, np.array(cabbage_settings()[0].natural))
    return {
        "claimed setting": claimed,
        "corner (-1, -1, -1)": np.array([-1.0, -1.0, -1.0]),
        "corner (-1, -1, 1)": np.array([-1.0, -1.0, 1.0]),
    }


def _optimum_parts(both: tuple[Response, Response]) -> list[Part]:
    predicted, *checks = cabbage_settings()
    points = _points()
    claimed = points["claimed setting"]
    equations = tuple(float(each.printed.predict(claimed)[0]) for each in both)
    said = tuple(predicted.responses[each.name] for each in both)
    field = checks[-1].responses
    points_off = tuple(field[each.name] - value for each, value in zip(both, said, strict=True))
    relative = tuple(100 * off / value for off, value in zip(points_off, said, strict=True))
    rows = [(each.source, each.responses["Y1"], each.responses["Y2"]) for each in (predicted, *checks)]
    comparisons = [
        optimum_table(
            f"{each.name.lower()}-settings",
            f"{each.label} at selected settings",
            CABBAGE_FACTORS,
            response=each.name,
            points=points,
            surfaces={
                f"eq. {each.number}": each.printed,
                "reduced refit": each.reduced,
                "weighted, reduced": each.weighted_reduced,
            },
        )
        for each in both
    ]
    return [
        Heading("Claimed optimum"),
        Table("claims", "Statements of the paper about its best setting", ("source", "Y1, %", "Y2, %"), tuple(rows)),
        *comparisons,
        f"Erratum: the claimed force is coded {claimed[2]:.3f}, outside the stated range of -1 to 1. Equations 10 and "
        f"11 give {equations[0]:.2f} and {equations[1]:.2f} % there; the paper states {said[0]:g} and {said[1]:g} %.",
        f'Erratum: the "relative errors" of the field test are differences in percentage points, {points_off[0]:.2f} '
        f"and {points_off[1]:.2f}; relative to the prediction they are {relative[0]:.1f} and {relative[1]:.1f} %.",
        _speed_ratio_erratum(both[0].full.coded),
    ]


def speed_ratio(speed_km_h: float, frequency_per_min: float) -> float:
    """Return λ, the ratio of chain speed to machine speed; the chain speed is proportional to the frequency.

    Args:
        speed_km_h: Speed of the machine, km/h.
        frequency_per_min: Planting frequency, plants/min.
    """
    chain = sheet("cabbage-chain-speed")
    chain_mm_per_plant = float(chain.numbers("chain_speed_mm_s")[0] / chain.numbers("frequency_per_min")[0])
    return chain_mm_per_plant * frequency_per_min / (speed_km_h / 3.6 * 1000)


def _speed_ratio_erratum(runs: NDArray[np.float64]) -> str:
    coding = sheet("cabbage-table-1")
    speed, frequency = coding.numbers("speed_km_h"), coding.numbers("frequency_per_min")
    least, most = speed_ratio(speed.max(), frequency.min()), speed_ratio(speed.min(), frequency.max())
    reached = max(speed_ratio(*setting[:2]) for setting in to_natural(CABBAGE_FACTORS, runs).tolist())
    claimed = speed_ratio(*cabbage_settings()[0].natural[:2])
    return (
        "Erratum: the paper's conclusion requires a ratio λ of chain to machine speed of at least 1.17, but the tested "
        f"ranges of speed and frequency give λ from {least:.2f} to {most:.2f}, and its own best setting gives "
        f"{claimed:.2f}. The value {most:.2f} requires the lowest speed and the highest frequency, {speed.min():g} "
        f"km/h and {frequency.max():g}/min, a corner that is not part of the design. The runs reach at most "
        f"{reached:.2f}, so the required ratio was never tested."
    )


def _front_parts(both: tuple[Response, Response], front: Front, weighted: Front) -> list[Part]:
    lodging, injury = both
    cloud = full_factorial([tuple(np.linspace(low, high, _CLOUD_LEVELS)) for low, high in zip(LOW, HIGH, strict=True)])
    marks = {name: tuple(float(each.reduced.predict(point)[0]) for each in both) for name, point in _points().items()}
    said = cabbage_settings()[0].responses
    figure = pareto_front(
        front,
        a=lodging.label,
        b=injury.label,
        marks={f"{name}, by the refit": (values[0], values[1]) for name, values in marks.items()}
        | {f"claimed by the paper: {said['Y1']:g}, {said['Y2']:g}": (said["Y1"], said["Y2"])},
        cloud=np.column_stack([lodging.reduced.predict(cloud), injury.reduced.predict(cloud)]),
        beside={"Pareto front, weighted fits": weighted},
    )
    return [
        Heading("Lodging against injury"),
        "Within the box there is no single best setting: less lodging means more injury. The Pareto front of the "
        f"reduced refits is sampled at {len(front.coded)} settings, none of which is dominated by another. Its last "
        "section, along which the speed increases, depends on the X1 term of Y2, which may be due to chance "
        f"(P = {p_text(injury.reduced.coefficients['X1'].p)}).",
        _front_table("pareto", "least squares as printed", both, front),
        f"By the weighted fits with the same terms the least lodging is {weighted.a.min():.2f} %, by least squares "
        f"{front.a.min():.2f} %, and the least injury {weighted.b.min():.2f} % instead of {front.b.min():.2f} %: a "
        "share near 0 has more weight.",
        _front_table("pareto-weighted", "weighted fits", both, weighted),
        Picture(
            "pareto-front",
            "Pareto fronts of the least squares refits, as printed, and of the weighted fits; the claimed setting is "
            "outside the box, and the values predicted by the refits for it differ from those in the paper",
            figure,
        ),
    ]


def _front_table(name: str, fits: str, both: tuple[Response, Response], front: Front) -> Table:
    listed = slice(None, None, _FRONT_LISTED)
    natural = to_natural(CABBAGE_FACTORS, front.coded)
    rows = tuple(
        (*map(float, setting), float(y1), float(y2))
        for setting, y1, y2 in zip(natural[listed], front.a[listed], front.b[listed], strict=True)
    )
    heading = (*(factor.label for factor in CABBAGE_FACTORS), *(each.label for each in both))
    return Table(name, f"Pareto front with every factor from -1 to 1, {fits}, every fifth point", heading, rows)


def _record(both: tuple[Response, Response], front: Front, weighted: Front, data: CabbageData) -> dict[str, object]:
    points = _points()
    return {
        "data": data,
        "factors": [factor.label for factor in CABBAGE_FACTORS],
        "corrections": [each._asdict() for each in corrections()],
        "responses": {each.name: _response_record(each, points) for each in both},
        "claims": [{"source": each.source, **each.responses} for each in cabbage_settings()],
        "points": {name: point.tolist() for name, point in points.items()},
        "pareto": _front_record(front),
        "pareto_weighted": _front_record(weighted),
    }


def _front_record(front: Front) -> dict[str, object]:
    return {"coded": front.coded.tolist(), "Y1": front.a.tolist(), "Y2": front.b.tolist()}


def _response_record(response: Response, points: Mapping[str, NDArray[np.float64]]) -> dict[str, object]:
    optimum, value = best(response.reduced, LOW, HIGH, maximise=False)
    return {
        "paper": {
            "r2": response.r2,
            "anova": {row.source: row._asdict() for row in printed_anova(response.anova_sheet)},
            "coefficients": dict(response.printed.coefficients),
        },
        "full": fit_record(response.full),
        "reduced": fit_record(response.reduced),
        "weighted": fit_record(response.weighted),
        "weighted_reduced": fit_record(response.weighted_reduced),
        "reproduced": reproduces(response),
        "table_3": table_3_agreement(response)._asdict(),
        "equation": equation_agreement(response)._asdict(),
        "by_equation": {name: float(response.printed.predict(point)[0]) for name, point in points.items()},
        "by_reduced": {name: float(response.reduced.predict(point)[0]) for name, point in points.items()},
        "smallest": {"coded": optimum.tolist(), "value": value},
    }
