"""Variance between repeated trials of counted seedlings, as a multiple of the binomial variance."""

from __future__ import annotations

from dataclasses import dataclass

from scipy import stats


@dataclass(frozen=True, slots=True)
class Dispersion:
    """Variance between repeated trials, as a multiple of the binomial variance.

    Attributes:
        estimate: Mean square of the pure error; None without repeated runs.
        degrees: Degrees of freedom of the estimate.
    """

    estimate: float | None
    degrees: int

    @property
    def value(self) -> float:
        """Dispersion for planning and for a statement without degrees of freedom: the estimate, but at least 1."""
        return 1.0 if self.estimate is None else max(1.0, self.estimate)

    @property
    def is_known(self) -> bool:
        """True if there are repeated runs and they differ, so that F tests have an error."""
        return self.estimate is not None and self.estimate > 0

    def interval(self, confidence: float = 0.95) -> tuple[float, float] | None:
        """Return the χ² confidence interval of the dispersion, not limited to 1; None if it is unknown."""
        if self.estimate is None or not self.is_known:
            return None
        tail = (1 - confidence) / 2
        high, low = stats.chi2.ppf((tail, 1 - tail), self.degrees)
        total = self.estimate * self.degrees
        return float(total / low), float(total / high)

    def correlation(self, seedlings: float) -> float:
        """Return the correlation within groups of seedlings that gives this dispersion: (value - 1) / (m - 1)."""
        return (self.value - 1) / (seedlings - 1)
