"""What the pepper paper says in words of each factor by itself, and whether trials bear it out ([P], section 3.3).

The paper shows these results as pictures only. Its words have no numbers: what "low", "high" or "a little" means here
is ours, and stands beside each of them. Trials decide a sentence only as far as the scatter of their counts allows: it
is compared by confidence intervals that hold together, over all comparisons of the sentence, with 95 % (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Final, Literal

from statsmodels.stats.proportion import confint_proportions_2indep

from plant_sim.bench.repeats import Pool
from plant_sim.bench.report import CONFIDENCE, binomial_interval

Verdict = Literal["yes", "no", "undecided"]
Levels = tuple[int, ...]
"""Places of levels of a factor, from 0 for the lowest; their seedlings count together."""
Course = tuple[Pool, ...]
"""What trials gave at the seven levels of a factor, rising."""
Interval = tuple[float, float]
Comparison = Callable[[Course, str, float], Interval]
"""Gives the confidence interval, for a share and an error probability, of what is above 0 if the paper is right."""

_PERCENT = 100.0
_FLUCTUATION = 1.0
_A_LITTLE = 5.0
_SMALL_PART = 1 / 3


@dataclass(frozen=True, slots=True)
class Sentence:
    """Something the paper says.

    Attributes:
        words: What it says.
        share: Of which failures.
        meaning: What is taken to bear it out.
        judge: Tells whether a course does, for a share.
    """

    words: str
    share: str
    meaning: str
    judge: Callable[[Course, str], Verdict]

    def verdict(self, course: Course) -> Verdict:
        """Tell whether trials bear it out; undecided where they are too few to tell."""
        return self.judge(course, self.share)


def _count(course: Course, share: str, levels: Levels) -> tuple[int, int]:
    """Return how many seedlings failed at some levels, and of how many."""
    return sum(course[level].counts[share] for level in levels), sum(course[level].seedlings for level in levels)


def _difference(course: Course, share: str, levels: Levels, others: Levels, error: float) -> Interval:
    """Interval of a share at some levels less that at others, percentage points (Newcombe)."""
    counts = (*_count(course, share, levels), *_count(course, share, others))
    low, high = confint_proportions_2indep(*counts, method="newcomb", compare="diff", alpha=error)
    return _PERCENT * float(low), _PERCENT * float(high)


def _above(levels: Levels, others: Levels, by: float = 0.0) -> Comparison:
    """A share is higher at some levels than at others, by more than some points."""

    def compare(course: Course, share: str, error: float) -> Interval:
        low, high = _difference(course, share, levels, others, error)
        return low - by, high - by

    return compare


def _times(levels: Levels, others: Levels, factor: float) -> Comparison:
    """A share is more than so many times as high at some levels as at others."""

    def compare(course: Course, share: str, error: float) -> Interval:
        counts = (*_count(course, share, levels), *_count(course, share, others))
        low, high = confint_proportions_2indep(*counts, method="log-adjusted", compare="ratio", alpha=error)
        return float(low) - factor, float(high) - factor

    return compare


def _below(level: int, percent: float) -> Comparison:
    """A share is below some percent at a level."""

    def compare(course: Course, share: str, error: float) -> Interval:
        low, high = binomial_interval(*_count(course, share, (level,)), 1 - error)
        return percent - _PERCENT * high, percent - _PERCENT * low

    return compare


def _a_little_above(levels: Levels, others: Levels) -> tuple[Comparison, Comparison]:
    return _above(levels, others), _above(others, levels, by=-_A_LITTLE)


def _verdicts(course: Course, share: str, comparisons: Iterable[Comparison], error: float) -> set[Verdict]:
    found: set[Verdict] = set()
    for compare in comparisons:
        low, high = compare(course, share, error)
        found.add("yes" if low > 0 else "no" if high < 0 else "undecided")
    return found


def _all(verdicts: set[Verdict]) -> Verdict:
    """What several make together: all must be borne out."""
    if "no" in verdicts:
        return "no"
    return "undecided" if "undecided" in verdicts else "yes"


def _any(verdicts: set[Verdict]) -> Verdict:
    """What several make together: one borne out is enough."""
    if "yes" in verdicts:
        return "yes"
    return "undecided" if "undecided" in verdicts else "no"


def _every(*comparisons: Comparison) -> Callable[[Course, str], Verdict]:
    """All comparisons are as the paper says."""
    error = (1 - CONFIDENCE) / len(comparisons)
    return lambda course, share: _all(_verdicts(course, share, comparisons, error))


def _fluctuates(levels: Levels) -> Callable[[Course, str], Verdict]:
    """A share both rises and falls by more than a point from one of some levels to a later one."""
    pairs = list(combinations(levels, 2))
    rises = [_above((later,), (earlier,), by=_FLUCTUATION) for earlier, later in pairs]
    falls = [_above((earlier,), (later,), by=_FLUCTUATION) for earlier, later in pairs]
    error = (1 - CONFIDENCE) / (2 * len(pairs))
    return lambda course, share: _all({_any(_verdicts(course, share, each, error)) for each in (rises, falls)})


def _unchanged(levels: Levels, others: Levels, beside: tuple[str, ...]) -> Callable[[Course, str], Verdict]:
    """A share does not differ beyond chance, and at most by a small part of what other shares change."""
    error = (1 - CONFIDENCE) / (1 + len(beside))

    def judge(course: Course, share: str) -> Verdict:
        least, most = _size(_difference(course, share, levels, others, error))
        changes = [_size(_difference(course, other, levels, others, error)) for other in beside]
        if least > 0:
            return "no"
        return "yes" if most < _SMALL_PART * min(change[0] for change in changes) else "undecided"

    return judge


def _size(interval: Interval) -> Interval:
    """Interval of a difference without its sign."""
    low, high = interval
    return max(low, -high, 0.0), max(high, -low)


FOAM: Final = (
    Sentence("7.5 mm and less: pick failures low", "F_p", "each below 5 %",
             _every(*(_below(at, 5) for at in range(3)))),
    Sentence("7.5 mm and less: carry failures high", "F_d", "each above 12.5 mm and more together",
             _every(*(_above((at,), (4, 5, 6)) for at in range(3)))),
    Sentence("15 mm and more: pick failures up", "F_p", "both above 12.5 mm",
             _every(_above((5,), (4,)), _above((6,), (4,)))),
    Sentence("15 mm and more: carry failures far lower", "F_d", "7.5 mm more than twice each",
             _every(_times((2,), (5,), 2), _times((2,), (6,), 2))),
    Sentence("15 mm and more: throw failures unchanged", "F_t", "no difference to 7.5 mm and less beyond chance, and "
             "less than a third of that of F_p and of F_d", _unchanged((5, 6), (0, 1, 2), ("F_p", "F_d"))),
)  # fmt: skip
AGE: Final = (
    *(Sentence(f"43 d and less: {name} failures high", share, "both above 52 d and more together",
               _every(_above((0,), (4, 5, 6)), _above((1,), (4, 5, 6))))
      for name, share in (("pick", "F_p"), ("carry", "F_d"))),
    *(Sentence(f"52 d and more: {name} failures fall", share, "55 and 58 d together below 52 d",
               _every(_above((4,), (5, 6))))
      for name, share in (("pick", "F_p"), ("carry", "F_d"))),
)  # fmt: skip
PRESSURE: Final = (
    Sentence("0.25 MPa and less: plugs stay in their cells", "F_p", "both above 0.45 MPa",
             _every(_above((0,), (3,)), _above((1,), (3,)))),
    Sentence("0.65 MPa and more: stems are cut", "F_p", "both above 0.45 MPa",
             _every(_above((5,), (3,)), _above((6,), (3,)))),
    Sentence("carry failures fluctuate", "F_d", "rise and fall by more than 1 point between levels up to 0.55 MPa",
             _fluctuates((0, 1, 2, 3, 4))),
    Sentence("carry failures then rise a little", "F_d", "from 0.65 MPa on above those before, by less than 5 points",
             _every(*_a_little_above((5, 6), (0, 1, 2, 3, 4)))),
    Sentence("throw failures fall fast", "F_t", "at 0.15 MPa more than twice 0.35", _every(_times((0,), (2,), 2))),
    Sentence("throw failures then rise a little", "F_t", "from 0.55 MPa on above 0.35 and 0.45, by less than 5 points",
             _every(*_a_little_above((4, 5, 6), (2, 3)))),
)  # fmt: skip

SENTENCES: Final[Mapping[str, tuple[Sentence, ...]]] = {"foam": FOAM, "age": AGE, "pressure": PRESSURE}
"""By factor."""
