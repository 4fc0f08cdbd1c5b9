"""Expected failure rates of a seedling population, computed with the laws for individual seedlings."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import chndtr, ndtr

from plant_sim.crop.mechanics import Mechanics
from plant_sim.crop.response import Number


@dataclass(frozen=True, slots=True)
class HandlingMotion:
    """Motion and forces to which the seedlings are subjected.

    Attributes:
        along_m: Offset of the claws from the cells along the row at closing, m.
        across_m: Offset across the row, m.
        force_n: Force of a finger, N.
        held_s: Time from grip to release, s.
        throw_along_m: Offset of the plugs from the cups along the row at landing, m.
        throw_across_m: Offset across the row at landing, m.
        fall_s: Fall time, s.
        catch_m: Largest distance from the centre of a cup at which a plug still falls into it, m.
    """

    along_m: Number
    across_m: Number
    force_n: Number
    held_s: Number
    throw_along_m: Number
    throw_across_m: Number
    fall_s: Number
    catch_m: float


class Shares(NamedTuple):
    """Expected fractions of all seedlings, 0 to 1.

    Attributes:
        P: Lost while picking.
        D: Lost while carrying.
        T: Lost while throwing, the papers' term for the release over the cups.
        missed: Not gripped.
        cut: Cut while picking. The fractions `missed`, `cut` and `slipped` overlap, so their sum exceeds `P`.
        slipped: Plug not pulled out.
    """

    P: Number
    D: Number
    T: Number
    missed: Number
    cut: Number
    slipped: Number

    @property
    def success_percent(self) -> Number:
        """Percentage of seedlings in cups."""
        return 100 * (1 - self.P - self.D - self.T)


def expected(mechanics: Mechanics, motion: HandlingMotion) -> Shares:
    """Return the expected failure rates of a large population.

    Args:
        mechanics: Crop and pads.
        motion: Motion and forces of the machine.
    """
    seen = ndtr(mechanics.height_margin())
    for margin, off_m in (
        (mechanics.gap_margin, motion.along_m),
        (mechanics.strip_margin, motion.across_m),
    ):
        # if the pads close the gap, no stem fits between them
        seen = seen * np.maximum(1 - ndtr(-margin(off_m)) - ndtr(-margin(-np.asarray(off_m))), 0.0)
    cut = ndtr(-mechanics.cut_margin(motion.force_n))
    slipped = ndtr(-mechanics.slip_margin(motion.force_n))
    picked = seen * (1 - cut) * (1 - slipped)
    carried = picked * ndtr(mechanics.break_margin(motion.force_n, motion.held_s))
    sd_m = mechanics.drift_sd_m(motion.force_n, motion.fall_s)
    off = np.hypot(motion.throw_along_m, motion.throw_across_m) / sd_m
    beside = 1 - chndtr((motion.catch_m / sd_m) ** 2, 2, off**2)  # two normal deviations, with an offset mean
    return Shares(1 - picked, picked - carried, carried * beside, 1 - seen, cut, slipped)
