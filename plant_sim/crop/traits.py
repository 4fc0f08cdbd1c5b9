"""Individual deviations of a seedling."""

import random
from typing import NamedTuple


class Traits(NamedTuple):
    """Deviations from the typical seedling of the same age, in standard deviations of each property.

    Attributes:
        height: Length of free stem below the lowest leaf; positive is taller.
        lean_along: Stem position between the fingers, along the row.
        lean_across: Stem position along the strips, across the row.
        grasp: Ease of plug extraction; positive means that the plug comes out more easily.
        strength: Force that cuts the stem while the claws close and pull.
        endurance: Contact pressure that the stem endures while carried.
        drift_along: Landing position of the plug along the row.
        drift_across: Landing position of the plug across the row.
    """

    height: float
    lean_along: float
    lean_across: float
    grasp: float
    strength: float
    endurance: float
    drift_along: float
    drift_across: float


TYPICAL = Traits(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""The typical seedling."""


def draw_traits(draws: random.Random) -> Traits:
    """Draw the traits of a seedling from its population.

    Args:
        draws: Random generator.
    """
    return Traits(*(draws.gauss(0.0, 1.0) for _ in Traits._fields))
