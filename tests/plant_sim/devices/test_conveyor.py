"""Tray conveyor: the stepper and its ramp, beam edges, gaps, magazine, stops and lost steps.

At 0.2 m/s and 4 m/s2, a ramp takes 50 ms and 5 mm. A full step turns the 40 mm drum by 1.8 degrees / 3, which moves the
belt by 0.209 mm.
"""

import math

import pytest

from plant_sim.common.parameter_file import Value
from plant_sim.devices.conveyor import Conveyor
from plant_sim.machine.plant import Plant
from tests.plant_sim.machine.plant_rig import MACHINE, Rig
from tests.sampling import first_of

STEP_M = math.radians(1.8) / 3 * 0.020
FORWARD = ("tray_run", "tray_forward")


def make_conveyor(trays: int = 2, values: dict[str, Value] | None = None) -> tuple[Rig, Conveyor]:
    rig = Rig(values, trays=trays)
    return rig, rig.plant.conveyor


def test_no_tray_is_at_the_pick_position_at_first() -> None:
    rig, conveyor = make_conveyor()
    rig.run(10_000)
    assert conveyor.front_m == {0: -0.300}
    assert not conveyor.beam.read()
    assert conveyor.placed_tray is None
    assert conveyor.in_magazine == 1


def test_the_direction_alone_moves_nothing() -> None:
    rig, conveyor = make_conveyor()
    rig.run(1_000, "tray_forward")
    assert conveyor.belt_m == 0.0


def test_the_belt_ramps_up_and_down_and_stops_within_5_mm() -> None:
    """Friction of 15 N makes the belt lag by 9 um, and the motor oscillates by less than a step."""
    rig, conveyor = make_conveyor()
    rig.run(50, *FORWARD)
    assert conveyor.belt_m == pytest.approx(0.005, abs=STEP_M)
    rig.run(950, *FORWARD)
    assert conveyor.speed_m_s == pytest.approx(0.200, abs=0.001)
    off_m = conveyor.belt_m
    assert off_m == pytest.approx(0.195, abs=STEP_M)
    rig.run(45)
    assert conveyor.speed_m_s > 0.0
    rig.run(205)
    assert conveyor.speed_m_s == 0.0
    assert conveyor.belt_m - off_m == pytest.approx(0.005, abs=STEP_M)
    assert conveyor.lost_steps == 0


def test_the_beam_detects_tray_gap_tray_and_then_nothing() -> None:
    """The first edge occurs after 302 mm of travel plus 25 ms for the ramp.

    A 540 mm tray, a 45 mm gap and the next tray follow.
    """
    rig, conveyor = make_conveyor()
    edges_s: list[float] = []
    levels = []
    for _ in range(10_000):
        rig.run(1, *FORWARD)
        if conveyor.beam.edge_s not in (0.0, *edges_s):
            edges_s.append(conveyor.beam.edge_s)
            levels.append(conveyor.beam.read())
    assert levels == [True, False, True, False]
    assert edges_s == pytest.approx([1.535, 4.235, 4.460, 7.160], abs=0.0002)


@pytest.mark.parametrize("gap_m", [0.040, 0.100])
def test_the_gap_equals_the_parameter(gap_m: float) -> None:
    rig, conveyor = make_conveyor(2, {"conveyor.gap_m": gap_m})
    rig.run(4_500, *FORWARD)
    first_m, second_m = conveyor.front_m.values()
    assert first_m - 0.540 - second_m == pytest.approx(gap_m)


def test_the_magazine_waits_for_room() -> None:
    """There is room for the second tray after 2 mm of play and 300 + 285 mm of travel, i.e. after 2.96 s.

    The magazine checks for room every 10 ms.
    """
    rig, conveyor = make_conveyor()
    rig.run(2_950, *FORWARD)
    assert list(conveyor.front_m) == [0]
    assert not conveyor.magazine_empty.read()
    rig.run(20, *FORWARD)
    assert list(conveyor.front_m) == [0, 1]
    assert conveyor.magazine_empty.read()
    assert conveyor.in_magazine == 0


