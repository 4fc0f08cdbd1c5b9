"""What an arm runs into when it moves low over a tray."""

from plant_sim.crop.bed import Bed
from plant_sim.crop.handling import HandlingSpec
from plant_sim.crop.incident import Incident, Report
from plant_sim.crop.pose import Pose, Reach
from plant_sim.crop.seedling import Place, Seedling, Seedlings


class Sweep:
    """State: which columns the claw row has passed, and from where it came.

    Open, converged claws straddle the stems of a column from its outer side, and draw back the
    same way. Going through a column that still stands is a collision; hence the order 1, 2, 3.
    Claws that are closed or spread damage what they touch.

    Attributes:
        low: Whether the arm is low enough to meet what stands in a tray.
    """

    __slots__ = (
        "_bed",
        "_gentle_x_m",
        "_passed",
        "_reach",
        "_report",
        "_seedlings",
        "_spec",
        "_tray_has_moved",
        "_trays_m",
        "low",
    )

    def __init__(self, spec: HandlingSpec, reach: Reach, seedlings: Seedlings, bed: Bed, report: Report) -> None:
        """Start away from the tray; `sync` puts it elsewhere.

        Args:
            spec: Distances.
            reach: What the arm can get at.
            seedlings: All of them.
            bed: What lies under the arms.
            report: Takes note of incidents.
        """
        self._spec = spec
        self._reach = reach
        self._seedlings = seedlings
        self._bed = bed
        self._report = report
        self._passed = 0  # columns the claw row is inward of
        self._gentle_x_m = 0.0  # where the claws last were open and converged
        self._trays_m = 0.0  # where the trays were when the arm came to the tray
        self._tray_has_moved = False
        self.low = False

    def sync(self, pose: Pose) -> None:
        """Take up a starting situation without asking how the arm came there.

        Args:
            pose: Where it is.
        """
        self.low = pose.rise_m < self._spec.stem_clearance_rise_m
        self._passed = sum(pose.x_m > inward_m for inward_m in self._far_sides_m())
        self._gentle_x_m = pose.x_m
        self._trays_m = self._bed.trays_m

    def step(self, pose: Pose) -> None:
        """See what the last movement of arm or tray ran into.

        Args:
            pose: Where the arm is now.
        """
        was_low = self.low
        self.low = pose.rise_m < self._spec.stem_clearance_rise_m
        converged = pose.travel_m <= self._spec.pitch_tolerance_m
        gentle = pose.free and converged
        self._pass_columns(pose.x_m, gentle)
        index = self._reach.index_at(pose.x_m) if self.low else None
        if index is not None:
            came = abs(pose.x_m - self._gentle_x_m) > self._spec.grip_tolerance_m
            if not converged or (not gentle and (came or not was_low)):
                self._run_into(index, "swept through", damage=True)
            elif not was_low:
                self._run_into(index, "came down on", damage=False)
        self._watch_tray(pose, index)
        if gentle:
            self._gentle_x_m = pose.x_m

    def _far_sides_m(self) -> list[float]:
        return [column_m + self._reach.reach_m for column_m in self._reach.columns_m]

    def _pass_columns(self, x_m: float, gentle: bool) -> None:
        columns_m, reach_m = self._reach.columns_m, self._reach.reach_m
        passed = self._passed
        while passed < len(columns_m) and x_m > columns_m[passed] + reach_m:
            if self.low:
                self._run_into(passed, "went through", damage=not gentle)
            passed += 1
        while passed > 0 and x_m < columns_m[passed - 1] - reach_m:
            passed -= 1
            if self.low:
                self._run_into(passed, "went through", damage=not gentle)
        self._passed = passed

    def _watch_tray(self, pose: Pose, index: int | None) -> None:
        """Notice a tray that moves while the arm is low in it."""
        in_tray = self.low and pose.x_m > self._reach.tray_edge_m
        if not in_tray or self._bed.is_empty:
            self._trays_m = self._bed.trays_m
            self._tray_has_moved = False
            return
        moved_m = abs(self._bed.trays_m - self._trays_m)
        if self._tray_has_moved or moved_m <= self._spec.grip_tolerance_m:
            return
        self._tray_has_moved = True
        stems = [] if index is None else self._bed.standing(self._reach.column(index))
        self._collide(f"the tray moved while the {self._reach.side} arm was low in it", stems)

    def _run_into(self, index: int, how: str, *, damage: bool) -> None:
        stems = self._bed.standing(self._reach.column(index))
        if stems:
            text = (
                f"the low {self._reach.side} arm {how} column {index + 1} from its side, "
                f"{len(stems)} seedlings standing"
            )
            self._collide(text, stems if damage else [])

    def _collide(self, text: str, damaged: list[Seedling]) -> None:
        self._report(Incident.ARM_THROUGH_TRAY, text)
        for seedling in damaged:
            self._seedlings.move(seedling, Place.LOST_PICK)
