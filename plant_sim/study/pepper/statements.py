"""Statements of the pepper paper about single factors, and tests of these statements against trials ([P], section 3.3).

The paper shows these results as figures without numbers. The criteria for "low", "high" or "a little" are assumptions
and are listed with each statement. A statement is confirmed or rejected only if the scatter of the counts allows it,
based on simultaneous 95 % confidence intervals for all its comparisons (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Final, Literal

from statsmodels.stats.proportion import confint_proportions_2indep

from plant_sim.common.proportion import CONFIDENCE, binomial_interval
from plant_sim.twin.repeats import Pool

Verdict = Literal["yes", "no", "undecided"]
Levels = tuple[int, ...]
"""Indices of levels of a factor, from 0 for the lowest; their seedlings are pooled."""
Course = tuple[Pool, ...]
"""Pooled trials at the seven levels of a factor, ascending."""
Interval = tuple[float, float]
Comparison = Callable[[Course, str, float], Interval]
"""Function that takes a course, a share and an error probability, and returns the confidence interval of a quantity.

The quantity is above 0 if the statement is true.
"""

_PERCENT = 100.0
_FLUCTUATION = 1.0
_A_LITTLE = 5.0
_SMALL_PART = 1 / 3


@dataclass(frozen=True, slots=True)
class Statement:
    """Statement of the paper.

    Attributes:
        text: Text of the statement.
        share: Name of the failure rate.
        meaning: Criterion for the statement.
        judge: Function that takes a `Course` and the name of a failure rate, and returns the verdict.
    """

    text: str
    share: str
    meaning: str
    judge: Callable[[Course, str], Verdict]

    def verdict(self, course: Course) -> Verdict:
        """Return the verdict of the trials on the statement; undecided if there are too few trials."""
        return self.judge(course, self.share)


def _count(course: Course, share: str, levels: Levels) -> tuple[int, int]:
    """Return the number of failed seedlings and the total number of seedlings at some levels."""
    return sum(course[level].counts[share] for level in levels), sum(course[level].seedlings for level in levels)


def _difference(course: Course, share: str, levels: Levels, others: Levels, error: float) -> Interval:
    """Return Newcombe's confidence interval of the difference in a rate between levels, percentage points."""
    counts = (*_count(course, share, levels), *_count(course, share, others))
    low, high = confint_proportions_2indep(*counts, method="newcomb", compare="diff", alpha=error)
    return _PERCENT * float(low), _PERCENT * float(high)


def _above(levels: Levels, others: Levels, by: float = 0.0) -> Comparison:
    """Return a comparison that tests whether the rate at some levels is higher than the rate at others.

    The difference must exceed `by` percentage points.
    """

    def compare(course: Course, share: str, error: float) -> Interval:
        low, high = _difference(course, share, levels, others, error)
        return low - by, high - by

    return compare


def _times(levels: Levels, others: Levels, factor: float) -> Comparison:
    """Return a comparison that tests whether the rate at some levels is more than `factor` times the rate at others."""

    def compare(course: Course, share: str, error: float) -> Interval:
        counts = (*_count(course, share, levels), *_count(course, share, others))
        low, high = confint_proportions_2indep(*counts, method="log-adjusted", compare="ratio", alpha=error)
        return float(low) - factor, float(high) - factor

    return compare


def _below(level: int, percent: float) -> Comparison:
    """Return a comparison that tests whether the rate at a level is below `percent`."""

    def compare(course: Course, share: str, error: float) -> Interval:
        low, high = binomial_interval(*_count(course, share, (level,)), 1 - error)
        return percent - _PERCENT * high, percent - _PERCENT * low

    return compare


def _a_little_above(levels: Levels, others: Levels) -> tuple[Comparison, Comparison]:
    return _above(levels, others), _above(others, levels, by=-_A_LITTLE)


def _verdicts(course: Course, share: str, comparisons: Iterable[Comparison], error: float) -> set[Verdict]:
    verdicts: set[Verdict] = set()
    for compare in comparisons:
        low, high = compare(course, share, error)
        verdicts.add("yes" if low > 0 else "no" if high < 0 else "undecided")
    return verdicts


def _all(verdicts: set[Verdict]) -> Verdict:
    """Return the verdict on whether all comparisons hold."""
    if "no" in verdicts:
        return "no"
    return "undecided" if "undecided" in verdicts else "yes"


def _any(verdicts: set[Verdict]) -> Verdict:
    """Return the verdict on whether at least one comparison holds."""
    if "yes" in verdicts:
        return "yes"
    return "undecided" if "undecided" in verdicts else "no"


def _every(*comparisons: Comparison) -> Callable[[Course, str], Verdict]:
    """Return a judge that requires all comparisons to hold."""
    error = (1 - CONFIDENCE) / len(comparisons)
    return lambda course, share: _all(_verdicts(course, share, comparisons, error))


