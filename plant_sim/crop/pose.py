"""Where an arm is, and what it can get at from there."""

from dataclasses import dataclass

from plant_sim.crop.seedling import COLUMNS


@dataclass(slots=True)
class Pose:
    """Where an arm and its claws are.

    Attributes:
        x_m: Slide, from the feed inward, m.
        rise_m: Height above the lower limit, m.
        gripping: Claws closed enough to grip a stem.
        free: Claws open enough to touch nothing between them.
        travel_m: Belt travel of the spreader from converged, m.
        freed_s: When the claws last came to touch nothing, s.
        now_s: Time, s.
        force_n: Force of a finger, N; positive clamps.
    """

    x_m: float
    rise_m: float
    gripping: bool
    free: bool
    travel_m: float
    freed_s: float
    now_s: float = 0.0
    force_n: float = 0.0

    def take(self, x_m: float, rise_m: float, travel_m: float, *, freed_s: float, now_s: float, force_n: float) -> None:
        """Bring places, times and force up to date."""
        self.x_m = x_m
        self.rise_m = rise_m
        self.travel_m = travel_m
        self.freed_s = freed_s
        self.now_s = now_s
        self.force_n = force_n


@dataclass(frozen=True, slots=True)
class Reach:
    """What one arm can get at.

    Attributes:
        side: Name of the arm in reports.
        columns_m: Slide positions of the six columns of a tray, nearest to the feed first, m.
        tray_edge_m: Slide position above the near edge of a tray, m.
        mirrored: Whether the nearest column is the tray's last.
        spread_m: Belt travel at which the claws are spread, m.
        reach_m: Claws this far off a column touch its stems, m.
    """

    side: str
    columns_m: tuple[float, ...]
    tray_edge_m: float
    mirrored: bool
    spread_m: float
    reach_m: float

    def index_at(self, x_m: float) -> int | None:
        """Which column the claws touch, counted from the arm's own side; None between columns.

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
        """Column of the tray, 0 at the left.

        Args:
            index: The same column counted from the arm's own side.
        """
        return COLUMNS - 1 - index if self.mirrored else index
