"""Result of a line: counts, spacing, rates, productivity, lambda and all assumed values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np

from plant_sim.line.indices import (
    MISS_ABOVE,
    MULTIPLE_BELOW,
    Rate,
    SpacingIndices,
    missing_by_cause,
    planting_rates,
    spacing_indices,
)
from plant_sim.line.release import ReleaseForecast
from plant_sim.line.row import PlantRow
from plant_sim.line.run import LineRun

HAND_FED_PER_H: Final = (2_500, 3_000)
"""Plants per hour of the hand-fed two-row machine. Source: pepper paper."""

_NEEDED_QUANTILE = 0.999


@dataclass(frozen=True)
class LineResult:
    """Result of a line.

    Attributes:
        title: Title of the line.
        seed: Seed.
        metres: Length of each row, m.
        spacing_m: Set spacing, m.
        run: Rows of plants.
        releases: Forecasts of the release at the set spacing and at other spacings; empty without a chain planter.
        window: Catch window of the chutes in planting cycles; None without chutes.
        is_fed_by_arms: True if the arms of the machine feed the line.
        assumed: Key and value, as text, of every assumed value.
        remarks: Limits of the models that apply to this line.
    """

    title: str
    seed: int
    metres: float
    spacing_m: float
    run: LineRun
    releases: tuple[ReleaseForecast, ...] = ()
    window: float | None = None
    is_fed_by_arms: bool = False
    assumed: tuple[str, ...] = ()
    remarks: tuple[str, ...] = field(default=())

    def __repr__(self) -> str:
        quality = self.spacing.quality.text() if self.spacing.number else "unknown"
        return (
            f"<LineResult {self.title}, seed {self.seed}: rows {len(self.rows)} x {self.metres:g} m, {self.plants} "
            f"plants, {self.plants_per_h:,.0f} plants/h, quality of feed {quality}>"
        )

    @property
    def rows(self) -> tuple[PlantRow, ...]:
        """Rows of plants, left first."""
        return self.run.rows

    @cached_property
    def spacing(self) -> SpacingIndices:
        """Indices of the spacing."""
        return spacing_indices([row.plants_m for row in self.rows], self.spacing_m)

    @cached_property
    def rates(self) -> dict[str, Rate]:
        """Rates of all rows."""
        return planting_rates(self.rows)

    @property
    def missing(self) -> dict[str, int]:
        """Missing plants by cause."""
        return missing_by_cause(self.rows)

    @property
    def plants(self) -> int:
        """Number of plants; both plants of a double are counted."""
        return sum(int(row.seedlings.sum()) for row in self.rows)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last release, s."""
        return float(max(row.time_s[-1] for row in self.rows) - min(row.time_s[0] for row in self.rows))

    @property
    def plants_per_h(self) -> float:
        """Productivity of all rows including stops, 1/h; NaN for fewer than two releases."""
        return 3600 * self.plants / self.duration_s if self.duration_s else math.nan

    @property
    def ratios(self) -> tuple[float, float] | None:
        """Smallest and largest lambda at a release; None without a chain planter."""
        ratios = np.concatenate([row.ratio for row in self.rows])
        return (float(ratios.min()), float(ratios.max())) if not np.isnan(ratios).any() else None

    @property
    def scraped(self) -> Rate | None:
        """Share of the plants that the guide plate has touched on the ground; None without a chain planter."""
        if self.ratios is None:
            return None
        planted = sum(int(np.count_nonzero(row.planted)) for row in self.rows)
        return Rate(sum(int(np.count_nonzero(row.scraped)) for row in self.rows), planted)

    @property
    def extrapolated(self) -> int:
        """Number of plants whose lambda is outside the range of the fall table."""
        return sum(int(np.count_nonzero(~row.within)) for row in self.rows)

    @property
    def extrapolated_injuries(self) -> int:
        """Number of plants whose speed or frequency is outside the levels of the bench test on injury."""
        return sum(int(np.count_nonzero(~row.injury_within)) for row in self.rows)

    @property
    def needed_window(self) -> float | None:
        """Catch window required for 99.9 % of the arrivals, in planting cycles; None without chutes."""
        phase = np.concatenate([row.phase for row in self.rows])
        return 2 * float(np.quantile(np.abs(phase), _NEEDED_QUANTILE)) if len(phase) else None

    def record(self) -> dict[str, Any]:
        """Return the result as a JSON object, without the list of plants."""
        indices, balance = self.spacing, self.run.balance
        return {
            "title": self.title,
            "seed": self.seed,
            "metres": self.metres,
            "accounted": self.run.accounted,
            "rows": [_counts(row) for row in self.rows],
            "missing": self.missing,
            "plants": self.plants,
            "duration_s": self.duration_s,
            "plants_per_h": _number(self.plants_per_h),
            "hand_fed_per_h": HAND_FED_PER_H if self.is_fed_by_arms else None,
            "spacing": {
                "set_m": self.spacing_m,
                "number": indices.number,
                "mean_m": _number(indices.mean_m),
                "sd_m": _number(indices.sd_m),
                "quality_mean_m": _number(indices.regular_mean_m),
                "cv": _number(indices.cv),
                "multiple": indices.multiple.record(),
                "quality": indices.quality.record(),
                "miss": indices.miss.record(),
                "precision": _number(indices.precision),
            },
            "rates": {name: rate.record() for name, rate in self.rates.items()},
            "lambda": None if self.ratios is None else [_number(end) for end in self.ratios],
            "scraped": None if self.scraped is None else self.scraped.record(),
            "extrapolated_falls": self.extrapolated,
            "extrapolated_injuries": self.extrapolated_injuries,
            "releases": [release.record() for release in self.releases],
            "catch_window": None if self.window is None else {"given": self.window, "needed": self.needed_window},
            "seedlings": None if balance is None else {name: getattr(balance.counts, name) for name in _PLACES},
            "alarms": list(self.run.alarms),
            "assumed": list(self.assumed),
            "remarks": list(self.remarks),
        }

    def text(self) -> str:
        """Return the result as text."""
        rates, balance = self.rates, self.run.balance
        released = sum(row.released for row in self.rows)
        single, double = (sum(getattr(row, name) for row in self.rows) for name in ("single", "double"))
        transit = sum(row.in_transit for row in self.rows)
        what = "planters" if self.ratios is not None and not self.is_fed_by_arms else "cups"
        lines = [
            self.title,
            f"rows {len(self.rows)} x {self.metres:g} m, seed {self.seed}, {self.duration_s:.0f} s",
            f"{what} released {released} = single {single} + double {double} + missing {released - single - double}; "
            f"in transit {transit}" + ("" if self.run.accounted else "  NOT ACCOUNTED FOR"),
            f"missing by cause: {_listed(self.missing)}",
            *self._spacing_lines(),
            "rates, 95 % binomial: " + ", ".join(f"{name} {rate.text()}" for name, rate in rates.items()),
            *self._injury_lines(),
            *self._release_lines(),
            self._productivity(),
        ]
        if balance is not None:
            lines.append("seedlings: " + ", ".join(f"{name} {getattr(balance.counts, name)}" for name in _PLACES))
        if balance is not None:
            lines.append(f"alarms: {'; '.join(self.run.alarms) or 'none'}")
        if self.assumed:
            lines.append(f"assumed: {'; '.join(self.assumed)}")
        return "\n".join([*lines, *self.remarks])

    def _spacing_lines(self) -> list[str]:
        indices = self.spacing
        if indices.number < 2:
            return [f"spacing set {100 * self.spacing_m:.1f} cm; too few plants for a mean"]
        return [
            f"spacing set {100 * self.spacing_m:.1f} cm, mean {100 * indices.mean_m:.1f} cm, "
            f"SD {100 * indices.sd_m:.1f} cm, CV {100 * indices.cv:.1f} %, {indices.number} spacings; "
            f"mean in the quality of feed {100 * indices.regular_mean_m:.1f} cm",
            f"indices ({MULTIPLE_BELOW:g} and {MISS_ABOVE:g} x the set spacing, after ISO 7256-1): "
            f"multiple {indices.multiple.text()}, quality {indices.quality.text()}, miss {indices.miss.text()}, "
            f"precision {100 * indices.precision:.1f} %",
        ]

    def _injury_lines(self) -> list[str]:
        count = self.extrapolated_injuries
        return [f"injury extrapolated for {count} plants, beyond the levels of the bench test"] if count else []

    def _release_lines(self) -> list[str]:
        ratios, lines = self.ratios, []
        if ratios is not None and self.scraped is not None:
            beyond = f", {self.extrapolated} falls extrapolated" if self.extrapolated else ""
            lines = [
                f"lambda at release {ratios[0]:.3f} to {ratios[1]:.3f}, scraped {self.scraped.text()}{beyond}",
                *(each.text() for each in self.releases),
            ]
        if self.window is not None:
            needed = f"{100 * self.needed_window:.1f} %" if self.needed_window is not None else "unknown"
            lines.append(f"catch window {100 * self.window:.1f} % of a cycle; 99.9 % of the arrivals need {needed}")
        return lines

    def _productivity(self) -> str:
        if math.isnan(self.plants_per_h):
            return "productivity unknown: fewer than two releases"
        text = f"productivity {self.plants_per_h:,.0f} plants/h"
        if not self.is_fed_by_arms:
            return text
        low, high = HAND_FED_PER_H
        times = sorted(self.plants_per_h / baseline for baseline in HAND_FED_PER_H)
        return f"{text}, {times[0]:.2f} to {times[1]:.2f} x the {low:,} to {high:,} plants/h fed by hand"


_PLACES = ("total", "in_tray", "in_claw", "in_cups", "P", "D", "T")


def _counts(row: PlantRow) -> dict[str, object]:
    return {
        "released": row.released,
        "single": row.single,
        "double": row.double,
        "missing": row.released - row.single - row.double,
        "in_transit": row.in_transit,
    }


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in counts.items())


def _number(value: float) -> float | None:
    """Return a number that JSON can represent; None for infinity and NaN."""
    return value if math.isfinite(value) else None
