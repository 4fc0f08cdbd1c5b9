"""Distances that decide what a claw does to a seedling."""

import math
from dataclasses import dataclass

from plant_sim.spec import require, require_within

_GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, slots=True)
class HandlingSpec:
    """Geometry of gripping, pulling and throwing.

    Attributes:
        cell_pitch_m: From cell to cell of a tray, and from claw to claw when converged, m.
        grip_tolerance_m: A claw row this far off a column still grips its stems, m; clamped
            seedlings can be moved as much before they tear.
        reach_m: Claws this far off a column touch its stems, m.
        down_tolerance_m: The arm counts as down this high above its lower limit when gripping, m.
        pitch_tolerance_m: Belt travel by which the claws may be off either pitch, m.
        put_back_rise_m: Clamped seedlings raised by less than this can be put back unharmed, m.
        extraction_rise_m: Raised by this much the plug is out of its cell, m.
        stem_clearance_rise_m: An arm raised by less than this meets what stands in the tray, m.
        tray_half_width_m: Half of a tray across the machine, m.
        feed_tolerance_m: The slide counts as at feed this far from it, m.
        throw_rise_m: Claws open over the cups at most this high above the lower limit, m.
        drop_height_m: From the plug to the cup when the arm is down, m.
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
        """Refuse impossible values."""
        require_within(self, 0.01, 0.2, "cell_pitch_m")
        require_within(self, 0.0005, 0.02, "grip_tolerance_m", "down_tolerance_m", "pitch_tolerance_m")
        require_within(self, 0.001, 0.03, "put_back_rise_m", "feed_tolerance_m", "throw_rise_m")
        require_within(self, 0.01, 0.5, "extraction_rise_m", "stem_clearance_rise_m")
        require_within(self, 0.05, 0.5, "tray_half_width_m")
        require_within(self, 0.0, 1.0, "drop_height_m")
        require(
            self.grip_tolerance_m <= self.reach_m < self.cell_pitch_m / 2,
            "reach_m",
            "must lie between grip_tolerance_m and half of cell_pitch_m",
        )
        require(
            self.put_back_rise_m < self.extraction_rise_m <= self.stem_clearance_rise_m,
            "extraction_rise_m",
            "must lie between put_back_rise_m and stem_clearance_rise_m",
        )

    def fall_s(self, rise_m: float) -> float:
        """Time of free fall into a cup, s.

        Args:
            rise_m: Height of the arm above its lower limit, m.
        """
        return math.sqrt(2 * (self.drop_height_m + rise_m) / _GRAVITY_M_S2)
