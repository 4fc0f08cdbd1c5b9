"""The pace of simulated time against a clock that is passed in, and a pause that can be left."""

from __future__ import annotations

import threading

import pytest

from controller.io import pace as pace_module
from controller.io.pace import FASTEST, FLAT_OUT, Pace, PaceError

NEVER = threading.Event()
STUCK_S = 10.0


class Wall:
    """The clock on the wall; waiting lets it go on, by exactly what was asked for."""

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


@pytest.mark.parametrize(("percent", "took_s"), [(100, 10.0), (50, 20.0), (200, 5.0), (1, 1_000.0), (FASTEST, 0.2)])
def test_ten_seconds_of_simulated_time(wall: Wall, percent: int, took_s: float) -> None:
    pace = paced(wall, percent)
    assert all(pace.wait(10, NEVER) for _ in range(1_000))
    assert wall.now_s - 1_000.0 == pytest.approx(took_s)


def test_flat_out_never_waits(wall: Wall) -> None:
    pace = paced(wall, FLAT_OUT)
    assert all(pace.wait(10, NEVER) for _ in range(1_000))
    assert wall.waits == 0


def test_the_time_a_scan_takes_is_not_added(wall: Wall) -> None:
    pace = paced(wall, 100)
    for _ in range(100):
        pace.wait(10, NEVER)
        wall.now_s += 0.004
    assert wall.now_s - 1_000.0 == pytest.approx(1.004)


def test_a_busy_computer_catches_up_a_little_and_does_not_race(wall: Wall) -> None:
    pace = paced(wall, 100)
    pace.wait(10, NEVER)
    wall.now_s += 60.0
    caught_up = 0
    while pace.wait(10, NEVER) and not wall.waits > 1:
        caught_up += 1
        assert caught_up < 100
    assert caught_up in range(19, 23)


def test_another_pace_holds_from_the_next_wait_and_nothing_is_made_good(wall: Wall) -> None:
    pace = paced(wall, 1)
    pace.wait(10, NEVER)
    began_s = wall.now_s
    pace.set(100)
    for _ in range(100):
        pace.wait(10, NEVER)
    assert wall.now_s - began_s == pytest.approx(1.0)


def test_a_pause_is_not_made_good(wall: Wall) -> None:
    pace = paced(wall, 100)
    pace.wait(10, NEVER)
    wall.now_s += 60.0
    pace.set(100)
    began_s = wall.now_s
    for _ in range(100):
        pace.wait(10, NEVER)
    assert wall.now_s - began_s == pytest.approx(1.0)


def test_a_pause_is_left_by_another_pace_at_once() -> None:
    pace = Pace(0)
    wait_for_news = pace._changed.wait
    pace._changed.wait = lambda timeout=None: wait_for_news()  # type: ignore[method-assign]
    going = threading.Event()

    def wait() -> None:
        if pace.wait(10, NEVER):
            going.set()

    waiter = threading.Thread(target=wait, daemon=True)
    waiter.start()
    assert not going.wait(0.25), "a pause is no pace"
    pace.set(FLAT_OUT)
    assert going.wait(STUCK_S)
    waiter.join(STUCK_S)


def test_a_pause_is_left_by_stop() -> None:
    pace, stop = Pace(0), threading.Event()
    answers: list[bool] = []
    waiter = threading.Thread(target=lambda: answers.append(pace.wait(10, stop)), daemon=True)
    waiter.start()
    stop.set()
    waiter.join(STUCK_S)
    assert answers == [False]


def test_stopped_before_the_wait() -> None:
    stop = threading.Event()
    stop.set()
    assert not Pace(FLAT_OUT).wait(10, stop)


@pytest.mark.parametrize("percent", [0, 1, 100, FASTEST, FLAT_OUT])
def test_paces_that_are(percent: int) -> None:
    assert Pace(percent).percent == percent


@pytest.mark.parametrize("percent", [-1, FASTEST + 1, FLAT_OUT - 1, FLAT_OUT + 1])
def test_paces_that_are_not(percent: int) -> None:
    with pytest.raises(PaceError, match=f"pace {percent} %: give 0"):
        Pace(percent)
    pace = Pace(100)
    with pytest.raises(PaceError):
        pace.set(percent)
    assert pace.percent == 100
