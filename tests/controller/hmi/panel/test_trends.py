"""Trends over hours: extremes and gaps at any span, cycles of the history, and the answers of the panel."""

from __future__ import annotations

import asyncio
import sys
import tracemalloc
from collections.abc import Sequence
from pathlib import Path

import pytest

from controller.events.kinds import CycleEvent
from controller.history.query import HistoryReader
from controller.history.writer import HistoryWriter
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.panel.modbus.telemetry import Telemetry, TelemetryTag
from controller.hmi.panel.view.trend_periods import GAP_MS
from controller.hmi.panel.view.trends import (
    KEPT_MS,
    MOST_PERIODS,
    MOST_POINTS,
    PERIOD_MS,
    SAMPLE_MS,
    SAMPLED_MS,
    Trends,
)
from controller.program.tags import Side
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.machine.plant import Plant
from tests.controller.common.modbus_rig import IO_MAP, MACHINE
from tests.controller.hmi.panel.panel_rig import PanelRig
from tests.controller.hmi.panel.trend_rig import HOUR_MS, NAME, NOON_MS, Recorder, known, stored, values

# --- extremes, points and gaps --------------------------------------------------------------------


@pytest.fixture(scope="module")
def half_day() -> Recorder:
    """Return a recorder after 12 h, with one low sample in the second hour and one high sample in the last minute."""
    recorder = Recorder()
    pressures = [390.0] * (12 * 3_600)
    pressures[5_000], pressures[-30] = 310.0, 505.0
    recorder.record(pressures, every_ms=1_000)
    return recorder


@pytest.mark.parametrize("points", [10, 300, MOST_POINTS])
@pytest.mark.parametrize("span_ms", [60_000, SAMPLED_MS, HOUR_MS, 12 * HOUR_MS, KEPT_MS])
def test_an_answer_is_as_long_as_the_page_is_wide_and_keeps_the_extremes(
    half_day: Recorder, span_ms: int, points: int
) -> None:
    answer = half_day.answer(span_ms, points=points)
    times = answer["tables"][0]["times"]
    assert 5 <= len(times) <= points + 1
    assert times == sorted(set(times))
    found = values(answer)
    assert max(known(found["high"])) == 505.0
    assert min(known(found["low"])) == (310.0 if span_ms >= 12 * HOUR_MS else 390.0)
    assert None not in found["mean"], "nothing is missing"


def test_a_shorter_span_has_finer_points(half_day: Recorder) -> None:
    steps = [half_day.answer(span_ms)["step_ms"] for span_ms in (12 * HOUR_MS, HOUR_MS, SAMPLED_MS, 10_000)]
    assert steps == [144_000, 12_000, 2_000, SAMPLE_MS]
    dip_ms = NOON_MS + 5_000_000
    table = half_day.answer(60_000, dip_ms + 30_000)["tables"][0]
    assert len(table["times"]) == 60_000 // PERIOD_MS
    (lowest,) = [n for n, low in enumerate(table["series"][NAME]["low"]) if low == 310.0]
    assert abs(table["times"][lowest] - dip_ms) <= PERIOD_MS
    assert table["series"][NAME]["mean"][lowest] == 382.0, "one of ten samples"


def test_what_is_older_than_the_limit_is_dropped_from_memory() -> None:
    recorder = Recorder()
    recorder.record([390.0] * (MOST_PERIODS + 100), every_ms=PERIOD_MS)
    table = recorder.answer(KEPT_MS, points=MOST_POINTS)["tables"][0]
    assert recorder.at_ms - KEPT_MS <= table["times"][0] + 87_000
    assert len(recorder.trends._periods) == MOST_PERIODS
    assert len(recorder.trends._samples) == SAMPLED_MS // SAMPLE_MS


