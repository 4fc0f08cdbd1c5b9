"""Tray conveyor: edges, gaps, magazine, stops."""

import pytest
from plant_rig import MACHINE

from plant_sim.devices.conveyor import Conveyor


def make_conveyor(trays: int = 2) -> Conveyor:
    return Conveyor(MACHINE.conveyor, trays=trays)


def feed(conveyor: Conveyor, for_ms: int, *, run: bool = True, forward: bool = True) -> None:
    for _ in range(for_ms // 5):
        conveyor.step(0.005, run=run, forward=forward)


def beam_changes_ms(conveyor: Conveyor, for_ms: int) -> list[tuple[int, bool]]:
    changes = []
    was_on = conveyor.beam.read()
    for at_ms in range(5, for_ms + 5, 5):
        conveyor.step(0.005, run=True, forward=True)
        if conveyor.beam.read() != was_on:
            was_on = not was_on
            changes.append((at_ms, was_on))
    return changes


def test_no_tray_is_at_the_pick_position_at_first() -> None:
    conveyor = make_conveyor()
    feed(conveyor, 10_000, run=False)
    assert conveyor.front_m == {0: -0.300}
    assert not conveyor.beam.read()
    assert conveyor.placed_tray is None
    assert conveyor.in_magazine == 1


def test_the_beam_tells_tray_gap_tray_and_then_nothing() -> None:
    """300 mm at 0.2 m/s and 25 ms for the ramp; then 540 mm tray, 45 mm gap, 540 mm tray."""
    changes = beam_changes_ms(make_conveyor(), 30_000)
    assert [on for _, on in changes] == [True, False, True, False]
    for (seen_ms, _), due_ms in zip(changes, (1_525, 4_225, 4_450, 7_150), strict=True):
        assert due_ms <= seen_ms <= due_ms + 5


@pytest.mark.parametrize("gap_m", [0.040, 0.100])
def test_the_gap_is_what_the_parameter_says(gap_m: float) -> None:
    machine = MACHINE.with_values({"conveyor.gap_m": gap_m})
    conveyor = Conveyor(machine.conveyor, trays=2)
    feed(conveyor, 4_500)
    first_m, second_m = conveyor.front_m.values()
    assert first_m - 0.540 - second_m == pytest.approx(gap_m)


def test_the_magazine_waits_for_room() -> None:
    """The first tray must go 300 + 285 mm before the second fits behind it: 2.95 s."""
    conveyor = make_conveyor()
    feed(conveyor, 2_945)
    assert list(conveyor.front_m) == [0]
    assert not conveyor.magazine_empty.read()
    feed(conveyor, 10)
    assert list(conveyor.front_m) == [0, 1]
    assert conveyor.magazine_empty.read()
    assert conveyor.in_magazine == 0


def test_a_tray_leaves_at_the_far_end() -> None:
    """Its rear edge must pass 1 m: 300 + 1540 mm of way, 9.225 s."""
    conveyor = make_conveyor(1)
    feed(conveyor, 9_220)
    assert list(conveyor.front_m) == [0]
    feed(conveyor, 10)
    assert conveyor.front_m == {}


@pytest.mark.parametrize("trays", [0, 1, 5])
def test_every_tray_passes_once(trays: int) -> None:
    changes = beam_changes_ms(make_conveyor(trays), 40_000)
    assert [on for _, on in changes] == [True, False] * trays


def test_the_belt_stops_within_5_mm() -> None:
    conveyor = make_conveyor()
    feed(conveyor, 1_000)
    off_m = conveyor.belt_m
    feed(conveyor, 45, run=False)
    assert conveyor.moving
    feed(conveyor, 15, run=False)
    assert conveyor.belt_m - off_m == pytest.approx(0.005)
    assert not conveyor.moving


def test_a_stop_on_the_beam_places_the_tray() -> None:
    conveyor = make_conveyor()
    while not conveyor.beam.read():
        feed(conveyor, 5)
    feed(conveyor, 500, run=False)
    assert 0.005 <= conveyor.front_m[0] <= 0.006
    assert conveyor.placed_tray == 0


@pytest.mark.parametrize(("front_m", "placed"), [(-0.0005, None), (0.0005, 0), (0.0155, 0), (0.0165, None)])
def test_a_tray_is_placed_within_8_mm_of_8_mm_past_the_beam(front_m: float, placed: int | None) -> None:
    machine = MACHINE.with_values({"conveyor.magazine_before_beam_m": 0.100})
    conveyor = Conveyor(machine.conveyor, trays=1)
    while conveyor.front_m[0] < front_m:
        conveyor.step(0.0005, run=True, forward=True)
    assert conveyor.placed_tray == placed


def test_without_the_forward_bit_the_belt_runs_backward() -> None:
    conveyor = make_conveyor()
    feed(conveyor, 2_000)
    feed(conveyor, 500, run=False)
    before_m = conveyor.belt_m
    feed(conveyor, 1_000, forward=False)
    assert conveyor.belt_m - before_m == pytest.approx(-0.195)  # 0.2 m/s, 25 ms lost to the ramp


def test_backward_a_tray_comes_to_rest_against_the_magazine() -> None:
    conveyor = make_conveyor()
    feed(conveyor, 500)
    feed(conveyor, 5_000, forward=False)
    assert conveyor.front_m[0] == pytest.approx(-0.300)
    assert conveyor.speed_m_s == 0.0
    assert not conveyor.moving


def test_a_jammed_belt_stands_dead_and_ramps_up_again() -> None:
    conveyor = make_conveyor()
    feed(conveyor, 500)
    conveyor.jammed = True
    stuck_m = conveyor.belt_m
    feed(conveyor, 500)
    assert conveyor.belt_m == stuck_m
    assert not conveyor.moving
    conveyor.jammed = False
    feed(conveyor, 50)
    assert conveyor.belt_m - stuck_m == pytest.approx(0.005)


def test_fewer_than_no_trays_are_refused() -> None:
    with pytest.raises(ValueError, match="trays is -1"):
        make_conveyor(-1)
