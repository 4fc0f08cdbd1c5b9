"""Tracebacks of joblib's manager thread: reported with a delay, within which an interrupted command has ended."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from plant_sim.study import engines


def _raise() -> None:
    raise RuntimeError("process ended")


def _raise_in_manager() -> None:
    thread = threading.Thread(target=_raise, name="ExecutorManagerThread")
    thread.start()
    thread.join()


def test_an_error_of_the_manager_is_reported_by_another_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    reported: list[str] = []
    monkeypatch.setattr(threading, "__excepthook__", lambda error: reported.append(str(error.exc_value)))
    monkeypatch.setattr(threading, "excepthook", engines._report_unless_ending)
    monkeypatch.setattr(engines, "_ENDED_WITHIN_S", 0.0)
    before = set(threading.enumerate())
    _raise_in_manager()
    for late in set(threading.enumerate()) - before:
        late.join()
    assert reported == ["process ended"]


def test_an_error_of_the_manager_is_not_reported_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process may end before the other thread reports."""
    reported: list[str] = []
    late: list[Callable[[], None]] = []

    class Waiting:
        def __init__(self, _name: str, report: Callable[[], None]) -> None:
            self._report = report

        def start(self) -> None:
            late.append(self._report)

    monkeypatch.setattr(threading, "__excepthook__", lambda error: reported.append(str(error.exc_value)))
    monkeypatch.setattr(threading, "excepthook", engines._report_unless_ending)
    monkeypatch.setattr(engines, "supervised", Waiting)
    _raise_in_manager()
    assert reported == []
    monkeypatch.setattr(engines, "_ENDED_WITHIN_S", 0.0)
    (report,) = late
    report()
    assert reported == ["process ended"]


def test_an_error_of_another_thread_is_reported_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    reported: list[str] = []
    monkeypatch.setattr(threading, "__excepthook__", lambda error: reported.append(str(error.exc_value)))
    monkeypatch.setattr(threading, "excepthook", engines._report_unless_ending)
    thread = threading.Thread(target=_raise)
    thread.start()
    thread.join()
    assert reported == ["process ended"]
