"""Individual laws of the seedling mechanics, and the population failure rates that follow from them."""

import dataclasses
import math

import numpy as np
import pytest

from plant_sim.common.limits import SpecError
from plant_sim.crop.expectation import HandlingMotion, expected
from plant_sim.crop.mechanics import Mechanics, SeedlingSpec
from plant_sim.crop.seedling import Seedlings
from plant_sim.crop.traits import TYPICAL
from plant_sim.machine.parameters import load_machine
from tests.sampling import first_of

MACHINE = load_machine()
SPEC = MACHINE.seedling
FORCE_N = 7.8
MOTION = HandlingMotion(0.004, 0.0029, FORCE_N, 11.9, 0.0005, 0.0016, 0.1277, 0.0085)


def mechanics(foam_mm: float = 10.0, age_d: float = 51.0, spec: SeedlingSpec = SPEC) -> Mechanics:
    return Mechanics(spec, foam_mm=foam_mm, age_d=age_d)


def test_the_free_stem_equals_the_manual_calculation() -> None:
    """Stem height is 128 mm at 51 d plus daily growth.

    The margin is the excess over the finger height, in standard deviations.
    """
    need_m, sd_m, growth_m_d = SPEC.finger_height_m, SPEC.height_sd_m, 1e-3 * SPEC.growth_mm_d
    for age_d in (41.0, 51.0, 58.0):
        margin = (0.128 + growth_m_d * (age_d - 51) - need_m) / sd_m
        assert float(mechanics(age_d=age_d).height_margin()) == pytest.approx(margin)


def test_the_grip_equals_the_manual_calculation() -> None:
    """The margin is ln((friction of two fingers - plug weight) / adhesion), in standard deviations of the adhesion."""
    spec = dataclasses.replace(SPEC, friction_age=0.0, friction_age2=0.0)
    holds_n = 2 * 0.5 * FORCE_N - spec.plug_kg * 9.80665
    margin = math.log(holds_n / spec.adhesion_n) / spec.adhesion_sd
    assert float(mechanics(age_d=58.0, spec=spec).slip_margin(FORCE_N)) == pytest.approx(margin)


def test_foam_of_the_yield_thickness_halves_the_force() -> None:
    at_10_mm = 1 / (1 + (10 / SPEC.yield_mm) ** SPEC.yield_exponent)
    weaker = mechanics(foam_mm=SPEC.yield_mm).slip_margin(FORCE_N)
    assert float(weaker) == pytest.approx(float(mechanics().slip_margin(FORCE_N * 0.5 / at_10_mm)))


def test_a_contact_pressure_equal_to_the_endurance_breaks_half_of_the_stems() -> None:
    spec = dataclasses.replace(SPEC, contact_force=0.5)
    plain = mechanics(age_d=50.0, spec=spec)
    force_n = 8.0 * spec.endurance**2
    assert float(plain.break_margin(force_n, 12.5)) == pytest.approx(0.0, abs=1e-12)
    assert plain.breaks(TYPICAL, 1.01 * force_n, 12.5)
    assert not plain.breaks(TYPICAL, 0.99 * force_n, 12.5)
    assert plain.breaks(TYPICAL, 0.99 * force_n, 25.0)  # twice the time adds 7 %, 1 % less force subtracts 0.5 %


def test_drifts_add_as_squares_and_grow_with_the_fall() -> None:
    alone = [
        dataclasses.replace(SPEC, **{name: 0.0 for name in ("crown_m", "sway_m", "stick_m") if name != term})
        for term in ("crown_m", "sway_m", "stick_m")
    ]
    parts = [float(mechanics(spec=spec).drift_sd_m(FORCE_N, 0.1277)) for spec in alone]
    assert min(parts) > 0
    whole = float(mechanics().drift_sd_m(FORCE_N, 0.1277))
    assert whole == pytest.approx(math.hypot(*parts))
    assert float(mechanics().drift_sd_m(FORCE_N, 0.2554)) == pytest.approx(2 * whole)


def test_every_law_at_another_foam_age_and_force() -> None:
    """Adding 5 mm of foam narrows the gap by 5 mm times `gap_foam`; an age of 56 d is 1.2 units of 5 d above 50 d."""
    here, force_n = mechanics(foam_mm=15.0, age_d=56.0), 6.0
    foam, age, force = math.log(1.5), 1.2, math.log(0.75)
    calculated = {
        "gap": (SPEC.gap_m - 0.005 * SPEC.gap_foam - 0.002) / SPEC.lean_sd_m,
        "cut": (math.log(SPEC.cut_n / 8) + SPEC.cut_age * age + SPEC.cut_age2 * age**2 + SPEC.cut_foam * foam - force)
        / SPEC.cut_sd,
        "break": (
            math.log(SPEC.endurance)
            + SPEC.endurance_age * age
            + SPEC.endurance_age2 * age**2
            - SPEC.contact_force * force
            + SPEC.contact_foam * foam
            - SPEC.hold_exponent * math.log(2)
        )
        / SPEC.endurance_sd,
    }
    found = {"gap": here.gap_margin(0.002), "cut": here.cut_margin(force_n), "break": here.break_margin(force_n, 25.0)}
    assert {name: float(margin) for name, margin in found.items()} == pytest.approx(calculated)


