"""Live trial: plant, controller and operator panel as separate processes, connected by Modbus TCP.

By default time is simulated: the plant advances by one scan at each write of the outputs, the controller sets the pace,
and a panel can pause simulated time and change its speed. A busy computer slows the trial down without changing its
result. In real time, plant and controller follow the wall clock, as on a real machine.
"""

from __future__ import annotations

import json
import queue
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from controller.program.states import State
from plant_sim.links.tag_file import tag_csv
from plant_sim.machine.parameters import load_machine
from plant_sim.twin.commissioning import constants_file, needs_confirmation
from plant_sim.twin.lock_step import CLEAR_MS, SCAN_MS
from plant_sim.twin.operator import Operator, counts_of
from plant_sim.twin.process import ChildError, Interrupts, LiveError, Process
from plant_sim.twin.progress import ProgressState, ProgressView
from plant_sim.twin.report import TrialReport, make_report
from plant_sim.twin.trial import ROWS_A_TRAY

POLL_S = 0.2
START_LIMIT_S = 60.0
"""Limit of the start of a process, s: the end of a hang; a busy computer needs several times 3 s."""
HOMING_LIMIT_S = 60.0
TRAY_LIMIT_S = 600.0
LOCK_STEP_TIMEOUT_MS = 5_000
"""Response timeout in simulated time, long enough for a busy computer, ms."""

Record = dict[str, Any]


