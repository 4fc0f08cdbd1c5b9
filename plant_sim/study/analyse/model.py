"""Model of a table of trials: polynomial in the factors, blocks, and the errors within and between whole plots."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from plant_sim.common.polynomial import CONSTANT, Polynomial, model_matrix
from plant_sim.study.analyse.roles import Trials
from plant_sim.study.doe.block_columns import block_columns
from plant_sim.study.doe.irls import Link
from plant_sim.study.doe.regression import AnovaRow, Coefficient, fit
from plant_sim.study.doe.weighted import Model, WeightedFit, weighted_fit
from plant_sim.study.errors import StudyError

Order = Literal["linear", "interactions", "squares", "quadratic"]
ORDERS: Final[tuple[Order, ...]] = ("linear", "interactions", "squares", "quadratic")
"""Models, the simplest first; ``squares`` has the squares without the products."""

_FIRST_CHOICE: Final[tuple[Order, ...]] = ("quadratic", "squares", "interactions", "linear")
_COLUMN = re.compile(r"X(\d+)")
_FEWEST_ERROR_DEGREES = 2
_LEAST_LEFT = 1e-9
"""Complement of the leverage below which a trial determines a coefficient alone."""


@dataclass(frozen=True)
class Stratum:
    """Fit whose error tests some of the terms.

    Attributes:
        name: Name of the stratum for the report.
        fit: The fit; a reason if there is none.
        terms: Terms of the factors that it tests.
        blocks: Terms of the blocks in it.
        effects: Terms of the factors by effect: those of a categorical factor, one for each level but the last, are
            tested together.
    """

    name: str
    fit: Model | str
    terms: tuple[str, ...]
    blocks: tuple[str, ...]
    effects: Mapping[str, tuple[str, ...]]

    def rows(self) -> tuple[AnovaRow, ...]:
        """Return the analysis of variance with the factors together and the blocks together."""
        if isinstance(self.fit, str):
            return ()
        hidden = {"model", *self.fit.coefficients}
        tested = [self.fit.joint_row("factors", self.terms)]
        if self.blocks:
            tested.append(self.fit.joint_row("blocks", self.blocks))
        tested += [self.fit.joint_row(effect, terms) for effect, terms in self.effects.items()]
        return (*tested, *(row for row in self.fit.anova if row.source not in hidden))

    @property
    def model_p(self) -> float | None:
        """P value of all terms of the factors together; None without a fit or without an error."""
        return None if isinstance(self.fit, str) else self.fit.joint_row("factors", self.terms).p

    def coefficient(self, term: str) -> Coefficient | None:
        """Return the coefficient of a term that this stratum tests."""
        return None if isinstance(self.fit, str) else self.fit.coefficients[term]


@dataclass(frozen=True)
class TrialModel:
    """Fitted model.

    Attributes:
        order: Kind of the polynomial.
        terms: Terms of the factors; X1, X2, ... are the columns of the trials.
        fit: Fit of all terms to all trials; its error is that of the trials.
        strata: Strata of the error: one, or those within and between whole plots.
    """

    order: Order
    terms: tuple[str, ...]
    fit: Model
    strata: tuple[Stratum, ...]
    _columns: int

    def predict(self, coded: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the response at points in the columns of the trials, in the average block."""
        return self.fit.predict(self.padded(coded))

    def padded(self, coded: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points in the columns of the trials with 0 for the blocks."""
        points = np.atleast_2d(np.asarray(coded, dtype=np.float64))
        return np.hstack([points, np.zeros((len(points), self.fit.coded.shape[1] - self._columns))])

    def is_extrapolated(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point is outside the trials: its leverage is above that of every trial."""
        names, trials = list(self.fit.coefficients), self.fit.coded
        matrix = model_matrix(trials, names)
        inverse = np.linalg.inv(matrix.T @ matrix)
        points = np.vstack([self.padded(point), self.padded(trials[:, : self._columns])])
        asked = model_matrix(points, names)
        leverage = np.einsum("ij,jk,ik->i", asked, inverse, asked)
        return bool(leverage[0] > leverage[1:].max() * (1 + _LEAST_LEFT))

    def drawn_optima(
        self, grid: NDArray[np.float64], *, is_high_best: bool, draws: int, seed: int
    ) -> NDArray[np.float64]:
        """Return the best point of a grid in each of many draws of the coefficients from their estimated distribution.

        Args:
            grid: Points in the columns of the trials.
            is_high_best: True if a high response is good.
            draws: Number of draws.
            seed: Seed of the draws.
        """
        names = list(self.fit.coefficients)
        kept = [place for place, name in enumerate(names) if name in (CONSTANT, *self.terms)]
        matrix = model_matrix(grid, [names[place] for place in kept])
        values = self.fit.drawn(draws, seed=seed)[:, kept] @ matrix.T
        found: NDArray[np.float64] = grid[values.argmax(axis=1) if is_high_best else values.argmin(axis=1)]
        return found

    @property
    def polynomial(self) -> Polynomial:
        """Polynomial of the factors in the average block; of the logit with the logit link."""
        return Polynomial({name: each for name, each in self.fit.values.items() if name in (CONSTANT, *self.terms)})


def fit_model(trials: Trials, order: Order | None, link: Link) -> TrialModel | str:
    """Fit the polynomial, with blocks as further columns of the model.

    Args:
        trials: The trials.
        order: Kind of polynomial; None for the richest one that the trials identify.
        link: Link of a fit to counts.

    Returns:
        The model; the reason if there is none, although no order was asked for.

    Raises:
        StudyError: The polynomial that was asked for cannot be fitted.
    """
    reasons = []
    for each in _FIRST_CHOICE if order is None else (order,):
        try:
            return _fitted(trials, each, link, spare=_FEWEST_ERROR_DEGREES if order is None else 1)
        except StudyError as error:
            if order is not None:
                raise StudyError(f"--model {order}: {error}") from None
            reasons.append(str(error))
    return reasons[-1]


def model_terms(coded: NDArray[np.float64], order: Order, owners: Sequence[int] | None = None) -> tuple[str, ...]:
    """Return the terms of a polynomial.

    A factor of two levels has no square, and a categorical factor has neither a square nor a product of its columns.

    Args:
        coded: Coded levels of the numeric factors, whose columns are the first ones.
        order: Kind of the polynomial.
        owners: Number of the factor of each column; None if every column is a numeric factor.
    """
    owners = owners or tuple(range(1, coded.shape[1] + 1))
    linear = tuple(f"X{column}" for column in range(1, len(owners) + 1))
    squares = tuple(
        f"X{number}^2" for number, column in enumerate(coded.T, 1) if len(np.unique(np.round(column, 9))) > 2
    )
    products = tuple(
        f"{a} {b}"
        for (a, of_a), (b, of_b) in itertools.combinations(zip(linear, owners, strict=True), 2)
        if of_a != of_b
    )
    if order == "linear":
        return linear
    if order == "squares":
        return (*linear, *squares)
    return (*linear, *products) if order == "interactions" else (*linear, *products, *squares)


def effects_of(trials: Trials, terms: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the terms of each effect, which is named by the numbers of its factors."""
    effects: dict[str, tuple[str, ...]] = {}
    for term in terms:
        effect = _by_factor(trials, term)
        effects[effect] = (*effects.get(effect, ()), term)
    return effects


def term_text(trials: Trials, term: str) -> str:
    """Return a term for the report: a column of a categorical factor is its factor with the level, as in X3[B]."""
    labels = [""] * len(trials.factors)
    labels += [f"[{label}]" for kind in trials.kinds for label in kind.labels[:-1]]
    return _COLUMN.sub(lambda match: f"X{trials.owners[int(match[1]) - 1]}{labels[int(match[1]) - 1]}", term)


def _by_factor(trials: Trials, term: str) -> str:
    """Return a term with the numbers of the factors in place of those of the columns."""
    return _COLUMN.sub(lambda match: f"X{trials.owners[int(match[1]) - 1]}", term)


def _fitted(trials: Trials, order: Order, link: Link, *, spare: int) -> TrialModel:
    """Return the model with the given polynomial."""
    terms = model_terms(trials.coded, order, trials.owners)
    whole = tuple(
        name for name in terms if trials.plots is not None and _factors_of(_by_factor(trials, name)) <= set(trials.hard)
    )
    if len(trials.coded) - 1 - len(terms) - trials.block_columns.shape[1] < spare:
        raise StudyError(
            f"regression: {len(trials.coded)} trials for {1 + len(terms)} coefficients of the factors "
            f"and {trials.block_columns.shape[1]} of the blocks leave too few degrees of freedom for the error; "
            "add trials or choose a simpler --model"
        )
    everything, blocks = _with_columns(trials, trials.block_columns, terms, link)
    strata: tuple[Stratum, ...] = (Stratum("trials", everything, terms, blocks, effects_of(trials, terms)),)
    if trials.plots is not None:
        strata = _strata(trials, trials.plots, terms, whole, link)
    return TrialModel(order, terms, everything, strata, len(trials.owners))


def _factors_of(term: str) -> set[int]:
    """Return the numbers of the factors in a term.

    >>> sorted(_factors_of("X1 X3")), sorted(_factors_of("X2^2"))
    ([1, 3], [2])
    """
    return {int(part.removeprefix("X").partition("^")[0]) for part in term.split(" ")}


def _strata(
    trials: Trials, plots: Sequence[str], terms: tuple[str, ...], whole: tuple[str, ...], link: Link
) -> tuple[Stratum, ...]:
    """Return the strata within and between whole plots."""
    within_terms = tuple(name for name in terms if name not in whole)
    strata = []
    if within_terms:
        try:
            within, columns = _with_columns(trials, block_columns(plots), within_terms, link)
            strata.append(
                Stratum("within whole plots", within, within_terms, columns, effects_of(trials, within_terms))
            )
        except StudyError as error:
            strata.append(Stratum("within whole plots", str(error), within_terms, (), {}))
    try:
        between = _between(trials, plots, whole, link)
        strata.append(Stratum("between whole plots", between, whole, (), effects_of(trials, whole)))
    except StudyError as error:
        strata.append(Stratum("between whole plots", str(error), whole, (), {}))
    return tuple(strata)


def _between(trials: Trials, plots: Sequence[str], whole: Sequence[str], link: Link) -> Model:
    """Return the fit of one mean, or of the pooled counts, of each whole plot."""
    _, first, groups, sizes = np.unique(plots, return_index=True, return_inverse=True, return_counts=True)
    is_hard = np.isin(trials.owners, trials.hard)
    coded = np.where(is_hard, trials.columns[first], 0.0)
    if trials.counts is not None and trials.totals is not None:
        counts, totals = (_sums(groups, each) for each in (trials.counts, trials.totals))
        return weighted_fit(coded, counts, totals, whole, link)
    return fit(coded, _sums(groups, trials.response) / sizes, whole)


def _sums(groups: NDArray[np.intp], values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.bincount(groups, weights=values).astype(np.float64)


def _with_columns(
    trials: Trials, columns: NDArray[np.float64], terms: Sequence[str], link: Link
) -> tuple[Model, tuple[str, ...]]:
    """Return the fit with further columns, such as those of blocks, and the names of their terms."""
    own = trials.columns
    k = own.shape[1]
    further = tuple(f"X{number}" for number in range(k + 1, k + 1 + columns.shape[1]))
    coded, names = np.hstack([own, columns]), (*terms, *further)
    if trials.counts is not None and trials.totals is not None:
        return weighted_fit(coded, trials.counts, trials.totals, names, link, additive=len(further)), further
    return fit(coded, trials.response, names, additive=len(further)), further


def predicted_r2(fitted: Model) -> float | None:
    """Return the coefficient of determination of trials predicted without them; None if one cannot be left out."""
    if isinstance(fitted, WeightedFit):
        return fitted.predicted_r2
    basis, _ = np.linalg.qr(model_matrix(fitted.coded, list(fitted.coefficients)))
    left = 1 - (basis**2).sum(axis=1)
    if (left < _LEAST_LEFT).any():
        return None
    press = np.sum(((fitted.response - fitted.predict(fitted.coded)) / left) ** 2)
    return 1 - float(press / np.sum((fitted.response - fitted.response.mean()) ** 2))
