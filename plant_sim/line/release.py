"""Forecast of the release by a chain planter: lambda that a plant spacing requires, and the plants that result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from plant_sim.line.planting import FallModel, chain_pitch_m
from plant_sim.line.row import Stand
from plant_sim.planter.chain import ChainSpec
from plant_sim.planter.ratio import Regime, regime_of

SPACINGS_M: Final = (0.35, 0.40, 0.45, 0.50)
"""Agronomic spacings of the forecast, m. Source: requirement of the line, 35 to 50 cm."""
CLEAN_FROM: Final = 1.17
"""Smallest lambda of a clean release according to the conclusion of the cabbage paper; its own optimum has 1.05."""
_DRAWS = 2_000


@dataclass(frozen=True, slots=True)
class ReleaseForecast:
    """Release at one plant spacing.

    Attributes:
        spacing_m: Plant spacing, m.
        ratio: Required lambda.
        upright: Share of upright plants.
        lodged: Share of lodged plants.
        scraped: Share of the plants that the planter touches after the release.
    """

    spacing_m: float
    ratio: float
    upright: float
    lodged: float
    scraped: float

    @property
    def regime(self) -> Regime:
        """Kind of path."""
        return regime_of(self.ratio)

    @property
    def is_clean(self) -> bool:
        """True if the planter scrapes no plant."""
        return self.scraped == 0.0

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
        }

    def text(self) -> str:
        """Return the forecast as text."""
        verdict = "clean" if self.is_clean else "not clean"
        paper = "at least" if self.ratio >= CLEAN_FROM else "below"
        return (
            f"  {100 * self.spacing_m:.0f} cm requires lambda {self.ratio:.3f} ({self.regime.value}, {paper} the "
            f"{CLEAN_FROM:g} of the paper): release {verdict}, {100 * self.scraped:.1f} % scraped, "
            f"{100 * self.upright:.1f} % upright, {100 * self.lodged:.1f} % lodged"
        )


def forecasts(
    spacings_m: Sequence[float], chain: ChainSpec, falls: FallModel, *, seed: int
) -> tuple[ReleaseForecast, ...]:
    """Return the forecasts for several spacings, in ascending order.

    Args:
        spacings_m: Plant spacings, m.
        chain: Chain of the planter.
        falls: Results of falling blocks.
        seed: Seed of the random numbers.
    """
    return tuple(_forecast(spacing_m, chain, falls, seed) for spacing_m in sorted(set(spacings_m)))


def _forecast(spacing_m: float, chain: ChainSpec, falls: FallModel, seed: int) -> ReleaseForecast:
    ratio = chain_pitch_m(chain) / spacing_m
    landing = falls.draw(np.full(_DRAWS, ratio), np.random.default_rng(seed))
    return ReleaseForecast(
        spacing_m,
        ratio,
        upright=float(np.mean(landing.stand == Stand.UPRIGHT)),
        lodged=float(np.mean(landing.stand == Stand.LODGED)),
        scraped=float(np.mean(landing.scraped)),
    )
