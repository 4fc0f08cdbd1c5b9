"""Collisions of a lowered arm with the seedlings in a tray."""

from controller.common.saved import Saved
from plant_sim.crop.bed import Bed
from plant_sim.crop.handling import HandlingSpec
from plant_sim.crop.incident import Incident, Report
from plant_sim.crop.pose import Pose, Reach
from plant_sim.crop.seedling import Location, Seedling, Seedlings


class Sweep(Saved):
    """Columns passed by the claw row, and the direction of approach.

    Open, converged claws approach a column from its outer side until they straddle its stems, and retract the
    same way. Passing through a standing column is a collision; hence the pick order 1, 2, 3.
    Closed or spread claws damage the stems that they touch.

    Attributes:
        low: True if the arm is low enough to touch seedlings standing in a tray.
    """

    SAVED = ("_gentle", "_gentle_x_m", "_in_contact", "_passed", "_tray_has_moved", "_trays_m", "low")

    __slots__ = (
        "_bed",
        "_edges_m",
        "_gentle",
        "_gentle_x_m",
        "_in_contact",
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
        """Initialise with the arm away from the tray; `sync` sets another position.

        Args:
            spec: Handling distances.
            reach: Reach of the arm.
            seedlings: All seedlings.
            bed: Trays under the arms.
            report: Callback for incidents.
        """
        self._spec = spec
        self._reach = reach
        self._seedlings = seedlings
        self._bed = bed
        self._report = report
        sides_m = (column_m + side * reach.reach_m for column_m in reach.columns_m for side in (-1, 1))
        self._edges_m = (*sides_m, reach.tray_edge_m)  # slide positions at which the claws reach or leave something
        self._passed = 0  # number of columns outward of the claw row
        self._gentle_x_m = 0.0  # last position with open, converged claws
        self._gentle = self._in_contact = False
        self._trays_m = 0.0  # travel of the trays when the arm reached the tray
        self._tray_has_moved = False
        self.low = False

    def sync(self, pose: Pose) -> None:
        """Adopt a pose without evaluating the motion that led to it.

        Args:
            pose: Pose of the arm.
        """
        self.low = pose.rise_m < self._spec.stem_clearance_rise_m
        self._passed = sum(pose.x_m > inward_m for inward_m in self._far_sides_m())
        self._gentle_x_m = pose.x_m
        self._gentle = pose.free and pose.travel_m <= self._spec.pitch_tolerance_m
        self._trays_m = self._bed.trays_m

    def step(self, pose: Pose) -> None:
        """Detect collisions caused by the latest motion of arm or tray.

        Args:
            pose: Current pose of the arm.
        """
        was_low = self.low
        self.low = pose.rise_m < self._spec.stem_clearance_rise_m
        converged = pose.travel_m <= self._spec.pitch_tolerance_m
        gentle = self._gentle = pose.free and converged
        self._pass_columns(pose.x_m, gentle)
        index = self._reach.index_at(pose.x_m) if self.low else None
        self._in_contact = False
        if index is not None:
            came = abs(pose.x_m - self._gentle_x_m) > self._spec.grip_tolerance_m
            if not converged or (not gentle and (came or not was_low)):
                self._in_contact = True
                self._run_into(index, "swept through", damage=True)
            elif not was_low:
                self._run_into(index, "moved down onto", damage=False)
        self._check_tray_motion(pose, index)
        if gentle:
            self._gentle_x_m = pose.x_m

    def thresholds(self) -> tuple[list[float], list[float], list[float]]:
        """Return the slide positions, heights of the arm and spreader travels at which `step` has an effect, m.

        The claw opening at which the claws are free of the stems is not included.
        """
        spec = self._spec
        gentle_m = [self._gentle_x_m - spec.grip_tolerance_m, self._gentle_x_m + spec.grip_tolerance_m]
        return (
            [*self._edges_m, *([] if self._gentle else gentle_m)],
            [spec.stem_clearance_rise_m],
            [spec.pitch_tolerance_m],
        )

    @property
    def is_in_contact(self) -> bool:
        """True while the arm touches a column that it damages as soon as a seedling stands in it."""
        return self._in_contact

    def follow_gently(self, x_m: float) -> None:
        """Adopt a slide position that the arm has reached without any effect since the last step.

        Args:
            x_m: Slide position, m.
        """
        if self._gentle:
            self._gentle_x_m = x_m

    def pass_trays(self) -> None:
        """Adopt a motion of the trays while the arm is not lowered into one."""
        self._trays_m = self._bed.trays_m
        self._tray_has_moved = False

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

    def _check_tray_motion(self, pose: Pose, index: int | None) -> None:
        """Detect a tray that moves while the arm is lowered into it."""
        in_tray = self.low and pose.x_m > self._reach.tray_edge_m
        if not in_tray or self._bed.is_empty:
            self.pass_trays()
            return
        moved_m = abs(self._bed.trays_m - self._trays_m)
        if self._tray_has_moved or moved_m <= self._spec.grip_tolerance_m:
            return
        self._tray_has_moved = True
        stems = [] if index is None else self._bed.standing(self._reach.column(index))
        self._collide(f"the tray moved while the {self._reach.side} arm was lowered into it", stems)

    def _run_into(self, index: int, how: str, *, damage: bool) -> None:
        stems = self._bed.standing(self._reach.column(index))
        if stems:
            text = (
                f"the lowered {self._reach.side} arm {how} column {index + 1} from its side, "
                f"with {len(stems)} standing seedlings"
            )
            self._collide(text, stems, damage=damage)

    def _collide(self, text: str, stems: list[Seedling], *, damage: bool = True) -> None:
        self._report(Incident.ARM_THROUGH_TRAY, text)
        for seedling in stems:
            if damage:
                self._seedlings.move(seedling, Location.LOST_PICK)
            else:
                self._seedlings.plough(seedling)
