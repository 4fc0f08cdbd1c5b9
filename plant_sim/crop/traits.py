"""What makes one seedling differ from the next."""

import random
from typing import NamedTuple


class Traits(NamedTuple):
    """How a seedling differs from the typical one of its age, in standard deviations of each property.

    Attributes:
        height: Free stem below the lowest leaf; more is taller.
        lean_along: Where the stem stands between the fingers, along the row.
        lean_across: Where it stands along the strips, across the row.
        grasp: How little its plug clings to the cell; more comes out more easily.
        strength: Force that cuts the stem while the claws close and pull.
        endurance: Contact pressure that the stem bears while it is carried.
        drift_along: Where its plug comes down, along the row.
        drift_across: Where its plug comes down, across the row.
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
"""A seedling in the middle of everything."""


def draw_traits(draws: random.Random) -> Traits:
    """Draw a seedling from its population.

    Args:
        draws: Source of all draws.
    """
    return Traits(*(draws.gauss(0.0, 1.0) for _ in Traits._fields))
