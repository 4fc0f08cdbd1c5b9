"""Shares of a population of seedlings that fail, by the same mechanics that decide over each of them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import chndtr, ndtr

from plant_sim.crop.mechanics import Mechanics
from plant_sim.crop.response import Number


@dataclass(frozen=True, slots=True)
class Motion:
    """How a machine handles its seedlings, as far as they feel it.

    Attributes:
        along_m: How far the claws are off the cells along the row when they close, m.
        across_m: The same across the row, m.
        force_n: Force of a finger, N.
        held_s: From grip to release, s.
        throw_along_m: How far the plugs are off the cups along the row when they come down, m.
        throw_across_m: The same across the row, m.
        fall_s: Time of the fall, s.
        catch_m: How far off its centre a plug still goes into a cup, m.
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
    """Expected shares of all seedlings, 0 to 1.

    Attributes:
        P: Lost while picking.
        D: Lost while carrying.
        T: Lost while throwing.
        missed: Not gripped.
        cut: Cut while picking; with `missed` and `slipped`, each taken alone, more than `P`.
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
        """Share that ends in a cup, %."""
        return 100 * (1 - self.P - self.D - self.T)


def expected(mechanics: Mechanics, motion: Motion) -> Shares:
    """Shares of a large population that fail.

    Args:
        mechanics: Crop and pads.
        motion: How the machine handles them.
    """
    seen = ndtr(mechanics.height_margin())
    for margin, off_m in (
        (mechanics.gap_margin, motion.along_m),
        (mechanics.strip_margin, motion.across_m),
    ):
        # a gap that the pads have closed lets nothing through
        seen = seen * np.maximum(1 - ndtr(-margin(off_m)) - ndtr(-margin(-np.asarray(off_m))), 0.0)
    cut = ndtr(-mechanics.cut_margin(motion.force_n))
    slipped = ndtr(-mechanics.slip_margin(motion.force_n))
    picked = seen * (1 - cut) * (1 - slipped)
    carried = picked * ndtr(mechanics.break_margin(motion.force_n, motion.held_s))
    sd_m = mechanics.drift_sd_m(motion.force_n, motion.fall_s)
    off = np.hypot(motion.throw_along_m, motion.throw_across_m) / sd_m
    beside = 1 - chndtr((motion.catch_m / sd_m) ** 2, 2, off**2)  # two normal errors about a point that is off
    return Shares(1 - picked, picked - carried, carried * beside, 1 - seen, cut, slipped)
