"""End of a trial in processes, with stand-ins for plant and controller: operators, signals, processes that end."""

from __future__ import annotations

import io
import json
import queue
import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Self, cast

import pytest
from rich.console import Console

from controller.events.kinds import AlarmEvent, Event, StateEvent, as_record
from controller.iomap.loader import DEFAULT_IO_MAP
from controller.program.states import State
from controller.program.texts.operator import Text
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.twin import live
from plant_sim.twin.ending.attendance import has_open_page
from plant_sim.twin.live import LiveOptions, LiveTrial
from plant_sim.twin.process import Interrupts, Process
from plant_sim.twin.progress import ProgressView
from plant_sim.twin.report import TrialReport
from tests.controller.hmi.panel.panel_rig import PanelRig

LOOK_MS = 400
"""Plant time between two looks at the telemetry, ms."""
HELD_MS = 5_000
STARTS = [(State.STOPPED, 0), (State.RESETTING, 1_000), (State.IDLE, 3_000), (State.EXECUTE, 4_000)]
WORKS: list[Event] = [StateEvent(at_ms, state, Text.plain(state.name)) for state, at_ms in STARTS]
HOLDS: list[Event] = [
    AlarmEvent(HELD_MS - 500, 911, active=True, text=Text.plain("another text")),
    StateEvent(HELD_MS, State.HELD, Text.plain("Held"), Text.plain("alarm")),
]
OPTIONS = LiveOptions(1, 1, "127.0.0.1", 5020, DEFAULT_IO_MAP, DEFAULT_MACHINE, panel_port=None)
ALARM = "S911 left arm not up after clamping"
NO_ONE = f"Held: {ALARM}; no operator after 10 s"


class StandIn:
    """Operator at a plant whose time goes on with each look."""

    def __init__(self) -> None:
        self.time_ms = 0
        self.pressed: list[str] = []
        self.press_lasts_ms = 0
        self.on_look: Callable[[int], object] = lambda _: None
        self.on_press: Callable[[str], object] = lambda _: None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def press(self, button: str, for_ms: int) -> None:
        self.pressed.append(button)
        self.on_press(button)
        self.time_ms += self.press_lasts_ms

    def telemetry(self) -> dict[str, float]:
        self.time_ms += LOOK_MS
        self.on_look(self.time_ms)
        counts = {"in_tray": 24, "in_claw": 12, "in_cups": 30, "P": 3, "D": 2, "T": 1, "total": 72, "ploughed": 12}
        return {"time_ms": self.time_ms, **counts}


class Ended:
    """Controller that writes each event at its time, and has ended after the last one if `code` is given."""

    def __init__(self, operator: StandIn, events: list[Event], code: int | None) -> None:
        self.lines = self
        self._operator = operator
        self._events = [*events]
        self._code = code

    def get(self, timeout: float) -> str | None:
        if not self._events and self._code is not None:
            return None
        if not self._events or self._events[0].at_ms > self._operator.time_ms:
            raise queue.Empty
        return json.dumps(as_record(self._events.pop(0)))

    def stop(self) -> int | None:
        return self._code


@pytest.fixture
def operator(monkeypatch: pytest.MonkeyPatch) -> StandIn:
    """Return an operator; standard input is no terminal, and a look takes 1 ms."""
    stand_in = StandIn()
    monkeypatch.setattr(live, "Operator", lambda *_: stand_in)
    monkeypatch.setattr(live, "POLL_S", 1e-3)
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    return stand_in


def run(
    operator: StandIn, events: list[Event], options: LiveOptions = OPTIONS, code: int | None = None
) -> tuple[TrialReport, int | None]:
    """Run a trial with these events; return its report and exit code."""
    with Interrupts() as interrupts, ProgressView(Console(file=io.StringIO())) as view:
        controller = cast("Process", Ended(operator, events, code))
        trial = LiveTrial(options, view, cast("Any", operator), controller, interrupts)
        return trial.run(), trial.exit_code


def test_without_an_operator_a_run_ends_10_s_after_it_rests(operator: StandIn) -> None:
    report, code = run(operator, WORKS + HOLDS)
    assert (report.reason, report.simulated_s, code) == (NO_ONE, 15.0, None)
    assert report.alarms == [ALARM]
    assert operator.pressed == ["start", "start"]
    assert report.text().splitlines()[1].endswith("in claws 12, in trays untouched 12, in trays ploughed through 12")


def test_a_complete_run_has_no_reason(operator: StandIn) -> None:
    report, code = run(operator, [*WORKS, StateEvent(9_000, State.COMPLETE, Text.plain("Complete"))])
    assert (report.reason, report.completed, code) == ("", True, None)


