"""One fault in every kind of trial: the same end, names and account; signals and seedlings that are left."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from controller.common.stop_request import INTERRUPTED, SIGNALS, StopRequest
from controller.core.expr import Expr
from controller.events.kinds import AlarmEvent, as_record
from controller.fx.language.il import write_il
from controller.program.states import State
from controller.program.texts.operator import NO_TEXT, STATES
from plant_sim.cli import run as run_command
from plant_sim.cli import trial as trial_command
from plant_sim.cli.main import main
from plant_sim.crop.seedling import TRAY_CELLS, SeedlingCounts
from plant_sim.faults import parse_fault
from plant_sim.machine.plant import Plant
from plant_sim.twin import live
from plant_sim.twin.ladder import trial as ladder_trial
from plant_sim.twin.ladder.question_lamp import LAMP, PERIOD_MS
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.report import make_report
from plant_sim.twin.trial import run_trial
from tests.controller.export.fx_equality import EXPORTED
from tests.plant_sim.twin.ending.accounts import account_of
from tests.real_time import WAIT_S
from tests.sampling import first_of

FAULT = "stuck_off:left.lift_up"
ALARM = "S934 Homing: left arm not up while loaded"
ACCOUNT = "seedlings 144: in cups 0, lost picking P 0, carrying D 0, throwing T 0, in trays untouched 144"
STOP_AT_MS = 30_000
"""Time of a signal, ms: after the first rows have been picked, before they are thrown."""


@pytest.fixture(autouse=True)
def _signals() -> Iterator[None]:
    """Restore the handlers that every command replaces."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def exported(tmp_path: Path) -> str:
    """Return the file of the machine's program."""
    path = tmp_path / "transplanter.il"
    path.write_text(write_il(EXPORTED), encoding="utf-8")
    return str(path)


def printed(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 1) -> str:
    assert main(list(arguments)) == code
    return str(capsys.readouterr().out)


