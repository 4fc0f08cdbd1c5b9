"""Specs of the machine as a whole: how it is put together, simulated and rated."""

from dataclasses import dataclass

from plant_sim.spec import require, require_within


@dataclass(frozen=True, slots=True)
class LayoutSpec:
    """How the machine is put together.

    Attributes:
        row_spacing_m: From planting row to planting row, m.
        arms_may_meet_in_plant: Whether both arms fit inward of pick 2 at once.
    """

    row_spacing_m: float
    arms_may_meet_in_plant: bool

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.350, 0.800, "row_spacing_m")


@dataclass(frozen=True, slots=True)
class SimulationSpec:
    """How finely the plant looks at itself.

    Attributes:
        step_s: Step of air and motion, s; a millisecond holds a whole number of them.
        look_ms: Longest time until it is seen what a motion did to the seedlings, ms.
    """

    step_s: float
    look_ms: int

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 1e-5, 1e-3, "step_s")
        whole = abs(self.steps_per_ms * self.step_s - 1e-3) < 1e-12
        require(whole, "step_s", "must divide a millisecond: 1.0e-3, 0.5e-3, 0.2e-3, 0.1e-3")
        require_within(self, 1, 20, "look_ms")

    @property
    def steps_per_ms(self) -> int:
        """Steps in a millisecond."""
        return round(1e-3 / self.step_s)


@dataclass(frozen=True, slots=True)
class RatingSpec:
    """Up to where the makers vouch for their parts; beyond it the machine is warned about, not refused.

    Attributes:
        slide_pa: Highest gauge pressure of the slide, Pa.
        slide_least_pa: Lowest, Pa.
        slide_m_s: Highest piston speed of the slide, m/s.
        slide_least_m_s: Lowest, m/s.
        lift_pa: Highest gauge pressure of the lift, Pa.
        lift_m_s: Highest piston speed of the lift, m/s.
        claws_pa: Highest gauge pressure of the claws, Pa.
        claws_least_pa: Lowest, Pa.
    """

    slide_pa: float
    slide_least_pa: float
    slide_m_s: float
    slide_least_m_s: float
    lift_pa: float
    lift_m_s: float
    claws_pa: float
    claws_least_pa: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.0, 2e6, "slide_pa", "slide_least_pa", "lift_pa", "claws_pa", "claws_least_pa")
        require_within(self, 0.0, 10.0, "slide_m_s", "slide_least_m_s", "lift_m_s")
