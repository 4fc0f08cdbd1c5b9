"""Random blocks, grounds and releases within the plausible ranges of the parameters."""

import dataclasses
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from plant_sim.planter.contact import Disturbance, Fall, drop
from plant_sim.planter.ground import GroundSpec
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter
from plant_sim.planter.roll import final_roll_deg

Ranges = Mapping[str, tuple[float, float]]
"""Plausible ranges by dotted name, from `plant_sim.planter.parameters.load_ranges`."""


class Ground(StrEnum):
    """Section of ``planter.yaml`` that describes the ground."""

    RIGID = "rigid_ground"
    """Rigid ground, as in the paper's simulation."""
    SOIL = "bench_soil"
    """Soil of the bench test: the depth of the furrow varies, and some blocks stick to a plate."""


class Draw(NamedTuple):
    """Random values of one fall.

    Attributes:
        planter: Planter with the drawn masses and coefficients.
        ground: Ground with the drawn values.
        opener_deg: Deviation of the release from the position of the opener, degrees.
        disturbance: Deviations of the block, the plates and the ground.
        sticks: True if the block sticks to one plate and lodges across the row; such a fall is not simulated.
    """

    planter: Planter
    ground: GroundSpec
    opener_deg: float
    disturbance: Disturbance
    sticks: bool

    def fall(self, motion: Motion, opener_deg: float) -> Fall:
        """Simulate the fall, in the plane of travel, of a block that does not stick.

        Args:
            motion: Motion of the planters.
            opener_deg: Nominal phase of the start of the opening, degrees; the deviation is added.
        """
        start_deg = opener_deg + self.opener_deg
        return drop(self.planter, self.ground, motion, opener_deg=start_deg, disturbance=self.disturbance)

    def roll_deg(self, motion: Motion, opener_deg: float) -> float:
        """Simulate the fall across the row; return the angle of the stem from the vertical at rest, degrees.

        Args:
            motion: Motion of the planters.
            opener_deg: Nominal phase of the start of the opening, degrees; the deviation is added.
        """
        start_deg = opener_deg + self.opener_deg
        return final_roll_deg(self.planter, self.ground, motion, self.disturbance, opener_deg=start_deg)


def draw(planter: Planter, ranges: Ranges, kind: Ground, rng: np.random.Generator) -> Draw:
    """Draw the values of one fall: what varies from block to block.

    Masses, coefficients and soil values are distributed uniformly over their ranges, and the deviations of block,
    opener, plates and ground uniformly up to the largest ones of the section ``scatter``. On soil, the clearance below
    the tip is normally distributed, and a share of the blocks sticks.

    Args:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
        kind: Ground.
        rng: Random number generator.
    """
    drawn = {name: rng.uniform(*ranges[name]) for name in sorted(ranges) if _varies(name, kind)}
    changed = replaced(planter, drawn)
    ground: GroundSpec = getattr(changed, kind)
    scatter, sticks = planter.scatter, False
    opener_deg, behind_m = scatter.opener_deg * rng.uniform(-1, 1), scatter.place_m * rng.uniform(-1, 1)
    if kind is Ground.SOIL:
        clearance_m = rng.normal(ground.clearance_m, scatter.clearance_sd_m)
        ground = dataclasses.replace(ground, clearance_m=float(np.clip(clearance_m, -0.02, 0.08)))
        sticks = bool(rng.uniform() < scatter.stick_share_at(planter.grip.clamp_n))
    pitch, roll, slope = rng.uniform(-1, 1, 3).tolist()
    disturbance = Disturbance(
        behind_m,
        pitch_deg=scatter.pitch_deg * pitch,
        roll_deg=scatter.roll_deg * roll,
        uneven_s=scatter.uneven_s * rng.uniform(),
        slope_deg=scatter.slope_deg * slope,
    )
    return Draw(changed, ground, opener_deg, disturbance, sticks)


def replaced(planter: Planter, values: Mapping[str, float]) -> Planter:
    """Return a planter with drawn values by dotted name; a whole number is rounded."""
    sections: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        section, _, key = name.partition(".")
        is_whole = isinstance(getattr(getattr(planter, section), key), int)
        sections.setdefault(section, {})[key] = round(value) if is_whole else value
    changed: dict[str, Any] = {
        section: dataclasses.replace(getattr(planter, section), **drawn) for section, drawn in sections.items()
    }
    return dataclasses.replace(planter, **changed)


def _varies(name: str, kind: Ground) -> bool:
    """Return True for a parameter that varies from block to block; the mean clearance belongs to the machine."""
    section, _, key = name.partition(".")
    return name == "grip.guide_friction" or section == "block" or (section == kind and key != "clearance_m")