def test_a_withheld_tray_is_placed_at_the_magazine_once_released() -> None:
    rig, conveyor = make_conveyor()
    conveyor.withheld = True
    rig.run(4_000, *FORWARD)
    assert list(conveyor.front_m) == [0]
    conveyor.withheld = False
    rig.run(20, *FORWARD)
    assert list(conveyor.front_m) == [0, 1]
    assert conveyor.front_m[1] == pytest.approx(-0.300, abs=0.005)


def test_a_tray_leaves_at_the_far_end() -> None:
    """The rear edge must pass the belt end at 1 m, which requires 300 + 1540 mm of travel and takes 9.225 s."""
    rig, conveyor = make_conveyor(1)
    rig.run(9_220, *FORWARD)
    assert list(conveyor.front_m) == [0]
    rig.run(20, *FORWARD)
    assert conveyor.front_m == {}


@pytest.mark.parametrize(
    ("trays", "for_ms"), first_of([(0, 4_000), (1, 8_000), (5, 20_000), (0, 20_000), (1, 20_000)], 3)
)
def test_every_tray_passes_once(trays: int, for_ms: int) -> None:
    rig, conveyor = make_conveyor(trays)
    changes = rig.changes(conveyor.beam, for_ms, *FORWARD)
    assert [on for _, on in changes] == [True, False] * trays


def test_a_stop_on_the_beam_places_the_tray() -> None:
    rig, conveyor = make_conveyor()
    rig.run_until(conveyor.beam.read, *FORWARD)
    rig.run(500)
    assert 0.005 <= conveyor.front_m[0] <= 0.0065
    assert conveyor.placed_tray == 0


@pytest.mark.parametrize("past_m", [-0.0090, -0.0070, 0.0070, 0.0090])
def test_a_tray_is_placed_within_8_mm_of_the_pick_position(past_m: float) -> None:
    due_m = MACHINE.conveyor.stop_past_beam_m + past_m
    rig, conveyor = make_conveyor(1, {"conveyor.magazine_before_beam_m": 0.100})
    while conveyor.front_m[0] < due_m:
        rig.run(1, *FORWARD)
    assert conveyor.front_m[0] - due_m < 0.0003
    assert conveyor.placed_tray == (0 if abs(past_m) < 0.008 else None)


def test_without_the_forward_bit_the_belt_runs_backward() -> None:
    rig, conveyor = make_conveyor()
    rig.run(2_000, *FORWARD)
    rig.run(500)
    before_m = conveyor.belt_m
    rig.run(1_000, "tray_run")
    assert conveyor.belt_m - before_m == pytest.approx(-0.195, abs=STEP_M)  # 0.2 m/s, 25 ms lost to the ramp


def test_a_tray_driven_backward_stops_against_the_magazine_and_steps_are_lost() -> None:
    """The tray moves back 95 mm in just over 0.5 s; for the rest of the 5 s the motor is driven but blocked."""
    rig, conveyor = make_conveyor()
    rig.run(500, *FORWARD)
    rig.run(5_000, "tray_run")
    assert conveyor.front_m[0] == pytest.approx(-0.300)
    rig.run(500)
    assert conveyor.speed_m_s == 0.0
    assert conveyor.front_m[0] == pytest.approx(-0.300, abs=4 * STEP_M)
    lost = (5.0 * 0.2 - 0.100) / STEP_M
    assert -conveyor.lost_steps == pytest.approx(lost, abs=60)


