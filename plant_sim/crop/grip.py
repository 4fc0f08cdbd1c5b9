"""Effect of the twelve claws of one arm on the seedlings, determined by the current positions."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from controller.common.saved import Saved
from plant_sim.crop.bed import Bed
from plant_sim.crop.handling import HandlingSpec
from plant_sim.crop.incident import Incident, Report
from plant_sim.crop.mechanics import Mechanics
from plant_sim.crop.planting_row import PlantingRow
from plant_sim.crop.pose import Pose, Reach
from plant_sim.crop.seedling import CELLS_ALONG, Location, Seedling, Seedlings


@dataclass(slots=True)
class GripHistory(Saved):
    """Loads on the gripped seedlings since the grip.

    Attributes:
        since_s: Time of the grip, s.
        x_m: Slide position at the grip, m.
        rise_m: Height of the arm at the grip, m.
        trays_m: Travel of the trays at the grip, m.
        along_m: Offset of the cells past the claws, m, measured at the first seedling.
        across_m: Inward offset of the claws from the centre of the column, m.
        peak_n: Maximum force of a finger since the grip, N.
        least_n: Minimum force during the pull, N.
    """

    SAVED: ClassVar[tuple[str, ...]] = (
        "since_s",
        "x_m",
        "rise_m",
        "trays_m",
        "along_m",
        "across_m",
        "peak_n",
        "least_n",
    )

    since_s: float = 0.0
    x_m: float = 0.0
    rise_m: float = 0.0
    trays_m: float = 0.0
    along_m: float = 0.0
    across_m: float = 0.0
    peak_n: float = 0.0
    least_n: float = math.inf


class Grip(Saved):
    """Gripped seedlings and their progress.

    Attributes:
        held: Seedlings clamped or carried; the cell number along the tray is also the claw number.
        extracted: True once the plugs of the gripped seedlings are out of their cells.
        delivered: True once the gripped seedlings have reached the feed.
        history: Loads on the gripped seedlings.
        slipped: True if closed fingers have dropped their seedlings and have not opened since.
    """

    SAVED = ("_closed", "_loosened", "_taken", "delivered", "extracted", "held", "slipped")

    __slots__ = (
        "_bed",
        "_closed",
        "_loosened",
        "_mechanics",
        "_reach",
        "_report",
        "_row",
        "_seedlings",
        "_spec",
        "_taken",
        "delivered",
        "extracted",
        "held",
        "history",
        "slipped",
    )

    def __init__(
        self,
        spec: HandlingSpec,
        mechanics: Mechanics,
        reach: Reach,
        seedlings: Seedlings,
        bed: Bed,
        *,
        row: PlantingRow,
        report: Report,
    ) -> None:
        """Initialise open claws without seedlings.

        Args:
            spec: Handling distances.
            mechanics: Effect of the claws on stems and plugs.
            reach: Reach of the arm.
            seedlings: All seedlings.
            bed: Trays under the arms.
            row: Cups of this side.
            report: Callback for incidents.
        """
        self._spec = spec
        self._mechanics = mechanics
        self._reach = reach
        self._seedlings = seedlings
        self._bed = bed
        self._row = row
        self._report = report
        self._closed = False
        self._loosened = False
        self.history = GripHistory()
        self.slipped = False
        self._taken: list[Seedling] = []
        self.held: list[Seedling] = []
        self.extracted = False
        self.delivered = False

    def save(self) -> Any:
        """Return the current state."""
        return super().save(), self.history.save()

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        own, history = saved
        super().restore(own)
        self.history.restore(history)

    def sync(self, pose: Pose) -> None:
        """Adopt an initial pose; gripped seedlings remain gripped.

        Args:
            pose: Pose of the arm.
        """
        self._closed = pose.gripping

    def step(self, pose: Pose) -> None:
        """Apply the latest motion of arm or tray to the seedlings.

        Args:
            pose: Current pose of the arm.
        """
        if self._closed and pose.free:
            self._closed = self.slipped = False
            self._open(pose)
        elif not self._closed and pose.gripping:
            self._closed = True
            self._close(pose)
        if not self.held:
            return
        if self.extracted:
            self._carry(pose)
        else:
            self._pull(pose)

    def _close(self, pose: Pose) -> None:
        """Close the claws on the seedlings between them."""
        index = self._reach.index_at(pose.x_m)
        if index is None or pose.rise_m >= self._spec.stem_clearance_rise_m:
            return
        stems = self._bed.standing(self._reach.column(index))
        if stems:
            self._taken = stems
        if stems and self._fits(pose, index):
            stems = self._within_claws(stems)
            self.held = stems
            self.extracted = self.delivered = self._loosened = False
            self.history = GripHistory(
                pose.now_s,
                pose.x_m,
                pose.rise_m,
                self._bed.trays_m,
                along_m=self._bed.ahead_m(stems[0]) if stems else 0.0,
                across_m=pose.x_m - self._reach.columns_m[index],
            )
            self._move(stems, Location.CLAMPED)
        elif stems:
            self._move(stems, Location.LOST_PICK)
            self._report_incident(Incident.STEMS_CUT, f"claws closed on {len(stems)} stems outside the grip position")

    def record_force(self, force_n: float, rise_m: float) -> None:
        """Record the finger force on the gripped seedlings, even if the arm is at rest.

        Args:
            force_n: Force of a finger, N.
            rise_m: Height of the arm above its lower limit, m.
        """
        history = self.history
        history.peak_n = max(history.peak_n, force_n)
        if rise_m > self.pulled_above_m:
            history.least_n = min(history.least_n, force_n)

    @property
    def pulled_above_m(self) -> float:
        """Height of the arm above which the gripped plugs are being pulled, m; infinite if none are in their cells."""
        if not self.held or self.extracted:
            return math.inf
        return self.history.rise_m + self._spec.put_back_rise_m  # the lift yields to its end stops by less

    def thresholds(self) -> tuple[list[float], list[float], list[float]]:
        """Return the slide positions, heights of the arm and spreader travels at which `step` has an effect, m.

        The claw openings at which they grip and release are not included.
        """
        spec, history = self._spec, self.history
        if not self.held:
            return [], [], []
        if self.extracted:
            return [self._reach.tray_edge_m, spec.feed_tolerance_m], [self.lowest_m], []
        return (
            [history.x_m - spec.grip_tolerance_m, history.x_m + spec.grip_tolerance_m],
            [history.rise_m + spec.put_back_rise_m, history.rise_m + spec.extraction_rise_m],
            [spec.pitch_tolerance_m],
        )

    def regrip(self, pose: Pose) -> None:
        """Grip the seedlings between closed fingers whose force has been restored.

        Args:
            pose: Pose of the arm.
        """
        self.slipped = False
        if self._closed:
            self._close(pose)

    def drop_all(self, pose: Pose, now_s: float) -> None:
        """Drop all seedlings because the closed fingers have lost their force.

        Args:
            pose: Pose of the arm.
            now_s: Plant time, s.
        """
        self._report_incident(Incident.DROPPED, f"{len(self.held)} seedlings slipped out of claws without air")
        pose.freed_s = now_s
        self._open(pose, slipped=True)
        self.slipped = True

    def _within_claws(self, stems: list[Seedling]) -> list[Seedling]:
        """Return the stems of a skewed tray that are within the claws; the others are cut."""
        gripped = [stem for stem in stems if abs(self._bed.off_m(stem)) <= self._spec.grip_tolerance_m]
        cut = [stem for stem in stems if stem not in gripped]
        if cut:
            self._move(cut, Location.LOST_PICK)
            self._report_incident(Incident.STEMS_CUT, f"claws closed beside {len(cut)} stems of a skewed tray")
        return gripped

    def _fits(self, pose: Pose, index: int) -> bool:
        """Return True if the stems of a column are in the grip position of the claws."""
        return (
            abs(pose.x_m - self._reach.columns_m[index]) <= self._spec.grip_tolerance_m
            and pose.rise_m <= self._spec.down_tolerance_m
            and pose.travel_m <= self._spec.pitch_tolerance_m
            and self._bed.is_placed
        )

    def _pull(self, pose: Pose) -> None:
        """Pull the plugs out of their cells; seedlings that are moved sideways before extraction are torn."""
        spec = self._spec
        history = self.history
        shift_m = max(abs(pose.x_m - history.x_m), abs(self._bed.trays_m - history.trays_m))
        risen_m = pose.rise_m - history.rise_m
        if shift_m > spec.grip_tolerance_m or pose.travel_m > spec.pitch_tolerance_m:
            self._report_incident(Incident.TORN, f"{len(self.held)} clamped seedlings were torn sideways")
            self._lose_all(Location.LOST_PICK)
        elif risen_m >= spec.extraction_rise_m:
            self.extracted = True
            self._move(self.held, Location.IN_CLAW)
            self._lose([seedling for seedling in self.held if not self._is_picked(seedling)], Location.LOST_PICK)
        elif risen_m >= spec.put_back_rise_m:
            self._loosened = True

    def _carry(self, pose: Pose) -> None:
        """Carry the plugs to the feed; they must be high enough to clear the tray."""
        spec = self._spec
        if pose.rise_m < self.lowest_m and self._is_over_tray(pose):
            text = f"{len(self.held)} plugs hit the tray"
            self._report_incident(Incident.ARM_THROUGH_TRAY, text)
            self._lose_all(Location.LOST_CARRY)
        elif not self.delivered and pose.x_m <= spec.feed_tolerance_m:
            self.delivered = True
            self._lose_broken(pose.now_s)

    @property
    def lowest_m(self) -> float:
        """Height of the arm below which carried plugs hit the tray, m."""
        return self.history.rise_m + self._spec.extraction_rise_m - self._spec.put_back_rise_m

    def _open(self, pose: Pose, *, slipped: bool = False) -> None:
        """Release all seedlings; if `slipped` is True, the drop has already been reported as a slip."""
        if self.extracted:
            self._lose_broken(pose.freed_s)
        released, self.held = self.held, []
        if self._is_over_cups(pose):
            self._note_losses(pose)
        if not released:
            return
        if not self.extracted:
            self._put_back(released, pose.freed_s)
        elif self._is_over_cups(pose):
            self._throw(released, pose)
        else:
            self._move(released, Location.LOST_THROW if self.delivered else Location.LOST_CARRY)
            if not slipped:
                self._report_incident(Incident.DROPPED, f"{len(released)} seedlings dropped beside the cups")
            if self._is_over_tray(pose):
                self._report_incident(Incident.DROP_OVER_TRAY, f"{len(released)} seedlings dropped on a tray")

    def _is_over_cups(self, pose: Pose) -> bool:
        spec = self._spec
        return (
            pose.x_m <= spec.feed_tolerance_m
            and pose.rise_m <= spec.throw_rise_m
            and pose.travel_m >= self._reach.spread_m - spec.pitch_tolerance_m
        )

    def _is_over_tray(self, pose: Pose) -> bool:
        return pose.x_m > self._reach.tray_edge_m and not self._bed.is_empty

    def _is_picked(self, seedling: Seedling) -> bool:
        """Return True if the claws hold the uncut stem of a seedling and have pulled its plug."""
        history, mechanics, traits = self.history, self._mechanics, seedling.traits
        askew_m = -self._bed.off_m(seedling) if self._reach.mirrored else self._bed.off_m(seedling)
        return not (
            mechanics.is_missed(traits, along_m=history.along_m, across_m=history.across_m + askew_m)
            or mechanics.is_cut(traits, history.peak_n)
            or mechanics.slips(traits, history.least_n)
        )

    def _lose_broken(self, now_s: float) -> None:
        """Record the gripped seedlings whose stems have broken as lost."""
        history = self.history
        held_s = now_s - history.since_s
        broken = [each for each in self.held if self._mechanics.breaks(each.traits, history.peak_n, held_s)]
        self._lose(broken, Location.LOST_CARRY)

    def _is_harmed(self, seedling: Seedling, held_s: float) -> bool:
        """Return True if the claws have cut or broken the stem of a seedling still in its cell."""
        mechanics, peak_n = self._mechanics, self.history.peak_n
        return mechanics.is_cut(seedling.traits, peak_n) or mechanics.breaks(seedling.traits, peak_n, held_s)

    def _put_back(self, released: list[Seedling], now_s: float) -> None:
        """Return seedlings to their cells; those cut, broken or loosened by the claws are lost."""
        held_s = now_s - self.history.since_s
        for seedling in released:
            harmed = self._loosened or self._is_harmed(seedling, held_s)
            self._seedlings.move(seedling, Location.LOST_PICK if harmed else Location.STANDING)

    def _throw(self, released: list[Seedling], pose: Pose) -> None:
        """Drop plugs towards the cups."""
        claw_pitch_m = self._claw_pitch_m(pose)
        fall_s = self._spec.fall_s(pose.rise_m)
        for seedling in released:
            drift_m, across_m = self._mechanics.drift_m(seedling.traits, self.history.peak_n, fall_s)
            self._row.start_fall(
                seedling,
                position_m=seedling.along * claw_pitch_m,
                lands_s=pose.freed_s + fall_s,
                drift_m=drift_m,
                across_m=pose.x_m + across_m,
            )

    def _note_losses(self, pose: Pose) -> None:
        """Report to the cups which seedlings of the row were lost before the throw."""
        for seedling in self._taken:
            if seedling.location in {Location.LOST_PICK, Location.LOST_CARRY}:
                self._row.note_loss(
                    seedling,
                    position_m=seedling.along * self._claw_pitch_m(pose),
                    lands_s=pose.freed_s + self._spec.fall_s(pose.rise_m),
                )
        self._taken = []

    def _claw_pitch_m(self, pose: Pose) -> float:
        """Return the distance from claw to claw, m."""
        return self._spec.cell_pitch_m + pose.travel_m / (CELLS_ALONG - 1)

    def _lose(self, lost: list[Seedling], location: Location) -> None:
        """Record the given gripped seedlings as lost."""
        self._move(lost, location)
        self.held = [seedling for seedling in self.held if seedling not in lost]

    def _lose_all(self, location: Location) -> None:
        self._lose(self.held, location)

    def _move(self, seedlings: list[Seedling], location: Location) -> None:
        for seedling in seedlings:
            self._seedlings.move(seedling, location)

    def _report_incident(self, incident: Incident, text: str) -> None:
        self._report(incident, f"{self._reach.side} arm: {text}")
