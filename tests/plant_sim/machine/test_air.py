"""Compressed air of the machine: venting on emergency stop, soft start, reservoir, pressure switch, step length."""

from itertools import pairwise

import pytest

from plant_sim.common.parameter_file import Value
from tests.plant_sim.machine.plant_rig import Rig, make_rig

EVERYTHING = ("left.slide_inward", "left.lift_retract", "left.spread", "tray_run", "tray_forward")


def places_m(rig: Rig) -> tuple[float, ...]:
    arm = rig.left
    return arm.slide.x_m, arm.lift.y_m, arm.spreader.travel_m, rig.plant.conveyor.belt_m


def test_the_emergency_stop_removes_coil_power_and_air_regardless_of_the_outputs() -> None:
    """Stopping distances are at most 7 mm (slide), 16 mm (lift), 1.9 mm (spreader) and 5 mm plus 0.2 mm (belt)."""
    rig = Rig(trays=2)
    rig.left.place(y_m=0.075)
    rig.run(600, *EVERYTHING)
    rig.left.place(y_m=0.140)
    rig.run(300, *EVERYTHING)
    moving = places_m(rig)
    assert abs(rig.left.lift.speed_m_s) > 0.1
    rig.plant.box.emergency_stop = True
    rig.run(2_000, *EVERYTHING)
    stopped = places_m(rig)
    for before_m, after_m, run_m in zip(moving, stopped, (0.007, 0.016, 0.0019, 0.0052), strict=True):
        assert 0.001 < abs(after_m - before_m) <= run_m
    rig.run(60_000, *EVERYTHING)
    assert places_m(rig) == stopped
    rig.plant.box.emergency_stop = False
    rig.run(2_000, *EVERYTHING)
    assert rig.left.slide.x_m > stopped[0] + 0.05


def test_the_emergency_stop_vents_the_manifold_and_not_the_claws() -> None:
    """The manifold pressure falls from 601 kPa to 1/e of that in 50 to 60 ms; the claw supply retains its pressure.

    The 0.3 L manifold is vented through a conductance of 5e-8 m3/(s Pa). After 60 ms, its pressure is 601 kPa / exp(1.0
    to 1.2) = 181 to 221 kPa abs, or 80 to 120 kPa gauge.
    """
    rig = Rig()
    rig.left.place(is_open=False)
    rig.plant.box.emergency_stop = True
    rig.run(60)
    assert 0.08e6 < rig.plant.supply.pressure_pa < 0.12e6
    rig.run(440)
    assert rig.plant.supply.pressure_pa < 0.002e6
    rig.run(60_000)
    assert rig.plant.supply.pressure_pa == pytest.approx(0.0, abs=100.0)
    assert rig.plant.supply.claw_pressure_pa == pytest.approx(0.40e6, rel=0.02)
    assert rig.left.claws.clamp_n == pytest.approx(7.8, rel=0.02)


@pytest.mark.parametrize("is_open", [False, True])
def test_claws_keep_their_state_in_an_emergency_stop(is_open: bool) -> None:
    rig = Rig()
    rig.left.place(is_open=is_open)
    rig.plant.box.emergency_stop = True
    rig.run(5_000, "left.claws_open" if not is_open else "left.claws_close")
    assert rig.left.claws.angle_deg == (30 if is_open else -10)


def test_nothing_moves_when_air_returns() -> None:
    """While the air is off, the check valves hold all drives, and the soft start causes no motion."""
    rig = Rig(trays=0)
    for arm, x_m, y_m in ((rig.left, 0.15, 0.06), (rig.plant.right, 0.25, 0.12)):
        arm.place(x_m=x_m, y_m=y_m, is_open=False, travel_m=0.05)
    rig.run(400, "left.slide_inward", "right.slide_outward", "left.lift_retract", "right.lift_extend")
    rig.plant.box.emergency_stop = True
    rig.run(5_000)
    stood = [(arm.slide.x_m, arm.lift.y_m, arm.claws.angle_deg) for arm in rig.plant.arms.values()]
    rig.plant.box.emergency_stop = False
    for _ in range(500):
        rig.run(10)
        now = [(arm.slide.x_m, arm.lift.y_m, arm.claws.angle_deg) for arm in rig.plant.arms.values()]
        assert now == stood
    assert rig.plant.supply.pressure_pa == pytest.approx(0.50e6, rel=0.01)


def test_air_returns_softly() -> None:
    """At 0.6 MPa, a conductance of 0.2e-8 m3/(s Pa) passes 0.12e-2 m3/s ANR and fills 0.3 L to 2 bar in 0.5 s.

    Then the soft-start valve opens fully.
    """
    rig = Rig(trays=0)
    rig.plant.box.emergency_stop = True
    rig.run(3_000)
    rig.plant.box.emergency_stop = False
    rig.run(20)
    gauges_pa = rig.trace(lambda: rig.plant.supply.pressure_pa, 2_000)
    half_ms = next(ms for ms, gauge_pa in enumerate(gauges_pa) if gauge_pa > 0.19e6)
    full_ms = next(ms for ms, gauge_pa in enumerate(gauges_pa) if gauge_pa > 0.48e6)
    assert gauges_pa[1] < 0.005e6
    assert 300 <= half_ms <= 700
    assert full_ms - half_ms < 250
    assert all(after_pa >= before_pa for before_pa, after_pa in pairwise(gauges_pa[:full_ms]))


