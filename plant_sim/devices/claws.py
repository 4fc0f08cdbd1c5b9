"""The twelve claws of an arm, opened and closed together by one latching valve."""

from dataclasses import dataclass

from plant_sim.devices.pneumatic import Cylinder, FrictionSpec, Pneumatics, PortSpec, Records, vent_tubes
from plant_sim.pneumatics.chamber import fill
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.pneumatics.meter_out import piston_area_m2
from plant_sim.spec import require, require_within


@dataclass(frozen=True, slots=True)
class ClawsSpec:
    """What is bolted to the machine: twelve MHC2 an arm, finger angle positive when open.

    Attributes:
        bore_m: Bore of one gripper, m.
        stroke_m: Stroke of its piston, m.
        grippers: How many an arm has; their chambers are taken as one.
        moved_kg: Piston and fingers of one, kg.
        throttle_conductance_m3_s_pa: Meter-out throttle of the arm's claws, m3/(s Pa).
        moment_nm_pa: Moment of a finger for each Pa across the piston, N m/Pa.
        finger_m: From the joint to where a finger holds the stem, m.
        closed_deg: Finger angle at the closed end, degrees.
        open_deg: Finger angle at the open end, degrees.
        grips_below_deg: At this angle or less a stem is gripped, degrees.
        frees_above_deg: At this angle or more a stem is free, degrees.
        holds_above_n: Closed fingers with less force let slip what they hold, N.
    """

    bore_m: float
    stroke_m: float
    grippers: int
    moved_kg: float
    throttle_conductance_m3_s_pa: float
    moment_nm_pa: float
    finger_m: float
    closed_deg: float
    open_deg: float
    grips_below_deg: float
    frees_above_deg: float
    holds_above_n: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.004, 0.1, "bore_m")
        require_within(self, 0.001, 0.1, "stroke_m")
        require_within(self, 1, 100, "grippers")
        require_within(self, 0.001, 10.0, "moved_kg")
        require_within(self, 1e-11, 1e-7, "throttle_conductance_m3_s_pa")
        require_within(self, 1e-8, 1e-4, "moment_nm_pa")
        require_within(self, 0.005, 0.5, "finger_m")
        require_within(self, 0.0, 100.0, "holds_above_n")
        require_within(self, -45.0, 90.0, "closed_deg", "open_deg")
        require(
            self.closed_deg < self.grips_below_deg,
            "grips_below_deg",
            "must lie above the closed end, or nothing is ever gripped",
        )
        require(
            self.grips_below_deg < self.frees_above_deg < self.open_deg,
            "frees_above_deg",
            "must lie between grips_below_deg and the open end",
        )

    @property
    def area_m2(self) -> float:
        """Piston area of all grippers of an arm, m2."""
        return self.grippers * piston_area_m2(self.bore_m)


class Claws(Cylinder):
    """A view of the claws of an arm; position 0 is closed.

    Attributes:
        grips_below_m: Position at which a stem is gripped, m.
        frees_above_m: Position at which a stem is free, m.
        holds_above_pa: Pressure across the pistons with which closed fingers just hold, Pa.
    """

    __slots__ = ("_deg_m", "_port", "_pressure_pa", "_spec", "frees_above_m", "grips_below_m", "holds_above_pa")

    def __init__(
        self,
        spec: ClawsSpec,
        port: PortSpec,
        friction: FrictionSpec,
        common: Pneumatics,
        arm: Records,
        *,
        pressure_pa: float,
    ) -> None:
        """Build them, open.

        Args:
            spec: What they are.
            port: The way to either chamber of all grippers.
            friction: Friction of one gripper.
            common: Valves and air.
            arm: Where the arm lies in the memory of the kernel.
            pressure_pa: Gauge pressure of the claws, Pa.
        """
        make = arm.make["claws"]
        super().__init__(arm.state["claws"], make, arm.gas, port, friction, common, hold_pa=ATMOSPHERE_PA + pressure_pa)
        self._spec = spec
        self._port = port
        self._pressure_pa = pressure_pa
        self._deg_m = (spec.open_deg - spec.closed_deg) / spec.stroke_m
        self.holds_above_pa = spec.holds_above_n * spec.finger_m / spec.moment_nm_pa
        self.grips_below_m = (spec.grips_below_deg - spec.closed_deg) / self._deg_m
        self.frees_above_m = (spec.frees_above_deg - spec.closed_deg) / self._deg_m
        make["stroke_m"] = spec.stroke_m
        make["plus_area_m2"] = make["minus_area_m2"] = spec.area_m2
        make["load_kg"] = spec.grippers * spec.moved_kg
        for name in ("coulomb_n", "static_n", "viscous_n_s_m"):
            make["friction"][name] *= spec.grippers
        make["cushion_share"] = 1.0
        make["valve"]["latching"] = 1
        for line in (make["plus"], make["minus"]):
            line["throttle_m3_s_pa"] = spec.throttle_conductance_m3_s_pa
            line["checked"] = 0
        self.swing(is_open=True)

    @property
    def angle_deg(self) -> float:
        """Finger angle, degrees."""
        return self._spec.closed_deg + self._deg_m * self.position_m

    @property
    def gripping(self) -> bool:
        """Whether what is between the fingers is gripped."""
        return self.position_m <= self.grips_below_m

    @property
    def free(self) -> bool:
        """Whether nothing between the fingers is touched."""
        return self.position_m >= self.frees_above_m

    @property
    def clamp_n(self) -> float:
        """Force of a finger on the stem, N: positive clamps, negative opens.

        The catalogue's moment at 0.5 MPa, taken as proportional to the pressure across the piston.
        """
        across_pa = float(self.state["minus"]["chamber"]["pressure_pa"] - self.state["plus"]["chamber"]["pressure_pa"])
        return self._spec.moment_nm_pa * across_pa / self._spec.finger_m

    def swing(self, *, is_open: bool) -> None:
        """Put fingers, valve and air at one end: a starting situation, not a motion."""
        state, make = self.state, self.make
        state["valve"]["spool"] = state["valve"]["target"] = 1.0 if is_open else -1.0
        self.place(self._spec.stroke_m if is_open else 0.0)
        vent_tubes(state, make, self._gas)
        fed, vented = ("plus", "minus") if is_open else ("minus", "plus")
        full_pa = ATMOSPHERE_PA + self._pressure_pa
        fill(state[fed]["tube"], self._port.tube_m3, full_pa, self._gas)
        fill(state[fed]["chamber"], float(state[fed]["chamber"]["volume_m3"]), full_pa, self._gas)
        fill(state[vented]["chamber"], float(state[vented]["chamber"]["volume_m3"]), ATMOSPHERE_PA, self._gas)
