"""Tests of the verdicts over all ranges: space, robustness, screening and indices of a known function."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from plant_sim.common.proportion import Proportion
from plant_sim.planter.parameters import load_planter, load_ranges
from plant_sim.planter.verdict import FallVerdict, margin_of, verdict_of
from plant_sim.study.planter import robustness_parts as parts
from plant_sim.study.planter import verdict_robustness as robust
from plant_sim.study.planter import verdict_sensitivity as sensitivity
from plant_sim.study.planter.lodging_fit import Values
from plant_sim.study.planter.verdict_robustness import PITCHES_DEG, Robustness, robust_up_to_deg, robustness
from plant_sim.study.planter.verdict_sensitivity import Influence, SampleSize, Sensitivity, planned_jobs, sensitivities
from plant_sim.study.planter.verdict_space import DEVIATIONS, VerdictSpace
from plant_sim.study.planter.verdicts import CASES, SimulatedCase

PLANTER, RANGES = load_planter(), load_ranges()
SPACE = VerdictSpace(PLANTER, RANGES)
TIPPED, PUSHED, CLEAN = CASES


@dataclasses.dataclass(frozen=True)
class LinearSpace(VerdictSpace):
    """Space with a linear distance, whose indices are known."""

    def margins(self, case: SimulatedCase, points: Values) -> list[float]:
        """Return 0.6 times the friction of the guide plate and 0.3 times the pitch, less a constant."""
        friction, pitch = (self.names.index(name) for name in ("grip.guide_friction", "pitch of the block"))
        margins: list[float] = (0.6 * points[:, friction] + 0.3 * points[:, pitch] - 0.2).tolist()
        return margins


def test_space_contains_everything_that_a_fall_on_rigid_ground_depends_on() -> None:
    sections = ("chain", "block", "grip", "rigid_ground")
    wide = {name for name, (low, high) in RANGES.items() if name.partition(".")[0] in sections and high > low}
    assert wide == set(SPACE.parameters)
    assert {"rigid_ground.clearance_m", "chain.guide_behind_m", "grip.clamp_n", "chain.teeth"} <= wide
    assert set(SPACE.bounds) == {name for name in RANGES if name.startswith("scatter.")} - {
        "scatter.clearance_sd_m",
        "scatter.stick_share",
        "scatter.stick_exponent",
        "scatter.strength_n",
        "scatter.strength_sd_n",
    }


@pytest.mark.parametrize("end", [0, 1])
def test_corners_of_the_space_are_the_ends_of_the_ranges(end: int) -> None:
    drawn = SPACE.draw_at(np.full(len(SPACE.names), float(end)))
    for name in (*SPACE.parameters, *SPACE.bounds):
        section, _, key = name.partition(".")
        assert getattr(getattr(drawn.planter, section), key) == pytest.approx(RANGES[name][end])
    assert drawn.ground == drawn.planter.rigid_ground
    expected = [0.0] * 5 if end == 0 else [RANGES[name][1] for name in SPACE.bounds[1:]]
    assert drawn.disturbance == pytest.approx(expected)


def test_nominal_point_is_the_default_planter_without_deviations() -> None:
    drawn = SPACE.draw_at(SPACE.nominal())
    same = dataclasses.replace(drawn.planter, scatter=PLANTER.scatter)
    for section in ("chain", "block", "grip", "rigid_ground"):
        got, expected = dataclasses.astuple(getattr(same, section)), dataclasses.astuple(getattr(PLANTER, section))
        assert got == pytest.approx(expected)
    assert (drawn.opener_deg, *drawn.disturbance) == pytest.approx((0.0,) * 6)
    assert [SPACE.margins(case, SPACE.nominal()[np.newaxis])[0] > 0.0 for case in CASES] == [True] * 3


def test_distance_is_positive_exactly_for_the_verdict() -> None:
    rng = np.random.default_rng(1)
    for tilt_deg, pushed_m in zip(rng.uniform(-90, 90, 500), rng.uniform(-0.003, 0.003, 500), strict=True):
        found = verdict_of(tilt_deg, pushed_m)
        for verdict in (FallVerdict.CLEAN, FallVerdict.PUSHED, FallVerdict.FORWARD):
            margin = margin_of(verdict, tilt_deg, pushed_m)
            assert (margin > 0.0) == (found is verdict)
            assert -1.0 <= margin <= 1.0


@pytest.mark.parametrize(
    ("hits", "draws", "is_robust"), [(180, 200, True), (179, 200, False), (18, 20, False), (60, 60, True)]
)
def test_robust_is_a_share_of_90_percent_whose_interval_begins_at_80(hits: int, draws: int, is_robust: bool) -> None:
    assert Robustness(CLEAN, 0.0, Proportion(hits, draws)).is_robust is is_robust


def test_robust_up_to_the_first_pitch_that_is_not() -> None:
    shares = [
        Robustness(CLEAN, pitch_deg, Proportion(hits, 200))
        for pitch_deg, hits in zip(range(4), (200, 190, 150, 199), strict=True)
    ]
    assert robust_up_to_deg(shares) == 1.0
    assert robust_up_to_deg(shares[2:]) is None


def test_shares_follow_from_the_same_draws_at_every_pitch() -> None:
    """The distance of the linear space depends on the deviation, not on the largest one."""
    shares = robustness(LinearSpace(PLANTER, RANGES), draws=400, seed=1, workers=1)
    assert [each.pitch_deg for each in shares] == [*PITCHES_DEG] * 3
    assert len({each.agreeing.hits for each in shares}) == 1
    # 0.6 x + 0.3 y > 0.2: all but the corner with an area of 1/9
    assert shares[0].agreeing.interval[0] < 8 / 9 < shares[0].agreeing.interval[1]


def test_assumed_pitch_is_that_of_the_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Values] = []

    def margins(space: VerdictSpace, case: SimulatedCase, points: Values) -> list[float]:
        seen.append(points)
        return [1.0] * len(points)

    monkeypatch.setattr(VerdictSpace, "margins", margins)
    monkeypatch.setattr(robust, "PITCHES_DEG", (0.0, 6.0))
    robustness(SPACE, draws=5, seed=1, workers=1)
    pitches = np.array([[SPACE.draw_at(point).disturbance.pitch_deg for point in points] for points in seen[:2]])
    assert not pitches[0].any()
    assert (np.abs(pitches[1]) > 0.0).all()


def test_screening_and_indices_of_a_linear_distance(monkeypatch: pytest.MonkeyPatch) -> None:
    """The effects are the slopes; the indices are the shares 0.36 and 0.09 of the variance 0.45."""
    monkeypatch.setattr(sensitivity, "_RESAMPLES", 99)
    monkeypatch.setattr(sensitivity, "CASES", CASES[:1])
    calls: list[int] = []
    size = SampleSize(4, 256)
    space = LinearSpace(PLANTER, RANGES)
    found = sensitivities(space, size, seed=3, workers=1, progress=lambda done, _: calls.append(done))
    for each in found:
        assert each.effects["grip.guide_friction"] == pytest.approx(0.6)
        assert each.effects["pitch of the block"] == pytest.approx(0.3)
        assert sum(each.effects.values()) == pytest.approx(0.9)
        assert each.depends_on == ("grip.guide_friction", "pitch of the block")
        for influence, share in zip(each.influences, (0.8, 0.2), strict=True):
            for value, low, high in (influence.first, influence.total):
                assert value == pytest.approx(share, abs=0.05)
                assert low < share < high
                assert high - low < 0.4
    assert len(calls) <= planned_jobs(space, size)
    assert found == sensitivities(space, size, seed=3, workers=1)


def test_distance_that_never_changes_depends_on_nothing() -> None:
    class ConstantSpace(VerdictSpace):
        """Space with a constant distance."""

        def margins(self, case: SimulatedCase, points: Values) -> list[float]:
            """Return a constant."""
            return [0.5] * len(points)

    assert all(not each.influences for each in sensitivities(ConstantSpace(PLANTER, RANGES), SampleSize(2, 4), seed=1))


def test_size_of_the_samples_follows_the_draws() -> None:
    assert SampleSize.of(240) == (20, 256)
    assert SampleSize.of(4) == (2, 4)


@pytest.mark.parametrize(
    ("hits", "text"),
    [
        ([200] * 7, "The verdict clean and upright at λ 1.17 is robust for every assumed pitch up to 6°."),
        (
            [200, 190, *[100] * 5],
            "The verdict clean and upright at λ 1.17 is robust only up to an assumed pitch of 1°: 100 % of the draws "
            "without pitch and 50 % with up to 6° have it. It depends on pitch of the block.",
        ),
        (
            [100] * 7,
            "The verdict clean and upright at λ 1.17 is not robust: 50 % of the draws without pitch and 50 % with up "
            "to 6° have it. It depends on pitch of the block.",
        ),
    ],
)
def test_conclusion_names_what_survives_and_what_decides(hits: list[int], text: str) -> None:
    shares = [
        Robustness(CLEAN, pitch_deg, Proportion(each, 200)) for pitch_deg, each in zip(PITCHES_DEG, hits, strict=True)
    ]
    indices = (0.5, 0.4, 0.6)
    influence = Influence("pitch of the block", 0.3, indices, indices)
    assert parts._sentence(CLEAN, shares, Sensitivity(CLEAN, {}, (influence,))) == text


def test_no_text_calls_a_share_of_draws_a_chance() -> None:
    shares = [Robustness(case, pitch_deg, Proportion(10, 20)) for case in CASES for pitch_deg in PITCHES_DEG]
    influences = [Sensitivity(case, {}, ()) for case in CASES]
    texts = [
        part for part in parts.robustness_parts(SPACE, shares, influences, SampleSize(2, 4)) if isinstance(part, str)
    ]
    for word in ("chance", "probab", "likel"):
        assert word not in " ".join(texts).lower()
    assert len(DEVIATIONS) == 6
