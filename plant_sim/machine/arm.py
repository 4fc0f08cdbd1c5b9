"""One arm with its drives, claws and cups, and the seedlings in them."""

import math
from typing import Any, Final

from controller.common.saved import Saved
from plant_sim.crop.bed import Bed
from plant_sim.crop.grip import Grip
from plant_sim.crop.incident import Report
from plant_sim.crop.mechanics import Mechanics
from plant_sim.crop.planting_row import PlantingRow
from plant_sim.crop.pose import Pose, Reach
from plant_sim.crop.quiet import AXES, Quiet, between
from plant_sim.crop.seedling import CELLS_ALONG, Seedlings
from plant_sim.crop.sweep import Sweep
from plant_sim.devices.claws import Claws
from plant_sim.devices.cups import Cups
from plant_sim.devices.lift import Lift
from plant_sim.devices.pneumatic import Records
from plant_sim.devices.sensor import Sensor
from plant_sim.devices.slide import Slide
from plant_sim.devices.spreader import Spreader
from plant_sim.devices.yield_sensors import ClawPressureSwitch, CupSensor, SeedlingBeam, YieldSensor
from plant_sim.machine.parameters import Machine

ARM_SWITCHES: Final = (
    "lift_down",
    "lift_up",
    "slide_at_feed",
    "slide_at_pick_1",
    "slide_at_pick_2",
    "slide_at_pick_3",
    "claws_spread",
    "claws_converged",
)
"""Switches of an arm by I/O tag, without the side; the cup counter is not among them, because it reports no place."""


