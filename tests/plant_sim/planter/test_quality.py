"""Tests of equations 10 and 11 of the cabbage paper: values, clipping and extrapolation."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from plant_sim.common.paper_sheet import equation
from plant_sim.planter.quality import STATED_CODE, Share, codes, injury_share, largest_codes, lodging_share

CENTRE = (1.75, 58.0, 104.62)
STEP = (0.15, 1.0, 8.79)
CLAIMED = (1.6, 57.0, 91.83)


def setting(*coded: float) -> tuple[float, float, float]:
    speed, frequency, force = (centre + step * code for centre, step, code in zip(CENTRE, STEP, coded, strict=True))
    return speed, frequency, force


def test_the_constants_of_the_equations_are_the_shares_at_the_centre() -> None:
    assert lodging_share(*CENTRE).value == pytest.approx(equation("cabbage-equation-10", "Y1")["1"] / 100)
    assert injury_share(*CENTRE).value == pytest.approx(0.0408)
    assert not lodging_share(*CENTRE).extrapolated


@pytest.mark.parametrize(
    ("coded", "lodging", "injury"),
    [
        ((-1, -1, -1), 0.0291, 0.028_86),
        ((-1, -1, 1), 0.0259, 0.040_46),
        ((1, 1, 1), 0.0877, 0.060_14),
    ],
)
def test_shares_at_corners_of_the_stated_range(coded: tuple[float, ...], lodging: float, injury: float) -> None:
    """The equations give the values computed manually from the printed coefficients."""
    assert lodging_share(*setting(*coded)).value == pytest.approx(lodging, abs=5e-5)
    assert injury_share(*setting(*coded)).value == pytest.approx(injury, abs=5e-5)


def test_the_claimed_optimum_is_outside_the_stated_range_but_not_extrapolated() -> None:
    assert codes(*CLAIMED) == pytest.approx((-1.0, -1.0, -1.455), abs=5e-4)
    assert abs(codes(*CLAIMED)[2]) > STATED_CODE
    for share, value in ((lodging_share(*CLAIMED), 0.0298), (injury_share(*CLAIMED), 0.0262)):
        assert share.value == pytest.approx(value, abs=5e-5)
        assert not share.extrapolated


@pytest.mark.parametrize("share", [lodging_share, injury_share])
@pytest.mark.parametrize("factor", range(3))
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_factor_beyond_its_tested_levels_is_marked(
    share: Callable[[float, float, float], Share], factor: int, sign: int
) -> None:
    assert largest_codes() == (1.682, 2.0, 1.682)
    coded = [0.0, 0.0, 0.0]
    coded[factor] = sign * largest_codes()[factor]
    assert not share(*setting(*coded)).extrapolated
    coded[factor] = sign * (largest_codes()[factor] + 0.001)
    assert share(*setting(*coded)).extrapolated


@pytest.mark.parametrize(("coded", "value"), [((-9, 9, 9), 0.0), ((30, 0, 30), 1.0)])
def test_a_share_is_from_0_to_1(coded: tuple[float, ...], value: float) -> None:
    assert lodging_share(*setting(*coded)) == (value, True)
