"""Real time in ticks of 1 ms, measured durations, and the timing of output writes."""

from __future__ import annotations

import asyncio
import selectors
from random import Random

import pytest

from plant_sim.links.durations import Durations
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.real_time import MOST_TICKS_AT_A_REQUEST, RealTime, precise_loop
from plant_sim.links.write_timing import MOST_CLIENTS, ClientTiming, LinkTiming
from tests.controller.common.modbus_rig import READ_ALL_INPUTS, read_registers, write_coils_pdu
from tests.plant_sim.links.block_rig import Rig, make_module


class TestDurations:
    """Percentiles are within the width of a class."""

    def test_percentiles_are_correct_within_two_percent(self) -> None:
        rng, durations = Random(1), Durations()
        values = sorted(rng.lognormvariate(-7, 1) for _ in range(5_000))
        for value in rng.sample(values, len(values)):
            durations.add(value)
        for percent in (1, 50, 99, 100):
            exact = values[max(0, -(-percent * len(values) // 100) - 1)]
            found = durations.percentile_s(percent)
            assert found is not None
            assert found == pytest.approx(exact, rel=0.02)
        assert durations.longest_s == values[-1]
        assert durations.mean_s == pytest.approx(sum(values) / len(values))
        mean = durations.mean_s
        assert durations.deviation_s == pytest.approx((sum((v - mean) ** 2 for v in values) / len(values)) ** 0.5)

    def test_nothing_measured_and_negative_values(self) -> None:
        durations = Durations()
        assert (durations.percentile_s(50), durations.deviation_s) == (None, 0.0)
        durations.add(-1.0)
        assert (durations.count, durations.percentile_s(99), durations.longest_s) == (1, 0.0, 0.0)


class TestWriteTiming:
    """Period, jitter and longest gap of a client."""

    def test_outputs_in_several_requests_have_the_period_of_the_scan(self) -> None:
        """Two requests per scan, 2 ms apart: the period is that of the output that was written first."""
        timing = ClientTiming(0)
        for scan in range(101):
            timing.add(0, 7, scan * 0.01)
            timing.add(8, 17, scan * 0.01 + 0.002)
        assert timing.periods.count == 100
        assert timing.periods.percentile_s(50) == pytest.approx(0.01, rel=0.02)
        assert timing.periods.deviation_s == pytest.approx(0, abs=1e-9)
        assert timing.longest_gap_s == pytest.approx(0.008)

    def test_jitter_and_gap(self) -> None:
        timing = LinkTiming()
        for now_s in (0.0, 0.01, 0.03, 0.04):
            timing.add("a", 0, 17, now_s)
        assert timing.latest is not None
        assert timing.lines() == [
            "outputs from a: 4 writes, period 10.00 ms (p50), 20.00 ms (p99), jitter 4.71 ms, longest gap 20.0 ms"
        ]

    def test_only_the_latest_clients_are_kept(self) -> None:
        timing = LinkTiming()
        for number in range(MOST_CLIENTS + 3):
            timing.add(f"client {number}", 0, 17, 0.0)
            timing.add("steady", 0, 17, 0.0)
        assert len(timing.clients) == MOST_CLIENTS
        assert timing.clients["steady"].writes == MOST_CLIENTS + 3
        assert timing.latest is timing.clients["steady"]


class FakeLoop:
    """Time that a test sets."""

    now_s = 0.0


def test_a_request_executes_the_ticks_that_are_due_but_not_many() -> None:
    """The state that a client sees is that of the present millisecond; a long delay is made up between requests."""
    advanced: list[int] = []
    timing = LinkTiming()

    def advance(for_ms: int) -> bool:
        advanced.append(for_ms)
        return True

    real_time = RealTime(advance, timing)
    real_time.catch_up()
    assert advanced == [], "not started"
    clock = FakeLoop()
    real_time._elapsed_s = lambda: clock.now_s
    for now_ms, total in ((0.9, 0), (1.0, 1), (1.9, 1), (4.2, 4), (4 + MOST_TICKS_AT_A_REQUEST + 1.5, 4)):
        clock.now_s = now_ms / 1_000
        real_time.catch_up()
        assert sum(advanced) == total
    assert timing.lateness.count == 4
    assert timing.lateness.longest_s == pytest.approx(0.0022)


def test_the_timers_of_the_plant_are_not_rounded_to_milliseconds() -> None:
    loop = precise_loop()
    try:
        assert isinstance(loop._selector, selectors.SelectSelector)  # type: ignore[attr-defined]
    finally:
        loop.close()


def test_ticks_are_counted_with_their_lateness() -> None:
    """Plant time, the number of ticks and the measured lateness agree in a run of 200 ms by the wall clock."""
    with Rig(PlantServer(make_module(), port=0)) as rig:
        client = rig.client()
        while read_registers(client)["time_ms"] < 200:
            client.ask(READ_ALL_INPUTS)
        telemetry = read_registers(client)
        timing = rig.module.timing
        ticks, time_ms = rig.thread.call(lambda: (timing.lateness.count, rig.module.plant.time_ms))
        assert ticks == time_ms
        assert 0 < telemetry["tick_lateness_ms"] <= telemetry["tick_lateness_p99_ms"]
        assert telemetry["tick_lateness_p99_ms"] <= telemetry["tick_lateness_longest_ms"]
        assert timing.lines()[0].startswith("ticks of 1 ms: ")


def test_inputs_are_sampled_at_the_millisecond() -> None:
    """A client that polls sees plant times that are not multiples of the former tick of 5 ms."""
    with Rig(PlantServer(make_module(), port=0)) as rig:
        client = rig.client()
        times = {int(read_registers(client)["time_ms"]) % 5 for _ in range(300)}
        while len(times) < 5:
            times.add(int(read_registers(client)["time_ms"]) % 5)


def test_the_period_of_a_client_is_measured_by_the_clock_in_lock_step_by_plant_time() -> None:
    with Rig(PlantServer(make_module(), port=0, lock_step_ms=10)) as rig:
        client = rig.client()
        for _ in range(20):
            client.ask(write_coils_pdu(0, "0" * 18))
        telemetry = read_registers(client)
        assert telemetry["write_period_ms"] == pytest.approx(10.0, rel=0.02)
        assert telemetry["write_jitter_ms"] == 0
        assert telemetry["longest_gap_ms"] == 10


def test_a_gap_is_told_by_the_server() -> None:
    """A client of a plant in real time that does not write for longer than the limit."""
    said: list[str] = []
    with Rig(PlantServer(make_module(), port=0, gap_limit_ms=20, tell=said.append)) as rig:
        client = rig.client()
        client.ask(write_coils_pdu(0, "0" * 18))
        while read_registers(client)["gaps"] == 0:
            pass
        client.ask(write_coils_pdu(0, "0" * 18))
    assert "between output writes of 127.0.0.1:" in said[0]
    assert "(limit 20 ms)" in said[0]


def test_the_timing_is_independent_of_the_event_loop_of_the_caller() -> None:
    """A server on an ordinary event loop works as well."""

    async def run() -> int:
        server = PlantServer(make_module(), port=0)
        await server.start()
        while server.module.plant.time_ms < 20:
            await asyncio.sleep(0)
        await server.stop()
        return server.module.timing.lateness.count

    assert asyncio.run(run()) >= 20
