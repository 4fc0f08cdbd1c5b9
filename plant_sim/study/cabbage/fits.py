"""Fits of the cabbage trial's data compared with the printed analysis ([K], section 3.2)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal
from typing import Final, NamedTuple

import numpy as np

from plant_sim.common.paper_sheet import equation, sheet
from plant_sim.common.polynomial import CONSTANT, Polynomial
from plant_sim.study.doe.regression import Fit, fit, terms
from plant_sim.study.doe.weighted import WeightedFit, weighted_fit
from plant_sim.study.paper_tables import Experiment

RUN_SEEDLINGS: Final = 360
"""Seedlings of a run: three trials of 120. The number of a trial is assumed; an equal number in all runs only scales
the dispersion."""


@dataclass(frozen=True)
class Response:
    """Printed and fitted models of one response.

    Attributes:
        name: ``Y1`` or ``Y2``.
        label: Name and unit.
        number: Number of its equation in the paper.
        printed: Printed equation.
        r2: R² as printed.
        full: The full quadratic model fitted to the data.
        reduced: The model fitted with only the terms of the printed equation.
        weighted: The full quadratic model fitted to the shares as counts of trials.
        weighted_reduced: The same with only the terms of the printed equation.
    """

    name: str
    label: str
    number: int
    printed: Polynomial
    r2: float
    full: Fit
    reduced: Fit
    weighted: WeightedFit
    weighted_reduced: WeightedFit

    @property
    def anova_sheet(self) -> str:
        """Name of the file that contains the response's part of Table 3."""
        return f"cabbage-table-3-{self.name.lower()}"


def responses(experiment: Experiment) -> tuple[Response, Response]:
    """Return lodging Y1 and injury Y2, fitted to an experiment."""
    return _response(experiment, "Y1", "Lodging Y1, %", 10), _response(experiment, "Y2", "Injury Y2, %", 11)


def _response(experiment: Experiment, name: str, label: str, number: int) -> Response:
    printed = equation(f"cabbage-equation-{number}", name)
    r2 = sheet("cabbage-r2")
    measured = experiment.responses[name]
    reduced_terms = [term for term in printed if term != CONSTANT]
    full_terms = terms(len(experiment.factors), "quadratic")
    totals = np.full(len(measured), float(RUN_SEEDLINGS))
    counts = measured / 100 * totals
    return Response(
        name=name,
        label=label,
        number=number,
        printed=Polynomial(printed),
        r2=float(r2.numbers("r2")[r2.texts("response").index(name)]),
        full=fit(experiment.coded, measured, full_terms),
        reduced=fit(experiment.coded, measured, reduced_terms),
        weighted=weighted_fit(experiment.coded, counts, totals, full_terms),
        weighted_reduced=weighted_fit(experiment.coded, counts, totals, reduced_terms),
    )


def agrees(value: float, printed: str) -> bool:
    """Return whether a value rounds to the printed figure.

    >>> agrees(17.0695, "17.07"), agrees(17.08, "17.07"), agrees(4.96e-5, "5e-5")
    (True, False, True)
    """
    exponent = Decimal(printed).as_tuple().exponent
    last_digit = 10.0 ** int(exponent)
    return abs(value - float(printed)) <= last_digit * (0.5 + 1e-6)


class Agreement(NamedTuple):
    """Agreement between computed and printed figures.

    Attributes:
        same: Number of figures that round to the printed digits.
        of: Number of printed figures.
        worst_percent: Largest deviation of the other figures, % of the printed figure; 0 if all agree.
    """

    same: int
    of: int
    worst_percent: float


def agreement(pairs: Iterable[tuple[float, str]]) -> Agreement:
    """Compare values with the printed figures."""
    pairs = list(pairs)
    off = [abs(value / float(text) - 1) for value, text in pairs if not agrees(value, text)]
    return Agreement(len(pairs) - len(off), len(pairs), 100 * max(off, default=0.0))


def table_3_agreement(response: Response) -> Agreement:
    """Compare every sum of squares and every F value of the full quadratic model with Table 3."""
    printed = sheet(response.anova_sheet)
    pairs = []
    for source, square, f in zip(*(printed.texts(name) for name in ("source", "sum_of_squares", "f")), strict=True):
        row = response.full.row(source)
        pairs.append((row.sum_of_squares, square))
        if f and row.f is not None:
            pairs.append((row.f, f))
    return agreement(pairs)


def equation_agreement(response: Response) -> Agreement:
    """Compare every coefficient of the reduced refit with the printed equation."""
    printed = sheet(f"cabbage-equation-{response.number}")
    pairs = zip(printed.texts("term"), printed.texts(response.name), strict=True)
    return agreement((response.reduced.values[term], text) for term, text in pairs)


def reproduces(response: Response) -> bool:
    """Return whether the data reproduce R², the F value of the model and the equation to the printed digits."""
    r2, table_3 = sheet("cabbage-r2"), sheet(response.anova_sheet)
    r2_text = r2.texts("r2")[r2.texts("response").index(response.name)]
    f_text = table_3.texts("f")[table_3.texts("source").index("model")]
    equation_fits = equation_agreement(response)
    f = response.full.row("model").f
    return (
        agrees(response.full.r2, r2_text)
        and f is not None
        and agrees(f, f_text)
        and equation_fits.same == equation_fits.of
    )
