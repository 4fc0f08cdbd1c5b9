"""Random blocks, grounds and releases within the plausible ranges of the parameters."""

import dataclasses
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from plant_sim.planter.contact import Fall, drop
from plant_sim.planter.ground import GroundSpec
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter

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
        behind_m: Distance of the block behind its nominal position, m.
        sticks: True if the block sticks to one plate and lodges across the row; such a fall is not simulated.
    """

    planter: Planter
    ground: GroundSpec
    opener_deg: float
    behind_m: float
    sticks: bool

    def fall(self, motion: Motion, opener_deg: float) -> Fall:
        """Simulate the fall of a block that does not stick.

        Args:
            motion: Motion of the planters.
            opener_deg: Nominal phase of the start of the opening, degrees; the deviation is added.
        """
        return drop(self.planter, self.ground, motion, opener_deg=opener_deg + self.opener_deg, behind_m=self.behind_m)


def draw(planter: Planter, ranges: Ranges, kind: Ground, rng: np.random.Generator) -> Draw:
    """Draw the values of one fall.

    Masses, coefficients and soil values are distributed uniformly over their ranges, and the positions of block and
    opener uniformly up to their largest deviations. On soil, the clearance below the tip is normally distributed, and a
    share of the blocks sticks.

    Args:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
        kind: Ground.
        rng: Random number generator.
    """
    drawn = {
        name: rng.uniform(*ranges[name])
        for name in sorted(ranges)
        if name.partition(".")[0] in ("block", kind) or name == "grip.guide_friction"
    }
    block, grip = _replaced(planter.block, "block", drawn), _replaced(planter.grip, "grip", drawn)
    ground = _replaced(getattr(planter, kind), kind, drawn)
    scatter, sticks = planter.scatter, False
    opener_deg, behind_m = scatter.opener_deg * rng.uniform(-1, 1), scatter.place_m * rng.uniform(-1, 1)
    if kind is Ground.SOIL:
        clearance_m = rng.normal(ground.clearance_m, scatter.clearance_sd_m)
        ground = dataclasses.replace(ground, clearance_m=float(np.clip(clearance_m, -0.02, 0.08)))
        sticks = bool(rng.uniform() < scatter.stick_share_at(grip.clamp_n))
    return Draw(dataclasses.replace(planter, block=block, grip=grip), ground, opener_deg, behind_m, sticks)


def _replaced(spec: Any, section: str, drawn: Mapping[str, float]) -> Any:
    """Return a spec with the drawn values of its section."""
    values = {name.partition(".")[2]: value for name, value in drawn.items() if name.partition(".")[0] == section}
    return dataclasses.replace(spec, **values)
