"""Forecast of the release by a chain planter: the lambda that a plant spacing requires, and the resulting plants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from plant_sim.line.planting import ChainPlanter
from plant_sim.planter.ratio import Regime, regime_of
from plant_sim.planter.verdict import Stand

SPACINGS_M: Final = (0.35, 0.40, 0.45, 0.50)
"""Agronomic spacings of the forecast, m. Source: required range of the line, 35 to 50 cm."""
CLEAN_FROM: Final = 1.17
"""Smallest lambda of a clean release according to the conclusion of the cabbage paper; its optimum has 1.05."""
MOST_SCRAPED: Final = 0.01
"""Largest share of scraped plants of a clean release; assumed."""
_DRAWS = 10_000


@dataclass(frozen=True, slots=True)
class ReleaseForecast:
    """Release at one plant spacing.

    Attributes:
        spacing_m: Plant spacing, m.
        ratio: Required lambda.
        upright: Share of upright plants.
        lodged: Share of lodged plants.
        scraped: Share of the plants that the guide plate touches after they have reached the ground.
        within: True if lambda and the planting frequency are within the range of the fall table.
    """

    spacing_m: float
    ratio: float
    upright: float
    lodged: float
    scraped: float
    within: bool

    @property
    def regime(self) -> Regime:
        """Kind of path."""
        return regime_of(self.ratio)

    @property
    def is_clean(self) -> bool:
        """True if the guide plate scrapes at most `MOST_SCRAPED` of the plants."""
        return self.scraped <= MOST_SCRAPED

    def record(self) -> dict[str, object]:
        """Return the forecast as a JSON object."""
        return {
            "spacing_m": self.spacing_m,
            "lambda": self.ratio,
            "path": self.regime.value,
            "clean": self.is_clean,
            "clean_by_paper": self.ratio >= CLEAN_FROM,
            "upright": self.upright,
            "lodged": self.lodged,
            "scraped": self.scraped,
            "extrapolated": not self.within,
        }

    def text(self) -> str:
        """Return the forecast as text."""
        verdict = "clean" if self.is_clean else "not clean"
        beyond = "" if self.within else ", extrapolated"
        paper = "at least" if self.ratio >= CLEAN_FROM else "below"
        return (
            f"  {100 * self.spacing_m:.0f} cm requires lambda {self.ratio:.3f} ({self.regime.value}, {paper} the "
            f"{CLEAN_FROM:g} of the paper): release {verdict}, {100 * self.scraped:.1f} % scraped, "
            f"{100 * self.upright:.1f} % upright, {100 * self.lodged:.1f} % lodged{beyond}"
        )


def forecasts(
    spacings_m: Sequence[float], planter: ChainPlanter, *, speed_m_s: float, seed: int
) -> tuple[ReleaseForecast, ...]:
    """Return the forecasts for several spacings, in ascending order.

    Args:
        spacings_m: Plant spacings, m.
        planter: The planter.
        speed_m_s: Speed of the machine, from which the planting frequency at a spacing follows, m/s.
        seed: Seed of the random numbers.
    """
    return tuple(_forecast(spacing_m, planter, speed_m_s, seed) for spacing_m in sorted(set(spacings_m)))


def _forecast(spacing_m: float, planter: ChainPlanter, speed_m_s: float, seed: int) -> ReleaseForecast:
    ratio = planter.pitch_m / spacing_m
    frequency_per_min = 60 * speed_m_s / spacing_m
    fall = planter.draw(np.full(_DRAWS, ratio), np.random.default_rng(seed), frequency_per_min=frequency_per_min)
    return ReleaseForecast(
        spacing_m,
        ratio,
        upright=float(np.mean(fall.stand == Stand.UPRIGHT)),
        lodged=float(np.mean(fall.stand == Stand.LODGED)),
        scraped=float(np.mean(fall.scraped)),
        within=bool(fall.within.all()),
    )