class TestLostSteps:
    """Steps that the motor cannot follow are lost in multiples of four, undetected by the controller."""

    def test_a_blocked_belt_does_not_move_while_its_drive_continues(self) -> None:
        """Half a second at 0.2 m/s corresponds to 100 mm of belt travel, i.e. 477 steps."""
        rig, conveyor = make_conveyor()
        rig.run(500, *FORWARD)
        conveyor.jammed = True
        stuck_m = conveyor.belt_m
        rig.run(500, *FORWARD)
        assert conveyor.belt_m == stuck_m
        assert conveyor.speed_m_s == 0.0
        assert conveyor.lost_steps == pytest.approx(477, abs=4)

    def test_a_released_belt_follows_again_and_the_steps_remain_lost(self) -> None:
        rig, conveyor = make_conveyor()
        rig.run(500, *FORWARD)
        conveyor.jammed = True
        rig.run(500, *FORWARD)
        conveyor.jammed = False
        rig.run(500, *FORWARD)
        lost = conveyor.lost_steps
        assert conveyor.speed_m_s == pytest.approx(0.200, abs=0.002)
        assert lost > 450
        rig.run(1_000, *FORWARD)
        rig.run(300)
        assert conveyor.lost_steps == lost
        assert lost % 4 == 0
        due_m = 0.2 * (2.5 - 0.025) + 0.005
        assert conveyor.belt_m == pytest.approx(due_m - lost * STEP_M, abs=STEP_M)

    @pytest.mark.parametrize(("share", "loses"), [(1.0, False), (0.6, False), (0.2, True)])
    def test_a_weak_motor_loses_steps_in_its_ramp_and_then_follows_the_drive(self, share: float, loses: bool) -> None:
        """A ramp needs 14.75 kg * 4 m/s2 + 15 N = 74 N; the limit at 0.2 m/s is 180 N / (1 + (0.2 / 0.6)^2) = 162 N."""
        rig, conveyor = make_conveyor()
        conveyor.params["holds_n"] *= share
        rig.run(2_000, *FORWARD)
        assert (conveyor.lost_steps > 0) is loses
        assert conveyor.lost_steps % 4 == 0
        assert conveyor.speed_m_s == pytest.approx(0.200, abs=0.002)
        assert conveyor.belt_m == pytest.approx(0.395 - conveyor.lost_steps * STEP_M, abs=STEP_M)


@pytest.mark.parametrize("run_ms", range(300, 340, 4))
def test_a_belt_whose_motor_just_balances_the_friction_comes_to_rest(run_ms: int) -> None:
    rig, conveyor = make_conveyor()
    conveyor.params["holds_n"] *= 0.1
    rig.run(run_ms, *FORWARD)
    rig.run(5_000)
    assert conveyor.speed_m_s == 0.0


def test_a_negative_number_of_trays_is_rejected() -> None:
    with pytest.raises(ValueError, match="trays is -1"):
        Plant(Rig().io_map, MACHINE, seed=1, trays=-1)


def test_the_pushers_take_up_their_play_before_a_tray_moves() -> None:
    """In either direction, the trays follow after 2 mm of belt travel; within the play, friction holds them."""
    rig, conveyor = make_conveyor()
    rig.run(2_000, *FORWARD)
    rig.run(500)
    at_m = conveyor.trays_m
    assert conveyor.belt_m - at_m == pytest.approx(0.002, abs=0.0001)  # the rotor oscillates slightly as it stops
    while conveyor.belt_m > at_m:
        assert conveyor.trays_m == at_m
        rig.run(1, "tray_run")
    rig.run(100, "tray_run")
    assert conveyor.trays_m == conveyor.belt_m < at_m


def test_a_tray_taken_off_leaves_the_beam_and_the_arms_and_the_next_one_follows() -> None:
    rig, conveyor = make_conveyor()
    while conveyor.placed_tray is None:
        rig.run(10, *FORWARD)
    rig.run(500)
    seen = [(conveyor.beam.read(), rig.plant._bed.is_empty)]
    conveyor.take_off(0)
    rig.run(10)
    seen.append((conveyor.beam.read(), rig.plant._bed.is_empty))
    assert seen == [(True, False), (False, True)]
    assert rig.plant.counts().in_tray == 2 * 72
    assert conveyor.front_m == {}
    rig.run(4_000, *FORWARD)
    assert (list(conveyor.front_m), conveyor.beam.read()) == ([1], True)
    with pytest.raises(KeyError):
        conveyor.take_off(0)
