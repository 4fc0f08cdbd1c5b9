"""Verdict on a planted block, from its posture and its displacement by the guide plate.

The limits are assumptions. The paper describes its three simulated cases in words only (2.2.2) and does not define
lodging. In the Chinese standard for dryland transplanters, JB/T 10291, a seedling is lodged if its stem is less than
30 degrees from the ground (quoted from memory, not verified).
"""

from enum import IntEnum, StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

TILTED_DEG: Final = 30.0
"""Smallest angle of the stem from the vertical at which a seedling counts as tilted, degrees."""
LODGED_DEG: Final = 60.0
"""Smallest angle of the stem from the vertical at which a seedling counts as lodged, degrees."""
PUSHED_M: Final = 0.001
"""Displacement on the ground above which a block counts as pushed, m."""


class Stand(IntEnum):
    """Posture of a planted seedling."""

    UPRIGHT = 0
    TILTED = 1
    LODGED = 2


class FallVerdict(StrEnum):
    """Verdict on one fall, based on the paper's three simulated cases."""

    CLEAN = "clean and upright"
    """Upright and not pushed, as in the paper's case at a ratio of 1.17."""
    PUSHED = "scraped and pushed, upright"
    """Upright and pushed by the guide plate, as in the paper's case at a ratio of 1."""
    TILTED = "tilted"
    FORWARD = "scraped and tipped forward"
    """Lodged in the direction of travel, as in the paper's case at a ratio of 0.87."""
    BACKWARD = "tipped backward"


def stand_of(tilt_deg: NDArray[np.float64]) -> NDArray[np.int8]:
    """Return the `Stand` code of each tilt angle.

    >>> stand_of(np.array([-29.0, 30.0, -61.0])).tolist()
    [0, 1, 2]
    """
    size = np.abs(tilt_deg)
    return np.where(size >= LODGED_DEG, Stand.LODGED, np.where(size >= TILTED_DEG, Stand.TILTED, Stand.UPRIGHT)).astype(
        np.int8
    )


def verdict_of(tilt_deg: float, pushed_m: float) -> FallVerdict:
    """Return the verdict on one fall.

    Args:
        tilt_deg: Angle of the stem from the vertical at rest, forward positive, degrees.
        pushed_m: Displacement by the guide plate from the first contact with the ground until rest, m.
    """
    return FallVerdict(str(verdicts_of(np.array(tilt_deg), np.array(pushed_m))))


def margin_of(verdict: FallVerdict, tilt_deg: float, pushed_m: float) -> float:
    """Return the signed distance of a fall from the limits of a verdict, positive if the fall has the verdict.

    The distance is the smaller one of tilt and displacement, each as a share of its limit, and is at most 1.

    Args:
        verdict: `CLEAN`, `PUSHED` or `FORWARD`.
        tilt_deg: Angle of the stem from the vertical at rest, forward positive, degrees.
        pushed_m: Displacement by the guide plate from the first contact with the ground until rest, m.

    >>> margin_of(FallVerdict.CLEAN, -3.0, 0.0005), margin_of(FallVerdict.PUSHED, 0.0, 0.0005)
    (0.5, -0.5)
    """
    if verdict is FallVerdict.FORWARD:
        margin = (tilt_deg - LODGED_DEG) / TILTED_DEG
    else:
        further = (abs(pushed_m) - PUSHED_M) / PUSHED_M
        margin = min(1.0 - abs(tilt_deg) / TILTED_DEG, further if verdict is FallVerdict.PUSHED else -further)
    return max(-1.0, min(1.0, margin))


def verdicts_of(tilt_deg: NDArray[np.float64], pushed_m: NDArray[np.float64]) -> NDArray[np.str_]:
    """Return the value of the `FallVerdict` of each fall.

    Args:
        tilt_deg: Angles of the stem from the vertical at rest, forward positive, degrees.
        pushed_m: Displacements by the guide plate from the first contact with the ground until rest, m.

    >>> verdicts_of(np.array([80.0, -80.0]), np.array([0.02, 0.0])).tolist()
    ['scraped and tipped forward', 'tipped backward']
    """
    stand = stand_of(tilt_deg)
    cases = [(stand == Stand.LODGED) & (tilt_deg > 0.0), stand == Stand.LODGED, stand == Stand.TILTED]
    verdicts = [FallVerdict.FORWARD, FallVerdict.BACKWARD, FallVerdict.TILTED]
    upright = np.where(np.abs(pushed_m) > PUSHED_M, FallVerdict.PUSHED.value, FallVerdict.CLEAN.value)
    return np.select(cases, [np.array(each.value) for each in verdicts], upright)
