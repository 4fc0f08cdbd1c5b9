"""Growth of memory: the slope and its interval, the open files, and the visits of a browser."""

from __future__ import annotations

import random
from itertools import accumulate
from pathlib import Path

import pytest

from plant_sim.twin.process import LiveError
from scripts.benchmark.live import growth
from scripts.benchmark.live.growth import Samples, slope, visit
from scripts.benchmark.live.hmi import MeasuredProcess
from tests.controller.hmi.panel.panel_rig import PanelRig

HALF_AN_HOUR = range(1_800)
TOLD_MB_PER_H = 11.0
"""Growth of 2.2 MB in 12 minutes, which must be told from none."""


def noise_mb(rng: random.Random) -> float:
    return rng.gauss(0.0, 0.05)


def test_a_growing_process_is_told_from_one_that_does_not_grow() -> None:
    rng = random.Random(1)
    grown = slope(HALF_AN_HOUR, [50 + TOLD_MB_PER_H * s / 3_600 + noise_mb(rng) for s in HALF_AN_HOUR])
    assert grown.lowest < TOLD_MB_PER_H < grown.highest
    assert grown.highest - grown.lowest < 1
    level = slope(HALF_AN_HOUR, [50 + noise_mb(rng) for _ in HALF_AN_HOUR])
    assert level.lowest < 0 < level.highest < 1


def test_memory_that_an_answer_takes_for_a_moment_is_no_growth() -> None:
    rng = random.Random(3)
    memory_mb = [50 + (rng.uniform(0, s / 100) if s % 5 else 0) for s in HALF_AN_HOUR]
    assert abs(slope(HALF_AN_HOUR, memory_mb).mean) < 0.01


def test_the_interval_of_a_memory_that_wanders_is_wider_than_that_of_independent_errors() -> None:
    rng = random.Random(2)
    independent = [rng.gauss(0.0, 0.02) for _ in HALF_AN_HOUR]
    alone, wandering = slope(HALF_AN_HOUR, independent), slope(HALF_AN_HOUR, [*accumulate(independent)])
    assert wandering.highest - wandering.lowest > 10 * (alone.highest - alone.lowest)


def test_more_open_files_are_those_of_the_last_third() -> None:
    assert Samples(files=[10, 11, 10, 15, 15, 15, 12, 11, 12]).more_files == 2
    assert Samples(files=[12, 11, 11, 15, 15, 15, 10, 11, 99]).more_files == 0


def test_memory_and_files_are_those_of_a_process() -> None:
    code = (
        "import os, signal; signal.signal(signal.SIGINT, signal.SIG_DFL); a = bytearray(30_000_000);"
        "f = [os.open('/dev/null', 0) for _ in range(7)]; print('x', flush=True); signal.pause()"
    )
    with MeasuredProcess("large", ["timeit", "-n", "1", "-r", "1", code]) as large:
        assert large.next_line(60) == "x"
        assert large.written_mb > 30
        assert large.open_files > 7


def test_a_visitor_opens_every_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(growth, "VISIT_PERIOD_S", 0.0)
    with PanelRig(tmp_path) as rig:
        assert visit(rig.origin, 0.05) % len(growth.VISITS) == 0
        monkeypatch.setattr(growth, "VISITS", ("/api/trends?span=0",))
        with pytest.raises(LiveError, match="400"):
            visit(rig.origin, 0.05)


@pytest.mark.weekly
@pytest.mark.real_time
def test_memory_and_open_files_do_not_grow_in_half_an_hour_with_clients() -> None:
    figures = growth.measure_growth(1)
    for name in ("plant", "controller", "panel"):
        assert figures[f"{name}_slope"] < 1, figures
        assert figures[f"{name}_files"] <= 0, figures
