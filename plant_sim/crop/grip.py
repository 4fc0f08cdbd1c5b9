"""What the twelve claws of one arm do to seedlings, decided by where things are at that moment."""

from plant_sim.crop.bed import Bed
from plant_sim.crop.handling import HandlingSpec
from plant_sim.crop.incident import Incident, Report
from plant_sim.crop.planting_row import PlantingRow
from plant_sim.crop.pose import Pose, Reach
from plant_sim.crop.response import Fate
from plant_sim.crop.seedling import CELLS_ALONG, Place, Seedling, Seedlings


class Grip:
    """State: what is held, and how far it has come.

    Attributes:
        held: Seedlings clamped or carried; a seedling's cell along the tray is its claw.
        extracted: Whether the plugs of what is held are out of their cells.
        delivered: Whether what is held has come to the feed.
    """

    __slots__ = (
        "_bed",
        "_clamp_rise_m",
        "_clamp_trays_m",
        "_clamp_x_m",
        "_closed",
        "_loosened",
        "_reach",
        "_report",
        "_row",
        "_seedlings",
        "_spec",
        "delivered",
        "extracted",
        "held",
    )

    def __init__(
        self,
        spec: HandlingSpec,
        reach: Reach,
        seedlings: Seedlings,
        bed: Bed,
        *,
        row: PlantingRow,
        report: Report,
    ) -> None:
        """Start open and empty.

        Args:
            spec: Distances.
            reach: What the arm can get at.
            seedlings: All of them.
            bed: What lies under the arms.
            row: The cups of this side.
            report: Takes note of incidents.
        """
        self._spec = spec
        self._reach = reach
        self._seedlings = seedlings
        self._bed = bed
        self._row = row
        self._report = report
        self._closed = False
        self._loosened = False
        self._clamp_x_m = self._clamp_rise_m = self._clamp_trays_m = 0.0
        self.held: list[Seedling] = []
        self.extracted = False
        self.delivered = False

    def sync(self, pose: Pose) -> None:
        """Take up a starting situation; what is held stays held.

        Args:
            pose: Where the arm is.
        """
        self._closed = pose.gripping

    def step(self, pose: Pose) -> None:
        """Decide what the last movement of arm or tray did to the seedlings.

        Args:
            pose: Where the arm is now.
        """
        if self._closed and pose.free:
            self._closed = False
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
        """Close on whatever stands between the claws."""
        index = self._reach.index_at(pose.x_m)
        if index is None or pose.rise_m >= self._spec.stem_clearance_rise_m:
            return
        stems = self._bed.standing(self._reach.column(index))
        if stems and self._fits(pose, index):
            stems = self._between_the_fingers(stems)
            self.held = stems
            self.extracted = self.delivered = self._loosened = False
            self._clamp_x_m, self._clamp_rise_m = pose.x_m, pose.rise_m
            self._clamp_trays_m = self._bed.trays_m
            self._move(stems, Place.CLAMPED)
        elif stems:
            self._move(stems, Place.LOST_PICK)
            self._note(Incident.STEMS_CUT, f"claws closed wrongly on {len(stems)} stems")

    def let_slip(self, pose: Pose, now_s: float) -> None:
        """Let go of everything because the closed fingers have lost their force.

        Args:
            pose: Where the arm is.
            now_s: Time, s.
        """
        self._note(Incident.DROPPED, f"{len(self.held)} seedlings slipped out of claws without air")
        pose.freed_s = now_s
        self._open(pose, slipped=True)

    def _between_the_fingers(self, stems: list[Seedling]) -> list[Seedling]:
        """Those of the stems that stand where the claws grip, the tray being askew; the others are cut."""
        gripped = [stem for stem in stems if abs(self._bed.off_m(stem)) <= self._spec.grip_tolerance_m]
        cut = [stem for stem in stems if stem not in gripped]
        if cut:
            self._move(cut, Place.LOST_PICK)
            self._note(Incident.STEMS_CUT, f"claws closed beside {len(cut)} stems of a tray that lies askew")
        return gripped

    def _fits(self, pose: Pose, index: int) -> bool:
        """Whether the stems of a column stand where the claws grip."""
        return (
            abs(pose.x_m - self._reach.columns_m[index]) <= self._spec.grip_tolerance_m
            and pose.rise_m <= self._spec.down_tolerance_m
            and pose.travel_m <= self._spec.pitch_tolerance_m
            and self._bed.is_placed
        )

    def _pull(self, pose: Pose) -> None:
        """Pull the plugs out of their cells, or tear what is moved sideways before that."""
        spec = self._spec
        shift_m = max(abs(pose.x_m - self._clamp_x_m), abs(self._bed.trays_m - self._clamp_trays_m))
        risen_m = pose.rise_m - self._clamp_rise_m
        if shift_m > spec.grip_tolerance_m or pose.travel_m > spec.pitch_tolerance_m:
            self._note(Incident.TORN, f"{len(self.held)} clamped seedlings were torn sideways")
            self._lose_all(Place.LOST_PICK)
        elif risen_m >= spec.extraction_rise_m:
            self.extracted = True
            self._move(self.held, Place.IN_CLAW)
            self._lose(Fate.FAILS_PICK, Place.LOST_PICK)
        elif risen_m >= spec.put_back_rise_m:
            self._loosened = True

    def _carry(self, pose: Pose) -> None:
        """Carry the plugs, over the tray not too low, to the feed."""
        spec = self._spec
        lowest_m = self._clamp_rise_m + spec.extraction_rise_m - spec.put_back_rise_m
        if pose.rise_m < lowest_m and self._is_over_tray(pose):
            text = f"{len(self.held)} plugs were driven against the tray"
            self._note(Incident.ARM_THROUGH_TRAY, text)
            self._lose_all(Place.LOST_CARRY)
        elif not self.delivered and pose.x_m <= spec.feed_tolerance_m:
            self.delivered = True
            self._lose(Fate.FAILS_CARRY, Place.LOST_CARRY)

    def _open(self, pose: Pose, *, slipped: bool = False) -> None:
        """Let go of everything; what has slipped has been told already."""
        released, self.held = self.held, []
        if not released:
            return
        if not self.extracted:
            self._move(released, Place.LOST_PICK if self._loosened else Place.STANDING)
        elif self._is_over_cups(pose):
            claw_pitch_m = self._spec.cell_pitch_m + pose.travel_m / (CELLS_ALONG - 1)
            lands_s = pose.freed_s + self._spec.fall_s(pose.rise_m)
            for seedling in released:
                position_m = seedling.along * claw_pitch_m
                self._row.let_fall(seedling, position_m=position_m, lands_s=lands_s)
        else:
            self._move(released, Place.LOST_THROW if self.delivered else Place.LOST_CARRY)
            if not slipped:
                self._note(Incident.DROPPED, f"{len(released)} seedlings dropped beside the cups")
            if self._is_over_tray(pose):
                self._note(Incident.DROP_OVER_TRAY, f"{len(released)} seedlings dropped on a tray")

    def _is_over_cups(self, pose: Pose) -> bool:
        spec = self._spec
        return (
            pose.x_m <= spec.feed_tolerance_m
            and pose.rise_m <= spec.throw_rise_m
            and pose.travel_m >= self._reach.spread_m - spec.pitch_tolerance_m
        )

    def _is_over_tray(self, pose: Pose) -> bool:
        return pose.x_m > self._reach.tray_edge_m and not self._bed.is_empty

    def _lose(self, fate: Fate, place: Place) -> None:
        """Lose those of the held seedlings that fail by themselves at this stage."""
        self._move([seedling for seedling in self.held if seedling.fate is fate], place)
        self.held = [seedling for seedling in self.held if seedling.fate is not fate]

    def _lose_all(self, place: Place) -> None:
        self._move(self.held, place)
        self.held = []

    def _move(self, seedlings: list[Seedling], place: Place) -> None:
        for seedling in seedlings:
            self._seedlings.move(seedling, place)

    def _note(self, incident: Incident, text: str) -> None:
        self._report(incident, f"{self._reach.side} arm: {text}")
