"""Report of the measurement on a busy computer; the measurement itself depends on the host, and is no test."""

from __future__ import annotations

import json
import queue
from collections.abc import Iterator

import pytest

from controller.program.states import State
from plant_sim.benchmark import busy_host
from plant_sim.benchmark.busy_host import BusyHostRow
from plant_sim.benchmark.punctuality import Punctuality
from plant_sim.cli.main import main
from plant_sim.twin.process import LiveError


def test_a_row_names_the_loss_of_the_field() -> None:
    row = BusyHostRow("normal priority, clients", Punctuality(10.0, 100.0, 7), 1_400, 14.04)
    assert row.text() == (
        "normal priority, clients             1400 scans,    7 missed,   10.0 ms late in 99 % of cases, "
        "at most  100.0 ms; Aborted after 14.0 s"
    )
    assert BusyHostRow("x", Punctuality(0.1, 0.1, 0), 1, None).text().endswith("; field link held")


@pytest.mark.parametrize(("state", "lost"), [(State.ABORTED, True), (State.SUSPENDED, False)])
def test_the_loss_is_read_from_the_events_of_the_controller(state: State, lost: bool) -> None:
    lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    lines.put(json.dumps({"event": "cycle"}))
    lines.put(json.dumps({"event": "state", "state": state}))
    found = busy_host._aborted_after_s(lines, 1)
    assert (found is not None) == lost


def test_a_failed_measurement_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def fail(_for_s: int, _priority: int) -> Iterator[BusyHostRow]:
        raise LiveError("the controller ended with exit code 2")

    monkeypatch.setattr(busy_host, "measure_busy_host", fail)
    assert main(["bench", "--busy-host", "1"]) == 1
    assert capsys.readouterr().err == "the controller ended with exit code 2\n"
    assert main(["bench", "--busy-host", "0"]) == 2
    assert capsys.readouterr().err == "--busy-host 0: must be 1 to 600\n"
