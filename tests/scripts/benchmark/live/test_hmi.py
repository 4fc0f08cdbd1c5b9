"""Benchmark of the operator interface: figures, fault detection and generated load."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import cast

import pytest

from controller.hmi.modbus.fx3u_map import register_address
from controller.io.loop import BOUNDS_US, Histogram
from controller.program.states import State
from plant_sim.twin.lock_step import CLEAR_MS
from plant_sim.twin.operator import Operator
from plant_sim.twin.process import LiveError, Process
from scripts.benchmark.live import hmi, hmi_load
from scripts.benchmark.live.hmi import Attendant, measure_malformed, measure_punctuality
from scripts.benchmark.live.ladder_page import LOOK, looks_of, measure_ladder_page
from scripts.benchmark.live.punctuality import Punctuality
from tests.controller.hmi.hmi_rig import HmiRig, read_long


def last_report(capsys: pytest.CaptureFixture[str]) -> dict[str, int]:
    """Return the last figures printed by a role of the benchmark."""
    last: dict[str, int] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return last


@contextmanager
def server(serve: Callable[[socket.socket], None], connections: int = 1) -> Iterator[int]:
    """Serve one connection after another with a function; yield the port number."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(10)  # a client that does not connect leaves no thread behind

        def accept() -> None:
            for _ in range(connections):
                with listener.accept()[0] as connection:
                    serve(connection)

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


def test_a_machine_that_does_not_scan_has_no_punctual_scans() -> None:
    with pytest.raises(LiveError, match="no scan"):
        Punctuality.of([0] * (len(BOUNDS_US) + 1), 0)


def test_clients_read_fifty_times_a_second_each(capsys: pytest.CaptureFixture[str]) -> None:
    """Each client reads coils and registers once every 20 ms."""
    with HmiRig() as rig:
        hmi_load.clients(rig.server.port, 2, 1)
        assert last_report(capsys) == {"answers": 2 * 2 * 50}
        assert rig.server.traffic.requests == 200


def test_the_server_survives_malformed_frames_and_closed_connections(capsys: pytest.CaptureFixture[str]) -> None:
    """Every complete frame gets an answer, and the next client is served."""
    with HmiRig() as rig:
        hmi_load.malformed(rig.server.port, 400, 60, seed=3)
        answered = last_report(capsys)["answered"]
        assert 250 < answered < 400
        assert rig.server.traffic.requests >= answered
        assert rig.server.traffic.bad_frames > 0
        assert rig.server.traffic.refused == 0
        assert read_long(rig.client(), "R", 0) == rig.twin.plc.scans


def test_a_server_that_closes_the_connection_is_reported() -> None:
    with (
        server(lambda connection: connection.close()) as port,
        hmi_load.connect(port) as connection,
        pytest.raises(hmi_load.SilentServerError, match=r"closed the connection|no answer"),
    ):
        hmi_load.read_registers(connection, 0, 2)


