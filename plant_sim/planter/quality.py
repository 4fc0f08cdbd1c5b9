"""Shares of lodged and injured seedlings from the regression equations of the cabbage paper's bench test.

Equations 10 and 11 describe blocks of 40 mm with cabbage seedlings. They are not valid for plugs of pepper seedlings.

The paper tested each factor at five levels and searched for the optimum at codes from -1 to 1. A setting beyond the
tested levels is extrapolated. The claimed optimum, whose force has a code of -1.455, is not: it is within the tested
levels, but outside the range stated for the search (docs/sources/machine.md 7).
"""

from functools import cache
from typing import Final, NamedTuple

import numpy as np

from plant_sim.common.paper_sheet import cabbage_coding, equation, sheet
from plant_sim.common.polynomial import Polynomial

STATED_CODE: Final = 1.0
"""Largest code in the paper's search for the optimum. Source: cabbage paper, equation 12."""

_ROUNDING = 1e-9


class Share(NamedTuple):
    """Share of the seedlings.

    Attributes:
        value: Share, 0 to 1; values of the equation below 0 or above 1 are replaced by 0 or 1.
        extrapolated: True if a factor is beyond its tested levels.
    """

    value: float
    extrapolated: bool


def lodging_share(speed_km_h: float, frequency_per_min: float, force_n: float) -> Share:
    """Return the share of lodged cabbage blocks from equation 10; not valid for pepper plugs.

    Args:
        speed_km_h: Speed of the machine, km/h.
        frequency_per_min: Planting frequency, 1/min.
        force_n: Force of the inner plates, N.
    """
    return _share("cabbage-equation-10", "Y1", speed_km_h, frequency_per_min, force_n)


def injury_share(speed_km_h: float, frequency_per_min: float, force_n: float) -> Share:
    """Return the share of injured cabbage blocks from equation 11; not valid for pepper plugs.

    Args:
        speed_km_h: Speed of the machine, km/h.
        frequency_per_min: Planting frequency, 1/min.
        force_n: Force of the inner plates, N.
    """
    return _share("cabbage-equation-11", "Y2", speed_km_h, frequency_per_min, force_n)


def codes(speed_km_h: float, frequency_per_min: float, force_n: float) -> tuple[float, float, float]:
    """Return the coded levels X1 to X3 of a setting."""
    values = (speed_km_h, frequency_per_min, force_n)
    x1, x2, x3 = ((value - centre) / step for value, (centre, step) in zip(values, _coding(), strict=True))
    return x1, x2, x3


def is_tested_force(force_n: float) -> bool:
    """Return True for a force of the inner plates within the tested levels."""
    lowest_n, highest_n = tested_forces_n()
    return lowest_n - _ROUNDING <= force_n <= highest_n + _ROUNDING


def tested_forces_n() -> tuple[float, float]:
    """Return the lowest and the highest tested force of the inner plates, N."""
    centre_n, step_n = _coding()[2]
    reach_n = step_n * largest_codes()[2]
    return centre_n - reach_n, centre_n + reach_n


@cache
def largest_codes() -> tuple[float, float, float]:
    """Return the largest tested code of each factor.

    This is the axial code of Table 2, 1.682, or the code of the outermost level in Table 1 if that is larger. For the
    frequency, whose levels are integers, it is 2.
    """
    axial = float(np.abs(sheet("cabbage-table-2").points("X1", "X2", "X3")).max())
    levels = sheet("cabbage-table-1").points("speed_km_h", "frequency_per_min", "force_n")
    centres, steps = np.array(_coding()).T
    x1, x2, x3 = np.maximum(np.abs((levels - centres) / steps).max(axis=0), axial).tolist()
    return x1, x2, x3


@cache
def _coding() -> tuple[tuple[float, float], ...]:
    return cabbage_coding()


@cache
def _equation(name: str, response: str) -> Polynomial:
    return Polynomial(equation(name, response))


def _share(name: str, response: str, speed_km_h: float, frequency_per_min: float, force_n: float) -> Share:
    coded = np.array(codes(speed_km_h, frequency_per_min, force_n))
    percent = float(_equation(name, response).predict(coded)[0])
    is_outside = bool((np.abs(coded) > np.array(largest_codes()) + _ROUNDING).any())
    return Share(min(1.0, max(0.0, percent / 100)), is_outside)