@pytest.mark.parametrize("command", [("run", "--fast"), ("trial",), ("trial", "--ladder")], ids=" ".join)
def test_a_fault_ends_every_trial_in_the_same_way(
    command: tuple[str, ...], exported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = [exported] if "--ladder" in command else []
    first, account, *rest = printed(capsys, *command, *file, "--fault", FAULT).splitlines()
    assert first.startswith("the trial did not complete")
    assert first.endswith(f": {ALARM}; no operator after 10 s")
    assert account == ACCOUNT
    (alarms,) = (line for line in rest if line.startswith("alarm"))
    assert alarms.endswith(f" {ALARM}")
    (ended,) = (line for line in rest if " s of machine time" in line or " s simulated" in line)
    assert 15.0 < float(ended.partition(" s ")[0].split()[-1]) < 16.0


@pytest.mark.nightly
def test_a_fault_ends_a_run_in_processes_in_the_same_way(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    command = [sys.executable, "-m", "plant_sim", "run", "--port", str(port), "--hmi-port", "0", "--panel-port", "0"]
    done = subprocess.run(
        [*command, "--pace", "5000", "--fault", FAULT],
        check=False,
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
    )
    assert done.returncode == 1
    first, account, *rest = done.stdout.splitlines()
    assert first == f"the trial did not complete, so it has no S: Held: {ALARM}; no operator after 10 s"
    assert account == ACCOUNT
    assert rest[-1] == f"alarms {ALARM}"


def test_the_record_has_the_same_account(capsys: pytest.CaptureFixture[str], exported: str) -> None:
    ours = json.loads(printed(capsys, "trial", "--json", "--fault", FAULT))
    theirs = json.loads(printed(capsys, "trial", "--json", "--ladder", exported, "--fault", FAULT))
    assert ours["alarms"] == theirs["alarms"] == [ALARM]
    assert account_of(ours) == (144, 0, 0, 144, 0)
    assert (theirs["in_tray"], theirs["ploughed"], theirs["in_claw"], theirs["total"]) == (144, 0, 0, 144)


def test_progress_is_told_once_and_with_the_name_of_the_alarm(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    assert main(["run", "--fast", "--wait", "--max-s", "60", "--fault", FAULT]) == 1
    lines = capsys.readouterr().err.splitlines()
    told = [line.partition(" s ")[2] for line in lines]
    assert len(told) == len(set(told)) == 4
    assert told[-1].split("  ")[0].strip() == "Held (alarm) trays 0/2"
    assert told[-1].endswith(f"ALARM {ALARM}")


def test_progress_is_told_in_the_selected_language(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    assert main(["run", "--fast", "--language", "zh", "--fault", FAULT]) == 1
    assert STATES[State.HELD].zh in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("command", [("run", "--fast"), ("trial",), ("trial", "--ladder")], ids=" ".join)
def test_a_trial_waits_on_request_until_its_limit(
    command: tuple[str, ...], exported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = [exported] if "--ladder" in command else []
    out = printed(capsys, *command, *file, "--wait", "--max-s", "18", "--fault", FAULT)
    assert "not complete after 18 s of machine time: " in out.splitlines()[0]


@pytest.mark.parametrize("seconds", ["0", "1000001"])
@pytest.mark.parametrize("command", ["run", "trial"])
def test_a_limit_out_of_range_is_one_line(command: str, seconds: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--max-s", seconds]) == 2
    assert capsys.readouterr() == ("", f"--max-s {seconds}: must be 1 to 1000000\n")


# --- signals -----------------------------------------------------------------------------------------


@contextmanager
def listening() -> Iterator[StopRequest]:
    """Let the signals make a request, as at the begin of a process."""
    with StopRequest() as stop:
        stop.listen()
        yield stop


def raising(number: signal.Signals) -> Callable[[Twin], None]:
    """Return a function that makes a twin raise a signal at `STOP_AT_MS`."""

    def strike(twin: Twin) -> None:
        if twin.now_ms == STOP_AT_MS:
            signal.raise_signal(number)

    return lambda twin: twin.every(STOP_AT_MS, strike)


@pytest.mark.parametrize("number", first_of([signal.SIGINT, signal.SIGTERM]))
@pytest.mark.parametrize("command", [("run", "--fast"), ("trial",), ("trial", "--repeat", "3")], ids=" ".join)
def test_a_signal_ends_a_trial_with_its_report(
    command: tuple[str, ...],
    number: signal.Signals,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A signal ends the trial within 0.1 s of machine time, and no further trial begins."""
    strike = raising(number)
    monkeypatch.setattr(run_command, "show_progress", lambda *_: strike)
    monkeypatch.setattr(trial_command, "run_trial", lambda **rest: run_trial(**rest, prepare=strike))
    with listening() as stop:
        assert main(list(command), stop) == INTERRUPTED
    out = capsys.readouterr().out
    assert out.count("the trial did not complete, so it has no S: interrupted") == 1
    if "--repeat" not in command:
        assert "throwing T 0, in claws 24, in trays untouched 120\n" in out
        assert ", 30.1 s of machine time" in out


@pytest.mark.parametrize("command", [("run", "--fast"), ("trial",), ("trial", "--ladder"), ("run",)], ids=" ".join)
def test_a_signal_before_the_first_scan_ends_a_trial_with_its_report(
    command: tuple[str, ...],
    exported: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The signal arrives while the program is loaded, before the arguments are read. No process is started."""
    monkeypatch.setattr(live, "Process", None)
    file = [exported] if "--ladder" in command else []
    with listening() as stop:
        signal.raise_signal(signal.SIGTERM)
        assert main([*command, *file], stop) == INTERRUPTED
    first, account, *_ = capsys.readouterr().out.splitlines()
    assert first.startswith("the trial did not complete")
    assert first.endswith(": interrupted")
    assert account == ACCOUNT


@pytest.mark.parametrize(("by_hand", "expected"), [(False, INTERRUPTED), (True, 0)])
def test_a_signal_during_the_start_of_a_plant_ends_a_run_with_its_report(
    by_hand: bool,
    expected: int,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    ended: list[str] = []

    class Starting:
        """Process that has not written anything yet."""

        def __init__(self, name: str, *_: object) -> None:
            self.name = name

        def __enter__(self) -> Starting:
            return self

        def __exit__(self, *_: object) -> None:
            ended.append(self.name)

        def next_line(self, within_s: float) -> str:
            signal.raise_signal(signal.SIGINT)
            return "plant listening on 127.0.0.1:1"

    monkeypatch.setattr(live, "Process", Starting)
    with listening() as stop:
        assert main(["run", *(["--by-hand"] if by_hand else [])], stop) == expected
    first, account, *rest = capsys.readouterr().out.splitlines()
    assert first == "the trial did not complete, so it has no S: interrupted"
    assert account == ACCOUNT
    assert ", 0.0 s of machine time" in rest[0]
    assert ended == ["plant"]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("fault", "state", "at_s"), [("broken_wire:start", "Stopped", 10.0), ("broken_wire:start@2s..", "Idle", 21.8)]
)
def test_a_machine_at_rest_without_an_alarm_ends_the_trial(
    fault: str, state: str, at_s: float, capsys: pytest.CaptureFixture[str]
) -> None:
    first, *rest = printed(capsys, "trial", "--fault", fault).splitlines()
    assert first.endswith(f": {state}, without an alarm or a question; no operator after 10 s")
    assert f", {at_s} s of machine time" in rest[1]


@pytest.mark.parametrize("fault", [None, "stuck_off:left.lift_up", "stuck_off:left.lift_down@30s.."])
def test_a_trial_that_nobody_can_stop_looks_rarely_and_ends_at_the_same_time(
    fault: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Studies run such trials; a look interrupts the machine code."""
    looks = 0
    runs_until = Twin.runs_until

    def counting(twin: Twin, condition: Expr | Callable[[], bool], *, for_ms: int) -> bool:
        nonlocal looks
        looks += 1
        return runs_until(twin, condition, for_ms=for_ms)

    monkeypatch.setattr(Twin, "runs_until", counting)
    faults = () if fault is None else (parse_fault(fault),)
    found = []
    with StopRequest() as request:
        for stop in (request, None):
            looks = 0
            report = run_trial(seed=2, trays=1, faults=faults, stop=stop)
            found.append((looks, replace(report, wall_s=0.0)))
    (often, watched), (rarely, unwatched) = found
    assert watched == unwatched
    assert watched.completed == (fault is None)
    assert often > 30 * rarely


@pytest.mark.parametrize("number", first_of([signal.SIGINT, signal.SIGTERM]))
def test_a_signal_ends_a_trial_of_a_program_with_its_report(
    number: signal.Signals, exported: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Striking(Plant):
        """Plant in whose step a signal arrives."""

        def step(self, for_ms: int, y: Sequence[bool]) -> None:
            if self.time_ms == STOP_AT_MS:
                signal.raise_signal(number)
            super().step(for_ms, y)

    monkeypatch.setattr(ladder_trial, "Plant", Striking)
    with listening() as stop:
        assert main(["trial", "--ladder", exported], stop) == INTERRUPTED
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["the trial did not complete: interrupted", ACCOUNT]
    assert lines[2].startswith("30.0 s simulated")


@pytest.mark.parametrize(
    ("flashes", "max_s", "expected"),
    first_of(
        [
            (0, 40, ["start", "emergency_stop", "stop", "start"]),
            (0, 75, ["start", "emergency_stop", "stop", "start", "start", "emergency_stop", "stop", "start"]),
            (4, 75, ["start", "start", "start", "start"]),
            (5, 75, ["start", "stop", "stop", "stop"]),
        ]
    ),
)
def test_the_operator_of_a_program_answers_a_question_and_otherwise_confirms_constants(
    flashes: int,
    max_s: int,
    expected: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A program that moves nothing: four flashes are answered with X0, five with X24, and none with X25, X24 and X0."""
    pressed: list[str] = []

    class Asking(Plant):
        """Plant that records its buttons when they are pressed, and whose amber lamp flashes."""

        held: Sequence[str] = ()

        def step(self, for_ms: int, y: Sequence[bool]) -> None:
            now = [name for name in ("start", "stop", "emergency_stop") if getattr(self.box, name)]
            pressed.extend(name for name in now if name not in self.held)
            self.held = now
            super().step(for_ms, y)
            flash, phase_ms = divmod(self.time_ms % PERIOD_MS, 600)
            self.indicators[LAMP] = flash < flashes and phase_ms < 300

    monkeypatch.setattr(ladder_trial, "Plant", Asking)
    program = tmp_path / "idle.il"
    program.write_text("LD X0\nOUT M0\nEND\n", encoding="utf-8")
    out = printed(capsys, "trial", "--ladder", str(program), "--max-s", str(max_s))
    assert pressed == expected
    assert out.startswith(f"the trial did not complete: not complete after {max_s} s of machine time: nothing moves\n")


# --- seedlings that are left ---------------------------------------------------------------------------

PLOUGH = """
LD M8000
OUT Y21
LD M8000
ANI X15
OUT Y0
LD X15
OUT Y5
END
"""
"""Program that conveys a tray in, and then drives the left arm, low and open, through all columns of it."""


def test_seedlings_that_an_arm_was_driven_through_are_not_untouched(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "plough.il"
    program.write_text(PLOUGH, encoding="utf-8")
    lines = printed(capsys, "trial", "--ladder", str(program), "--max-s", "60").splitlines()
    lost = "in cups 0, lost picking P 0, carrying D 0, throwing T 0"
    assert lines[1] == f"seedlings 144: {lost}, in trays untouched 72, in trays ploughed through 72"
    assert sum("arm_through_tray" in line for line in lines) == 6


def test_the_report_of_a_trial_counts_them_too() -> None:
    counts = SeedlingCounts(in_tray=30, in_claw=2, in_cups=30, P=4, D=1, T=5, total=72, ploughed=12)
    report = make_report(seed=1, counts=counts, events=[], reason="interrupted", simulated_s=1.0, wall_s=0.0)
    assert report.counts == counts
    assert account_of(report.record()) == (72, 30, 2, 18, 12)
    expected = "in claws 2, in trays untouched 18, in trays ploughed through 12"
    assert report.text().splitlines()[1].endswith(f"throwing T 5, {expected}")
    assert not report.accounted


def test_equal_alarms_are_told_once() -> None:
    raised = [AlarmEvent(at_ms, number, active=True, text=NO_TEXT) for at_ms, number in ((1, 911), (2, 905), (3, 911))]
    counts = SeedlingCounts(0, 0, 72, 0, 0, 0, total=72)
    events = [as_record(event) for event in raised]
    report = make_report(seed=1, counts=counts, events=events, reason="", simulated_s=1.0, wall_s=0.0)
    assert len(report.alarms) == 3
    alarms = report.text().splitlines()[-1]
    assert alarms.startswith("alarms S911 left arm not up after clamping (2 times); S905 ")


# --- number of seedlings -------------------------------------------------------------------------------


@pytest.mark.parametrize(("seedlings", "rows"), first_of([(12, 2), (36, 4), (TRAY_CELLS + 12, 8)]))
def test_a_trial_ends_with_the_cycle_of_its_last_seedling(seedlings: int, rows: int) -> None:
    """Homing, the first tray and the empty first throw take 17 s; then 16 s for each row of both arms."""
    twins: list[Twin] = []
    report = run_trial(seed=1, seedlings=seedlings, prepare=twins.append)
    assert report.completed
    assert report.accounted
    assert report.cycles == rows
    assert twins[0].state is State.EXECUTE
    assert report.simulated_s == pytest.approx(17.5 + 16.0 * rows / 2, abs=1.0)
