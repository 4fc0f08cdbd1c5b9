"""The live trial: plant, controller and operator panel as processes of their own, Modbus TCP between them.

Time is simulated unless the clock on the wall is asked for: the plant goes on by one scan at each write of the outputs,
the controller paces it, and a panel can pause it and change its speed. A computer that is busy slows the trial down but
does not spoil it. In real time both follow the clock, as on a machine.
"""

from __future__ import annotations

import json
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from controller.program.states import State
from plant_sim.bench.commissioning import set_points_of
from plant_sim.bench.operator import Operator, counts_of
from plant_sim.bench.progress import ProgressView, Situation
from plant_sim.bench.report import TrialReport, make_report
from plant_sim.bench.trial import ROWS_A_TRAY
from plant_sim.bench.twin import SCAN_MS
from plant_sim.links.tag_file import tag_csv
from plant_sim.parameters import load_machine

POLL_S = 0.2
STOP_S = 10.0
START_LIMIT_S = 30.0
HOMING_LIMIT_S = 60.0
TRAY_LIMIT_S = 600.0
LOCK_STEP_TIMEOUT_MS = 5_000
"""In simulated time an answer may take as long as a busy computer needs."""

Record = dict[str, Any]


class LiveError(Exception):
    """A process or the machine did not do what the trial needs; one line."""


class ChildError(Exception):
    """A child process ended by itself and has said why on standard error.

    Attributes:
        exit_code: Its exit code.
    """

    def __init__(self, name: str, exit_code: int) -> None:
        super().__init__(f"the {name} ended with exit code {exit_code}")
        self.exit_code = exit_code


class Process:
    """A child process whose lines of standard output arrive in a queue; ended with SIGINT."""

    def __init__(self, name: str, arguments: Sequence[str]) -> None:
        self.name = name
        # A session of its own: Ctrl-C reaches this program alone, which then stops controller and plant in order.
        self._process = subprocess.Popen(  # noqa: S603 - our own programs
            [sys.executable, "-m", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self._has_spoken = False
        self.lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, name=f"{name} output", daemon=True)
        self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    @property
    def exit_code(self) -> int | None:
        """Exit code; None while it runs."""
        return self._process.poll()

    def next_line(self, within_s: float) -> str | None:
        """Return the next line of output; None once there will be no more.

        Raises:
            LiveError: Nothing came within the time.
        """
        try:
            return self.lines.get(timeout=within_s)
        except queue.Empty:
            raise LiveError(f"the {self.name} said nothing for {within_s:.0f} s") from None

    def kill(self) -> None:
        """End it as a power failure would: no clean-up of its own."""
        self._process.kill()

    def stop(self) -> int:
        """End it cleanly, by force if it will not; return its exit code.

        One that has not said anything yet has not begun either and is ended at once.
        """
        if self._process.poll() is None and not self._has_spoken:
            self._process.kill()
        elif self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
        code = self._process.wait()
        self._reader.join()
        if self._process.stdout is not None:
            self._process.stdout.close()
        return code

    def _read(self) -> None:
        for line in self._process.stdout or ():
            self._has_spoken = True
            self.lines.put(line.rstrip("\n"))
        self.lines.put(None)


class Interrupts:
    """Ctrl-C and SIGTERM while processes run: raised at once, and again where the wait for events begins anew.

    The interpreter swallows what is raised while it runs a destructor; without the second chance the order to stop
    would be lost.
    """

    def __init__(self) -> None:
        self._came = False

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._take) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def check(self) -> None:
        """Raise `KeyboardInterrupt` if one has come."""
        if self._came:
            raise KeyboardInterrupt

    def _take(self, *_: object) -> None:
        self._came = True
        raise KeyboardInterrupt


