"""Reaction time at the plant, with real processes, and the timer of the edges."""

from __future__ import annotations

from statistics import median

import pytest

from controller.iomap.loader import DEFAULT_IO_MAP, IoMap, load_io_map
from plant_sim.benchmark import reaction
from plant_sim.benchmark.bare_loop import lateness_ns
from plant_sim.benchmark.reaction import EdgeTimer, Reaction, measure_reaction
from plant_sim.links.io_module import IoModule
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant


@pytest.fixture
def io_map(tmp_path_factory: pytest.TempPathFactory) -> IoMap:
    return load_io_map(reaction._map_with_lamps(tmp_path_factory.mktemp("map")))


@pytest.mark.parametrize("delay_ms", [1, 7, 25])
def test_the_timer_measures_the_delay_of_an_echo(io_map: IoMap, delay_ms: int) -> None:
    plant = Plant(io_map, load_machine(), seed=1, trays=1)
    plant.planting_frequency_per_min = reaction.PULSES_PER_MIN
    module = IoModule(plant, io_map)
    timer = EdgeTimer(module)
    x, y = io_map["left.cup_pulse"].number, io_map["lamp_green"].number
    past: list[bool] = []
    for _ in range(3_000):
        past.append(module.inputs()[x])
        image = io_map.safe_outputs()
        image[y] = past[max(0, len(past) - delay_ms)]
        module.write_outputs(0, image)
        module.advance(1)
        timer()
    assert len(timer.times_ms) > 10
    assert median(timer.times_ms) == delay_ms
    assert all(delay_ms - reaction.BOUNCE_MS <= each <= delay_ms for each in timer.times_ms)


def test_the_timer_counts_edges_without_an_echo(io_map: IoMap) -> None:
    plant = Plant(io_map, load_machine(), seed=1, trays=1)
    plant.planting_frequency_per_min = reaction.PULSES_PER_MIN
    module = IoModule(plant, io_map)
    timer = EdgeTimer(module)
    for _ in range(3_000):
        module.write_outputs(0, io_map.safe_outputs())
        module.advance(1)
        timer()
    assert timer.missed > 10


@pytest.mark.timeout(120)
@pytest.mark.parametrize("baud", [None, 115_200], ids=["tcp", "rtu"])
def test_real_processes_answer_the_edges(baud: int | None) -> None:
    """The reaction is bounded loosely; `scripts/bench` states the figures of an idle computer."""
    found = measure_reaction(50, seconds=3.0, baud=baud)
    assert found.edges > 10
    assert 1 < found.median_ms < 1_000
    assert found.median_ms <= found.p99_ms <= found.longest_ms
    assert f"{found.edges} edges" in found.text()


def test_goals_are_multiples_of_the_scan() -> None:
    found = Reaction("Modbus TCP", 10, 100, 0, 15.0, 25.0, 30.0, 0.6, 0.5, 0)
    assert "median 15 ms = 1.5 scans (goal: at most 2), p99 25 ms = 2.5 scans (goal: at most 3)" in found.text()
    assert "1.20 x (goal: at most 1.2)" in found.text()


def test_the_bare_loop_yields_every_deadline() -> None:
    assert len(list(lateness_ns(1_000_000, 20))) == 20
    assert load_io_map(DEFAULT_IO_MAP).get("lamp_green") is None  # the benchmark wires it in its own map
