"""Tracebacks of joblib's manager thread: reported with a delay, within which an interrupted command has ended."""

from __future__ import annotations

import threading

import pytest

from plant_sim.study import engines


def _raise() -> None:
    raise RuntimeError("process ended")


@pytest.mark.parametrize(("delay_s", "is_reported"), [(0.0, True), (60.0, False)])
def test_an_error_of_the_manager_waits_for_the_end_of_the_process(
    monkeypatch: pytest.MonkeyPatch, delay_s: float, is_reported: bool
) -> None:
    reported: list[str] = []
    monkeypatch.setattr(threading, "__excepthook__", lambda error: reported.append(str(error.exc_value)))
    monkeypatch.setattr(threading, "excepthook", engines._report_unless_ending)
    monkeypatch.setattr(engines, "_ENDED_WITHIN_S", delay_s)
    before = set(threading.enumerate())
    thread = threading.Thread(target=_raise, name="ExecutorManagerThread")
    thread.start()
    thread.join()
    for timer in set(threading.enumerate()) - before:
        if is_reported:
            timer.join()
        elif isinstance(timer, threading.Timer):
            timer.cancel()
    assert reported == (["process ended"] if is_reported else [])


def test_an_error_of_another_thread_is_reported_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    reported: list[str] = []
    monkeypatch.setattr(threading, "__excepthook__", lambda error: reported.append(str(error.exc_value)))
    monkeypatch.setattr(threading, "excepthook", engines._report_unless_ending)
    thread = threading.Thread(target=_raise)
    thread.start()
    thread.join()
    assert reported == ["process ended"]
