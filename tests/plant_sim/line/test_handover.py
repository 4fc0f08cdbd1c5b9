"""Handover as a design: phase and frequency, the band of speeds, the order of segments, ramps and stops."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from plant_sim.line.command import line_result
from plant_sim.line.file import ChuteEntry, GroundEntry, LineFile, find_line, load_line
from plant_sim.line.handover import HandoverBand, handover_band, lost_share
from plant_sim.line.planting import Course, Transport, drop_through_chute
from plant_sim.line.row import FedRow, TractorMotion
from plant_sim.line.run import design_frequency_hz, drive_of, phase_cycles, profile_of

COMBINED = load_line(find_line("combined")).values
DESIGN_HZ = 1.13 / 3.6 / 0.42
SLOW, FAST = {"speed": "1.13 km/h", "over": "25 m"}, {"speed": "1.32 km/h", "over": "25 m"}


def line_of(*segments: dict[str, str], slip: dict[str, str] | None = None, **chute: str) -> LineFile:
    """Return the combined line on a ground of given segments, with some values of its chute changed."""
    assert COMBINED.chute is not None
    entry = {"transit": "0.35 s", "scatter": "25 ms", "window": "15 %", **chute}
    ground: dict[str, Any] = {"segments": list(segments or (SLOW,))} | ({} if slip is None else {"slip": slip})
    return COMBINED.model_copy(
        update={"chute": ChuteEntry.model_validate(entry), "ground": GroundEntry.model_validate(ground)}
    )


def dropped(line: LineFile, cups: int, seed: int = 1) -> Transport:
    """Return the handover of full cups."""
    assert line.chute is not None
    rng = np.random.default_rng(seed)
    length_m = 1.2 * cups * line.spacing
    profile = profile_of(line.ground, length_m)
    ones = np.ones(cups, dtype=np.int64)
    course = Course(profile, drive_of(line, profile, rng), length_m)
    fed = FedRow(ones, np.zeros_like(ones), 10.0)
    return drop_through_chute(line.chute, fed, course, phase_cycles=phase_cycles(line), rng=rng)


def band_of(line: LineFile) -> HandoverBand:
    band = handover_band(line, seed=1)
    assert band is not None
    return band


def test_phase_and_design_frequency_are_one_setting() -> None:
    """A phase of 28 % is the frequency at which a plug falls 0.35 s in 28 % of a cycle: 48/min."""
    given = line_of(phase="28 %"), line_of(design_frequency="48/min")
    for line in given:
        assert design_frequency_hz(line) == pytest.approx(0.8)
        assert phase_cycles(line) == pytest.approx(0.28)
        assert "as given" in band_of(line).lines()[0]
    assert dropped(given[0], 50).phase.tolist() == pytest.approx(dropped(given[1], 50).phase.tolist())
    with pytest.raises(ValueError, match="phase and design_frequency state the same setting"):
        line_of(phase="28 %", design_frequency="48/min")


def test_the_default_design_is_the_mean_speed_over_the_ground() -> None:
    """Without a setting it is that of the mean set speed over the travel, so that a stop and the order do not count."""
    assert design_frequency_hz(line_of(SLOW)) == pytest.approx(DESIGN_HZ)
    mean_m_s = (1.13 + 1.32) / 2 / 3.6
    for order in ((SLOW, FAST), (FAST, SLOW), (SLOW, {"stand": "60 s"}, FAST)):
        assert design_frequency_hz(line_of(*order)) == pytest.approx(mean_m_s / 0.42, rel=1e-12)
    ramp = {"ramp_to": "1.32 km/h", "over": "10 m"}
    assert design_frequency_hz(line_of(SLOW, ramp)) == pytest.approx((25 * 1.13 + 10 * 1.225) / 35 / 3.6 / 0.42)
    assert "derived from the mean set speed" in band_of(line_of(SLOW, FAST)).lines()[0]


def test_losses_do_not_depend_on_the_order_of_the_segments() -> None:
    """Two speeds near the ends of the band lose the same share in either order, within 4 standard deviations."""
    speeds = [{**SLOW, "speed": "1.00 km/h"}, {**FAST, "speed": "1.30 km/h"}]
    cups = 6_000
    slow_first, fast_first = (dropped(line_of(*order), cups) for order in (speeds, speeds[::-1]))
    share = (slow_first.lost + fast_first.lost) / (2 * cups)
    assert 0.005 < share < 0.5
    sd = math.sqrt(2 * share * (1 - share) * cups)
    assert abs(slow_first.lost - fast_first.lost) < 4 * sd


def test_the_band_without_scatter_is_the_window() -> None:
    """Half a window of 7.5 % of a cycle allows 0.075/0.35 s = 0.214/s on both sides of the design frequency."""
    band = band_of(line_of(scatter="0 s"))
    half_m_s = 0.075 / 0.35 * 0.42 * 0.95  # the wheel is set for a slip of 5 %, and there is none
    assert band.low_m_s == pytest.approx(DESIGN_HZ * 0.42 * 0.95 - half_m_s, rel=1e-6)
    assert band.high_m_s == pytest.approx(DESIGN_HZ * 0.42 * 0.95 + half_m_s, rel=1e-6)
    assert [check.lost / check.cups for check in band.checks] == [0.0, 1.0, 0.0, 1.0]


@pytest.mark.parametrize("slip", [None, {"mean": "8 %", "sd": "2 %", "patch": "1 m"}])
def test_runs_just_inside_and_just_outside_confirm_the_band(slip: dict[str, str] | None) -> None:
    band = band_of(line_of(slip=slip))
    assert [check.is_inside for check in band.checks] == [True, False, True, False]
    for check in band.checks:
        assert (check.lost / check.cups <= band.most_lost) is check.is_inside
    assert band.low_m_s < 1.13 / 3.6 < band.high_m_s
    text = band.lines()[1]
    assert text.startswith(f"handover holds from {3.6 * band.low_m_s:.2f} to {3.6 * band.high_m_s:.2f} km/h")


def test_a_phase_error_shifts_the_band() -> None:
    """A setting that is 4 % too early is right for a frequency that is lower by 0.04/0.35 s."""
    wrong, right = band_of(line_of(scatter="0 s", phase_error="4 %")), band_of(line_of(scatter="0 s"))
    shift_m_s = 0.04 / 0.35 * 0.42 * 0.95
    assert wrong.low_m_s == pytest.approx(right.low_m_s - shift_m_s)
    assert wrong.high_m_s == pytest.approx(right.high_m_s - shift_m_s)
    assert [check.lost / check.cups for check in wrong.checks] == [0.0, 1.0, 0.0, 1.0]


@pytest.mark.parametrize("most_lost", [0.01, 0.10])
def test_the_limit_is_lost_at_the_ends_of_the_band(most_lost: float) -> None:
    line = line_of(most_lost=str(most_lost))
    band = band_of(line)
    assert line.chute is not None
    for end_m_s in (band.low_m_s, band.high_m_s):
        assert lost_share(line.chute, band.phase_cycles, end_m_s / (0.42 * 0.95)) == pytest.approx(most_lost)


@pytest.mark.parametrize("speed_km_h", [0.95, 1.30])
@pytest.mark.parametrize("sd", [0.0, 0.08])
def test_the_lost_share_is_that_of_a_run(speed_km_h: float, sd: float) -> None:
    """The closed form and the simulated cups agree within 4 standard deviations; a patch of soil has 2.4 cups."""
    cups = 8_000
    segment = {"speed": f"{speed_km_h} km/h", "over": "100 m"}
    line = line_of(segment, slip={"mean": "5 %", "sd": str(sd)}, scatter="10 ms", design_frequency="44.84/min")
    assert line.chute is not None
    frequency_hz = speed_km_h / 3.6 / 0.42
    share = lost_share(line.chute, phase_cycles(line), frequency_hz, slip_sd=sd / 0.95)
    lost = dropped(line, cups).lost
    assert lost == pytest.approx(share * cups, abs=4 * math.sqrt(2.4 * share * cups) + 5)


def test_a_band_can_begin_at_a_standstill_or_be_empty() -> None:
    """With half a window of 30 % and a phase of 26 %, a plug is caught at any lower speed; a window of 2 % is small."""
    assert band_of(line_of(window="60 %")).low_m_s == 0.0
    none = band_of(line_of(window="2 %"))
    assert not none.holds
    assert none.lines()[1] == "handover holds at no speed (at most 1 % lost, at a constant speed)"
    assert none.record()["low_m_s"] is None
    assert handover_band(load_line(find_line("pepper")).values, seed=1) is None


def test_a_stop_loses_the_plugs_that_are_still_falling() -> None:
    """In the last 0.35 s before a standstill, at 0.3 m/s2, the tractor drives 18 mm: 4.6 % of the distance of two cups.

    Of the 80 stops, 3.7 are therefore expected to meet a falling plug, which arrives before its planter.
    """
    segments = {"speed": "1.13 km/h", "over": "5 m"}, {"stand": "3 s"}
    transport = dropped(line_of(*segments, scatter="0 s"), 1_000)
    counts = {count.tractor: count for count in transport.handovers(1_000)}
    assert sum(count.seedlings for count in counts.values()) == 1_000
    assert sum(count.lost for count in counts.values()) == transport.lost
    assert counts[TractorMotion.STEADY].lost == 0
    assert 1 <= counts[TractorMotion.STOPS].seedlings <= 10
    assert counts[TractorMotion.STOPS].lost == counts[TractorMotion.STOPS].seedlings
    assert 0 < counts[TractorMotion.CHANGES].lost < counts[TractorMotion.CHANGES].seedlings


def test_a_slow_ramp_within_the_band_loses_nothing() -> None:
    segments = {"speed": "1.13 km/h", "over": "5 m"}, {"ramp_to": "1.25 km/h", "over": "10 m"}
    transport = dropped(line_of(*segments, scatter="0 s", design_frequency="47/min"), 1_000)
    counts = {count.tractor: count for count in transport.handovers(1_000)}
    assert counts[TractorMotion.CHANGES].seedlings > 500
    assert transport.lost == 0


@pytest.mark.nightly
def test_the_complete_line_loses_the_same_in_either_order(tmp_path: Any) -> None:
    """Ground files with the same two speeds in either order lose the same share of the plugs at the handover."""
    shares = []
    for number, order in enumerate(("1.00 km/h, 1.30 km/h", "1.30 km/h, 1.00 km/h")):
        segments = "".join(f"  - {{speed: {speed}, over: 25 m}}\n" for speed in order.split(", "))
        path = tmp_path / f"{number}.yaml"
        path.write_text(f"segments:\n{segments}slip: {{mean: 5 %}}\n", encoding="utf-8")
        done = line_result("combined", metres=100.0, seed=1, profile=path, repeat=1)
        assert done.handover is not None
        assert not done.handover.is_given
        assert "plugs lost at the handover: at a constant speed" in done.text()
        assert done.record()["handover"]["beyond_band"]["of"] == sum(row.released for row in done.rows)
        shares.append(done.missing["handover"] / sum(row.released for row in done.rows))
    assert shares[0] == pytest.approx(shares[1], abs=0.04)
    assert shares[0] > 0.0
