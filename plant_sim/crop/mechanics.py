"""Effect of a claw on a stem and a plug: miss, cut, slip, break, drift.

Each failure mode has a margin: the distance of a typical seedling from failure, in standard deviations of the relevant
property. A seedling fails if its deviation towards failure exceeds the margin. The fraction of a population that fails
is the tail of the normal distribution beyond the margin; `expectation` computes it. All functions accept numbers or
numpy arrays.

Where the pepper paper describes an effect in words only (docs/sources/machine.md 5), the simplest law with the
described behaviour is used, with calibrated constants: see docs/seedling.md.
"""

from dataclasses import dataclass

import numpy as np

from plant_sim.common.limits import require_within
from plant_sim.crop.response import Number
from plant_sim.crop.traits import Traits

_GRAVITY_M_S2 = 9.80665
_AGE_D = 50.0
"""Reference age: centre of the paper's design."""

_AGE_STEP_D = 5.0
_HEIGHT_AGE_D = 51.0
"""Age at which the seedlings were measured for the paper."""

_FOAM_MM = 10.0
_FORCE_N = 8.0
_HELD_S = 12.5
"""Time from grip to release of a row at 45 cups/min."""

_FALL_S = 0.1277
"""Time of a free fall of 80 mm."""


@dataclass(frozen=True, slots=True)
class SeedlingSpec:
    """Properties of pepper seedlings and of the foam that holds them.

    Attributes ending in `_age` and `_age2` are the linear and quadratic coefficients of the logarithm of a property.
    The age is in units of 5 d, counted from 50 d. An `_sd` without a unit is the standard deviation of a logarithm.
    Forces are per finger.

    Attributes:
        height_m: Length of free stem below the lowest leaf at 51 d, m.
        height_sd_m: Standard deviation of this height, m.
        growth_mm_d: Growth rate of this height, mm/d.
        finger_height_m: Length of free stem required by the fingers, m.
        lean_sd_m: Standard deviation of the stem position in either direction, m.
        gap_m: Half of the clear gap between the pads of open claws with 10 mm foam, m.
        gap_foam: Reduction of the half gap per unit of additional foam thickness.
        strip_reach_m: Half of the strip width plus the deflection of a stem, m.
        yield_mm: Foam thickness at which half of the finger force reaches the stem, mm.
        yield_exponent: Steepness of the decrease of this force with foam thickness.
        friction: Friction coefficient of foam on a stem at 50 d.
        friction_age: Linear change of the friction with age.
        friction_age2: Quadratic change of the friction with age.
        adhesion_n: Median adhesion of a plug in its cell, N.
        adhesion_sd: Spread of the adhesion.
        plug_kg: Mass of a plug with its seedling, kg.
        cut_n: Median force that cuts a stem at 50 d on 10 mm foam, N.
        cut_sd: Spread of the cutting force.
        cut_age: Linear change of the cutting force with age.
        cut_age2: Quadratic change of the cutting force with age.
        cut_foam: Exponent of the foam thickness in the cutting force.
        endurance: Median contact pressure that a stem at 50 d endures for 12.5 s, relative to 8 N on 10 mm foam.
        endurance_sd: Spread of the endurance.
        endurance_age: Linear change of the endurance with age.
        endurance_age2: Quadratic change of the endurance with age.
        contact_force: Exponent of the force in the contact pressure; 0.5 for a cylinder on an elastic bed.
        contact_foam: Exponent of the foam thickness in the contact pressure, with the sign reversed.
        hold_exponent: Exponent of the holding time in the decrease of endurance.
        crown_m: Drift of a falling plug caused by its leaves at 50 d, standard deviation in either direction, m.
        crown_age: Linear change of this drift with age.
        crown_age2: Quadratic change of this drift with age.
        sway_m: Drift caused by sway in a grip of 8 N on 10 mm foam, m.
        sway_force: Exponent of the force in the decrease of sway.
        stick_m: Drift caused by adhesion to the foam after a grip of 8 N on 10 mm foam at 50 d, m.
        stick_force: Exponent of the force in this drift.
        stick_foam: Exponent of the foam thickness in this drift.
        stick_age: Linear change of this drift with age.
    """

    height_m: float
    height_sd_m: float
    growth_mm_d: float
    finger_height_m: float
    lean_sd_m: float
    gap_m: float
    gap_foam: float
    strip_reach_m: float
    yield_mm: float
    yield_exponent: float
    friction: float
    friction_age: float
    friction_age2: float
    adhesion_n: float
    adhesion_sd: float
    plug_kg: float
    cut_n: float
    cut_sd: float
    cut_age: float
    cut_age2: float
    cut_foam: float
    endurance: float
    endurance_sd: float
    endurance_age: float
    endurance_age2: float
    contact_force: float
    contact_foam: float
    hold_exponent: float
    crown_m: float
    crown_age: float
    crown_age2: float
    sway_m: float
    sway_force: float
    stick_m: float
    stick_force: float
    stick_foam: float
    stick_age: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.01, 1.0, "height_m", "finger_height_m")
        require_within(self, 1e-4, 0.1, "height_sd_m", "lean_sd_m", "gap_m", "strip_reach_m")
        require_within(self, -20.0, 20.0, "growth_mm_d")
        require_within(self, 0.0, 2.0, "gap_foam", "contact_force", "contact_foam", "cut_foam", "hold_exponent")
        require_within(self, 1.0, 1000.0, "yield_mm")
        require_within(self, 0.0, 10.0, "yield_exponent", "sway_force", "stick_force")
        require_within(self, 0.01, 5.0, "friction")
        require_within(self, 0.01, 100.0, "adhesion_n", "cut_n", "endurance")
        require_within(self, 0.01, 5.0, "adhesion_sd", "cut_sd", "endurance_sd")
        require_within(self, 0.001, 1.0, "plug_kg")
        require_within(self, 0.0, 0.1, "crown_m", "sway_m", "stick_m")
        require_within(self, -5.0, 5.0, "stick_foam")
        changes = [name for name in self.__slots__ if "_age" in name]
        require_within(self, -2.0, 2.0, *changes)