def test_every_drift_at_another_foam_age_and_force() -> None:
    """The sway increases as the force decreases, whether because of a lower set force or because of thicker foam."""
    foam, age, force = math.log(1.5), 1.2, math.log(0.75)
    passed_on = [1 / (1 + (foam_mm / SPEC.yield_mm) ** SPEC.yield_exponent) for foam_mm in (15, 10)]
    calculated = {
        "crown_m": SPEC.crown_m * math.exp(SPEC.crown_age * age + SPEC.crown_age2 * age**2),
        "sway_m": SPEC.sway_m * (0.75 * passed_on[0] / passed_on[1]) ** -SPEC.sway_force,
        "stick_m": SPEC.stick_m * math.exp(SPEC.stick_force * force + SPEC.stick_foam * foam + SPEC.stick_age * age),
    }
    for term, drift_m in calculated.items():
        spec = dataclasses.replace(SPEC, **{name: 0.0 for name in calculated if name != term})
        found_m = mechanics(foam_mm=15.0, age_d=56.0, spec=spec).drift_sd_m(6.0, 0.1277)
        assert float(found_m) == pytest.approx(drift_m), term


@pytest.mark.parametrize(
    ("name", "worse"),
    [("height", "height"), ("grasp", "grasp"), ("strength", "strength"), ("endurance", "endurance")],
)
def test_a_seedling_fails_if_its_deviation_is_below_the_margin(name: str, worse: str) -> None:
    plain = mechanics()
    margin = float(
        {
            "height": plain.height_margin(),
            "grasp": plain.slip_margin(FORCE_N),
            "strength": plain.cut_margin(FORCE_N),
            "endurance": plain.break_margin(FORCE_N, 11.9),
        }[name]
    )

    def fails(deviation: float) -> bool:
        traits = TYPICAL._replace(**{worse: deviation})
        return (
            plain.is_missed(traits, along_m=0.0, across_m=0.0)
            or plain.slips(traits, FORCE_N)
            or plain.is_cut(traits, FORCE_N)
            or plain.breaks(traits, FORCE_N, 11.9)
        )

    assert not fails(-margin + 1e-6)
    assert fails(-margin - 1e-6)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_stem_between_the_pads_is_missed_if_lean_and_error_add_up(sign: int) -> None:
    plain, lean_m = mechanics(), SPEC.lean_sd_m
    for off_m, reach_m, lean in ((0.004, SPEC.gap_m, "lean_along"), (0.003, SPEC.strip_reach_m, "lean_across")):
        limit = (reach_m - off_m) / lean_m
        for deviation, missed in ((limit - 1e-6, False), (limit + 1e-6, True), (-limit - 1e-6, False)):
            traits = TYPICAL._replace(**{lean: sign * deviation})
            errors = {"along_m": 0.0, "across_m": 0.0}
            errors["along_m" if lean == "lean_along" else "across_m"] = sign * off_m
            assert plain.is_missed(traits, **errors) is missed, (lean, deviation)


@pytest.mark.parametrize("setting", first_of([((10.0, 51.0, 7.8),), ((16.0, 45.0, 5.0),), ((7.0, 57.0, 11.0),)]))
def test_the_expected_shares_are_those_of_many_seedlings(setting: tuple[float, float, float]) -> None:
    """28,800 seedlings are evaluated individually; the tolerance is four binomial standard deviations."""
    foam_mm, age_d, force_n = setting
    plain = mechanics(foam_mm, age_d)
    motion = dataclasses.replace(MOTION, force_n=force_n)
    lost = np.zeros(3)
    crowd = list(Seedlings(trays=400, seed=5))
    for plant in crowd:
        traits = plant.traits
        drift = plain.drift_m(traits, force_n, 0.1277)
        if (
            plain.is_missed(traits, along_m=0.004, across_m=0.0029)
            or plain.is_cut(traits, force_n)
            or plain.slips(traits, force_n)
        ):
            lost[0] += 1
        elif plain.breaks(traits, force_n, 11.9):
            lost[1] += 1
        elif math.hypot(drift[0] - 0.0005, drift[1] + 0.0016) > 0.0085:
            lost[2] += 1
    shares = np.array(expected(plain, motion)[:3], float)
    assert np.abs(lost / len(crowd) - shares).max() < 4 * math.sqrt(0.25 / len(crowd))
    assert (np.abs(lost / len(crowd) - shares) <= 4 * np.sqrt(shares * (1 - shares) / len(crowd)) + 1e-9).all()


@pytest.mark.parametrize(
    ("change", "share"),
    [
        ({"along_m": 0.007}, "missed"),
        ({"across_m": 0.0059}, "missed"),
        ({"force_n": 2.0}, "slipped"),
        ({"force_n": 14.0}, "cut"),
        ({"held_s": 600.0}, "D"),
        ({"throw_along_m": 0.010}, "T"),
        ({"throw_across_m": 0.010}, "T"),
        ({"fall_s": 0.2}, "T"),
    ],
)
def test_bad_motion_increases_the_failures(change: dict[str, float], share: str) -> None:
    good = expected(mechanics(), MOTION)
    bad = expected(mechanics(), dataclasses.replace(MOTION, **change))
    assert float(getattr(bad, share)) > 1.2 * float(getattr(good, share))
    assert float(bad.success_percent) < float(good.success_percent)


@pytest.mark.parametrize("foam_mm", [0.0, 1.0, 30.0])
@pytest.mark.parametrize("age_d", [1.0, 200.0])
@pytest.mark.parametrize("force_n", [0.0, 0.1, 500.0])
def test_success_remains_between_0_and_100_percent(foam_mm: float, age_d: float, force_n: float) -> None:
    shares = expected(mechanics(foam_mm, age_d), dataclasses.replace(MOTION, force_n=force_n))
    assert all(-1e-12 <= float(share) <= 1 + 1e-12 for share in shares)
    assert -1e-9 <= float(shares.success_percent) <= 100 + 1e-9


def test_invalid_properties_are_rejected() -> None:
    for name, value in (("friction", 0.0), ("cut_sd", -0.1), ("stick_age", 3.0), ("height_m", math.nan)):
        with pytest.raises(SpecError, match=name):
            dataclasses.replace(SPEC, **{name: value})