def test_an_answer_takes_no_more_memory_than_its_samples_in_the_ring() -> None:
    """The panel would grow by all samples as objects at once, or by a copy of all that has been recorded."""
    recorder = Recorder()
    recorder.record([390.0] * MOST_PERIODS, every_ms=PERIOD_MS)
    recorder.record(float(n) for n in range(SAMPLED_MS // SAMPLE_MS))
    kept = len(recorder.trends._samples)
    tracemalloc.start()
    recorder.answer(SAMPLED_MS, points=100)
    (_, peak), own = tracemalloc.get_traced_memory(), sys.getsizeof(recorder.trends._samples._values)
    tracemalloc.stop()
    assert kept == SAMPLED_MS // SAMPLE_MS
    assert peak < 4 * own


@pytest.mark.parametrize("span_ms", [60_000, HOUR_MS])
def test_a_missing_time_is_a_gap_and_so_is_a_missing_value(span_ms: int) -> None:
    recorder = Recorder()
    recorder.record([390.0] * 50)
    recorder.at_ms += 20_000
    recorder.record([391.0] * 25 + [None] * 50 + [392.0] * 25)
    means = values(recorder.answer(span_ms))["mean"]
    assert means[0] == 390.0
    assert means[-1] is not None
    gaps = [n for n, mean in enumerate(means) if mean is None]
    assert len(gaps) >= (51 if span_ms == 60_000 else 1)
    assert known(means[: gaps[0]]) == means[: gaps[0]]


def test_a_sample_that_is_a_little_late_is_no_gap() -> None:
    recorder = Recorder()
    recorder.record([390.0] * 5, every_ms=SAMPLE_MS + GAP_MS - 1)
    assert None not in values(recorder.answer(60_000))["mean"]
    recorder.record([390.0] * 2, every_ms=SAMPLE_MS + GAP_MS)
    assert values(recorder.answer(60_000))["mean"].count(None) == 1


def test_times_ascend_after_the_wall_clock_has_been_set_back() -> None:
    recorder = Recorder()
    recorder.record([390.0] * 300)
    recorder.at_ms -= 30_000
    recorder.record([380.0] * 100)
    answer = recorder.answer(120_000, points=MOST_POINTS)
    times, means = answer["tables"][0]["times"], values(answer)["mean"]
    assert times == sorted(set(times))
    assert means[-100:] == [380.0] * 100
    assert means.count(390.0) == 150


# --- cycles of the history ------------------------------------------------------------------------


def history_of(path: Path, cycles: Sequence[tuple[int, Side, int, int]]) -> HistoryReader:
    """Write cycles (end in wall-clock time, arm, time, waiting time, ms) into a history."""
    times = iter([NOON_MS, *(utc_ms for utc_ms, *_ in cycles)])
    writer = HistoryWriter(path, wall_ms=lambda: next(times), program="transplanter", version="0")
    for _, side, cycle_ms, waiting_ms in cycles:
        writer.write(CycleEvent(0, side, 1, cycle_ms, waiting_ms, 0))
    writer.close()
    return HistoryReader(path)


def test_cycles_come_from_the_history_without_any_telemetry(tmp_path: Path) -> None:
    sides: list[Side] = ["left", "right"]
    ends = range(NOON_MS, NOON_MS + 5 * HOUR_MS, 60_000)
    cycles = [(utc_ms, sides[n % 2], 8_000 + n, 500 + n) for n, utc_ms in enumerate(ends)]
    history = history_of(tmp_path / "history.sqlite", cycles)
    hour = history.cycle_times(NOON_MS + HOUR_MS, NOON_MS + 2 * HOUR_MS)
    assert [cycle.utc_ms for cycle in hour] == list(ends)[60:120]
    reader = Trends(None, history, None, lambda: NOON_MS + 5 * HOUR_MS)
    answer = asyncio.run(reader.answer(90 * 60_000, NOON_MS + 9 * HOUR_MS // 2, 500))
    table = answer["tables"][1]
    assert table["times"] == list(ends)[180:270]
    assert known(table["series"]["left.cycle_ms"]["mean"]) == [8_000 + n for n in range(180, 270, 2)]
    assert known(table["series"]["right.waiting_ms"]["high"]) == [500 + n for n in range(181, 270, 2)]
    hourly = answer["tables"][2]
    assert hourly["times"] == [NOON_MS + 3 * HOUR_MS, NOON_MS + 4 * HOUR_MS, answer["to_ms"]]
    assert hourly["series"]["left.rows_per_h"]["mean"] == [30, 30, 30], (
        "complete hours, also of the last one, which is shown in part"
    )
    coarse = asyncio.run(reader.answer(5 * HOUR_MS, None, 10))["tables"][1]
    assert len(coarse["times"]) <= 11
    assert max(known(coarse["series"]["right.cycle_ms"]["high"])) == 8_299
    assert min(known(coarse["series"]["left.cycle_ms"]["low"])) == 8_000


def test_without_a_history_there_are_no_cycles(tmp_path: Path) -> None:
    for history in (None, HistoryReader(tmp_path / "history.sqlite")):
        answer = Recorder(history=history).answer(HOUR_MS)
        assert [table["times"] for table in answer["tables"]] == [[], [], []]
    (tmp_path / "history.sqlite").write_bytes(b"damaged" * 1_000)
    assert Recorder(history=HistoryReader(tmp_path / "history.sqlite")).answer(HOUR_MS)["tables"][1]["times"] == []


# --- panel ----------------------------------------------------------------------------------------


def test_the_panel_answers_and_writes_its_last_period_when_it_stops(tmp_path: Path) -> None:
    tags = [TelemetryTag(name=NAME, table="input", address=32, scale=0.1)]
    plant = Plant(IO_MAP, MACHINE, seed=1)
    with ServerThread(PlantServer(IoModule(plant, IO_MAP), port=0)) as served:
        port = served.server.port
        with PanelRig(
            tmp_path, telemetry=lambda clock: Telemetry(ModbusConnection("127.0.0.1", port), tags, clock)
        ) as rig:
            with rig.browser() as browser:
                query = "/api/trends?span=600000&points=300"
                while not known(values(rig.here.get(query).json())["mean"]):
                    browser.read()
            answer = rig.here.get(query).json()
            assert answer["to_ms"] - answer["from_ms"] == 600_000
            assert answer["to_ms"] == answer["now_ms"]
            for wrong in ("", "?span=600000", "?points=300", "?span=x&points=1", "?span=999&points=1"):
                assert rig.here.get(f"/api/trends{wrong}").status_code == 400, wrong
            for wrong in (f"span={KEPT_MS + 1}&points=1", f"span=600000&points={MOST_POINTS + 1}"):
                assert rig.here.get(f"/api/trends?{wrong}").status_code == 400, wrong
            assert rig.here.get(f"{query}&end=x").status_code == 400
            assert rig.here.get(f"{query}&end=1").json()["tables"][0]["times"] == []
    assert len(stored(tmp_path / "trends.sqlite")) >= 1
