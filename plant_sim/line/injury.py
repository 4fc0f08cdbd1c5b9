"""Injury of cabbage blocks in a chain planter, by equation 11 of the cabbage paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from plant_sim.line.ground import Floats
from plant_sim.line.row import Flags
from plant_sim.planter.quality import injury_share

_SPEED_STEP_M_S: Final = 0.001
_FREQUENCY_STEP_PER_MIN: Final = 0.1
"""Resolution of the frequency; rounding changes the injured share by less than 0.05 percentage points."""
_KM_H: Final = 3.6


class InjuryShares(NamedTuple):
    """Injured shares of several blocks, as arrays of equal length.

    Attributes:
        value: Injured share, 0 to 1.
        within: True if speed and frequency are within the levels of the bench test.
    """

    value: Floats
    within: Flags


@dataclass(frozen=True, slots=True)
class CabbageInjury:
    """Injury at one clamp force; valid for cabbage blocks only.

    Attributes:
        clamp_n: Clamp force, N.
    """

    clamp_n: float

    def shares(self, speed_m_s: Floats, frequency_per_min: Floats) -> InjuryShares:
        """Return the injured share at each ground speed and planting frequency."""
        steps = np.array((_SPEED_STEP_M_S, _FREQUENCY_STEP_PER_MIN))
        settings = np.rint(np.column_stack((speed_m_s, frequency_per_min)) / steps)
        unique, place = np.unique(settings, axis=0, return_inverse=True)
        shares = [
            injury_share(_KM_H * speed, frequency, self.clamp_n) for speed, frequency in (unique * steps).tolist()
        ]
        value = np.array([share.value for share in shares])
        extrapolated = np.array([share.extrapolated for share in shares], dtype=np.bool_)
        return InjuryShares(value[place.ravel()], ~extrapolated[place.ravel()])
