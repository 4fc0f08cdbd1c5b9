"""The measurement of the operator's side: what it counts, what it notices, and that its load is a load."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields

import pytest
from hmi_rig import HmiRig, read_long

from controller.hmi.fx3u import register_address
from controller.io.loop import BOUNDS_US, Histogram
from plant_sim.bench import hmi_load
from plant_sim.bench.live import LiveError
from plant_sim.bench.measure_hmi import HmiFigures, Punctuality, measure_punctuality, measure_service


def told(capsys: pytest.CaptureFixture[str]) -> dict[str, int]:
    """What a role has told last."""
    last: dict[str, int] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return last


@contextmanager
def server(serve: Callable[[socket.socket], None]) -> Iterator[int]:
    """Serve one connection by hand; gives the port."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def accept() -> None:
            with listener.accept()[0] as line:
                serve(line)

        thread = threading.Thread(target=accept)
        thread.start()
        yield listener.getsockname()[1]
        thread.join()


@pytest.mark.parametrize(
    ("times_us", "percent", "bound_ms"),
    [
        ([50] * 99 + [1_500], 99, 0.1),
        ([50] * 98 + [1_500] * 2, 99, 2.0),
        ([50] * 99 + [1_500], 100, 2.0),
        ([2_000] * 100, 99, 2.0),
        ([2_001] * 100, 99, 3.0),
        ([BOUNDS_US[-1] + 1], 100, 1_000.0),
    ],
)
def test_a_percentile_is_the_bound_of_its_bucket(times_us: list[int], percent: float, bound_ms: float) -> None:
    histogram = Histogram()
    for time_us in times_us:
        histogram.add(time_us)
    assert hmi_load.percentile_ms(histogram.counts, percent) == bound_ms


def test_a_machine_that_does_not_scan_is_not_punctual() -> None:
    with pytest.raises(LiveError, match="no scan"):
        Punctuality.of([0] * (len(BOUNDS_US) + 1), 0)


def test_clients_read_fifty_times_a_second_each(capsys: pytest.CaptureFixture[str]) -> None:
    """Given a served machine, each client reads coils and registers once in 20 ms."""
    with HmiRig() as rig:
        hmi_load.clients(rig.server.port, 2, 1)
        assert told(capsys) == {"answers": 2 * 2 * 50}
        assert rig.server.traffic.requests == 200


def test_every_whole_frame_is_answered_and_the_machine_still_is(capsys: pytest.CaptureFixture[str]) -> None:
    """Given rubbish and connections that end, the server answers the next client, and as many frames as were whole."""
    with HmiRig() as rig:
        hmi_load.rubbish(rig.server.port, 400, 60, seed=3)
        answered = told(capsys)["answered"]
        assert 250 < answered < 400
        assert rig.server.traffic.requests >= answered
        assert rig.server.traffic.bad_frames > 0
        assert rig.server.traffic.refused == 0
        assert read_long(rig.client(), "R", 0) == rig.twin.plc.scans


def test_a_server_that_closes_instead_of_answering_is_noticed() -> None:
    with (
        server(lambda line: line.close()) as port,
        hmi_load.connect(port) as line,
        pytest.raises(hmi_load.SilentServerError, match=r"closed instead|no answer"),
    ):
        hmi_load.read_registers(line, 0, 2)


def test_a_server_that_does_not_answer_ends_the_role_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Given rubbish to a server that takes all and says nothing, the role ends with what is missing."""
    monkeypatch.setattr(hmi_load, "LIMIT_S", 0.2)

    def swallow(line: socket.socket) -> None:
        while line.recv(4_096):
            pass

    with server(swallow) as port, pytest.raises(SystemExit, match=r"rubbish: (no answer|the server keeps)"):
        hmi_load.main(["rubbish", str(port), "100", "0", "1"])


def test_a_refusal_is_no_reading() -> None:
    with (
        HmiRig() as rig,
        hmi_load.connect(rig.server.port) as line,
        pytest.raises(hmi_load.SilentServerError, match="exception 2"),
    ):
        hmi_load.read_registers(line, register_address("R", 0) - 1, 1)


def test_the_text_names_every_figure() -> None:
    """Given figures that are all different, each is in the text."""
    values = [float(100 + number) for number in range(len(fields(HmiFigures)))]
    text = HmiFigures(*values).hmi_text()
    assert [value for value in values if f"{value:.0f}" not in text] == []


@pytest.mark.nightly
@pytest.mark.timeout(300)
def test_the_whole_measurement_with_real_processes() -> None:
    """Given short times, all figures come, the clients were answered, the browsers saw something."""
    figures = HmiFigures(**measure_punctuality(waits_s=1, quiet_s=1, loaded_s=2),
                         **measure_service(frames=500, connections=200))  # fmt: skip
    assert figures.answers_per_s > 100
    assert figures.views_per_s > 1
    assert 0 < figures.frames_answered < 500
    assert figures.memory_before_mb > 10
