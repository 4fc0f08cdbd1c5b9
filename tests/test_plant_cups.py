"""Rotating cups: period, lead, standstill."""

import itertools

import pytest
from plant_rig import MACHINE, Rig

from plant_sim.devices.cups import Cups

PITCH_M = 0.060


def make_cups(frequency_per_min: float = 45.0, *, chain_m: float = 0.0) -> Cups:
    machine = MACHINE.with_values({"cups.planting_frequency_per_min": frequency_per_min})
    return Cups(machine.cups, chain_m=chain_m)


def pulse_changes(cups: Cups, for_ms: int) -> list[tuple[int, bool, float]]:
    """When the pulse changed, to what, and where the chain was."""
    changes = []
    was_on = cups.pulse.read()
    for at_ms in range(1, for_ms + 1):
        cups.step(0.001)
        if cups.pulse.read() != was_on:
            was_on = not was_on
            changes.append((at_ms, was_on, cups.chain_m))
    return changes


@pytest.mark.parametrize(("frequency_per_min", "period_ms"), [(45.0, 1_333.3), (60.0, 1_000.0), (80.0, 750.0)])
def test_pulses_come_at_the_planting_frequency(frequency_per_min: float, period_ms: float) -> None:
    changes = pulse_changes(make_cups(frequency_per_min), 60_000)
    rises_ms = [at_ms for at_ms, on, _ in changes if on]
    assert len(rises_ms) == pytest.approx(frequency_per_min, abs=1)
    for before_ms, after_ms in itertools.pairwise(rises_ms):
        assert after_ms - before_ms == pytest.approx(period_ms, abs=1.01)


def test_a_pulse_lasts_two_fifths_of_the_pitch() -> None:
    changes = pulse_changes(make_cups(), 5_000)
    rise = next(index for index, (_, on, _) in enumerate(changes) if on)
    assert changes[rise + 1][0] - changes[rise][0] == pytest.approx(0.4 * 1_333.3, abs=1.01)


def test_a_pulse_begins_15_mm_before_the_cups_are_under_the_claws() -> None:
    for _, on, chain_m in pulse_changes(make_cups(), 10_000):
        if on:
            assert (chain_m + 0.015) % PITCH_M < 0.045 * 0.001 + 1e-9


def test_the_phase_of_the_cups_differs_by_row_and_follows_the_seed() -> None:
    phases = [(rig.plant.left.cups.chain_m, rig.plant.right.cups.chain_m) for rig in (Rig(), Rig(), Rig(seed=2))]
    assert phases[0] == phases[1]
    assert len({*phases[0], *phases[2]}) == 4
    assert all(0.0 <= phase_m < PITCH_M for pair in phases for phase_m in pair)


def test_cups_follow_the_tractor_to_a_standstill_and_back() -> None:
    cups = make_cups()
    cups.planting_frequency_per_min = 0
    before_m = cups.chain_m
    for _ in range(895):
        cups.step(0.001)
    assert cups.speed_m_s > 0.0  # 45 mm/s at 0.05 m/s2: 0.9 s
    for _ in range(10):
        cups.step(0.001)
    assert cups.speed_m_s == 0.0
    assert cups.chain_m - before_m == pytest.approx(0.02025, abs=1e-5)
    assert pulse_changes(cups, 10_000) == []
    cups.planting_frequency_per_min = 45
    assert len(pulse_changes(cups, 10_000)) >= 12


def test_cups_never_run_backward() -> None:
    with pytest.raises(ValueError, match="never run backward"):
        make_cups().planting_frequency_per_min = -1


def test_jammed_cups_stand_dead() -> None:
    cups = make_cups()
    cups.jammed = True
    assert pulse_changes(cups, 5_000) == []
    assert cups.speed_m_s == 0.0


def test_one_setting_drives_both_rows() -> None:
    plant = Rig().plant
    plant.planting_frequency_per_min = 60
    assert plant.left.cups.planting_frequency_per_min == 60
    assert plant.right.cups.planting_frequency_per_min == 60
    assert plant.planting_frequency_per_min == 60
