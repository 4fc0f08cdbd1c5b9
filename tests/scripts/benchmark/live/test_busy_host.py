"""Measurement on a busy computer: its figures depend on the host and are no test."""

from __future__ import annotations

import json
import queue
from collections.abc import Sequence

import pytest

from controller.program.states import State
from scripts.benchmark.catalogue import PARTS
from scripts.benchmark.live import busy_host


@pytest.mark.parametrize(("state", "lost"), [(State.ABORTED, True), (State.SUSPENDED, False)])
def test_the_loss_is_read_from_the_events_of_the_controller(state: State, lost: bool) -> None:
    lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    lines.put(json.dumps({"event": "cycle"}))
    lines.put(json.dumps({"event": "state", "state": state}))
    found = busy_host._aborted_after_s(lines, 1)
    assert (found is not None) == lost


def test_each_run_has_its_own_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Normal and real-time priority alternate, and every figure of the part is measured."""
    runs: list[tuple[bool, bool]] = []

    def run(_for_s: int, options: Sequence[str], *, clients: bool) -> dict[str, float]:
        runs.append((bool(options), clients))
        return dict.fromkeys(("scans", "p99", "latest", "missed", "aborted"), float(len(runs)))

    monkeypatch.setattr(busy_host, "_run", run)
    figures = busy_host.measure_busy_host(1)
    assert runs == [(False, False), (True, False), (False, True), (True, True)]
    (part,) = (part for part in PARTS if part.name == "busy-host")
    assert set(figures) == set(part.figures)
    assert figures["real_time_alone_p99"] == 2.0
