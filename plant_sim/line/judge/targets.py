"""Targets of a row: the criteria by which it is judged, and their bounds."""

from __future__ import annotations

import enum
import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final, NamedTuple

from plant_sim.common.units import Bounds
from plant_sim.line.file import LineFile


class RowCriterion(enum.StrEnum):
    """Criterion of a row; the value is its name in the results."""

    QUALIFIED = "qualified"
    UPRIGHT = "upright"
    TILTED = "tilted"
    LODGED = "lodged"
    SCRAPED = "scraped"
    INJURED = "injured"
    MISSED = "missed"
    DOUBLE = "double"
    HANDOVER = "handover lost"
    SPACING_MEAN = "mean spacing"
    SPACING_CV = "CV of the spacing"
    SPACING_QUALITY = "quality of feed"
    DEPTH_MEAN = "mean depth"
    DEPTH_CV = "CV of the depth"
    DEPTH_QUALIFIED = "qualified depth"

    @property
    def is_length(self) -> bool:
        """True for a length, False for a share or a ratio."""
        return self in {RowCriterion.SPACING_MEAN, RowCriterion.DEPTH_MEAN}

    def shown(self, value: float) -> str:
        """Return a value as text, without its unit: mm for a length, percent otherwise."""
        return f"{1000 * value:.1f}" if self.is_length else f"{100 * value:.1f}"

    @property
    def unit(self) -> str:
        """Unit of the texts."""
        return "mm" if self.is_length else "%"


_AT_LEAST: Final = {
    RowCriterion.QUALIFIED: "qualified",
    RowCriterion.UPRIGHT: "upright",
    RowCriterion.SPACING_QUALITY: "spacing_quality",
    RowCriterion.DEPTH_QUALIFIED: "depth_qualified",
}
_AT_MOST: Final = {
    RowCriterion.TILTED: "tilted",
    RowCriterion.LODGED: "lodged",
    RowCriterion.SCRAPED: "scraped",
    RowCriterion.INJURED: "injured",
    RowCriterion.MISSED: "missed",
    RowCriterion.DOUBLE: "double",
    RowCriterion.SPACING_CV: "spacing_cv",
    RowCriterion.DEPTH_CV: "depth_cv",
}


class RowTarget(NamedTuple):
    """Target of one criterion.

    Attributes:
        bounds: Bounds of the value.
        is_assumed: True for a default or a value marked as assumed, False for a value that the user states.
    """

    bounds: Bounds
    is_assumed: bool


@dataclass(frozen=True)
class RowTargets:
    """Targets of a row.

    Attributes:
        by_criterion: Target of each criterion, in the order of the results.
        depth_m: Bounds of the depth of a plant, within which its depth is qualified, m.
    """

    by_criterion: dict[RowCriterion, RowTarget]
    depth_m: Bounds


def row_targets(line: LineFile, assumed: Collection[str]) -> RowTargets:
    """Return the targets of a line.

    Args:
        line: The line.
        assumed: Key and value, as text, of every assumed value.
    """
    entry = line.targets
    keys = {each.partition(" ")[0] for each in assumed}

    def is_assumed(*names: str) -> bool:
        return any(name not in entry.model_fields_set or f"targets.{name}" in keys for name in names)

    targets: dict[RowCriterion, RowTarget] = {}
    for criterion, name in _AT_LEAST.items():
        targets[criterion] = RowTarget(at_least(getattr(entry, name)), is_assumed(name))
    for criterion, name in _AT_MOST.items():
        targets[criterion] = RowTarget(at_most(getattr(entry, name)), is_assumed(name))
    if line.chute is not None:
        stated = "most_lost" in line.chute.model_fields_set and "chute.most_lost" not in keys
        targets[RowCriterion.HANDOVER] = RowTarget(at_most(line.chute.most_lost), not stated)
    depth_m = within(entry.depth, entry.depth_tolerance)
    spacing_m = within(line.spacing, line.spacing * entry.spacing_deviation)
    targets[RowCriterion.DEPTH_MEAN] = RowTarget(depth_m, is_assumed("depth", "depth_tolerance"))
    targets[RowCriterion.SPACING_MEAN] = RowTarget(spacing_m, is_assumed("spacing_deviation"))
    return RowTargets({each: targets[each] for each in RowCriterion if each in targets}, depth_m)


def at_least(share: float) -> Bounds:
    """Return the bounds of a value that must not be below a share."""
    return Bounds(share, math.inf, f"at least {100 * share:g} %")


def at_most(share: float) -> Bounds:
    """Return the bounds of a value that must not be above a share."""
    return Bounds(-math.inf, share, f"at most {100 * share:g} %")


def within(middle_m: float, tolerance_m: float) -> Bounds:
    """Return the bounds of a length that may deviate from its target."""
    low_m, high_m = middle_m - tolerance_m, middle_m + tolerance_m
    return Bounds(low_m, high_m, f"{1000 * low_m:g} to {1000 * high_m:g} mm")