@dataclass
class Story:
    """What the controller has reported so far."""

    events: list[Record] = field(default_factory=list)
    state: int = 0
    state_text: str = "not started"
    trays_done: int = 0
    cycles: int = 0
    alarms: dict[int, str] = field(default_factory=dict)

    def take(self, event: Record) -> None:
        """Take in one event."""
        self.events.append(event)
        match event["event"]:
            case "state":
                reason = f" ({event['reason']})" if event["reason"] else ""
                self.state, self.state_text = event["state"], event["text"] + reason
            case "tray":
                self.trays_done = event["trays_done"]
            case "cycle":
                self.cycles += 1
            case "alarm" if event["active"]:
                self.alarms[event["number"]] = event["text"]
            case "alarm":
                self.alarms.pop(event["number"], None)


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """Options of a live run.

    Attributes:
        hmi_port: Port of the controller's Modbus server; 0 = a free one.
        panel_port: Port of the panel's page; 0 = a free one, None = no panel.
        real_time: Follow the clock on the wall.
        pace: Speed of simulated time at the start, percent.
        by_hand: Nobody but the user presses buttons.
        users: File of the panel's passwords.
    """

    seed: int
    trays: int
    host: str
    port: int
    io_map: Path
    machine: Path
    language: str
    faults: tuple[str, ...] = ()
    record: Path | None = None
    hmi_port: int = 5021
    panel_port: int | None = 8080
    real_time: bool = False
    pace: int = 100
    by_hand: bool = False
    users: Path = Path("var/panel-users.json")


_BROKEN = (State.HELD, State.ABORTED)


@contextmanager
def live_trial(options: LiveOptions, view: ProgressView) -> Iterator[LiveTrial]:
    """Run plant and controller for the time of a with block; afterwards the controller is stopped first.

    Raises:
        ChildError: The plant could not start.
    """
    o = options
    common = ["--io-map", str(o.io_map), "--port", str(o.port), "--host", o.host]
    with ExitStack() as stack:
        interrupts = stack.enter_context(Interrupts())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="transplanter-")))
        plant = stack.enter_context(Process("plant", _serve(o, common)))
        if plant.next_line(START_LIMIT_S) is None:
            raise ChildError("plant", plant.stop())
        operator = stack.enter_context(Operator(o.host, o.port))
        controller = stack.enter_context(Process("controller", _control(o, common, folder)))
        trial = LiveTrial(options, view, operator, controller, interrupts)
        if o.panel_port is not None:
            panel = Process("panel", _panel(o, folder, o.panel_port, trial.hmi_port()))
            stack.enter_context(panel)
            trial.panel = panel.next_line(START_LIMIT_S) or "no panel: see above"
        yield trial


def _serve(o: LiveOptions, common: Sequence[str]) -> list[str]:
    """Return the plant's command."""
    serve = ["plant_sim", "serve", *common, "--machine", str(o.machine), "--seed", str(o.seed), "--trays", str(o.trays)]
    for fault in o.faults:
        serve += ["--fault", fault]
    if o.record is not None:
        serve += ["--record", str(o.record)]
    if not o.real_time:
        serve += ["--lock-step-ms", str(SCAN_MS)]
    return serve


def _control(o: LiveOptions, common: Sequence[str], folder: Path) -> list[str]:
    """Return the controller's command."""
    control = ["controller", "run", *common, "--retain", str(folder / "retentive.json"), "--events", "json"]
    control += ["--no-console", "--language", o.language, "--hmi-port", str(o.hmi_port), "--allow-forcing"]
    control += ["--scan-ms", str(SCAN_MS)]
    if not o.real_time:
        control += ["--simulated-time", "--pace", str(o.pace), "--timeout-ms", str(LOCK_STEP_TIMEOUT_MS)]
    for name, value in {"trays_target": o.trays, **set_points_of(load_machine(o.machine))}.items():
        control += ["--set", f"{name}={value}"]
    return control


def _panel(o: LiveOptions, folder: Path, port: int, hmi_port: int) -> list[str]:
    """Return the panel's command."""
    tags = folder / "plant-tags.csv"
    tags.write_text(tag_csv(), encoding="utf-8")
    return [
        "controller", "panel", "--io-map", str(o.io_map), "--port", str(port), "--users", str(o.users),
        "--controller", f"127.0.0.1:{hmi_port}", "--history", str(folder / "history.sqlite"),
        "--telemetry", f"{o.host}:{o.port}", "--telemetry-tags", str(tags),
    ]  # fmt: skip


