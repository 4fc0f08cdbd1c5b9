"""Pace of simulated time with a simulated real-time clock, and pauses."""

from __future__ import annotations

import threading

import pytest

from controller.io import pace as pace_module
from controller.io.pace import FASTEST, FLAT_OUT, Pace, PaceError

NEVER = threading.Event()
STUCK_S = 60.0


class Wall:
    """Simulated real-time clock; a wait advances it by exactly the requested time."""

    def __init__(self) -> None:
        self.now_s = 1_000.0
        self.waits = 0

    def perf_counter(self) -> float:
        return self.now_s


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    wall = Wall()
    monkeypatch.setattr(pace_module, "time", wall)
    return wall


def paced(wall: Wall, percent: int) -> Pace:
    pace = Pace(percent)

    def wait(timeout_s: float) -> bool:
        wall.now_s += timeout_s
        wall.waits += 1
        return False

    pace._changed.wait = wait  # type: ignore[method-assign, assignment]
    return pace


@pytest.mark.parametrize(("percent", "duration_s"), [(100, 10.0), (50, 20.0), (200, 5.0), (1, 1_000.0), (FASTEST, 0.2)])
def test_ten_seconds_of_simulated_time(wall: Wall, percent: int, duration_s: float) -> None:
    pace = paced(wall, percent)
    assert all(pace.wait(10, NEVER) for _ in range(1_000))
    assert wall.now_s - 1_000.0 == pytest.approx(duration_s)


def test_an_unlimited_pace_never_waits(wall: Wall) -> None:
    pace = paced(wall, FLAT_OUT)
    assert all(pace.wait(10, NEVER) for _ in range(1_000))
    assert wall.waits == 0


def test_the_duration_of_a_scan_is_not_added_to_the_period(wall: Wall) -> None:
    pace = paced(wall, 100)
    for _ in range(100):
        pace.wait(10, NEVER)
        wall.now_s += 0.004
    assert wall.now_s - 1_000.0 == pytest.approx(1.004)


def test_a_long_delay_is_made_up_for_only_partly(wall: Wall) -> None:
    pace = paced(wall, 100)
    pace.wait(10, NEVER)
    wall.now_s += 60.0
    caught_up = 0
    while pace.wait(10, NEVER) and not wall.waits > 1:
        caught_up += 1
        assert caught_up < 100
    assert caught_up in range(19, 23)


def test_a_new_pace_takes_effect_at_the_next_wait_without_making_up_for_the_past(wall: Wall) -> None:
    pace = paced(wall, 1)
    pace.wait(10, NEVER)
    start_s = wall.now_s
    pace.set(100)
    for _ in range(100):
        pace.wait(10, NEVER)
    assert wall.now_s - start_s == pytest.approx(1.0)


def test_a_pause_is_not_made_up_for(wall: Wall) -> None:
    pace = paced(wall, 100)
    pace.wait(10, NEVER)
    wall.now_s += 60.0
    pace.set(100)
    start_s = wall.now_s
    for _ in range(100):
        pace.wait(10, NEVER)
    assert wall.now_s - start_s == pytest.approx(1.0)


def test_a_new_pace_ends_a_pause_immediately() -> None:
    pace = Pace(0)
    wait_for_change = pace._changed.wait
    pace._changed.wait = lambda timeout=None: wait_for_change()  # type: ignore[method-assign]
    resumed = threading.Event()

    def wait() -> None:
        if pace.wait(10, NEVER):
            resumed.set()

    waiter = threading.Thread(target=wait, daemon=True)
    waiter.start()
    assert not resumed.wait(0.25), "time must not advance during a pause"
    pace.set(FLAT_OUT)
    assert resumed.wait(STUCK_S)
    waiter.join(STUCK_S)


def test_stop_ends_a_pause() -> None:
    pace, stop = Pace(0), threading.Event()
    answers: list[bool] = []
    waiter = threading.Thread(target=lambda: answers.append(pace.wait(10, stop)), daemon=True)
    waiter.start()
    stop.set()
    waiter.join(STUCK_S)
    assert answers == [False]


def test_a_wait_after_stop_returns_false() -> None:
    stop = threading.Event()
    stop.set()
    assert not Pace(FLAT_OUT).wait(10, stop)


@pytest.mark.parametrize("percent", [0, 1, 100, FASTEST, FLAT_OUT])
def test_valid_paces(percent: int) -> None:
    assert Pace(percent).percent == percent


@pytest.mark.parametrize("percent", [-1, FASTEST + 1, FLAT_OUT - 1, FLAT_OUT + 1])
def test_invalid_paces(percent: int) -> None:
    with pytest.raises(PaceError, match=f"pace {percent} %: must be 0"):
        Pace(percent)
    pace = Pace(100)
    with pytest.raises(PaceError):
        pace.set(percent)
    assert pace.percent == 100
