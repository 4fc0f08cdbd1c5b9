"""Grip of the inner plates on a block, and its release by the opener.

The plates grip the block across the plane of travel. The block is assumed to be linearly elastic:
the force is the stiffness times the compression, up to the force that crushes the block. The clamp springs are soft
compared with the block, so the compression depends on the clamp force only. At the opener the plates move apart at
constant speed, the second one possibly later than the first. The force falls to zero while the block expands, and the
block is free from then on.

Source: cabbage paper, 2.2.1 (opening 45 mm, peak forces 89.95 to 119.29 N in Fig. 6); force law and speeds are assumed.
"""

from dataclasses import dataclass

from plant_sim.common.limits import require, require_within
from plant_sim.planter.block import BlockSpec
from plant_sim.planter.separation import GRAVITY_M_S2


@dataclass(frozen=True, slots=True)
class GripSpec:
    """Parameters of the inner plates and of the opener.

    Attributes:
        clamp_n: Force of each inner plate on the block, N.
        stiffness_n_m: Force per compression of the block, N/m.
        friction: Coefficient of friction between plate and block.
        guide_friction: Coefficient of friction between guide plate and block.
        opening_m: Distance between the open plates, m.
        opening_m_s: Speed of each plate while the opener moves it, m/s.
        crush_low_n: Smallest peak force at which a block is crushed, N.
        crush_high_n: Largest peak force at which a block is crushed, N.
    """

    clamp_n: float
    stiffness_n_m: float
    friction: float
    guide_friction: float
    opening_m: float
    opening_m_s: float
    crush_low_n: float
    crush_high_n: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.0, 1000.0, "clamp_n", "crush_low_n", "crush_high_n")
        require_within(self, 1e3, 1e6, "stiffness_n_m")
        require_within(self, 0.05, 2.0, "friction", "guide_friction")
        require_within(self, 0.01, 0.2, "opening_m")
        require_within(self, 0.01, 5.0, "opening_m_s")
        require(self.crush_low_n <= self.crush_high_n, "crush_low_n", "must not exceed crush_high_n")

    @property
    def compression_m(self) -> float:
        """Compression of the gripped block, m."""
        return self.clamp_n / self.stiffness_n_m

    @property
    def free_s(self) -> float:
        """Time from the start of the opening until the plates no longer touch the block, s."""
        return self.free_after_s(0.0)

    def free_after_s(self, uneven_s: float) -> float:
        """Return the time from the start of the opening until the plates no longer touch the block, s.

        Args:
            uneven_s: Delay of the second plate, s.
        """
        alone_s = self.compression_m / self.opening_m_s
        return alone_s if uneven_s >= alone_s else (alone_s + uneven_s) / 2

    def sideways_m_s(self, uneven_s: float) -> float:
        """Return the speed of the block across the row when it is free, m/s.

        A compressed block is always in the middle between the plates: its stiffness moves it within a millisecond. It
        moves at half the speed of the first plate until the second plate starts.

        Args:
            uneven_s: Delay of the second plate, s.
        """
        return self.opening_m_s / 2 if uneven_s >= self.compression_m / self.opening_m_s else 0.0

    def open_s(self, block: BlockSpec) -> float:
        """Return the time from the start of the opening until the plates are fully open, s."""
        return (self.opening_m - block.edge_m + self.compression_m) / (2 * self.opening_m_s)

    def clearance_m(self, block: BlockSpec) -> float:
        """Return the clearance on each side of the block between the open plates, m."""
        return (self.opening_m - block.edge_m) / 2

    def force_n(self, since_s: float, uneven_s: float = 0.0) -> float:
        """Return the force of each plate on the block, N.

        Args:
            since_s: Time since the start of the opening, s; negative before it.
            uneven_s: Delay of the second plate, s.
        """
        opened_m = self.opening_m_s * (max(0.0, since_s) + max(0.0, since_s - uneven_s))
        return max(0.0, self.stiffness_n_m * (self.compression_m - opened_m))

    def holds(self, block: BlockSpec, acceleration_m_s2: float) -> bool:
        """Return True if the friction at both plates holds the block at an upward acceleration."""
        return 2 * self.friction * self.clamp_n >= block.mass_kg * (GRAVITY_M_S2 + acceleration_m_s2)

    def crushed_share(self) -> float:
        """Return the fraction of blocks whose peak force is below the clamp force.

        The peak force is assumed to be uniformly distributed between the limits of the paper.
        """
        if self.crush_low_n == self.crush_high_n:
            return float(self.clamp_n > self.crush_low_n)
        share = (self.clamp_n - self.crush_low_n) / (self.crush_high_n - self.crush_low_n)
        return min(1.0, max(0.0, share))