def _fluctuates(levels: Levels) -> Callable[[Course, str], Verdict]:
    """Return a judge that requires the rate both to rise and to fall by more than one point between levels."""
    pairs = list(combinations(levels, 2))
    rises = [_above((later,), (earlier,), by=_FLUCTUATION) for earlier, later in pairs]
    falls = [_above((earlier,), (later,), by=_FLUCTUATION) for earlier, later in pairs]
    error = (1 - CONFIDENCE) / (2 * len(pairs))
    return lambda course, share: _all({_any(_verdicts(course, share, each, error)) for each in (rises, falls)})


def _unchanged(levels: Levels, others: Levels, other_shares: tuple[str, ...]) -> Callable[[Course, str], Verdict]:
    """Return a judge that requires the change in a rate to be insignificant and much smaller than in other rates."""
    error = (1 - CONFIDENCE) / (1 + len(other_shares))

    def judge(course: Course, share: str) -> Verdict:
        least, most = _size(_difference(course, share, levels, others, error))
        changes = [_size(_difference(course, other, levels, others, error)) for other in other_shares]
        if least > 0:
            return "no"
        return "yes" if most < _SMALL_PART * min(change[0] for change in changes) else "undecided"

    return judge


def _size(interval: Interval) -> Interval:
    """Return the confidence interval of the magnitude of a difference."""
    low, high = interval
    return max(low, -high, 0.0), max(high, -low)


FOAM: Final = (
    Statement(
        "7.5 mm or less: pick failures low", "F_p", "each below 5 %", _every(*(_below(at, 5) for at in range(3)))
    ),
    Statement(
        "7.5 mm or less: carry failures high",
        "F_d",
        "each above the pooled rate at 12.5 mm or more",
        _every(*(_above((at,), (4, 5, 6)) for at in range(3))),
    ),
    Statement(
        "15 mm or more: pick failures up",
        "F_p",
        "both above the rate at 12.5 mm",
        _every(_above((5,), (4,)), _above((6,), (4,))),
    ),
    Statement(
        "15 mm or more: carry failures far lower",
        "F_d",
        "rate at 7.5 mm more than twice each",
        _every(_times((2,), (5,), 2), _times((2,), (6,), 2)),
    ),
    Statement(
        "15 mm or more: throw failures unchanged",
        "F_t",
        "no significant difference from 7.5 mm or less, and less than a third of the differences of F_p and F_d",
        _unchanged((5, 6), (0, 1, 2), ("F_p", "F_d")),
    ),
)
AGE: Final = (
    *(
        Statement(
            f"43 d or less: {name} failures high",
            share,
            "both above the pooled rate at 52 d or more",
            _every(_above((0,), (4, 5, 6)), _above((1,), (4, 5, 6))),
        )
        for name, share in (("pick", "F_p"), ("carry", "F_d"))
    ),
    *(
        Statement(
            f"52 d or more: {name} failures fall",
            share,
            "pooled rate at 55 and 58 d below 52 d",
            _every(_above((4,), (5, 6))),
        )
        for name, share in (("pick", "F_p"), ("carry", "F_d"))
    ),
)
PRESSURE: Final = (
    Statement(
        "0.25 MPa or less: plugs stay in their cells",
        "F_p",
        "both above the rate at 0.45 MPa",
        _every(_above((0,), (3,)), _above((1,), (3,))),
    ),
    Statement(
        "0.65 MPa or more: stems are cut",
        "F_p",
        "both above the rate at 0.45 MPa",
        _every(_above((5,), (3,)), _above((6,), (3,))),
    ),
    Statement(
        "carry failures fluctuate",
        "F_d",
        "rise and fall by more than 1 point between levels up to 0.55 MPa",
        _fluctuates((0, 1, 2, 3, 4)),
    ),
    Statement(
        "carry failures then rise a little",
        "F_d",
        "pooled rate from 0.65 MPa above that at lower pressures, by less than 5 percentage points",
        _every(*_a_little_above((5, 6), (0, 1, 2, 3, 4))),
    ),
    Statement(
        "throw failures fall fast",
        "F_t",
        "rate at 0.15 MPa more than twice that at 0.35 MPa",
        _every(_times((0,), (2,), 2)),
    ),
    Statement(
        "throw failures then rise a little",
        "F_t",
        "pooled rate from 0.55 MPa above that at 0.35 and 0.45 MPa, by less than 5 percentage points",
        _every(*_a_little_above((4, 5, 6), (2, 3))),
    ),
)

STATEMENTS: Final[Mapping[str, tuple[Statement, ...]]] = {"foam": FOAM, "age": AGE, "pressure": PRESSURE}
"""Statements by factor."""
