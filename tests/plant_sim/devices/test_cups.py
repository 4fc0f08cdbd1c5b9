"""Rotating cups: period, jitter, lead, missed and doubled flags, and standstill."""

import itertools

import pytest

from plant_sim.devices.cups import DOUBLED, HALVED, MISSED, SOUND, Cups
from tests.plant_sim.machine.plant_rig import Rig
from tests.sampling import first_of, one_in

PITCH_M, LEAD_M = 0.060, 0.024
LOOK_MS = 5
"""Time between looks at the cup pulse, shorter than any of its levels."""
JITTER_M = 0.0006
"""1 % of the pitch, in either direction."""


def make_cups(frequency_per_min: float = 45.0, *, jitter: float = 0.01, seed: int = 1) -> tuple[Rig, Cups]:
    values = {"cups.planting_frequency_per_min": frequency_per_min, "cups.pulse_jitter": jitter}
    rig = Rig(dict(values), trays=0, seed=seed)
    return rig, rig.left.cups


def edges(rig: Rig, for_ms: int) -> list[tuple[float, bool, float]]:
    """Return the edges of the left cup pulse, each as its time, s, its level, and the chain travel, m."""
    cups, pulse = rig.left.cups, rig.plant.state[0]["arms"][0]["cups"]["pulse"]
    changes = []
    last_s = cups.pulse.edge_s
    for _ in range(for_ms // LOOK_MS):
        rig.run(LOOK_MS)
        if cups.pulse.edge_s != last_s:
            last_s = cups.pulse.edge_s
            chain_m = cups.chain_m - (rig.plant.time_ms / 1000 - last_s) * cups.speed_m_s
            changes.append((last_s, bool(pulse["detected"]), chain_m))
    return changes


def off_place_m(chain_m: float) -> float:
    """Return the offset of a flag from its nominal position, 24 mm before the cups are under the claws, m."""
    return (chain_m + LEAD_M + PITCH_M / 2) % PITCH_M - PITCH_M / 2


@pytest.mark.parametrize(("frequency_per_min", "period_s"), first_of([(45.0, 1.3333), (60.0, 1.0), (80.0, 0.75)]))
def test_pulses_come_at_the_planting_frequency_and_jitter_by_one_percent(
    frequency_per_min: float, period_s: float
) -> None:
    """Adjacent flags may be offset by 1 % in opposite directions, so a period varies by up to 2 %."""
    rig, _ = make_cups(frequency_per_min)
    rises_s = [at_s for at_s, on, _ in edges(rig, 60_000) if on]
    assert len(rises_s) == pytest.approx(frequency_per_min, abs=1)
    periods_s = [after_s - before_s for before_s, after_s in itertools.pairwise(rises_s)]
    assert all(abs(period - period_s) <= 0.02 * period_s + 1e-4 for period in periods_s)
    assert max(periods_s) - min(periods_s) > 0.01 * period_s
    assert sum(periods_s) / len(periods_s) == pytest.approx(period_s, rel=0.001)


def test_without_jitter_pulses_are_even_and_last_a_fifth_of_the_pitch() -> None:
    """Edge times are interpolated within a step and are accurate to a few microseconds."""
    rig, _ = make_cups(jitter=0.0)
    changes = edges(rig, 20_000)
    rise = next(index for index, (_, on, _) in enumerate(changes) if on)
    for before, after in itertools.pairwise(changes[rise:]):
        share = 0.2 if before[1] else 0.8
        assert after[0] - before[0] == pytest.approx(share * 60 / 45, abs=1e-5)
    for _, on, chain_m in changes:
        assert off_place_m(chain_m if on else chain_m - 0.2 * PITCH_M) == pytest.approx(0.0, abs=1e-6)


def test_a_pulse_begins_24_mm_before_the_cups_are_under_the_claws() -> None:
    rig, _ = make_cups()
    offs_m = [off_place_m(chain_m) for _, on, chain_m in edges(rig, 60_000) if on]
    assert all(abs(off_m) <= JITTER_M + 1e-5 for off_m in offs_m)
    assert max(offs_m) > JITTER_M / 2
    assert min(offs_m) < -JITTER_M / 2


def test_a_flag_has_the_same_offset_in_every_round() -> None:
    """The sequence of offsets repeats after 256 flags."""
    rig, _ = make_cups(240.0)
    offs_m = [off_place_m(chain_m) for _, on, chain_m in edges(rig, 70_000) if on]
    assert len(offs_m) > 266
    assert offs_m[256:266] == pytest.approx(offs_m[:10], abs=1e-6)


def test_the_phase_of_the_cups_differs_by_row_and_follows_the_seed() -> None:
    phases = [(rig.plant.left.cups.chain_m, rig.plant.right.cups.chain_m) for rig in (Rig(), Rig(), Rig(seed=2))]
    assert phases[0] == phases[1]
    assert len({*phases[0], *phases[2]}) == 4
    assert all(0.0 <= phase_m < PITCH_M for pair in phases for phase_m in pair)


def test_a_closing_contact_bounces_and_settles() -> None:
    """A closing contact that reopens twice within 3 ms shows one to three changes when sampled every millisecond."""
    rig, cups = make_cups()
    changes = rig.changes(cups.pulse, 10_000)
    ups = [(at_ms, on) for at_ms, on in changes if on]
    assert len(ups) > 7  # more than there are flags
    downs = [at_ms for at_ms, on in changes if not on]
    clean = [at_ms for at_ms in downs if not any(0 < up_ms - at_ms <= 4 for up_ms, _ in ups)]
    assert len(clean) == pytest.approx(7, abs=1)


@pytest.mark.parametrize(("kind", "per_flag"), one_in(3, [(MISSED, 0), (DOUBLED, 2), (HALVED, 2), (SOUND, 1)]))
def test_all_flags_can_be_missed_or_counted_twice(kind: int, per_flag: int) -> None:
    """A flag counted twice, or two halved flags, give a second pulse half a pitch after the first."""
    rig, cups = make_cups(60.0, jitter=0.0)
    cups.set_flag_kinds(kind, 1.0)
    rig.run(2_000)
    rises_s = [at_s for at_s, on, _ in edges(rig, 30_000) if on]
    assert len(rises_s) == 30 * per_flag
    assert all(
        after_s - before_s == pytest.approx(1.0 / per_flag, abs=1e-5)
        for before_s, after_s in itertools.pairwise(rises_s)
    )


@pytest.mark.parametrize(("kind", "expected"), first_of([(MISSED, 192), (DOUBLED, 320)]))
def test_a_quarter_of_the_flags_can_be_altered_and_restored(kind: int, expected: int) -> None:
    """Of the 256 pulses per round, 64 are missing, or 64 are added."""
    rig, cups = make_cups(240.0)
    cups.set_flag_kinds(kind, 0.25)
    assert len([1 for _, on, _ in edges(rig, 64_000) if on]) == pytest.approx(expected, abs=2)
    cups.set_flag_kinds(SOUND, 0.0)
    assert len([1 for _, on, _ in edges(rig, 16_000) if on]) == pytest.approx(64, abs=1)


def test_a_flag_missed_is_still_a_cup() -> None:
    rig, cups = make_cups()
    before_m = cups.chain_m
    cups.set_flag_kinds(MISSED, 1.0)
    rig.run(10_000)
    assert cups.chain_m - before_m == pytest.approx(0.45)


def test_cups_follow_the_tractor_to_a_standstill_and_back() -> None:
    """Stopping from 45 mm/s at 0.05 m/s2 takes 0.9 s and 20.25 mm, plus half a simulation step at the final speed."""
    rig, cups = make_cups()
    rig.plant.planting_frequency_per_min = 0
    before_m = cups.chain_m
    rig.run(895)
    assert cups.speed_m_s > 0.0
    rig.run(10)
    assert cups.speed_m_s == 0.0
    assert cups.chain_m - before_m == pytest.approx(0.02025, abs=3e-5)
    assert edges(rig, 10_000) == []
    rig.plant.planting_frequency_per_min = 45
    assert len(edges(rig, 10_000)) >= 12


def test_a_change_of_the_planting_frequency_takes_its_time() -> None:
    """From 45 to 80/min is a change of 35 mm/s, which takes 0.7 s at 50 mm/s2."""
    rig, cups = make_cups()
    rig.plant.planting_frequency_per_min = 80
    rig.run(690)
    assert 0.079 < cups.speed_m_s < 0.080
    rig.run(15)
    assert cups.speed_m_s == pytest.approx(0.080)


def test_cups_never_run_backward() -> None:
    _, cups = make_cups()
    with pytest.raises(ValueError, match="cannot run backward"):
        cups.planting_frequency_per_min = -1
    assert cups.planting_frequency_per_min == 45


def test_jammed_cups_stop_and_continue_when_released() -> None:
    rig, cups = make_cups()
    cups.jammed = True
    assert edges(rig, 5_000) == []
    assert cups.speed_m_s == 0.0
    cups.jammed = False
    rig.run(1_000)
    assert cups.speed_m_s == pytest.approx(0.045)


def test_one_setting_drives_both_rows() -> None:
    plant = Rig().plant
    plant.planting_frequency_per_min = 60
    assert plant.left.cups.planting_frequency_per_min == 60
    assert plant.right.cups.planting_frequency_per_min == 60
    assert plant.planting_frequency_per_min == 60
