"""Verdicts on a row: pass, fail or undecided for each criterion, by an interval between passes of the machine."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy.special import stdtrit

from plant_sim.common.proportion import Proportion
from plant_sim.common.units import Bounds
from plant_sim.line.ground import Floats
from plant_sim.line.indices import planting_rates, spacing_indices
from plant_sim.line.judge.targets import RowCriterion, RowTargets
from plant_sim.line.row import PlantRow
from plant_sim.planter.verdict import Stand

_UPPER: Final = 0.975
"""Quantile of Student's t distribution for a 95 % interval."""

Values = Mapping[RowCriterion, Proportion | float]
"""Counted shares and measured values: lengths in m, and coefficients of variation."""


class RowVerdict(enum.StrEnum):
    """Verdict on one criterion or on a row."""

    PASS = "pass"  # noqa: S105 - a verdict, not a password
    FAIL = "fail"
    UNDECIDED = "undecided"


class PassValues(NamedTuple):
    """Values of one pass of the machine, whose rows are planted together and share drive and soil.

    Attributes:
        values: Value of each criterion.
        by_geometry: Those of the depth without the clearance below the tip of the planter; empty without a chain
            planter.
    """

    values: Values
    by_geometry: Values


@dataclass(frozen=True, slots=True)
class JudgedCriterion:
    """Verdict on one criterion.

    Attributes:
        criterion: The criterion.
        value: Value of all passes.
        interval: 95 % interval; None for a single pass.
        bounds: Target.
        is_assumed: True for a target that is assumed.
        verdict: Verdict.
        remark: Reason for a verdict that does not follow from the interval; empty without one.
    """

    criterion: RowCriterion
    value: float
    interval: tuple[float, float] | None
    bounds: Bounds
    is_assumed: bool
    verdict: RowVerdict
    remark: str = ""

    def record(self) -> dict[str, object]:
        """Return the verdict as a JSON object; lengths are in m."""
        low, high = self.interval or (None, None)
        return {
            "name": self.criterion.value,
            "value": self.value,
            "low": low,
            "high": high,
            "target": self.bounds.text,
            "target_assumed": self.is_assumed,
            "verdict": self.verdict.value,
            "remark": self.remark,
        }

    def line(self) -> str:
        """Return the verdict as a line of a table."""
        shown, unit = self.criterion.shown, self.criterion.unit
        interval = "" if self.interval is None else f"({shown(self.interval[0])} to {shown(self.interval[1])})"
        origin = "assumed" if self.is_assumed else "user's target"
        remark = f"; {self.remark}" if self.remark else ""
        value = f"{shown(self.value)} {unit} {interval}"
        return f"  {self.criterion:<26}{value:<26} {self.bounds.text + ', ' + origin:<30} {self.verdict}{remark}"


@dataclass(frozen=True, slots=True)
class RowVerdicts:
    """Verdicts on the rows of several passes.

    Attributes:
        seeds: Seeds of the passes.
        criteria: Verdict on each criterion.
    """

    seeds: tuple[int, ...]
    criteria: tuple[JudgedCriterion, ...]

    @property
    def verdict(self) -> RowVerdict:
        """Fail if a criterion fails, otherwise undecided if one is undecided."""
        found = {each.verdict for each in self.criteria}
        worst = (RowVerdict.FAIL, RowVerdict.UNDECIDED, RowVerdict.PASS)
        return next(each for each in worst if each in found)

    def record(self) -> dict[str, object]:
        """Return the verdicts as a JSON object."""
        return {
            "seeds": list(self.seeds),
            "verdict": self.verdict.value,
            "criteria": [each.record() for each in self.criteria],
        }

    def headline(self) -> str:
        """Return the verdict on the row, with the criteria that it is due to, as a line of text."""
        if len(self.seeds) == 1:
            return "row judged: UNDECIDED, by one pass"
        names = {
            verdict: [
                f"{each.criterion} {each.criterion.shown(each.value)} {each.criterion.unit}"
                for each in self.criteria
                if each.verdict is verdict
            ]
            for verdict in (RowVerdict.FAIL, RowVerdict.UNDECIDED)
        }
        due = [f"{verdict}: {', '.join(each)}" for verdict, each in names.items() if each]
        return f"row judged: {'; '.join([self.verdict.upper(), *due])}"

    def lines(self) -> list[str]:
        """Return the verdicts as lines of a table with a heading."""
        number = len(self.seeds)
        if number == 1:
            heading = f"judged by one pass, seed {self.seeds[0]}: no interval; increase --repeat"
        else:
            heading = (
                f"judged by {number} passes, seeds {self.seeds[0]} to {self.seeds[-1]}, 95 % intervals between passes"
            )
        return [heading, *(each.line() for each in self.criteria)]