def test_a_server_without_a_response_ends_the_role_with_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the server accepts all bytes and sends none, the message names the missing response."""
    monkeypatch.setattr(hmi_load, "LIMIT_S", 0.2)

    def swallow(connection: socket.socket) -> None:
        while connection.recv(4_096):
            pass

    with server(swallow) as port, pytest.raises(SystemExit, match=r"malformed: (no answer|the server did not close)"):
        hmi_load.main(["malformed", str(port), "100", "0", "1"])


def test_an_exception_response_does_not_count_as_a_reading() -> None:
    with (
        HmiRig() as rig,
        hmi_load.connect(rig.server.port) as connection,
        pytest.raises(hmi_load.SilentServerError, match="exception 2"),
    ):
        hmi_load.read_registers(connection, register_address("R", 0) - 1, 1)


class Reporter:
    """Controller that has reported some states and alarms."""

    name = "controller"

    def __init__(self, *reported: State | int) -> None:
        self._lines = iter(
            {"event": "state", "state": each, "text": each.name, "reason": ""}
            if isinstance(each, State)
            else {"event": "alarm", "number": each, "active": True}
            for each in reported
        )

    def next_line(self, within_s: float) -> str:
        return json.dumps(next(self._lines))


class Buttons:
    """Operator who notes what is done: `start`, and `stop` pressed for a time, ms."""

    def __init__(self) -> None:
        self.done: list[str] = []

    def press(self, button: str, for_ms: int | None = None) -> None:
        self.done.append(button if for_ms is None else f"{button} {for_ms}")


def put_to_work(*reported: State | int, is_patient: bool = False) -> list[str]:
    buttons = Buttons()
    attendant = Attendant(cast("Operator", buttons), is_patient=is_patient)
    hmi.put_to_work(cast("Process", Reporter(*reported)), attendant)
    return buttons.done


def test_an_abort_because_of_a_late_scan_is_cleared_before_the_measurement() -> None:
    assert put_to_work(State.RESETTING, State.IDLE, State.EXECUTE) == ["start", "start"]
    aborted = (902, State.ABORTING, State.ABORTED, State.CLEARING, State.STOPPED)
    done = put_to_work(State.RESETTING, *aborted, State.RESETTING, State.IDLE, State.EXECUTE)
    assert done == ["start", f"stop {CLEAR_MS}", "start", "start"]


def test_a_patient_operator_homes_a_machine_that_was_held() -> None:
    held = (958, State.HOLDING, State.HELD, State.RESETTING, State.IDLE, State.EXECUTE)
    assert put_to_work(State.RESETTING, *held, is_patient=True) == ["start", "start", "start"]


@pytest.mark.parametrize(
    "reported",
    [
        (State.ABORTED,),
        (905, State.ABORTED),
        (901, State.ABORTED, State.STOPPED, State.ABORTED),
        (901, State.HELD),
        (902, State.ABORTED, 902, State.STOPPED) * hmi.ABORTS + (902, State.ABORTED),
    ],
    ids=["no alarm", "other alarm", "earlier alarm", "held", "too often"],
)
def test_another_abort_ends_the_measurement(reported: tuple[State | int, ...]) -> None:
    with pytest.raises(LiveError, match=r"^EXECUTE not reached: (ABORTED|HELD)$"):
        put_to_work(*reported)


@pytest.mark.nightly
@pytest.mark.real_time
def test_clients_and_browsers_are_served_by_real_processes() -> None:
    """After a short run, clients have received answers, and browsers have received events."""
    figures = measure_punctuality(1, waits_s=1, quiet_s=1, loaded_s=2)
    assert figures["answers"] > 100
    assert figures["views"] > 1


@pytest.mark.nightly
@pytest.mark.real_time
def test_scans_with_a_ladder_page_are_measured_beside_a_bare_loop() -> None:
    """A busy computer delays both; the limit of the ratio is that of the benchmark."""
    figures = measure_ladder_page(1, rounds=2, round_s=3)
    assert figures["looks"] > 1
    others_ms = (figures["open_bare_p99"], figures["closed_bare_p99"], figures["closed_p99"])
    assert figures["open_p99"] <= 2 * max(others_ms)


@contextmanager
def page(*replies: bytes) -> Iterator[str]:
    """Serve one answer on each connection and close it; yield the URL."""
    remaining = iter(replies)

    def serve(connection: socket.socket) -> None:
        assert connection.recv(1_000).startswith(f"GET {LOOK} ".encode())
        connection.sendall(next(remaining))

    with server(serve, connections=len(replies)) as port:
        yield f"http://127.0.0.1:{port}/"


NO_SCAN = b"HTTP/1.1 503 Service Unavailable\r\nContent-Length: 2\r\n\r\n{}"
SCAN = b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}"


def test_a_look_is_repeated_on_a_new_connection_when_the_kept_one_was_closed() -> None:
    with page(NO_SCAN, SCAN) as url:
        assert looks_of(url, for_s=0) == 1


def test_a_page_that_closes_the_new_connection_too_is_an_error() -> None:
    with page(NO_SCAN, b"") as url, pytest.raises(ConnectionError):
        looks_of(url, for_s=0)


@pytest.mark.nightly
@pytest.mark.real_time
def test_malformed_frames_are_sent_to_a_real_process() -> None:
    figures = measure_malformed(1, frames=500, connections=200)
    assert 0 < figures["answered"] < 500
    assert figures["memory_before"] > 10
