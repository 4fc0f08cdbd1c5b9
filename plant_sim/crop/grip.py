"""What the twelve claws of one arm do to seedlings, decided by where things are at that moment."""

from dataclasses import dataclass

from plant_sim.crop.bed import Bed
from plant_sim.crop.handling import HandlingSpec
from plant_sim.crop.incident import Incident, Report
from plant_sim.crop.mechanics import Mechanics
from plant_sim.crop.planting_row import PlantingRow
from plant_sim.crop.pose import Pose, Reach
from plant_sim.crop.seedling import CELLS_ALONG, Place, Seedling, Seedlings


@dataclass(slots=True)
class Felt:
    """What the seedlings gripped last have felt of the machine.

    Attributes:
        since_s: When they were gripped, s.
        x_m: Where the slide stood then, m.
        rise_m: How high the arm was, m.
        trays_m: How far the trays had gone, m.
        along_m: How far their cells were past the claws, m; that of the first of them.
        across_m: How far the claws were inward of the middle of the column, m.
        peak_n: Greatest force of a finger since then, N.
        least_n: Least force while they were pulled, N.
    """

    since_s: float = 0.0
    x_m: float = 0.0
    rise_m: float = 0.0
    trays_m: float = 0.0
    along_m: float = 0.0
    across_m: float = 0.0
    peak_n: float = 0.0
    least_n: float = float("inf")


