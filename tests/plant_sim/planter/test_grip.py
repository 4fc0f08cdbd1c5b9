"""Tests of the grip of the plates: force law, opening and crush range."""

import dataclasses

import pytest

from plant_sim.common.limits import SpecError
from plant_sim.planter.grip import GripSpec
from plant_sim.planter.parameters import load_planter

PLANTER = load_planter()


def grip(**values: float) -> GripSpec:
    return dataclasses.replace(PLANTER.grip, **values)


def test_force_falls_from_the_clamp_force_to_zero_while_the_plates_open() -> None:
    spec = grip(clamp_n=100.0, stiffness_n_m=20e3, opening_m_s=0.25)
    assert spec.compression_m == pytest.approx(0.005)
    assert spec.free_s == pytest.approx(0.010)
    assert [spec.force_n(at_s) for at_s in (-1.0, 0.0, 0.005, 0.010, 0.02)] == pytest.approx([100, 100, 50, 0, 0])


def test_open_plates_leave_the_clearance_of_the_paper() -> None:
    spec = grip(clamp_n=100.0, stiffness_n_m=20e3, opening_m_s=0.25)
    assert spec.clearance_m(PLANTER.block) == pytest.approx(0.0025)
    assert spec.open_s(PLANTER.block) == pytest.approx(0.020)


@pytest.mark.parametrize(("clamp_n", "share"), [(80.0, 0.0), (89.95, 0.0), (104.62, 0.5), (119.29, 1.0), (200.0, 1.0)])
def test_crush_range_of_the_paper_taken_literally(clamp_n: float, share: float) -> None:
    """Half of the blocks would be crushed at the centre of the test, where the paper reports 4 % injury."""
    assert grip(clamp_n=clamp_n).crushed_share() == pytest.approx(share, abs=1e-3)


def test_crush_range_without_width_is_a_limit() -> None:
    spec = grip(crush_low_n=100.0, crush_high_n=100.0)
    assert dataclasses.replace(spec, clamp_n=99.0).crushed_share() == 0.0
    assert dataclasses.replace(spec, clamp_n=101.0).crushed_share() == 1.0


def test_plates_hold_the_block_until_friction_is_exceeded() -> None:
    weight_n = PLANTER.block.mass_kg * 9.80665
    assert grip(friction=0.5, clamp_n=1.01 * weight_n).holds(PLANTER.block, 0.0)
    assert not grip(friction=0.5, clamp_n=0.99 * weight_n).holds(PLANTER.block, 0.0)
    assert not grip(friction=0.5, clamp_n=1.01 * weight_n).holds(PLANTER.block, 1.0)


def test_invalid_values_are_rejected() -> None:
    with pytest.raises(SpecError, match="crush_low_n must not exceed crush_high_n"):
        grip(crush_low_n=120.0)
    with pytest.raises(SpecError, match=r"opening_m_s must be 0\.01 to 5"):
        grip(opening_m_s=0.0)


def test_block_is_a_cube_with_a_stem() -> None:
    """Mass, centre of mass and inertia of a block agree with the sums over cube and stem."""
    block = dataclasses.replace(PLANTER.block, cube_kg=0.05, stem_kg=0.01)
    assert block.mass_kg == pytest.approx(0.06)
    assert block.centre_m == pytest.approx((0.05 * 0.02 + 0.01 * 0.0625) / 0.06)
    cube = 0.05 * (0.04**2 / 6 + (block.centre_m - 0.02) ** 2)
    stem = 0.01 * (0.005**2 / 4 + 0.045**2 / 12 + (0.0625 - block.centre_m) ** 2)
    assert block.inertia_kg_m2 == pytest.approx(cube + stem)
