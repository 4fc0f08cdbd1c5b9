"""Result of a line: counts, spacing, rates, productivity, lambda and all assumed values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np

from plant_sim.common.proportion import Proportion
from plant_sim.line.handover import HandoverBand
from plant_sim.line.indices import (
    MISS_ABOVE,
    MULTIPLE_BELOW,
    SpacingIndices,
    missing_by_cause,
    planting_rates,
    spacing_indices,
)
from plant_sim.line.judge.capacity import AreaCapacity
from plant_sim.line.judge.domain import WITHIN, DomainNote
from plant_sim.line.judge.verdicts import RowVerdicts
from plant_sim.line.release import ReleaseForecast
from plant_sim.line.row import PlantRow, TractorMotion
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
        verdicts: Verdicts on the rows of several passes, of which `run` is the first.
        capacity: Area capacity, and air and energy of the plants; None for fewer than two releases.
        releases: Forecasts of the release at the set spacing and at other spacings; empty without a chain planter.
        window: Catch window of the chutes in planting cycles; None without chutes.
        handover: Speeds at which the chutes lose few plugs; None without chutes.
        domain: Parts of the result that are beyond the tested range of a model.
        is_fed_by_arms: True if the arms of the machine feed the line.
        assumed: Key and value, as text, of every assumed value.
        remarks: Limits of the models that apply to this line.
    """

    title: str
    seed: int
    metres: float
    spacing_m: float
    run: LineRun
    verdicts: RowVerdicts
    capacity: AreaCapacity | None
    releases: tuple[ReleaseForecast, ...] = ()
    window: float | None = None
    handover: HandoverBand | None = None
    domain: tuple[DomainNote, ...] = ()
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
    def rates(self) -> dict[str, Proportion]:
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
        from_s, until_s = self._period_s
        return until_s - from_s

    @property
    def _period_s(self) -> tuple[float, float]:
        return float(min(row.time_s[0] for row in self.rows)), float(max(row.time_s[-1] for row in self.rows))

    @property
    def stops(self) -> tuple[int, float]:
        """Number of stops of the tractor between the first and the last release, and the time at standstill, s."""
        profile, (from_s, until_s) = self.run.profile, self._period_s
        starts_s, ends_s = np.maximum(profile.time_s[:-1], from_s), np.minimum(profile.time_s[1:], until_s)
        stands = (profile.speed_m_s[:-1] == 0.0) & (profile.speed_m_s[1:] == 0.0) & (ends_s > starts_s)
        return int(np.count_nonzero(stands)), float((ends_s - starts_s)[stands].sum())

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
    def scraped(self) -> Proportion | None:
        """Share of the plants that the guide plate has touched on the ground; None without a chain planter."""
        if self.ratios is None:
            return None
        planted = sum(int(np.count_nonzero(row.planted)) for row in self.rows)
        return Proportion(sum(int(np.count_nonzero(row.scraped)) for row in self.rows), planted)

    @property
    def extrapolated(self) -> int:
        """Number of plants whose lambda or planting frequency is outside the range of the fall table."""
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

    @property
    def handovers(self) -> dict[TractorMotion, Proportion]:
        """Share of the plugs lost at the handover, by the motion of the tractor; empty without chutes."""
        counts = [count for row in self.rows for count in row.handovers]
        return {
            motion: Proportion(
                sum(count.lost for count in counts if count.tractor is motion),
                sum(count.seedlings for count in counts if count.tractor is motion),
            )
            for motion in (TractorMotion if counts else ())
        }

    @property
    def speeds(self) -> tuple[float, float]:
        """Lowest and highest ground speed at a release, m/s."""
        speed_m_s = np.concatenate([row.speed_m_s for row in self.rows])
        return float(speed_m_s.min()), float(speed_m_s.max())

    def record(self) -> dict[str, Any]:
        """Return the result as a JSON object, without the list of plants."""
        indices, balance = self.spacing, self.run.balance
        return {
            "title": self.title,
            "seed": self.seed,
            "metres": self.metres,
            "domain": [note.record() for note in self.domain],
            "judged": self.verdicts.record(),
            "capacity": None if self.capacity is None else self.capacity.record(),
            "accounted": self.run.accounted,
            "rows": [_counts(row) for row in self.rows],
            "missing": self.missing,
            "plants": self.plants,
            "duration_s": self.duration_s,
            "stops": {"number": self.stops[0], "duration_s": self.stops[1]},
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
            "handover": None if self.handover is None else self._handover_record(self.handover),
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
            *([note.line() for note in self.domain] or [WITHIN]),
            self.verdicts.headline(),
            f"rows {len(self.rows)} x {self.metres:g} m, seed {self.seed}, {self.duration_s:.0f} s{self._stops_text()}",
            f"{what} released {released} = single {single} + double {double} + missing {released - single - double}; "
            f"in transit {transit}" + ("" if self.run.accounted else "  NOT ACCOUNTED FOR"),
            f"missing by cause: {_listed(self.missing)}",
            *self._spacing_lines(),
            "rates, 95 % binomial: " + ", ".join(f"{name} {rate.text()}" for name, rate in rates.items()),
            *self._release_lines(),
            self._productivity(),
            *([] if self.capacity is None else self.capacity.lines()),
            *self.verdicts.lines(),
        ]
        if balance is not None:
            lines.append("seedlings: " + ", ".join(f"{name} {getattr(balance.counts, name)}" for name in _PLACES))
        if balance is not None:
            lines.append(f"alarms: {'; '.join(self.run.alarms) or 'none'}")
        if self.assumed:
            lines.append(f"assumed: {'; '.join(self.assumed)}")
        return "\n".join([*lines, *self.remarks])

    def _stops_text(self) -> str:
        stops, for_s = self.stops
        return f", of which {for_s:.0f} s at {stops} stops" if stops else ""

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

    def _release_lines(self) -> list[str]:
        ratios, lines = self.ratios, []
        if ratios is not None and self.scraped is not None:
            lines = [
                f"lambda at release {ratios[0]:.3f} to {ratios[1]:.3f}, scraped {self.scraped.text()}",
                *(each.text() for each in self.releases),
            ]
        if self.window is not None:
            needed = f"{100 * self.needed_window:.1f} %" if self.needed_window is not None else "unknown"
            lines += self._handover_lines()
            lines.append(f"catch window {100 * self.window:.1f} % of a cycle; 99.9 % of the arrivals need {needed}")
        return lines

    def _handover_lines(self) -> list[str]:
        assert self.handover is not None  # noqa: S101 - a line with a catch window has chutes
        counts = ", ".join(f"{_TRACTOR[motion]} {rate.text()}" for motion, rate in self.handovers.items())
        low, high = (3.6 * speed for speed in self.speeds)
        beyond = self._beyond_band(self.handover)
        return [
            *self.handover.lines(),
            f"speed at the releases {low:.2f} to {high:.2f} km/h, {beyond.percent:.1f} % of them beyond the band",
            f"plugs lost at the handover: {counts}",
        ]

    def _beyond_band(self, band: HandoverBand) -> Proportion:
        """Return the share of the releases at a speed at which the handover does not hold."""
        speed_m_s = np.concatenate([row.speed_m_s for row in self.rows])
        holds = (speed_m_s >= band.low_m_s) & (speed_m_s <= band.high_m_s)
        return Proportion(int(np.count_nonzero(~holds)), len(speed_m_s))

    def _handover_record(self, band: HandoverBand) -> dict[str, object]:
        return band.record() | {
            "beyond_band": self._beyond_band(band).record(),
            "by_motion": {motion.name.lower(): rate.record() for motion, rate in self.handovers.items()},
        }

    def _productivity(self) -> str:
        if math.isnan(self.plants_per_h):
            return "productivity unknown: fewer than two releases"
        text = f"productivity {self.plants_per_h:,.0f} plants/h"
        if not self.is_fed_by_arms:
            return text
        low, high = HAND_FED_PER_H
        times = sorted(self.plants_per_h / baseline for baseline in HAND_FED_PER_H)
        return f"{text}, {times[0]:.2f} to {times[1]:.2f} x the {low:,} to {high:,} plants/h fed by hand"


_TRACTOR = {
    TractorMotion.STEADY: "at a constant speed",
    TractorMotion.CHANGES: "while the speed changes",
    TractorMotion.STOPS: "at a stop",
}
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
