"""What a claw does to a stem and a plug: missing, cutting, slipping, breaking, drifting.

Each way to fail is a margin: by how many standard deviations of its own property a typical seedling is away from
failing. A seedling fails where its own deviation is worse than the margin, and the share of a population that fails
is the normal integral of the margin; `expectation` builds on that. Every function takes numbers or numpy arrays.

Where the pepper paper gives words only (MACHINE.md 5), the law is the simplest of that shape and its constants are
calibrated: see docs/seedling.md.
"""

from dataclasses import dataclass

import numpy as np

from plant_sim.crop.response import Number
from plant_sim.crop.traits import Traits
from plant_sim.spec import require_within

_GRAVITY_M_S2 = 9.80665
_AGE_D = 50.0  # the middle of the paper's design, in which ages are counted
_AGE_STEP_D = 5.0
_HEIGHT_AGE_D = 51.0  # the age at which the paper measured its seedlings
_FOAM_MM = 10.0
_FORCE_N = 8.0
_HELD_S = 12.5  # a row at 45 cups a minute, from grip to release
_FALL_S = 0.1277  # 80 mm of free fall


@dataclass(frozen=True, slots=True)
class SeedlingSpec:
    """Properties of pepper seedlings and of the foam that holds them.

    An `_age` and an `_age2` are the logarithmic change of a property for every 5 d from 50 d on, and that for the
    square of it; an `_sd` without a unit is the standard deviation of a logarithm. Forces are those of one finger.

    Attributes:
        height_m: Free stem below the lowest leaf at 51 d, m.
        height_sd_m: Its standard deviation, m.
        growth_mm_d: Its growth, mm/d.
        finger_height_m: Free stem that the fingers need, m.
        lean_sd_m: Standard deviation of where a stem stands, either way, m.
        gap_m: Half of the way free between the pads of open claws with foam of 10 mm, m.
        gap_foam: How much of additional foam narrows it.
        strip_reach_m: Half of the width of the strips, and what a stem gives way, m.
        yield_mm: Thickness of foam that takes half of the finger's force from the stem, mm.
        yield_exponent: How steeply it does.
        friction: Friction of foam on a stem at 50 d.
        friction_age: Its change with age.
        friction_age2: Its change with the square of it.
        adhesion_n: What holds a plug in its cell, median, N.
        adhesion_sd: Its spread.
        plug_kg: A plug with its seedling, kg.
        cut_n: Force that cuts a stem at 50 d, on foam of 10 mm, median, N.
        cut_sd: Its spread.
        cut_age: Its change with age.
        cut_age2: Its change with the square of it.
        cut_foam: Exponent with which foam protects the stem.
        endurance: Contact pressure that a stem at 50 d bears for 12.5 s, median; 1 is that of 8 N on foam of 10 mm.
        endurance_sd: Its spread.
        endurance_age: Its change with age.
        endurance_age2: Its change with the square of it.
        contact_force: Exponent of the contact pressure over the force; 0.5 for a cylinder on an elastic bed.
        contact_foam: Exponent of the contact pressure over the thickness of the foam, with the opposite sign.
        hold_exponent: Exponent with which endurance falls over the time held.
        crown_m: Drift of a falling plug by its leaves at 50 d, standard deviation either way, m.
        crown_age: Its change with age.
        crown_age2: Its change with the square of it.
        sway_m: Drift by swaying in a grip of 8 N on foam of 10 mm, m.
        sway_force: Exponent with which a firmer grip lessens it.
        stick_m: Drift by sticking to the foam after 8 N on 10 mm at 50 d, m.
        stick_force: Exponent of that over the force.
        stick_foam: Exponent of that over the thickness of the foam.
        stick_age: Its change with age.
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
        """Refuse impossible values."""
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
    """Seedlings of one age between pads of one thickness."""

    __slots__ = ("_age", "_foam", "_foam_mm", "_spec", "_yields")

    def __init__(self, spec: SeedlingSpec, *, foam_mm: Number, age_d: Number) -> None:
        """Take up a crop and the pads.

        Args:
            spec: Properties of seedlings and foam.
            foam_mm: Thickness of the foam, mm.
            age_d: Age of the seedlings, d.
        """
        self._spec = spec
        self._foam_mm = foam_mm
        self._age = (np.asarray(age_d) - _AGE_D) / _AGE_STEP_D
        self._foam = np.log(np.maximum(foam_mm, 0.1) / _FOAM_MM)  # without foam the laws of foam would have no bound
        self._yields = _share(foam_mm, spec) / _share(_FOAM_MM, spec)

    def height_margin(self) -> Number:
        """Margin of the free stem over what the fingers need."""
        spec = self._spec
        days = _AGE_STEP_D * self._age + _AGE_D - _HEIGHT_AGE_D
        return (spec.height_m + 1e-3 * spec.growth_mm_d * days - spec.finger_height_m) / spec.height_sd_m

    def gap_margin(self, off_m: Number) -> Number:
        """Margin of a stem towards the pad that stands nearer.

        Args:
            off_m: How far the middle of the claw is off the middle of the cell, along the row, without sign, m.
        """
        spec = self._spec
        gap_m = spec.gap_m - 1e-3 * spec.gap_foam * (np.asarray(self._foam_mm) - _FOAM_MM)
        return (gap_m - off_m) / spec.lean_sd_m

    def strip_margin(self, off_m: Number) -> Number:
        """Margin of a stem towards the edge of the strips that is nearer.

        Args:
            off_m: How far the claws stopped off the middle of the column, without sign, m.
        """
        return (self._spec.strip_reach_m - off_m) / self._spec.lean_sd_m

    def slip_margin(self, force_n: Number) -> Number:
        """Margin of the grip over what a plug needs to leave its cell.

        Args:
            force_n: Least force of a finger during the pull, N.
        """
        spec = self._spec
        friction = spec.friction * np.exp(spec.friction_age * self._age + spec.friction_age2 * self._age**2)
        spare_n = 2 * friction * self._yields * np.maximum(force_n, 0.0) - spec.plug_kg * _GRAVITY_M_S2
        margin: Number = np.log(np.maximum(spare_n, 1e-9) / spec.adhesion_n) / spec.adhesion_sd
        return margin

    def cut_margin(self, force_n: Number) -> Number:
        """Margin of a stem over the closing force.

        Args:
            force_n: Greatest force of a finger until the plug was out, N.
        """
        spec = self._spec
        strength = np.log(spec.cut_n / _FORCE_N) + spec.cut_age * self._age + spec.cut_age2 * self._age**2
        margin: Number = (strength + spec.cut_foam * self._foam - _log_force(force_n)) / spec.cut_sd
        return margin

    def break_margin(self, force_n: Number, held_s: Number) -> Number:
        """Margin of a stem over being held.

        Args:
            force_n: Greatest force of a finger, N.
            held_s: How long it has been held, s.
        """
        spec = self._spec
        endurance = np.log(spec.endurance) + spec.endurance_age * self._age + spec.endurance_age2 * self._age**2
        pressure = spec.contact_force * _log_force(force_n) - spec.contact_foam * self._foam
        tired = spec.hold_exponent * np.log(np.maximum(held_s, 0.01) / _HELD_S)
        margin: Number = (endurance - pressure - tired) / spec.endurance_sd
        return margin

    def drift_sd_m(self, force_n: Number, fall_s: Number) -> Number:
        """Standard deviation of where a plug comes down, either way, m.

        Args:
            force_n: Greatest force of a finger while it was held, N.
            fall_s: How long the plug fell, s.
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
        """Whether the fingers close beside a stem.

        Args:
            traits: The seedling.
            along_m: How far the middle of the claw is off the cell, along the row, m.
            across_m: The same across the row, m.
        """
        lean_m = self._spec.lean_sd_m
        return bool(
            traits.height < -self.height_margin()
            or self.gap_margin(abs(along_m + lean_m * traits.lean_along)) < 0
            or self.strip_margin(abs(across_m + lean_m * traits.lean_across)) < 0
        )

    def is_cut(self, traits: Traits, force_n: float) -> bool:
        """Whether closing and pulling cut a stem; arguments as in `cut_margin`."""
        return bool(traits.strength < -self.cut_margin(force_n))

    def slips(self, traits: Traits, force_n: float) -> bool:
        """Whether a stem slips through the fingers and its plug stays; arguments as in `slip_margin`."""
        return bool(traits.grasp < -self.slip_margin(force_n))

    def breaks(self, traits: Traits, force_n: float, held_s: float) -> bool:
        """Whether a held stem has broken by now; arguments as in `break_margin`."""
        return bool(traits.endurance < -self.break_margin(force_n, held_s))

    def drift_m(self, traits: Traits, force_n: float, fall_s: float) -> tuple[float, float]:
        """Where a plug comes down, off the point below the claw, along and across, m; arguments as in `drift_sd_m`."""
        sd_m = float(self.drift_sd_m(force_n, fall_s))
        return sd_m * traits.drift_along, sd_m * traits.drift_across


def _share(foam_mm: Number, spec: SeedlingSpec) -> Number:
    """Share of the finger's force that reaches the stem: thicker foam bends the strip less."""
    return 1 / (1 + (np.asarray(foam_mm) / spec.yield_mm) ** spec.yield_exponent)


def _log_force(force_n: Number) -> Number:
    """Logarithm of a force over the reference; no force counts as almost none."""
    force: Number = np.log(np.maximum(force_n, 1e-3) / _FORCE_N)
    return force
