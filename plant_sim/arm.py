"""One arm with everything that belongs to its side: drives, claws, cups and what they hold."""

from collections.abc import Sequence

from plant_sim.crop.bed import Bed
from plant_sim.crop.grip import Grip
from plant_sim.crop.incident import Report
from plant_sim.crop.planting_row import PlantingRow
from plant_sim.crop.pose import Pose, Reach
from plant_sim.crop.seedling import Seedlings
from plant_sim.crop.sweep import Sweep
from plant_sim.devices.claws import Claws
from plant_sim.devices.cups import Cups
from plant_sim.devices.lift import Lift
from plant_sim.devices.sensor import Sensor
from plant_sim.devices.slide import Slide
from plant_sim.devices.spreader import Spreader
from plant_sim.parameters import Machine

#: The coils of an arm in the order in which `ArmPlant.step` takes them.
ARM_COILS = (
    "lift_extend",
    "lift_retract",
    "slide_inward",
    "slide_outward",
    "converge",
    "spread",
    "claws_open",
    "claws_close",
)


class ArmPlant:
    """One side of the machine. It is found as a normal stop leaves it: at feed, down, open.

    Attributes:
        slide: Between cups and tray.
        lift: Up and down.
        claws: All twelve.
        spreader: Their pitch.
        cups: The carousel of this row.
        grip: What the claws hold.
        row: What the cups hold.
    """

    __slots__ = (
        "_bed",
        "_belt_m",
        "_pose",
        "_sweep",
        "claws",
        "cups",
        "grip",
        "lift",
        "row",
        "slide",
        "spreader",
    )

    def __init__(
        self,
        side: str,
        machine: Machine,
        seedlings: Seedlings,
        bed: Bed,
        report: Report,
        *,
        chain_m: float,
    ) -> None:
        """Put an arm together.

        Args:
            side: ``left`` or ``right``.
            machine: All parameters.
            seedlings: All of them.
            bed: What lies under the arms.
            report: Takes note of incidents.
            chain_m: Where the cups stand, m.
        """
        self.slide = Slide(machine.slide, machine.valve, machine.picks_m, x_m=0.0)
        self.lift = Lift(machine.lift, machine.valve, y_m=machine.lift.stroke_m)
        self.claws = Claws(machine.claws, machine.valve, is_open=True)
        self.spreader = Spreader(machine.spreader, travel_m=0.0)
        self.cups = Cups(machine.cups, chain_m=chain_m)
        self.row = PlantingRow(
            side,
            seedlings,
            report,
            pitch_m=machine.cups.pitch_m,
            catch_m=machine.cups.catch_m,
        )
        reach = Reach(
            side=side,
            columns_m=machine.columns_m,
            tray_edge_m=machine.layout.row_spacing_m / 2 - machine.handling.tray_half_width_m,
            mirrored=side == "right",
            spread_m=machine.spreader.travel_m,
            reach_m=machine.handling.reach_m,
        )
        self.grip = Grip(machine.handling, reach, seedlings, bed, row=self.row, report=report)
        self._sweep = Sweep(machine.handling, reach, seedlings, bed, report)
        self._bed = bed
        self._belt_m = bed.belt_m
        self._pose = Pose(0.0, 0.0, gripping=False, free=False, travel_m=0.0)
        self._sync()

    @property
    def sensors(self) -> dict[str, Sensor]:
        """Every sensor of the arm by the tag of its wire, without the side."""
        return {
            "lift_down": self.lift.down,
            "lift_up": self.lift.up,
            "slide_at_feed": self.slide.at_feed,
            **{f"slide_at_pick_{number}": switch for number, switch in enumerate(self.slide.at_pick, start=1)},
            "claws_spread": self.spreader.spread_switch,
            "claws_converged": self.spreader.converged_switch,
            "cup_pulse": self.cups.pulse,
        }

    def place(
        self,
        *,
        x_m: float | None = None,
        y_m: float | None = None,
        is_open: bool | None = None,
        travel_m: float | None = None,
    ) -> None:
        """Put the arm somewhere, at rest: a starting situation, not a motion.

        Args:
            x_m: Slide, from the feed inward, m; None leaves it.
            y_m: Extension of the lift, m; None leaves it.
            is_open: Whether the claws are open; None leaves them.
            travel_m: Belt travel of the spreader, m; None leaves it.
        """
        if x_m is not None:
            self.slide.place(x_m)
        if y_m is not None:
            self.lift.place(y_m)
        if is_open is not None:
            self.claws.place(is_open=is_open)
        if travel_m is not None:
            self.spreader.place(travel_m)
        self._sync()

    def step(self, dt_s: float, coils: Sequence[bool]) -> None:
        """Let time pass.

        Args:
            dt_s: How long, s.
            coils: One for each of `ARM_COILS`, True when energised.
        """
        extend, retract, inward, outward, converge, spread, open_coil, close_coil = coils
        slide, lift, claws, spreader = self.slide, self.lift, self.claws, self.spreader
        slide.step(dt_s, inward=inward, outward=outward)
        lift.step(dt_s, extend=extend, retract=retract)
        claws.step(dt_s, open_coil=open_coil, close_coil=close_coil)
        spreader.step(dt_s, spread=spread, converge=converge)
        self.cups.step(dt_s)
        self.row.step(dt_s, chain_m=self.cups.chain_m)
        arm_moves = slide.moving or lift.moving or claws.moving or spreader.moving
        if arm_moves or self._bed.belt_m != self._belt_m:
            self._belt_m = self._bed.belt_m
            self._look()
            self.grip.step(self._pose)
            self._sweep.step(self._pose)

    def _look(self) -> None:
        """Bring the pose up to date."""
        pose = self._pose
        pose.x_m = self.slide.position_m
        pose.rise_m = self.lift.rise_m
        pose.gripping = self.claws.gripping
        pose.free = self.claws.free
        pose.travel_m = self.spreader.travel_m

    def _sync(self) -> None:
        self._look()
        self.grip.sync(self._pose)
        self._sweep.sync(self._pose)