class Grip:
    """State: what is held, and how far it has come.

    Attributes:
        held: Seedlings clamped or carried; a seedling's cell along the tray is its claw.
        extracted: Whether the plugs of what is held are out of their cells.
        delivered: Whether what is held has come to the feed.
        felt: What it has felt so far.
        slipped: Whether closed fingers have lost what they held, and not opened since.
    """

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
        "delivered",
        "extracted",
        "felt",
        "held",
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
        """Start open and empty.

        Args:
            spec: Distances.
            mechanics: What claws do to stems and plugs.
            reach: What the arm can get at.
            seedlings: All of them.
            bed: What lies under the arms.
            row: The cups of this side.
            report: Takes note of incidents.
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
        self.felt = Felt()
        self.slipped = False
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
        """Close on whatever stands between the claws."""
        index = self._reach.index_at(pose.x_m)
        if index is None or pose.rise_m >= self._spec.stem_clearance_rise_m:
            return
        stems = self._bed.standing(self._reach.column(index))
        if stems and self._fits(pose, index):
            stems = self._between_the_fingers(stems)
            self.held = stems
            self.extracted = self.delivered = self._loosened = False
            self.felt = Felt(
                pose.now_s, pose.x_m, pose.rise_m, self._bed.trays_m,
                along_m=self._bed.ahead_m(stems[0]) if stems else 0.0,
                across_m=pose.x_m - self._reach.columns_m[index],
            )  # fmt: skip
            self._move(stems, Place.CLAMPED)
        elif stems:
            self._move(stems, Place.LOST_PICK)
            self._note(Incident.STEMS_CUT, f"claws closed wrongly on {len(stems)} stems")

    def feel(self, force_n: float) -> None:
        """Let what is held feel the fingers, also while nothing moves.

        Args:
            force_n: Force of a finger, N.
        """
        self.felt.peak_n = max(self.felt.peak_n, force_n)

    def grip_again(self, pose: Pose) -> None:
        """Close on what stands between fingers that had lost their force and have it again.

        Args:
            pose: Where the arm is.
        """
        self.slipped = False
        if self._closed:
            self._close(pose)

    def let_slip(self, pose: Pose, now_s: float) -> None:
        """Let go of everything because the closed fingers have lost their force.

        Args:
            pose: Where the arm is.
            now_s: Time, s.
        """
        self._note(Incident.DROPPED, f"{len(self.held)} seedlings slipped out of claws without air")
        pose.freed_s = now_s
        self._open(pose, slipped=True)
        self.slipped = True

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
        felt = self.felt
        shift_m = max(abs(pose.x_m - felt.x_m), abs(self._bed.trays_m - felt.trays_m))
        risen_m = pose.rise_m - felt.rise_m
        if risen_m > 0.0:
            felt.least_n = min(felt.least_n, pose.force_n)
        if shift_m > spec.grip_tolerance_m or pose.travel_m > spec.pitch_tolerance_m:
            self._note(Incident.TORN, f"{len(self.held)} clamped seedlings were torn sideways")
            self._lose_all(Place.LOST_PICK)
        elif risen_m >= spec.extraction_rise_m:
            self.extracted = True
            self._move(self.held, Place.IN_CLAW)
            self._lose([seedling for seedling in self.held if not self._is_picked(seedling)], Place.LOST_PICK)
        elif risen_m >= spec.put_back_rise_m:
            self._loosened = True

    def _carry(self, pose: Pose) -> None:
        """Carry the plugs, over the tray not too low, to the feed."""
        spec = self._spec
        lowest_m = self.felt.rise_m + spec.extraction_rise_m - spec.put_back_rise_m
        if pose.rise_m < lowest_m and self._is_over_tray(pose):
            text = f"{len(self.held)} plugs were driven against the tray"
            self._note(Incident.ARM_THROUGH_TRAY, text)
            self._lose_all(Place.LOST_CARRY)
        elif not self.delivered and pose.x_m <= spec.feed_tolerance_m:
            self.delivered = True
            self._lose_broken(pose.now_s)

    def _open(self, pose: Pose, *, slipped: bool = False) -> None:
        """Let go of everything; what has slipped has been told already."""
        if self.extracted:
            self._lose_broken(pose.freed_s)
        released, self.held = self.held, []
        if not released:
            return
        if not self.extracted:
            self._put_back(released, pose.freed_s)
        elif self._is_over_cups(pose):
            self._throw(released, pose)
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

    def _is_picked(self, seedling: Seedling) -> bool:
        """Whether the claws hold a seedling's stem, whole, and have pulled its plug."""
        felt, mechanics, traits = self.felt, self._mechanics, seedling.traits
        askew_m = -self._bed.off_m(seedling) if self._reach.mirrored else self._bed.off_m(seedling)
        return not (
            mechanics.is_missed(traits, along_m=felt.along_m, across_m=felt.across_m + askew_m)
            or mechanics.is_cut(traits, felt.peak_n)
            or mechanics.slips(traits, felt.least_n)
        )

    def _lose_broken(self, now_s: float) -> None:
        """Lose those of the held seedlings whose stem has not borne being held so long."""
        felt = self.felt
        held_s = now_s - felt.since_s
        broken = [each for each in self.held if self._mechanics.breaks(each.traits, felt.peak_n, held_s)]
        self._lose(broken, Place.LOST_CARRY)

    def _is_harmed(self, seedling: Seedling, held_s: float) -> bool:
        """Whether the claws have cut or broken the stem of a seedling that has not left its cell."""
        mechanics, peak_n = self._mechanics, self.felt.peak_n
        return mechanics.is_cut(seedling.traits, peak_n) or mechanics.breaks(seedling.traits, peak_n, held_s)

    def _put_back(self, released: list[Seedling], now_s: float) -> None:
        """Leave seedlings in the cells they have not left; what the claws have cut, broken or loosened is lost."""
        held_s = now_s - self.felt.since_s
        for seedling in released:
            harmed = self._loosened or self._is_harmed(seedling, held_s)
            self._seedlings.move(seedling, Place.LOST_PICK if harmed else Place.STANDING)

    def _throw(self, released: list[Seedling], pose: Pose) -> None:
        """Let plugs fall to the cups."""
        claw_pitch_m = self._spec.cell_pitch_m + pose.travel_m / (CELLS_ALONG - 1)
        fall_s = self._spec.fall_s(pose.rise_m)
        for seedling in released:
            drift_m, across_m = self._mechanics.drift_m(seedling.traits, self.felt.peak_n, fall_s)
            self._row.let_fall(
                seedling,
                position_m=seedling.along * claw_pitch_m,
                lands_s=pose.freed_s + fall_s,
                drift_m=drift_m,
                across_m=pose.x_m + across_m,
            )

    def _lose(self, lost: list[Seedling], place: Place) -> None:
        """Lose some of the held seedlings."""
        self._move(lost, place)
        self.held = [seedling for seedling in self.held if seedling not in lost]

    def _lose_all(self, place: Place) -> None:
        self._lose(self.held, place)

    def _move(self, seedlings: list[Seedling], place: Place) -> None:
        for seedling in seedlings:
            self._seedlings.move(seedling, place)

    def _note(self, incident: Incident, text: str) -> None:
        self._report(incident, f"{self._reach.side} arm: {text}")