def pass_values(
    rows: Sequence[PlantRow], targets: RowTargets, *, spacing_m: float, clearance_m: float | None
) -> PassValues:
    """Return the values of one pass.

    Args:
        rows: Rows of plants.
        targets: Targets, which contain the bounds of a qualified depth.
        spacing_m: Set spacing, m.
        clearance_m: Mean clearance below the tip of the chain planter, m; None for a line with nozzles.
    """
    planted = sum(int(np.count_nonzero(row.planted)) for row in rows)
    indices = spacing_indices([row.plants_m for row in rows], spacing_m)
    values: dict[RowCriterion, Proportion | float] = {
        **{RowCriterion(name): rate for name, rate in planting_rates(rows).items()},
        RowCriterion.UPRIGHT: Proportion(_count(rows, Stand.UPRIGHT), planted),
        RowCriterion.TILTED: Proportion(_count(rows, Stand.TILTED), planted),
        RowCriterion.SPACING_MEAN: indices.regular_mean_m,
        RowCriterion.SPACING_CV: indices.precision,
        RowCriterion.SPACING_QUALITY: indices.quality,
    }
    handovers = [count for row in rows for count in row.handovers]
    if handovers:
        arrivals = sum(count.seedlings for count in handovers)
        values[RowCriterion.HANDOVER] = Proportion(sum(count.lost for count in handovers), arrivals)
    depths_m = np.concatenate([row.depth_m[row.planted] for row in rows])
    values |= _depth(depths_m, targets.depth_m)
    if clearance_m is None:
        return PassValues(values, {})
    values[RowCriterion.SCRAPED] = Proportion(sum(int(np.count_nonzero(row.scraped)) for row in rows), planted)
    return PassValues(values, _depth(depths_m - clearance_m, targets.depth_m))


def row_verdicts(passes: Sequence[PassValues], targets: RowTargets, seeds: Sequence[int]) -> RowVerdicts:
    """Return the verdicts on several passes.

    A share has the interval of Student's t between the passes, widened to the exact binomial interval of all plants, so
    that passes that happen to be equal do not decide. A verdict on the depth that holds only with the fitted clearance
    below the tip, or only without it, is undecided.

    Args:
        passes: Values of each pass.
        targets: Targets of the rows.
        seeds: Seeds of the passes.
    """
    judged = []
    for criterion, (bounds, is_assumed) in targets.by_criterion.items():
        observed = [each.values[criterion] for each in passes if criterion in each.values]
        value, interval = _estimate(observed)
        if math.isnan(value):
            continue
        verdict, remark = _verdict(interval, bounds), ""
        geometric = [each.by_geometry[criterion] for each in passes if criterion in each.by_geometry]
        if geometric:
            alone, alone_interval = _estimate(geometric)
            if _verdict(alone_interval, bounds) is not verdict:
                verdict = RowVerdict.UNDECIDED
            shown = "unknown" if math.isnan(alone) else f"{criterion.shown(alone)} {criterion.unit}"
            remark = f"{shown} by the geometry of the planter alone"
        judged.append(JudgedCriterion(criterion, value, interval, bounds, is_assumed, verdict, remark))
    return RowVerdicts(tuple(seeds), tuple(judged))


def _verdict(interval: tuple[float, float] | None, bounds: Bounds) -> RowVerdict:
    if interval is None:
        return RowVerdict.UNDECIDED
    low, high = interval
    if bounds.low <= low and high <= bounds.high:
        return RowVerdict.PASS
    return RowVerdict.FAIL if high < bounds.low or low > bounds.high else RowVerdict.UNDECIDED


def _estimate(observed: Sequence[Proportion | float]) -> tuple[float, tuple[float, float] | None]:
    """Return the value of several passes and its 95 % interval, None for a single pass; NaN without observations."""
    rates = [each for each in observed if isinstance(each, Proportion)]
    numbers = [each.percent / 100 if isinstance(each, Proportion) else each for each in observed]
    numbers = [each for each in numbers if not math.isnan(each)]
    if not numbers:
        return math.nan, None
    pooled = Proportion(sum(each.hits for each in rates), sum(each.draws for each in rates))
    value = pooled.percent / 100 if rates else float(np.mean(numbers))
    number = len(numbers)
    if number == 1:
        return value, None
    half = float(stdtrit(number - 1, _UPPER)) * float(np.std(numbers, ddof=1)) / math.sqrt(number)
    low, high = value - half, value + half
    if rates:
        exact_low, exact_high = (each / 100 for each in pooled.interval_percent)
        low, high = max(min(low, exact_low), 0.0), min(max(high, exact_high), 1.0)
    return value, (low, high)


def _count(rows: Sequence[PlantRow], stand: Stand) -> int:
    return sum(int(np.count_nonzero(row.stand == stand)) for row in rows)


def _depth(depths_m: Floats, bounds_m: Bounds) -> dict[RowCriterion, Proportion | float]:
    """Return mean, coefficient of variation and qualified rate of depths."""
    number = len(depths_m)
    mean_m = float(depths_m.mean()) if number else math.nan
    sd_m = float(depths_m.std(ddof=1)) if number > 1 else math.nan
    qualified = int(np.count_nonzero((depths_m >= bounds_m.low) & (depths_m <= bounds_m.high)))
    return {
        RowCriterion.DEPTH_MEAN: mean_m,
        RowCriterion.DEPTH_CV: sd_m / mean_m if mean_m > 0.0 else math.nan,
        RowCriterion.DEPTH_QUALIFIED: Proportion(qualified, number),
    }
