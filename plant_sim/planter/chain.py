"""Parameters of the chain, and of the points of a planter that the kinematics require."""

import math
from dataclasses import dataclass

from plant_sim.common.limits import require, require_within

Offset = tuple[float, float]
"""Position of a point of a planter relative to its hinge, (forward, up), m."""


@dataclass(frozen=True, slots=True)
class ChainSpec:
    """Parameters of the chain.

    The planters hang from hinges on the chain, evenly spaced. Two equal sprockets, one above the other, guide the
    chain.

    Attributes:
        sprocket_radius_m: Pitch radius R of the sprockets, m.
        centre_distance_m: Distance H between the centres of the sprockets, m.
        planters: Number of planters on the chain.
        teeth: Number of teeth of each sprocket.
        span_part: Part of a link by which the distance between the centres exceeds a whole number of links.
        offset_m: Horizontal distance l of the tip from the pitch line of the chain, m.
        tip_height_m: Distance h of the tip below the hinge, m.
        guide_behind_m: Distance of the guide plate behind the tip, m.
        guide_above_m: Height of the lower edge of the guide plate above the tip, m.
        axle_height_m: Height of the centre of the lower sprocket above the soil surface, m.
        block_top_m: Height of the top of a gripped block above the tip, m.
        release_deg: Phase on the bottom arc at which the opener releases the block, degrees.
    """

    sprocket_radius_m: float
    centre_distance_m: float
    planters: int
    teeth: int
    span_part: float
    offset_m: float
    tip_height_m: float
    guide_behind_m: float
    guide_above_m: float
    axle_height_m: float
    block_top_m: float
    release_deg: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.02, 0.5, "sprocket_radius_m")
        require_within(self, 0.1, 5.0, "centre_distance_m")
        require_within(self, 1, 100, "planters")
        require_within(self, 6, 200, "teeth")
        require_within(self, 0.0, 1.0, "span_part")
        require_within(self, 0.0, 0.5, "offset_m")
        require_within(self, 0.01, 1.0, "tip_height_m")
        require_within(self, 0.0, 0.2, "guide_behind_m", "guide_above_m")
        require_within(self, 0.0, 2.0, "axle_height_m")
        require_within(self, 0.01, 0.2, "block_top_m")
        require_within(self, 0.0, 180.0, "release_deg")
        require(
            self.guide_behind_m < self.sprocket_radius_m + self.offset_m,
            "guide_behind_m",
            "must be less than the sum of sprocket_radius_m and offset_m",
        )

    @property
    def loop_m(self) -> float:
        """Length of the chain, m."""
        return 2 * math.pi * self.sprocket_radius_m + 2 * self.centre_distance_m

    @property
    def link_m(self) -> float:
        """Distance between two pins of the chain, m: the side of the polygon on the sprockets."""
        return 2 * self.sprocket_radius_m * math.sin(math.pi / self.teeth)

    @property
    def pitch_m(self) -> float:
        """Distance between two planters along the chain, m."""
        return self.loop_m / self.planters

    @property
    def tip(self) -> Offset:
        """Position of the tip relative to the hinge.

        The paper does not state the sign of l; it is assumed that the tip is in front of the hinge.
        """
        return self.offset_m, -self.tip_height_m

    @property
    def guide(self) -> Offset:
        """Position of the lower edge of the guide plate relative to the hinge."""
        return self.offset_m - self.guide_behind_m, self.guide_above_m - self.tip_height_m
