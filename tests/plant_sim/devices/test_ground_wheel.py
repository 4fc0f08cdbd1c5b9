"""Measuring wheel: travel from the drive of the cups, slip, and pulses."""

from __future__ import annotations

import pytest

from plant_sim.common.limits import SpecError
from plant_sim.devices.ground_wheel import GroundWheel, GroundWheelSpec
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from tests.wiring import wired

SPEC = GroundWheelSpec(plant_spacing_m=0.4, pulse_distance_m=0.05, pulse_share=0.5)


def test_the_travel_is_the_plant_spacing_per_plant() -> None:
    wheel = GroundWheel(SPEC)
    wheel.place(3.0)
    wheel.follow(5.0, 1.0)
    assert wheel.travel_m == pytest.approx(0.8)
    assert wheel.speed_m_s == pytest.approx(0.4)


def test_slip_of_the_drive_wheel_increases_the_travel() -> None:
    """With 20 % slip, the tractor travels 0.5 m per plant; slip changes only the travel that follows."""
    wheel = GroundWheel(SPEC)
    wheel.follow(1.0, 1.0)
    wheel.slip = 0.2
    wheel.follow(2.0, 1.0)
    assert wheel.travel_m == pytest.approx(0.4 + 0.5)


def test_one_pulse_per_pulse_distance() -> None:
    wheel = GroundWheel(SPEC)
    levels = []
    for step in range(1, 801):
        wheel.follow(step / 400, 0.01)
        levels.append(wheel.pulse.read())
    rising = sum(now and not before for before, now in zip([True, *levels], levels, strict=False))
    assert rising == round(wheel.travel_m / SPEC.pulse_distance_m) == 16
    assert sum(levels) == pytest.approx(400, abs=1)


@pytest.mark.parametrize("slip", [-0.01, 1.0])
def test_an_impossible_slip_is_rejected(slip: float) -> None:
    with pytest.raises(SpecError, match="slip"):
        GroundWheel(SPEC).slip = slip


@pytest.mark.parametrize("changed", [{"plant_spacing_m": 0.05}, {"pulse_distance_m": 0.6}, {"pulse_share": 1.0}])
def test_parameters_outside_their_limits_are_rejected(changed: dict[str, float]) -> None:
    values = {"plant_spacing_m": 0.4, "pulse_distance_m": 0.05, "pulse_share": 0.5} | changed
    with pytest.raises(SpecError, match=next(iter(changed))):
        GroundWheelSpec(**values)


def test_the_plant_drives_the_wheel_at_its_planting_frequency() -> None:
    """45 plants per minute at 0.4 m are 0.3 m/s; a jammed carousel does not stop the tractor."""
    io_map = wired("ground_pulse")
    plant = Plant(io_map, load_machine(), seed=1)
    number = io_map["ground_pulse"].number
    levels = []
    for _ in range(1_000):
        plant.step(10, io_map.safe_outputs())
        levels.append(plant.x[number])
    assert plant.ground.travel_m == pytest.approx(3.0, abs=0.01)
    rising = sum(now and not before for before, now in zip([True, *levels], levels, strict=False))
    assert abs(rising - 60) <= 1
    plant.params[0]["arms"][0]["cups"]["blocked"] = 1
    plant.step(2_000, io_map.safe_outputs())
    assert plant.ground.speed_m_s == pytest.approx(0.3, rel=0.02)
    plant.planting_frequency_per_min = 0
    plant.step(3_000, io_map.safe_outputs())
    assert plant.ground.speed_m_s == 0.0