@dataclass
class ReportedEvents:
    """State, alarms and production derived from the controller's events."""

    events: list[Record] = field(default_factory=list)
    state: int = 0
    state_text: str = "not started"
    trays_done: int = 0
    rows: int = 0
    alarms: dict[int, str] = field(default_factory=dict)

    def apply(self, event: Record) -> None:
        """Update from one event."""
        self.events.append(event)
        match event["event"]:
            case "state":
                reason = f" ({event['reason']})" if event["reason"] else ""
                self.state, self.state_text = event["state"], event["text"] + reason
            case "tray":
                self.trays_done = event["trays_done"]
            case "row":
                self.rows += 1
            case "alarm" if event["active"]:
                self.alarms[event["number"]] = event["text"]
            case "alarm":
                self.alarms.pop(event["number"], None)


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """Options of a live run.

    Attributes:
        language: Language of the controller's texts and of the panel's page; None = English, and on the page that of
            the browser.
        hmi_port: Port of the controller's Modbus server; 0 = any free port.
        panel_port: Port of the panel's page; 0 = any free port, None = no panel.
        real_time: True to follow the wall clock.
        pace: Speed of simulated time at the start, percent.
        by_hand: True if only the user presses the buttons.
        users: File of the panel's passwords.
    """

    seed: int
    trays: int
    host: str
    port: int
    io_map: Path
    machine: Path
    language: str | None = None
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
    """Run plant and controller for the duration of a `with` block; at its end the controller is stopped first.

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
        controller = stack.enter_context(Process("controller", _control(o, common, folder), ends_before=[plant]))
        trial = LiveTrial(options, view, operator, controller, interrupts)
        if o.panel_port is not None:
            panel = Process("panel", _panel(o, folder, o.panel_port, trial.hmi_port()))
            stack.enter_context(panel)
            trial.panel = panel.next_line(START_LIMIT_S) or "the panel did not start; see the message above"
        yield trial


def _serve(o: LiveOptions, common: Sequence[str]) -> list[str]:
    """Return the command line of the plant."""
    serve = ["plant_sim", "serve", *common, "--machine", str(o.machine), "--seed", str(o.seed), "--trays", str(o.trays)]
    for fault in o.faults:
        serve += ["--fault", fault]
    if o.record is not None:
        serve += ["--record", str(o.record)]
    if not o.real_time:
        serve += ["--lock-step-ms", str(SCAN_MS)]
    return serve


def _control(o: LiveOptions, common: Sequence[str], folder: Path) -> list[str]:
    """Return the command line of the controller."""
    control = ["controller", "run", *common, "--retain", str(folder / "retentive.json"), "--events", "json"]
    control += ["--no-console", "--language", o.language or "en", "--hmi-port", str(o.hmi_port), "--allow-forcing"]
    control += ["--scan-ms", str(SCAN_MS)]
    if not o.real_time:
        control += ["--simulated-time", "--pace", str(o.pace), "--timeout-ms", str(LOCK_STEP_TIMEOUT_MS)]
    constants = folder / "constants.yaml"
    constants.write_text(constants_file(load_machine(o.machine)), encoding="utf-8")
    return [*control, "--constants", str(constants), "--set", f"trays_target={o.trays}"]


def _panel(o: LiveOptions, folder: Path, port: int, hmi_port: int) -> list[str]:
    """Return the command line of the panel."""
    tags = folder / "plant-tags.csv"
    tags.write_text(tag_csv(load_machine(o.machine)), encoding="utf-8")
    return [
        "controller",
        "panel",
        "--io-map",
        str(o.io_map),
        "--port",
        str(port),
        "--users",
        str(o.users),
        "--controller",
        f"127.0.0.1:{hmi_port}",
        "--history",
        str(folder / "history.sqlite"),
        "--trends",
        str(folder / "panel-trends.sqlite"),
        "--telemetry",
        f"{o.host}:{o.port}",
        "--telemetry-tags",
        str(tags),
        *(() if o.language is None else ("--language", o.language)),
    ]


class LiveTrial:
    """Trial on a running plant and controller, with an operator at the push buttons.

    Attributes:
        panel: Line with the address of the panel; empty if there is no panel.
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
        self._progress = ReportedEvents()
        self.panel = ""

    def hmi_port(self) -> int:
        """Wait for the controller's Modbus server and return its port.

        Raises:
            ChildError: The controller could not start.
        """
        line = self._controller.next_line(START_LIMIT_S)
        if line is None:
            raise ChildError("controller", self._controller.stop())
        return int(json.loads(line)["hmi_port"])

    def run(self) -> TrialReport:
        """Home, start, and wait until the trays are empty; in manual operation, only wait."""
        start_s = time.perf_counter()
        operator, reason = self._operator, ""
        try:
            self._until(State.STOPPED, START_LIMIT_S, "controller in Stopped")
            if self._options.by_hand:
                self._until_complete()
            else:
                if needs_confirmation(load_machine(self._options.machine)):
                    self._confirm_constants()
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
            events=self._progress.events,
            reason=reason,
            simulated_s=telemetry["time_ms"] / 1000,
            wall_s=round(time.perf_counter() - start_s, 3),
        )

    def serve(self) -> None:
        """Keep the processes running until Ctrl-C."""
        while True:
            self._follow(POLL_S)
            self._show()

    def _until(self, state: State, limit_s: float, what: str, *, broken: Sequence[State] = _BROKEN) -> None:
        deadline_s = self._now_s() + limit_s
        while self._progress.state != state:
            if self._now_s() > deadline_s:
                raise LiveError(f"{what} not reached within {limit_s:.0f} s: {self._progress.state_text}")
            self._follow(POLL_S)
            self._show()
            if self._progress.state in broken:
                alarms = "; ".join(self._progress.alarms.values()) or "a question to the operator is open"
                raise LiveError(f"{what} not reached: {self._progress.state_text}, {alarms}")

    def _confirm_constants(self) -> None:
        """Press the emergency stop, release it and clear, as the program requires if a machine constant differs."""
        self._operator.press("emergency_stop")
        self._until(State.ABORTED, START_LIMIT_S, "emergency stop", broken=())
        self._operator.press("stop", for_ms=CLEAR_MS)
        self._until(State.STOPPED, START_LIMIT_S, "clear", broken=())

    def _until_complete(self) -> None:
        """Wait without a time limit until the machine is in Complete."""
        while self._progress.state != State.COMPLETE:
            self._follow(POLL_S)
            self._show()

    def _now_s(self) -> float:
        """Return the plant time, which stops during a pause, as the time base of the limits, s."""
        return self._operator.telemetry()["time_ms"] / 1000

    def _follow(self, for_s: float) -> None:
        """Process the controller's events for `for_s` seconds."""
        until_s = time.perf_counter() + for_s
        while (left_s := until_s - time.perf_counter()) > 0:
            self._interrupts.check()
            try:
                line = self._controller.lines.get(timeout=left_s)
            except queue.Empty:
                return
            if line is None:
                raise ChildError("controller", self._controller.stop())
            self._progress.apply(json.loads(line))

    def _show(self) -> None:
        progress, telemetry = self._progress, self._operator.telemetry()
        counts = counts_of(telemetry)
        trays = self._options.trays
        self._view.show(
            ProgressState(
                elapsed_s=telemetry["time_ms"] / 1000,
                state=progress.state_text,
                tray=f"{progress.trays_done}/{trays}",
                rows=f"{progress.rows}/{ROWS_A_TRAY * trays}",
                in_cups=counts.in_cups,
                lost=counts.P + counts.D + counts.T,
                seedlings=counts.total,
                alarm="; ".join(progress.alarms.values()),
            )
        )