IDLE = "Idle, without an alarm or a question; no operator after 10 s"


def test_a_machine_that_ignores_its_start_button_ends_10_s_after_the_press(operator: StandIn) -> None:
    """The press comes as late as a computer is slow; the rest has begun long before."""
    presses: list[int] = []
    operator.on_press = lambda button: presses.append(operator.time_ms)
    operator.press_lasts_ms = 30_000
    report, code = run(operator, WORKS[:3])
    assert (report.reason, code) == (IDLE, None)
    assert report.simulated_s == pytest.approx(presses[-1] / 1000 + 40.0, abs=0.5)


def test_a_machine_stopped_by_its_stop_button_ends_10_s_later(operator: StandIn) -> None:
    report, _ = run(
        operator, [*WORKS, StateEvent(20_000, State.STOPPED, Text.plain("Stopped"), Text.plain("operator"))]
    )
    assert report.reason == IDLE.replace("Idle", "Stopped")
    assert report.simulated_s == 30.0


@pytest.mark.parametrize("changes", [{"waits": True}, {"by_hand": True}], ids=str)
def test_a_run_waits_on_request(operator: StandIn, changes: dict[str, Any]) -> None:
    report, _ = run(operator, WORKS + HOLDS, replace(OPTIONS, max_ms=40_000, **changes))
    assert report.reason == "not complete after 40 s of machine time: Held"
    assert report.simulated_s == 40.0


def test_a_run_at_a_terminal_waits(operator: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    report, _ = run(operator, WORKS + HOLDS, replace(OPTIONS, max_ms=40_000))
    assert report.reason == "not complete after 40 s of machine time: Held"


def test_a_run_waits_while_a_page_of_the_panel_is_open(operator: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "has_open_page", lambda _: operator.time_ms < 30_000)
    report, _ = run(operator, WORKS + HOLDS)
    assert report.reason == NO_ONE
    assert 29.0 < report.simulated_s <= 30.0


def test_the_default_limit_is_60_s_and_600_s_for_each_tray(operator: StandIn) -> None:
    report, _ = run(operator, WORKS)
    assert (report.reason, report.simulated_s) == ("not complete after 660 s of machine time: Execute", 660.0)


def test_in_real_time_the_rest_counts_from_the_moment_it_is_noticed(operator: StandIn) -> None:
    """The clock of the controller may have begun later than that of the plant."""
    operator.time_ms = 100_000
    report, _ = run(operator, WORKS + HOLDS, replace(OPTIONS, real_time=True))
    assert report.reason == NO_ONE
    assert report.simulated_s == pytest.approx(110.0, abs=5.0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(("by_hand", "expected"), [(False, 130), (True, 0)])
def test_a_signal_ends_a_run_with_its_report(
    operator: StandIn, number: signal.Signals, by_hand: bool, expected: int
) -> None:
    before = signal.signal(number, lambda *_: None)
    try:
        operator.on_look = lambda time_ms: signal.raise_signal(number) if time_ms == 20 * LOOK_MS else None
        report, code = run(operator, WORKS, replace(OPTIONS, by_hand=by_hand))
    finally:
        signal.signal(number, before)
    assert (report.reason, code) == ("interrupted", expected)
    assert (report.in_cups, report.in_claws) == (30, 12)


def test_the_end_of_the_controller_is_the_reason_of_the_report(operator: StandIn) -> None:
    report, code = run(operator, WORKS, code=3)
    assert (report.reason, code) == ("the controller ended with exit code 3", 3)


def test_a_plant_that_is_gone_leaves_the_last_counts(operator: StandIn) -> None:
    def lose(time_ms: int) -> None:
        if time_ms > 10_000:
            raise ConnectionError("plant at 127.0.0.1:5020: no answer")

    operator.on_look = lose
    report, code = run(operator, WORKS)
    assert (report.reason, report.in_cups, code) == ("plant at 127.0.0.1:5020: no answer", 30, None)
    assert report.simulated_s == pytest.approx(10.0, abs=0.4)


def test_an_open_page_of_a_panel_is_seen(tmp_path: Path) -> None:
    """A panel alone has no page; that of a browser is open as long as its socket."""
    with PanelRig(tmp_path) as rig:
        line = f"panel at {rig.origin}"
        assert not has_open_page(line)
        with rig.browser() as browser:
            browser.until(lambda view: bool(view["link"]["controller"]))
            assert has_open_page(line)
            assert has_open_page(f"{line} (language zh)")
    assert not has_open_page(line)
    assert not has_open_page("")
