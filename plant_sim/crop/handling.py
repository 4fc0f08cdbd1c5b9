"""Distances that determine the effect of a claw on a seedling."""

import math
from dataclasses import dataclass

from plant_sim.common.limits import require, require_within

_GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, slots=True)
class HandlingSpec:
    """Distances for gripping, pulling and throwing (the papers' term for the release over the cups).

    Attributes:
        cell_pitch_m: Distance from cell to cell of a tray, and from claw to claw when converged, m.
        grip_tolerance_m: Largest offset of the claw row from a column at which the stems are gripped, and
            largest displacement of clamped seedlings before they tear, m.
        reach_m: Largest offset from a column at which claws touch its stems, m.
        down_tolerance_m: Largest height above the lower limit at which the arm counts as down for gripping, m.
        pitch_tolerance_m: Largest deviation of the belt travel from tray pitch or cup pitch, m.
        put_back_rise_m: Rise below which clamped seedlings can be put back unharmed, m.
        extraction_rise_m: Rise at which a plug is out of its cell, m.
        stem_clearance_rise_m: Rise below which an arm collides with seedlings standing in the tray, m.
        tray_half_width_m: Half of the tray width across the machine, m.
        feed_tolerance_m: Largest distance from the feed at which the slide counts as at feed, m.
        throw_rise_m: Largest height above the lower limit at which the claws may open over the cups, m.
        drop_height_m: Distance from plug to cup with the arm down, m.
    """

    cell_pitch_m: float
    grip_tolerance_m: float
    reach_m: float
    down_tolerance_m: float
    pitch_tolerance_m: float
    put_back_rise_m: float
    extraction_rise_m: float
    stem_clearance_rise_m: float
    tray_half_width_m: float
    feed_tolerance_m: float
    throw_rise_m: float
    drop_height_m: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.01, 0.2, "cell_pitch_m")
        require_within(self, 0.0005, 0.02, "grip_tolerance_m", "down_tolerance_m", "pitch_tolerance_m")
        require_within(self, 0.001, 0.03, "put_back_rise_m", "feed_tolerance_m", "throw_rise_m")
        require_within(self, 0.01, 0.5, "extraction_rise_m", "stem_clearance_rise_m")
        require_within(self, 0.05, 0.5, "tray_half_width_m")
        require_within(self, 0.0, 1.0, "drop_height_m")
        require(
            self.grip_tolerance_m <= self.reach_m < self.cell_pitch_m / 2,
            "reach_m",
            "must be between grip_tolerance_m and half of cell_pitch_m",
        )
        require(
            self.put_back_rise_m < self.extraction_rise_m <= self.stem_clearance_rise_m,
            "extraction_rise_m",
            "must be between put_back_rise_m and stem_clearance_rise_m",
        )

    def fall_s(self, rise_m: float) -> float:
        """Return the time of free fall into a cup, s.

        Args:
            rise_m: Height of the arm above its lower limit, m.
        """
        return math.sqrt(2 * (self.drop_height_m + rise_m) / _GRAVITY_M_S2)
