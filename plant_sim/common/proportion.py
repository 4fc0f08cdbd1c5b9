"""Observed proportions with their exact confidence intervals."""

from __future__ import annotations

from typing import Final, NamedTuple

CONFIDENCE: Final = 0.95
"""Confidence level of all intervals for which no other is stated."""


class Proportion(NamedTuple):
    """Observed proportion of independent draws.

    Attributes:
        hits: Number of hits.
        draws: Number of draws.

    >>> Proportion(136, 144).text()
    '94.4 % (89.3 to 97.6)'
    """

    hits: int
    draws: int

    @property
    def share(self) -> float:
        """Proportion, 0 to 1; NaN without draws."""
        return self.hits / self.draws if self.draws else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Exact binomial 95 % confidence interval, 0 to 1."""
        return binomial_interval(self.hits, self.draws)

    @property
    def percent(self) -> float:
        """Proportion, percent; NaN without draws."""
        return 100 * self.hits / self.draws if self.draws else float("nan")

    @property
    def interval_percent(self) -> tuple[float, float]:
        """Exact binomial 95 % confidence interval, percent."""
        low, high = self.interval
        return 100 * low, 100 * high

    def record(self) -> dict[str, object]:
        """Return the proportion as a JSON object."""
        low, high = self.interval_percent
        percent = self.percent if self.draws else None
        return {"hits": self.hits, "of": self.draws, "percent": percent, "low": low, "high": high}

    def text(self, decimals: int = 1) -> str:
        """Return the proportion and its interval in percent."""
        low, high = self.interval_percent
        if not self.draws:
            return "none"
        return f"{self.percent:.{decimals}f} % ({low:.{decimals}f} to {high:.{decimals}f})"


def binomial_interval(hits: int, draws: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the exact (Clopper-Pearson) confidence interval of a proportion, 0 to 1.

    Args:
        hits: Number of hits.
        draws: Number of draws; 0 gives the interval 0 to 1.
        confidence: Confidence level, 0 to 1.

    >>> [round(end, 4) for end in binomial_interval(136, 144)]
    [0.8935, 0.9757]
    """
    from scipy.special import betaincinv  # noqa: PLC0415 - importing it would delay every start of the plant

    if draws == 0:
        return 0.0, 1.0
    tail = (1 - confidence) / 2
    low = 0.0 if hits == 0 else float(betaincinv(hits, draws - hits + 1, tail))
    high = 1.0 if hits == draws else float(betaincinv(hits + 1, draws - hits, 1 - tail))
    return low, high