def test_the_pressure_switch_has_hysteresis() -> None:
    """The pressure switch turns on at 0.40 MPa and off below 0.38 MPa."""
    rig = Rig(trays=0)
    supply = rig.plant.supply
    assert supply.pressure_ok.read()
    rig.plant.box.emergency_stop = True
    falling = []
    while supply.pressure_ok.read():
        rig.run(1)
        falling.append(supply.pressure_pa)
    assert falling[-1] < 0.38e6 <= falling[-2]
    rig.run(2_000)
    rig.plant.box.emergency_stop = False
    rising = []
    while not supply.pressure_ok.read():
        rig.run(1)
        rising.append(supply.pressure_pa)
    assert rising[-2] < 0.40e6 <= rising[-1]


def test_after_lowering_the_regulator_consumption_reduces_the_pressure() -> None:
    rig = Rig(trays=0)
    rig.plant.params[0]["air"]["network"]["regulated_pa"] = 0.35e6
    for _ in range(4):
        rig.run(1_500, "left.lift_retract", "right.lift_retract")
        rig.run(1_500, "left.lift_extend", "right.lift_extend")
    rig.run(2_000)
    assert rig.plant.supply.pressure_pa == pytest.approx(0.35e6, abs=0.02e6)
    assert not rig.plant.supply.pressure_ok.read()


def edges_of_a_cycle(step_s: float) -> list[dict[str, float]]:
    """Return the times of all sensor edges of the left arm in each part of a scripted cycle, s after its start.

    Before each part all drives are set to the start positions of that part, so that errors do not accumulate.
    """
    parts: tuple[tuple[str, int, dict[str, float]], ...] = (
        ("slide_inward", 1_900, {}),
        ("lift_retract", 1_300, {"x_m": 0.1925}),
        ("slide_outward", 2_000, {"x_m": 0.1925, "y_m": 0.0}),
        ("spread", 1_300, {"y_m": 0.0}),
        ("lift_extend", 1_300, {"y_m": 0.0, "travel_m": 0.187}),
        ("converge", 1_300, {"travel_m": 0.187}),
    )
    values: dict[str, Value] = {"simulation.step_s": step_s}
    seen = []
    for coil, for_ms, place in parts:
        rig = make_rig(values, **place)
        rig.run(for_ms, f"left.{coil}")
        seen.append({tag: sensor.edge_s for tag, sensor in rig.left.sensors.items() if sensor.edge_s > 0.0})
    return seen


def test_a_finer_step_moves_no_edge_noticeably_for_a_controller() -> None:
    """Halving the step shifts spreader edges by at most 0.1 ms and does not shift cup edges.

    The measured shifts of the slide edges are 1.2 ms at the start, while the air in front of the piston is exhausted,
    and less than 0.3 ms after that; those of the lift edges are 0.5 ms, and 1.0 ms at the end of the cushion.
    """
    coarse, fine = edges_of_a_cycle(1e-3), edges_of_a_cycle(0.5e-3)
    assert [set(part) for part in coarse] == [set(part) for part in fine]
    shifts_ms: dict[str, float] = {}
    for part, finer in zip(coarse, fine, strict=True):
        for tag, edge_s in part.items():
            shifts_ms[tag] = max(shifts_ms.get(tag, 0.0), 1000 * abs(finer[tag] - edge_s))
    limits_ms = {
        "cup_pulse": 0.001,
        "claws_converged": 0.1,
        "claws_spread": 0.1,
        "slide_at_feed": 1.5,
        "slide_at_pick_1": 1.0,
        "lift_up": 2.0,
        "lift_down": 2.0,
    }
    assert shifts_ms.keys() == limits_ms.keys()
    assert {tag: shift_ms for tag, shift_ms in shifts_ms.items() if shift_ms >= limits_ms[tag]} == {}


def worked_claws(rig: Rig) -> float:
    """Open and close the claws of the left arm five times; return the final clamping force, N."""
    for _ in range(5):
        rig.run(1_000, "left.claws_open")
        rig.run(1_000, "left.claws_close")
    return rig.left.claws.clamp_n


def test_claws_can_be_set_above_the_main_pressure() -> None:
    """The claws are supplied from the receiver: at 0.6 MPa their force is 1.5 times that at 0.4 MPa.

    The main pressure remains 0.5 MPa.
    """
    rig = Rig({"crop.claw_pressure_mpa": 0.6})
    assert worked_claws(rig) == pytest.approx(1.5 * worked_claws(Rig()), rel=0.03)
    assert rig.plant.supply.claw_pressure_pa == pytest.approx(0.6e6, rel=0.02)
    assert rig.plant.supply.pressure_pa == pytest.approx(0.5e6, rel=0.02)


def test_a_low_main_pressure_does_not_affect_the_claws() -> None:
    sound_n = worked_claws(Rig())
    assert worked_claws(Rig({"supply.pressure_pa": 0.2e6})) == pytest.approx(sound_n, rel=0.001)
