"""Claws: the twelve grippers of an arm, opened and closed together by one latching valve."""

from dataclasses import dataclass

from plant_sim.common.limits import require, require_within
from plant_sim.devices.pneumatic import Cylinder, FrictionSpec, Pneumatics, PortSpec, Records, annular_wall, vent_tubes
from plant_sim.pneumatics.chamber import fill
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.pneumatics.meter_out import piston_area_m2


@dataclass(frozen=True, slots=True)
class ClawsSpec:
    """Parameters of the claws: twelve MHC2 grippers per arm, finger angle positive when open.

    Attributes:
        bore_m: Bore of one gripper, m.
        stroke_m: Stroke of its piston, m.
        grippers: Grippers per arm; their chambers are lumped into one.
        moved_kg: Mass of piston and fingers of one gripper, kg.
        throttle_conductance_m3_s_pa: Meter-out throttle of the arm's claws, m3/(s Pa).
        moment_nm_pa: Moment of a finger per Pa across the piston, N m/Pa.
        finger_m: Distance from the joint to the point where a finger holds the stem, m.
        closed_deg: Finger angle at the closed end, degrees.
        open_deg: Finger angle at the open end, degrees.
        grips_below_deg: Angle below which a stem is gripped, degrees.
        frees_above_deg: Angle above which a stem is free, degrees.
        holds_above_n: Minimum force at which closed fingers hold seedlings, N; below it, the seedlings slip out.
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
        """Validate the parameters."""
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
            "must be above the closed end, otherwise nothing can be gripped",
        )
        require(
            self.grips_below_deg < self.frees_above_deg < self.open_deg,
            "frees_above_deg",
            "must be between grips_below_deg and the open end",
        )

    @property
    def area_m2(self) -> float:
        """Piston area of all grippers of an arm, m2."""
        return self.grippers * piston_area_m2(self.bore_m)


class Claws(Cylinder):
    """View of the claws of an arm; position 0 is closed.

    Attributes:
        grips_below_m: Position below which a stem is gripped, m.
        frees_above_m: Position above which a stem is free, m.
        holds_above_pa: Minimum pressure across the pistons at which closed fingers hold seedlings, Pa.
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
        """Initialise the claws in the open position.

        Args:
            spec: Parameters of the claws.
            port: Path from the valve to either chamber of all grippers.
            friction: Friction of one gripper.
            common: Valves and air.
            arm: Records of the arm in the kernel memory.
            pressure_pa: Gauge pressure of the claws at rest, Pa.
        """
        params = arm.params["claws"]
        super().__init__(
            arm.state["claws"], params, arm.gas, port, friction, common, hold_pa=ATMOSPHERE_PA + pressure_pa
        )
        self._spec = spec
        self._port = port
        self._pressure_pa = pressure_pa
        self._deg_m = (spec.open_deg - spec.closed_deg) / spec.stroke_m
        self.holds_above_pa = spec.holds_above_n * spec.finger_m / spec.moment_nm_pa
        self.grips_below_m = (spec.grips_below_deg - spec.closed_deg) / self._deg_m
        self.frees_above_m = (spec.frees_above_deg - spec.closed_deg) / self._deg_m
        params["stroke_m"] = spec.stroke_m
        params["plus_area_m2"] = params["minus_area_m2"] = spec.area_m2
        params["load_kg"] = spec.grippers * spec.moved_kg
        for name in ("coulomb_n", "static_n", "viscous_n_s_m"):
            params["friction"][name] *= spec.grippers
        params["valve"]["latching"] = 1
        for line in (params["plus"], params["minus"]):
            line["chamber_wall"] = annular_wall(spec.bore_m, 0.0, count=spec.grippers)
            line["throttle_m3_s_pa"] = spec.throttle_conductance_m3_s_pa
            line["checked"] = 0
        self.swing(is_open=True)

    @property
    def angle_deg(self) -> float:
        """Finger angle, degrees."""
        return self._spec.closed_deg + self._deg_m * self.position_m

    @property
    def gripping(self) -> bool:
        """True if a stem between the fingers is gripped."""
        return self.position_m <= self.grips_below_m

    @property
    def free(self) -> bool:
        """True if the fingers do not touch a stem between them."""
        return self.position_m >= self.frees_above_m

    @property
    def clamp_n(self) -> float:
        """Force of a finger on the stem, N: positive clamps, negative opens.

        The moment is proportional to the pressure across the piston, scaled from the catalogue value at 0.5 MPa.
        """
        across_pa = float(self.state["minus"]["chamber"]["pressure_pa"] - self.state["plus"]["chamber"]["pressure_pa"])
        return self._spec.moment_nm_pa * across_pa / self._spec.finger_m

    def swing(self, *, is_open: bool) -> None:
        """Set fingers, valve and air to the open or closed state as an initial condition, without motion."""
        state, params = self.state, self.params
        state["valve"]["spool"] = state["valve"]["target"] = state["valve"]["sent"] = 1.0 if is_open else -1.0
        self.place(self._spec.stroke_m if is_open else 0.0)
        vent_tubes(state, params, self._gas)
        fed, vented = ("plus", "minus") if is_open else ("minus", "plus")
        full_pa = ATMOSPHERE_PA + self._pressure_pa
        fill(state[fed]["tube"], self._port.tube_m3, full_pa, self._gas)
        fill(state[fed]["chamber"], float(state[fed]["chamber"]["volume_m3"]), full_pa, self._gas)
        fill(state[vented]["chamber"], float(state[vented]["chamber"]["volume_m3"]), ATMOSPHERE_PA, self._gas)