class ArmPlant(Saved):
    """One side of the machine, initially in the state after a normal stop: at feed, arm down, claws open.

    Attributes:
        slide: Drive between cups and tray.
        lift: Vertical drive.
        claws: The twelve grippers.
        spreader: Drive of the claw pitch.
        cups: Carousel of this row.
        grip: Seedlings in the claws.
        row: Seedlings in the cups.
        claw_pressure: Pressure switch in the closing port of the claws.
        seedling_beam: Light barrier that the stems in the claws cross on the way to the feed.
        cup_filled: Sensor that looks into the cups behind the place of throwing.
    """

    SAVED = ("_slips", "_stirred", "_trays_m")

    __slots__ = (
        "_bed",
        "_beside_below_m",
        "_down_m",
        "_force_n_pa",
        "_frees_above_m",
        "_grips_below_m",
        "_holds_above_pa",
        "_params",
        "_parts",
        "_pose",
        "_slips",
        "_state",
        "_stirred",
        "_sweep",
        "_trays_m",
        "claw_pressure",
        "claws",
        "cup_filled",
        "cups",
        "grip",
        "lift",
        "row",
        "seedling_beam",
        "slide",
        "spreader",
    )

    def __init__(
        self,
        side: str,
        machine: Machine,
        records: Records,
        seedlings: Seedlings,
        *,
        mechanics: Mechanics,
        bed: Bed,
        report: Report,
        seed: str,
    ) -> None:
        """Initialise an arm.

        Args:
            side: ``left`` or ``right``.
            machine: All parameters.
            records: Records of the arm in the kernel memory.
            seedlings: All seedlings.
            mechanics: Effect of the claws on the seedlings.
            bed: Trays under the arms.
            report: Callback for incidents.
            seed: Seed of the initial chain position and of the flag offsets.
        """
        common, bounce_s, held_pa = machine.pneumatics, machine.contact.bounce_s, machine.held_pressure_pa
        self.slide = Slide(
            machine.slide,
            machine.slide_port,
            machine.slide_friction,
            common,
            records,
            picks_m=machine.picks_m,
            held_pa=held_pa,
            bounce_s=bounce_s,
        )
        self.lift = Lift(
            machine.lift,
            machine.lift_port,
            machine.lift_friction,
            common,
            records,
            held_pa=held_pa,
            bounce_s=bounce_s,
        )
        self.claws = Claws(
            machine.claws,
            machine.claws_port,
            machine.claws_friction,
            common,
            records,
            pressure_pa=machine.held_claw_pressure_pa,
        )
        state, params = records.state, records.params
        params["down_m"] = machine.lift.stroke_m
        params["frees_above_m"], params["grips_below_m"] = self.claws.frees_above_m, self.claws.grips_below_m
        params["holds_above_pa"] = self.claws.holds_above_pa
        self.spreader = Spreader(machine.spreader, state["spreader"], params["spreader"], bounce_s=bounce_s)
        self.cups = Cups(machine.cups, state["cups"], params["cups"], seed=seed, bounce_s=bounce_s)
        self._state, self._params = state, params
        self._stirred = self._slips = 0.0
        self._down_m = machine.lift.stroke_m
        self._grips_below_m, self._frees_above_m = self.claws.grips_below_m, self.claws.frees_above_m
        self._holds_above_pa = self.claws.holds_above_pa
        self._force_n_pa = machine.claws.moment_nm_pa / machine.claws.finger_m
        self.row = PlantingRow(
            side,
            seedlings,
            report,
            pitch_m=machine.cups.pitch_m,
            catch_m=machine.cups.catch_m,
        )
        yields, pitch_m = machine.yield_sensors, machine.cups.pitch_m
        self.claw_pressure = ClawPressureSwitch(
            yields,
            f"{seed}, claw pressure",
            state["claw_pressure"],
            params["claw_pressure"],
            set_pa=machine.claw_pressure_pa,
        )
        self.seedling_beam = SeedlingBeam(
            yields, f"{seed}, beam", state["seedling_beam"], params["seedling_beam"], claws=CELLS_ALONG
        )
        last_claw_m = (CELLS_ALONG - 1) * pitch_m
        self.cup_filled = CupSensor(
            yields,
            f"{seed}, cup sensor",
            state["cup_filled"],
            params["cup_filled"],
            last_claw_m=last_claw_m,
            pitch_m=pitch_m,
        )
        reach = Reach(
            side=side,
            columns_m=machine.columns_m,
            tray_edge_m=machine.layout.row_spacing_m / 2 - machine.handling.tray_half_width_m,
            mirrored=side == "right",
            spread_m=machine.spreader.travel_m,
            reach_m=machine.handling.reach_m,
        )
        self._beside_below_m = min(reach.tray_edge_m, reach.columns_m[0] - reach.reach_m)
        self.grip = Grip(machine.handling, mechanics, reach, seedlings, bed, row=self.row, report=report)
        self._sweep = Sweep(machine.handling, reach, seedlings, bed, report)
        self._bed = bed
        self._trays_m = bed.trays_m
        self._pose = Pose(0.0, 0.0, gripping=False, free=False, travel_m=0.0, freed_s=0.0)
        self._parts: tuple[Saved, ...] = (
            self.grip,
            self._sweep,
            self.row,
            self._pose,
            self.cups,
        )
        self._sync()

    def save(self) -> Any:
        """Return the current state, except for that in the kernel memory."""
        return super().save(), [part.save() for part in self._parts]

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        own, parts = saved
        super().restore(own)
        for part, state in zip(self._parts, parts, strict=True):
            part.restore(state)

    @property
    def sensors(self) -> dict[str, Sensor]:
        """Sensors of the arm by I/O tag, without the side."""
        return {
            "lift_down": self.lift.down,
            "lift_up": self.lift.up,
            "slide_at_feed": self.slide.at_feed,
            **{f"slide_at_pick_{number}": switch for number, switch in enumerate(self.slide.at_pick, start=1)},
            "claws_spread": self.spreader.spread_switch,
            "claws_converged": self.spreader.converged_switch,
            "cup_pulse": self.cups.pulse,
            **{tag: each.sensor for tag, each in self.yield_sensors.items()},
        }

    @property
    def yield_sensors(self) -> dict[str, YieldSensor]:
        """Optional sensors of held and planted rows by I/O tag, without the side."""
        return {
            "claw_pressure": self.claw_pressure,
            "seedling_beam": self.seedling_beam,
            "cup_filled": self.cup_filled,
        }

    def place(
        self,
        *,
        x_m: float | None = None,
        y_m: float | None = None,
        is_open: bool | None = None,
        travel_m: float | None = None,
    ) -> None:
        """Set the position of the arm at rest as an initial condition, without motion.

        Args:
            x_m: Slide, from the feed inward, m; None leaves it unchanged.
            y_m: Extension of the lift, m; None leaves it unchanged.
            is_open: True for open claws; None leaves them unchanged.
            travel_m: Belt travel of the spreader, m; None leaves it unchanged.
        """
        if x_m is not None:
            self.slide.place(x_m)
        if y_m is not None:
            self.lift.place(y_m)
        if is_open is not None:
            self.claws.swing(is_open=is_open)
        if travel_m is not None:
            self.spreader.place(travel_m)
        self._sync()

    def follow(self, now_s: float, positions: list[float]) -> None:
        """Apply the latest motion to the seedlings.

        Args:
            now_s: Plant time, s.
            positions: Positions of the arm in the order of `POSITIONS`.
        """
        x_m, y_m, claws_m, travel_m, chain_m, chain_m_s, stirred, freed_s, slips, clamp_pa = positions
        self.row.step(now_s, chain_m=chain_m, chain_m_s=chain_m_s)
        grip, pose, rise_m = self.grip, self._pose, self._down_m - y_m
        pose.update(x_m, rise_m, travel_m, freed_s=freed_s, now_s=now_s)
        if grip.held:
            grip.record_force(self._force_n_pa * clamp_pa, rise_m)
            if slips != self._slips:
                grip.drop_all(pose, now_s)
        elif grip.slipped and clamp_pa >= self._holds_above_pa:
            grip.regrip(pose)
        self._slips = slips
        if stirred != self._stirred or self._bed.trays_m != self._trays_m:
            self._stirred = stirred
            self._trays_m = self._bed.trays_m
            pose.gripping = claws_m <= self._grips_below_m
            pose.free = claws_m >= self._frees_above_m
            grip.step(pose)
            self._sweep.step(pose)

    @property
    def watches_yield(self) -> bool:
        """True if claw pressure switch, beam or cup sensor is wired; they are not evaluated otherwise."""
        return bool(self._params["watches_yield"])

    @watches_yield.setter
    def watches_yield(self, watches: bool) -> None:
        self._params["watches_yield"] = int(watches)

    def show_seedlings(self) -> None:
        """Set what beam and cup sensor see in the motion that follows: the stems in the claws, and the filled cups."""
        if self.watches_yield:
            self.seedling_beam.hold(seedling.along for seedling in self.grip.held if self.grip.extracted)
            self.cup_filled.fill(self.row.filled_cups)

    def follow_cups(self, now_s: float, positions: list[float]) -> None:
        """Apply the latest motion of the chain to the cups, if nothing else has an effect; arguments as in `follow`."""
        _, _, _, _, chain_m, chain_m_s, *_ = positions
        self.row.step(now_s, chain_m=chain_m, chain_m_s=chain_m_s)

    @property
    def is_clear_of_trays(self) -> bool:
        """True if the motion of a tray cannot affect the arm and its seedlings, whatever the trays do."""
        grip = self.grip
        if grip.held and not grip.extracted:
            return False
        is_low = self._sweep.low or (grip.held and self._pose.rise_m <= grip.lowest_m)
        return not is_low or self._pose.x_m < self._beside_below_m

    def pass_trays(self) -> None:
        """Adopt a motion of the trays while the arm is clear of them."""
        self._trays_m = self._bed.trays_m
        self._sweep.pass_trays()

    def catch_up(self, quiet: Quiet) -> None:
        """Adopt the loads and positions of the looks at which nothing could happen to a seedling.

        Args:
            quiet: The limits since the last look.
        """
        grip = self.grip
        if grip.held:
            if quiet.peak_pa > -math.inf:
                grip.record_force(self._force_n_pa * quiet.peak_pa, -math.inf)
            if quiet.least_pa < math.inf:
                grip.record_force(self._force_n_pa * quiet.least_pa, math.inf)
        self._sweep.follow_gently(quiet.slide_m)

    def limits(self, positions: list[float], meet_m: float) -> Quiet:
        """Return the limits within which no motion can affect a seedling.

        Args:
            positions: Current positions of the arm in the order of `POSITIONS`.
            meet_m: Slide position beyond which the arms can collide, m.
        """
        x_m, y_m, claws_m, travel_m = positions[: len(AXES)]
        grip = self.grip
        gripped, swept = grip.thresholds(), self._sweep.thresholds()
        slides_m, rises_m, travels_m = ([*one, *other] for one, other in zip(gripped, swept, strict=True))
        limits = [
            between(x_m, [*slides_m, meet_m]),
            between(y_m, [self._down_m - rise_m for rise_m in rises_m]),
            between(claws_m, [self._grips_below_m, self._frees_above_m]),
            between(travel_m, travels_m),
        ]
        if self._sweep.is_in_contact:  # evaluated at every look
            limits[0] = (math.inf, -math.inf)
        low, high = zip(*limits, strict=True)
        clamp_below_pa = self._holds_above_pa if grip.slipped else math.inf
        return Quiet(
            low,
            high,
            chain_below_m=self.row.leaves_at_m,
            until_s=self.row.lands_s,
            clamp_below_pa=clamp_below_pa,
            slips=self._slips,
            down_m=self._down_m,
            gripped_rise_m=grip.pulled_above_m,
            slide_m=x_m,
        )

    def _sync(self) -> None:
        """Adopt the current state without evaluating the motion that led to it."""
        pose, freed_s = self._pose, float(self._state["freed_s"])
        pose.update(
            self.slide.x_m,
            self.lift.rise_m,
            self.spreader.travel_m,
            freed_s=freed_s,
            now_s=pose.now_s,
        )
        pose.gripping, pose.free = self.claws.gripping, self.claws.free
        self.grip.sync(pose)
        self._sweep.sync(pose)