class Mechanics:
    """Laws for seedlings of one age between pads of one thickness."""

    __slots__ = ("_age", "_foam", "_foam_mm", "_spec", "_yields")

    def __init__(self, spec: SeedlingSpec, *, foam_mm: Number, age_d: Number) -> None:
        """Compute the constants of a crop and its pads.

        Args:
            spec: Properties of seedlings and foam.
            foam_mm: Foam thickness, mm.
            age_d: Age of the seedlings, d.
        """
        self._spec = spec
        self._foam_mm = foam_mm
        self._age = (np.asarray(age_d) - _AGE_D) / _AGE_STEP_D
        self._foam = np.log(np.maximum(foam_mm, 0.1) / _FOAM_MM)  # limited, because the power laws diverge without foam
        self._yields = _share(foam_mm, spec) / _share(_FOAM_MM, spec)

    def height_margin(self) -> Number:
        """Return the margin of the free stem over the height required by the fingers."""
        spec = self._spec
        days = _AGE_STEP_D * self._age + _AGE_D - _HEIGHT_AGE_D
        return (spec.height_m + 1e-3 * spec.growth_mm_d * days - spec.finger_height_m) / spec.height_sd_m

    def gap_margin(self, off_m: Number) -> Number:
        """Return the margin between a stem and the nearer pad.

        Args:
            off_m: Absolute offset of the claw centre from the cell centre along the row, m.
        """
        spec = self._spec
        gap_m = spec.gap_m - 1e-3 * spec.gap_foam * (np.asarray(self._foam_mm) - _FOAM_MM)
        return (gap_m - off_m) / spec.lean_sd_m

    def strip_margin(self, off_m: Number) -> Number:
        """Return the margin between a stem and the nearer edge of the strips.

        Args:
            off_m: Absolute offset of the claws from the centre of the column, m.
        """
        return (self._spec.strip_reach_m - off_m) / self._spec.lean_sd_m

    def slip_margin(self, force_n: Number) -> Number:
        """Return the margin of the grip over the force required to pull a plug.

        Args:
            force_n: Minimum force of a finger during the pull, N.
        """
        spec = self._spec
        friction = spec.friction * np.exp(spec.friction_age * self._age + spec.friction_age2 * self._age**2)
        spare_n = 2 * friction * self._yields * np.maximum(force_n, 0.0) - spec.plug_kg * _GRAVITY_M_S2
        margin: Number = np.log(np.maximum(spare_n, 1e-9) / spec.adhesion_n) / spec.adhesion_sd
        return margin

    def cut_margin(self, force_n: Number) -> Number:
        """Return the margin of the stem strength over the closing force.

        Args:
            force_n: Maximum force of a finger until the plug is out, N.
        """
        spec = self._spec
        strength = np.log(spec.cut_n / _FORCE_N) + spec.cut_age * self._age + spec.cut_age2 * self._age**2
        margin: Number = (strength + spec.cut_foam * self._foam - _log_force(force_n)) / spec.cut_sd
        return margin

    def break_margin(self, force_n: Number, held_s: Number) -> Number:
        """Return the margin of the endurance of a stem over the load while it is held.

        Args:
            force_n: Maximum force of a finger, N.
            held_s: Holding time, s.
        """
        spec = self._spec
        endurance = np.log(spec.endurance) + spec.endurance_age * self._age + spec.endurance_age2 * self._age**2
        pressure = spec.contact_force * _log_force(force_n) - spec.contact_foam * self._foam
        fatigue = spec.hold_exponent * np.log(np.maximum(held_s, 0.01) / _HELD_S)
        margin: Number = (endurance - pressure - fatigue) / spec.endurance_sd
        return margin

    def drift_sd_m(self, force_n: Number, fall_s: Number) -> Number:
        """Return the standard deviation of the landing position of a plug in either direction, m.

        Args:
            force_n: Maximum force of a finger while held, N.
            fall_s: Fall time, s.
        """
        spec = self._spec
        force = _log_force(force_n)
        crown_m = spec.crown_m * np.exp(spec.crown_age * self._age + spec.crown_age2 * self._age**2)
        sway_m = spec.sway_m * np.exp(-spec.sway_force * (force + np.log(self._yields)))
        stick_m = spec.stick_m * np.exp(
            spec.stick_force * force + spec.stick_foam * self._foam + spec.stick_age * self._age
        )
        drift_m: Number = np.sqrt(crown_m**2 + sway_m**2 + stick_m**2) * fall_s / _FALL_S
        return drift_m

    def is_missed(self, traits: Traits, *, along_m: float, across_m: float) -> bool:
        """Return True if the closing fingers miss a stem.

        Args:
            traits: Traits of the seedling.
            along_m: Offset of the claw centre from the cell along the row, m.
            across_m: Offset across the row, m.
        """
        lean_m = self._spec.lean_sd_m
        return bool(
            traits.height < -self.height_margin()
            or self.gap_margin(abs(along_m + lean_m * traits.lean_along)) < 0
            or self.strip_margin(abs(across_m + lean_m * traits.lean_across)) < 0
        )

    def is_cut(self, traits: Traits, force_n: float) -> bool:
        """Return True if closing and pulling cut a stem; arguments as in `cut_margin`."""
        return bool(traits.strength < -self.cut_margin(force_n))

    def slips(self, traits: Traits, force_n: float) -> bool:
        """Return True if a stem slips through the fingers and its plug stays; arguments as in `slip_margin`."""
        return bool(traits.grasp < -self.slip_margin(force_n))

    def breaks(self, traits: Traits, force_n: float, held_s: float) -> bool:
        """Return True if a held stem has broken; arguments as in `break_margin`."""
        return bool(traits.endurance < -self.break_margin(force_n, held_s))

    def drift_m(self, traits: Traits, force_n: float, fall_s: float) -> tuple[float, float]:
        """Return the landing offset of a plug along and across the row, m; arguments as in `drift_sd_m`."""
        sd_m = float(self.drift_sd_m(force_n, fall_s))
        return sd_m * traits.drift_along, sd_m * traits.drift_across


def _share(foam_mm: Number, spec: SeedlingSpec) -> Number:
    """Return the fraction of the finger force that reaches the stem; it decreases with foam thickness."""
    return 1 / (1 + (np.asarray(foam_mm) / spec.yield_mm) ** spec.yield_exponent)


def _log_force(force_n: Number) -> Number:
    """Return the logarithm of the ratio of a force to the reference force; forces below 1 mN count as 1 mN."""
    force: Number = np.log(np.maximum(force_n, 1e-3) / _FORCE_N)
    return force