class LiveTrial:
    """A trial on a running plant and controller, with an operator at the box.

    Attributes:
        panel: Where the panel is, one line; empty without one.
    """

    def __init__(
        self,
        options: LiveOptions,
        view: ProgressView,
        operator: Operator,
        controller: Process,
        interrupts: Interrupts,
    ) -> None:
        self._options = options
        self._interrupts = interrupts
        self._view = view
        self._operator = operator
        self._controller = controller
        self._story = Story()
        self.panel = ""

    def hmi_port(self) -> int:
        """Wait until the controller serves panels; return the port.

        Raises:
            ChildError: The controller could not start.
        """
        line = self._controller.next_line(START_LIMIT_S)
        if line is None:
            raise ChildError("controller", self._controller.stop())
        return int(json.loads(line)["hmi_port"])

    def run(self) -> TrialReport:
        """Home, start, and wait until the trays are empty; by hand, only wait."""
        began_s = time.perf_counter()
        operator, reason = self._operator, ""
        try:
            self._until(State.STOPPED, START_LIMIT_S, "controller in Stopped")
            if self._options.by_hand:
                self._until_complete()
            else:
                operator.press("start")
                self._until(State.IDLE, HOMING_LIMIT_S, "homing")
                operator.press("start")
                self._until(State.COMPLETE, TRAY_LIMIT_S * self._options.trays, "the trial")
        except LiveError as error:
            reason = str(error)
        telemetry = operator.telemetry()
        return make_report(
            seed=self._options.seed,
            counts=counts_of(telemetry),
            events=self._story.events,
            reason=reason,
            simulated_s=telemetry["time_ms"] / 1000,
            wall_s=round(time.perf_counter() - began_s, 3),
        )

    def keep(self) -> None:
        """Go on serving until Ctrl-C."""
        while True:
            self._follow(POLL_S)
            self._show()

    def _until(self, state: State, limit_s: float, what: str) -> None:
        deadline_s = self._now_s() + limit_s
        while self._story.state != state:
            if self._now_s() > deadline_s:
                raise LiveError(f"{what} not reached within {limit_s:.0f} s: {self._story.state_text}")
            self._follow(POLL_S)
            self._show()
            if self._story.state in _BROKEN:
                alarms = "; ".join(self._story.alarms.values()) or "a question is open"
                raise LiveError(f"{what} not reached: {self._story.state_text}, {alarms}")

    def _until_complete(self) -> None:
        """Wait for the user to bring the trays to their end, however long it takes and whatever happens."""
        while self._story.state != State.COMPLETE:
            self._follow(POLL_S)
            self._show()

    def _now_s(self) -> float:
        """Return the time by which limits are judged: the plant's, which stands in a pause."""
        return self._operator.telemetry()["time_ms"] / 1000

    def _follow(self, for_s: float) -> None:
        """Take in the controller's events for a while."""
        until_s = time.perf_counter() + for_s
        while (left_s := until_s - time.perf_counter()) > 0:
            self._interrupts.check()
            try:
                line = self._controller.lines.get(timeout=left_s)
            except queue.Empty:
                return
            if line is None:
                raise ChildError("controller", self._controller.stop())
            self._story.take(json.loads(line))

    def _show(self) -> None:
        story, telemetry = self._story, self._operator.telemetry()
        counts = counts_of(telemetry)
        trays = self._options.trays
        self._view.show(
            Situation(
                elapsed_s=telemetry["time_ms"] / 1000,
                state=story.state_text,
                tray=f"{story.trays_done}/{trays}",
                rows=f"{story.cycles}/{ROWS_A_TRAY * trays}",
                in_cups=counts.in_cups,
                lost=counts.P + counts.D + counts.T,
                seedlings=counts.total,
                alarm="; ".join(story.alarms.values()),
            )
        )
