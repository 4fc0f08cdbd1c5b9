"""Reaction time at the plant, with real processes, and the timer of the edges."""

from __future__ import annotations

import signal
from statistics import median

import pytest

from controller.common.modbus.io_map import IoMap
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.links.io_module import IoModule
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.process import LiveError
from scripts.benchmark.catalogue import PARTS
from scripts.benchmark.live import reaction
from scripts.benchmark.live.bare_loop import lateness_ns
from scripts.benchmark.live.reaction import EdgeTimer, measure_reaction
from tests.sampling import first_of


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


@pytest.mark.nightly
@pytest.mark.parametrize("baud", first_of([115_200, None]))
def test_real_processes_answer_the_edges(baud: int | None) -> None:
    """The reaction is bounded loosely; `scripts/bench` states the figures of an idle computer.

    Most edges are answered, unless a bare loop beside the controller is late by half a scan on this computer.
    """
    found = measure_reaction(1, scan_ms=50, seconds=3.0, baud=baud)
    assert found["edges"] + found["missed"] > 10
    assert found["edges"] > found["missed"] or found["bare_p99"] >= 25
    assert 1 < found["median"] < 1_000
    assert found["median"] <= found["p99"] <= found["longest"]
    assert found["median_scans"] == found["median"] / 50
    (part,) = (part for part in PARTS if part.name == "reaction-10")
    assert set(found) == set(part.figures)


def test_a_failed_process_is_reported_by_name(capfd: pytest.CaptureFixture[str]) -> None:
    with (
        reaction._process("scripts.benchmark.live.bare_loop", "--nothing") as process,
        pytest.raises(LiveError, match=r"^scripts\.benchmark\.live\.bare_loop ended with exit code 2$"),
    ):
        reaction._figures(process)
    assert "--scan-ms" in capfd.readouterr().err


def test_a_process_that_does_not_end_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reaction, "LIMIT_S", 0.1)
    with (
        reaction._process("scripts.benchmark.live.bare_loop", "--scan-ms", "10", "--seconds", "100") as process,
        pytest.raises(LiveError, match=r"did not end within 0 s$"),
    ):
        reaction._figures(process)
    assert process.returncode == -signal.SIGKILL


def test_the_bare_loop_yields_every_deadline() -> None:
    assert len(list(lateness_ns(1_000_000, 20))) == 20
    assert load_io_map(DEFAULT_IO_MAP).get("lamp_green") is None  # the benchmark wires it in its own map
