"""Specs of the complete machine: layout, simulation and ratings."""

from dataclasses import dataclass

from plant_sim.common.limits import require, require_within


@dataclass(frozen=True, slots=True)
class LayoutSpec:
    """Layout of the machine.

    Attributes:
        row_spacing_m: Distance between the planting rows, m.
        arms_may_meet_in_plant: True if both arms fit inward of pick 2 at the same time.
    """

    row_spacing_m: float
    arms_may_meet_in_plant: bool

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.350, 0.800, "row_spacing_m")


@dataclass(frozen=True, slots=True)
class StartSpec:
    """State of the machine at the start of the simulation.

    Attributes:
        chamber_share: Pressure in the chambers of slides and lifts, as a fraction of the main gauge pressure; 0 if they
            are vented.
    """

    chamber_share: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.0, 1.0, "chamber_share")


@dataclass(frozen=True, slots=True)
class SimulationSpec:
    """Time resolution of the simulation.

    Attributes:
        step_s: Longest time step of air and motion, s; a millisecond is an integer number of steps.
        look_ms: Longest interval between two evaluations of the effect of motion on seedlings, ms.
    """

    step_s: float
    look_ms: int

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 1e-5, 1e-3, "step_s")
        whole = abs(self.steps_per_ms * self.step_s - 1e-3) < 1e-12
        require(whole, "step_s", "must divide a millisecond: 1.0e-3, 0.5e-3, 0.2e-3, 0.1e-3")
        require_within(self, 1, 20, "look_ms")

    @property
    def steps_per_ms(self) -> int:
        """Number of steps per millisecond."""
        return round(1e-3 / self.step_s)


@dataclass(frozen=True, slots=True)
class RatingSpec:
    """Manufacturers' ratings of the parts; values outside them cause a warning, not an error.

    Attributes:
        slide_pa: Maximum gauge pressure of the slide, Pa.
        slide_least_pa: Minimum gauge pressure of the slide, Pa.
        slide_m_s: Maximum piston speed of the slide, m/s.
        slide_least_m_s: Minimum piston speed of the slide, m/s.
        lift_pa: Maximum gauge pressure of the lift, Pa.
        lift_least_pa: Minimum gauge pressure of the lift, Pa.
        lift_m_s: Maximum piston speed of the lift, m/s.
        claws_pa: Maximum gauge pressure of the claws, Pa.
        claws_least_pa: Minimum gauge pressure of the claws, Pa.
    """

    slide_pa: float
    slide_least_pa: float
    slide_m_s: float
    slide_least_m_s: float
    lift_pa: float
    lift_least_pa: float
    lift_m_s: float
    claws_pa: float
    claws_least_pa: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.0, 2e6, "slide_pa", "slide_least_pa", "lift_pa", "lift_least_pa")
        require_within(self, 0.0, 2e6, "claws_pa", "claws_least_pa")
        require_within(self, 0.0, 10.0, "slide_m_s", "slide_least_m_s", "lift_m_s")
