"""Ground below the planter, and random variation from block to block."""

import math
from dataclasses import dataclass

from plant_sim.common.limits import require_within
from plant_sim.planter.block import BlockSpec


@dataclass(frozen=True, slots=True)
class GroundSpec:
    """Parameters of one kind of ground.

    The bottom of the furrow is a plane. Loose soil covers the lower part of a standing block on all sides. It is
    perfectly plastic: it resists with a constant pressure on the front or rear face of the block. The pressure acts in
    one direction over the full height of the soil against displacement, and in opposite directions on its upper and
    lower halves against tilting.

    Attributes:
        clearance_m: Height of the tip above the bottom of the furrow at the lowest point, m; negative if the tip
            passes below it.
        friction: Coefficient of friction between block and ground.
        restitution: Coefficient of restitution.
        cover_m: Height of the loose soil around the base of the block, m; 0 without loose soil.
        resistance_pa: Horizontal resistance of the loose soil per area of a face of the block, Pa.
    """

    clearance_m: float
    friction: float
    restitution: float
    cover_m: float
    resistance_pa: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, -0.05, 0.1, "clearance_m")
        require_within(self, 0.0, 2.0, "friction")
        require_within(self, 0.0, 0.9, "restitution")
        require_within(self, 0.0, 0.1, "cover_m")
        require_within(self, 0.0, 1e5, "resistance_pa")

    def soil_n(self, block: BlockSpec) -> float:
        """Return the resistance of the loose soil to a horizontal displacement, N."""
        return self.resistance_pa * self.cover_m * block.edge_m

    def soil_nm(self, block: BlockSpec) -> float:
        """Return the resistance of the loose soil to tilting, N m."""
        return self.soil_n(block) * self.cover_m / 4


@dataclass(frozen=True, slots=True)
class ScatterSpec:
    """Random variation from block to block.

    On soil, a share of the blocks sticks to one plate, which swings sideways and tips the block across the row. Every
    such block is assumed to lodge. The share is a power function of the clamp force. A block is injured if the clamp
    force exceeds its strength, which is normally distributed.

    Attributes:
        place_m: Largest distance of a block from its nominal position in the planter, m.
        opener_deg: Largest deviation of the start of the opening, degrees.
        pitch_deg: Largest angle of the stem of a gripped block from the vertical, in the direction of travel, degrees.
        roll_deg: Largest angle of the stem of a gripped block from the vertical, across the row, degrees.
        uneven_s: Largest delay between the two plates at the opening, s.
        slope_deg: Largest slope of the bottom of the furrow in the direction of travel, degrees.
        clearance_sd_m: Standard deviation of the clearance between the tip and the bottom of the furrow, on soil, m.
        stick_share: Share of the blocks that stick at the clamp force `stick_n`.
        stick_n: Clamp force to which `stick_share` applies, N.
        stick_exponent: Exponent of the clamp force in this share.
        strength_n: Mean strength of a block: the clamp force at which it is injured, N.
        strength_sd_n: Standard deviation of the strength, N.
    """

    place_m: float
    opener_deg: float
    pitch_deg: float
    roll_deg: float
    uneven_s: float
    slope_deg: float
    clearance_sd_m: float
    stick_share: float
    stick_n: float
    stick_exponent: float
    strength_n: float
    strength_sd_n: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.0, 0.02, "place_m", "clearance_sd_m")
        require_within(self, 0.0, 45.0, "opener_deg")
        require_within(self, 0.0, 20.0, "pitch_deg", "roll_deg", "slope_deg")
        require_within(self, 0.0, 0.1, "uneven_s")
        require_within(self, 0.0, 1.0, "stick_share")
        require_within(self, 1.0, 1000.0, "stick_n")
        require_within(self, -20.0, 20.0, "stick_exponent")
        require_within(self, 1.0, 2000.0, "strength_n", "strength_sd_n")

    def stick_share_at(self, clamp_n: float) -> float:
        """Return the share of the blocks that stick to a plate at a clamp force."""
        return min(1.0, self.stick_share * math.pow(clamp_n / self.stick_n, self.stick_exponent))

    def injured_share_at(self, clamp_n: float) -> float:
        """Return the share of the blocks that a clamp force injures."""
        return math.erfc((self.strength_n - clamp_n) / (self.strength_sd_n * math.sqrt(2))) / 2
