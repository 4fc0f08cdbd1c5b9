"""Pose and reach of an arm."""

from dataclasses import dataclass
from typing import ClassVar

from controller.common.saved import Saved
from plant_sim.crop.seedling import COLUMNS


@dataclass(slots=True)
class Pose(Saved):
    """Position of an arm and its claws.

    Attributes:
        x_m: Slide position from the feed inward, m.
        rise_m: Height above the lower limit, m.
        gripping: True if the claws are closed enough to grip a stem.
        free: True if the claws are open enough not to touch a stem.
        travel_m: Belt travel of the spreader from the converged position, m.
        freed_s: Time at which the claws last became free, s.
        now_s: Plant time, s.
    """

    SAVED: ClassVar[tuple[str, ...]] = ("x_m", "rise_m", "gripping", "free", "travel_m", "freed_s", "now_s")

    x_m: float
    rise_m: float
    gripping: bool
    free: bool
    travel_m: float
    freed_s: float
    now_s: float = 0.0

    def update(self, x_m: float, rise_m: float, travel_m: float, *, freed_s: float, now_s: float) -> None:
        """Update positions and times."""
        self.x_m = x_m
        self.rise_m = rise_m
        self.travel_m = travel_m
        self.freed_s = freed_s
        self.now_s = now_s


@dataclass(frozen=True, slots=True)
class Reach:
    """Reach of one arm.

    Attributes:
        side: Name of the arm in reports.
        columns_m: Slide positions of the six columns of a tray, nearest to the feed first, m.
        tray_edge_m: Slide position at which the arm is above the near edge of a tray, m.
        mirrored: True if the nearest column is the last of the tray.
        spread_m: Belt travel at which the claws are spread, m.
        reach_m: Largest offset from a column at which claws touch its stems, m.
    """

    side: str
    columns_m: tuple[float, ...]
    tray_edge_m: float
    mirrored: bool
    spread_m: float
    reach_m: float

    def index_at(self, x_m: float) -> int | None:
        """Return the column touched by the claws, counted from the side of the arm; None between columns.

        Args:
            x_m: Slide position, m.
        """
        if x_m < self.columns_m[0] - self.reach_m:
            return None
        for index, column_m in enumerate(self.columns_m):
            if abs(x_m - column_m) <= self.reach_m:
                return index
        return None

    def column(self, index: int) -> int:
        """Return the column of the tray, 0 at the left.

        Args:
            index: Column counted from the side of the arm.
        """
        return COLUMNS - 1 - index if self.mirrored else index
