"""Claws: latching valve, motion of the fingers, gripping angle and force.

Times were measured with this rig at simulation.step_s = 1e-3; at 0.1e-3 they are up to 3 ms shorter. After the coil
turns on, the delay is 15 ms in the valve and 1.9 m / 343 m/s = 5.5 ms in the tube; then the air that holds the fingers
is exhausted.
"""

import pytest

from plant_sim.common.limits import SpecError
from plant_sim.devices.claws import Claws, ClawsSpec
from tests.plant_sim.machine.plant_rig import MACHINE, Rig

OPEN_DEG, CLOSED_DEG = 30.0, -10.0


def make_claws(*, is_open: bool, claw_pressure_mpa: float = 0.40) -> tuple[Rig, Claws]:
    rig = Rig({"crop.claw_pressure_mpa": claw_pressure_mpa}, trays=0)
    rig.left.place(is_open=is_open)
    return rig, rig.left.claws


def spool(claws: Claws) -> float:
    return float(claws.state["valve"]["spool"])


def end_deg(*, is_open: bool) -> float:
    return OPEN_DEG if is_open else CLOSED_DEG


@pytest.mark.parametrize("is_open", [False, True])
def test_placed_claws_remain_in_position_under_pressure(is_open: bool) -> None:
    """The finger force is 0.40 MPa * 0.39 N m / 0.5 MPa / 40 mm = 7.8 N in either direction."""
    rig, claws = make_claws(is_open=is_open)
    for for_ms in (0, 1, 60_000):
        rig.run(for_ms)
        assert claws.angle_deg == end_deg(is_open=is_open)
        assert (claws.gripping, claws.free) == (not is_open, is_open)
        assert claws.clamp_n == pytest.approx(-7.8 if is_open else 7.8, rel=0.01)


def test_a_finger_clamps_with_its_catalogue_moment() -> None:
    """A moment of 0.39 N m at 0.5 MPa gives 9.75 N at 40 mm from the joint; at 0.30 MPa the force is 5.85 N."""
    for pressure_mpa, force_n in ((0.50, 9.75), (0.30, 5.85)):
        rig, claws = make_claws(is_open=True, claw_pressure_mpa=pressure_mpa)
        rig.run(2_000, "left.claws_close")
        assert claws.clamp_n == pytest.approx(force_n, rel=0.02)


def test_they_open_while_the_air_leaves() -> None:
    rig, claws = make_claws(is_open=False)
    angles_deg = rig.trace(lambda: claws.angle_deg, 400, "left.claws_open")
    begins_ms = next(ms for ms, angle_deg in enumerate(angles_deg) if angle_deg > CLOSED_DEG)
    ends_ms = angles_deg.index(OPEN_DEG)
    assert 70 <= begins_ms <= 80
    assert 165 <= ends_ms <= 180
    assert angles_deg == sorted(angles_deg)
    assert float(rig.left._state["freed_s"]) == pytest.approx(0.121, abs=0.003)


def test_claws_are_free_above_10_degrees_and_grip_below_minus_5() -> None:
    for coil, begins_open, is_there in (("open", False, 10.0), ("close", True, -5.0)):
        rig, claws = make_claws(is_open=begins_open)
        for _ in range(300):
            rig.run(1, f"left.claws_{coil}")
            assert claws.free == (claws.angle_deg >= 10.0)
            assert claws.gripping == (claws.angle_deg <= -5.0)
        now_s = float(rig.left._state["freed_s" if coil == "open" else "gripped_s"])
        assert 0.10 < now_s < 0.18, is_there


def test_grip_and_release_times_are_interpolated_within_a_step() -> None:
    rig, claws = make_claws(is_open=True)
    angles_deg = rig.trace(lambda: claws.angle_deg, 300, "left.claws_close")
    after = next(ms for ms, angle_deg in enumerate(angles_deg) if angle_deg <= -5.0)
    before_deg, after_deg = angles_deg[after - 1 : after + 1]
    due_s = (after - 1 + (before_deg + 5.0) / (before_deg - after_deg)) / 1000
    assert float(rig.left._state["gripped_s"]) == pytest.approx(due_s, abs=1e-9)


def test_the_grip_has_no_force_at_first() -> None:
    """The fingers close before the pressure has fully built up: the force takes about another 100 ms to reach 7 N."""
    rig, claws = make_claws(is_open=True)
    rig.run_until(lambda: claws.gripping, "left.claws_close")
    assert claws.clamp_n < 1.0
    assert 60 <= rig.run_until(lambda: claws.clamp_n > 7.0, "left.claws_close") <= 140


@pytest.mark.parametrize("is_open", [False, True])
def test_claws_keep_their_state_without_power(is_open: bool) -> None:
    rig, claws = make_claws(is_open=not is_open)
    rig.run(300, "left.claws_open" if is_open else "left.claws_close")
    rig.run(60_000)
    assert claws.angle_deg == end_deg(is_open=is_open)
    assert abs(claws.clamp_n) == pytest.approx(7.8, rel=0.02)


def test_a_pulse_of_the_coil_is_enough_if_it_is_as_long_as_the_delay_of_the_valve() -> None:
    """The pilot switches after 15 ms; the 5.5 ms in the tube delay the effect but do not require a longer pulse."""
    for pulse_ms, angle_deg in ((14, CLOSED_DEG), (15, OPEN_DEG)):
        rig, claws = make_claws(is_open=False)
        rig.run(pulse_ms, "left.claws_open")
        rig.run(500)
        assert claws.angle_deg == angle_deg


@pytest.mark.parametrize("is_open", [False, True])
def test_both_coils_together_have_no_effect(is_open: bool) -> None:
    rig, claws = make_claws(is_open=is_open)
    rig.run(1_000, "left.claws_open", "left.claws_close")
    assert claws.angle_deg == end_deg(is_open=is_open)


def test_the_remaining_coil_takes_effect() -> None:
    """If one of two energised coils turns off, its pilot releases after 20 ms in the valve and 5.5 ms in the tube."""
    rig, claws = make_claws(is_open=True)
    rig.run(100, "left.claws_open", "left.claws_close")
    rig.run(25, "left.claws_close")
    assert spool(claws) == 1.0
    rig.run(9, "left.claws_close")
    assert spool(claws) == -1.0
    rig.run(300, "left.claws_close")
    assert claws.angle_deg == CLOSED_DEG


def test_jammed_claws_do_not_move_although_the_valve_switches() -> None:
    rig, claws = make_claws(is_open=False)
    claws.jammed = True
    rig.run(500, "left.claws_open")
    assert claws.angle_deg == CLOSED_DEG
    assert spool(claws) == 1.0
    assert claws.clamp_n == pytest.approx(-7.8, rel=0.02)
    claws.jammed = False
    rig.run(100)
    assert claws.angle_deg == OPEN_DEG


def test_claws_that_cannot_grip_are_rejected() -> None:
    spec = {name: getattr(MACHINE.claws, name) for name in ClawsSpec.__slots__}
    with pytest.raises(SpecError, match="grips_below_deg must be above the closed end"):
        ClawsSpec(**spec | {"grips_below_deg": -10.0})
    with pytest.raises(SpecError, match="frees_above_deg must be between grips_below_deg and the open end"):
        ClawsSpec(**spec | {"frees_above_deg": -6.0})
