"""Live trial: plant, controller and operator panel as separate processes, connected by Modbus TCP.

By default time is simulated: the plant advances by one scan at each write of the outputs, the controller sets the pace,
and a panel can pause simulated time and change its speed. A busy computer slows the trial down without changing its
result. In real time, plant and controller follow the wall clock, as on a real machine.
"""

from __future__ import annotations

import json
import queue
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from controller.common.files.state_folder import state_folder
from controller.common.stop_request import INTERRUPTED, StopRequest
from controller.history.file import LIMIT_BYTES, LIMIT_DAYS
from controller.history.writer import HISTORY_NAME
from controller.program.states import State
from plant_sim.common.kept_folder import KeptFolder
from plant_sim.links.tag_file import tag_csv
from plant_sim.machine.parameters import load_machine
from plant_sim.twin.commissioning import constants_file, needs_confirmation
from plant_sim.twin.ending import rule
from plant_sim.twin.ending.attendance import has_open_page
from plant_sim.twin.ending.reported import ReportedEvents
from plant_sim.twin.ending.rule import EndingRule, Rest, TrialEnd, default_max_ms
from plant_sim.twin.lock_step import CLEAR_MS, SCAN_MS
from plant_sim.twin.operator import PRESS_MS, Operator, counts_of
from plant_sim.twin.process import ChildError, Interrupts, Process
from plant_sim.twin.progress import ProgressView, progress_of
from plant_sim.twin.report import TrialReport, make_report

POLL_S = 0.2
START_LIMIT_S = 60.0
"""Limit of the start of a process, s: the end of a hang; a busy computer needs several times 3 s."""
LOCK_STEP_TIMEOUT_MS = 5_000
"""Response timeout in simulated time, long enough for a busy computer, ms."""


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """Options of a live run.

    Attributes:
        language: Language of the controller's texts and of the panel's page; None = English, and on the page that of
            the browser.
        port: Port of the plant's Modbus server; 0 = any free port.
        planting_frequency_per_min: Cups per minute per row; None = that of the machine.
        hmi_port: Port of the controller's Modbus server; 0 = any free port.
        panel_port: Port of the panel's page; 0 = any free port, None = no panel.
        real_time: True to follow the wall clock.
        pace: Speed of simulated time at the start, percent.
        by_hand: True if only the user presses the buttons.
        users: File of the panel's passwords.
        folder: Folder of the folders of all live runs, each of which has the memory, history and trends of one.
        max_ms: Longest machine time, ms; None = the default, and no limit by hand.
        waits: True if the trial waits for an operator in any case.
    """

    seed: int
    trays: int
    host: str
    port: int
    io_map: Path
    machine: Path
    language: str | None = None
    faults: tuple[str, ...] = ()
    planting_frequency_per_min: float | None = None
    record: Path | None = None
    hmi_port: int = 5021
    panel_port: int | None = 8080
    real_time: bool = False
    pace: int = 100
    by_hand: bool = False
    users: Path = field(default_factory=lambda: state_folder() / "panel-users.json")
    folder: Path = field(default_factory=lambda: state_folder() / "trials")
    max_ms: int | None = None
    waits: bool = False


class _EndedError(Exception):
    """End of the trial by its rule."""

    def __init__(self, ending: TrialEnd) -> None:
        super().__init__(ending.reason)
        self.ending = ending


@contextmanager
def live_trial(options: LiveOptions, view: ProgressView, stop: StopRequest | None = None) -> Iterator[LiveTrial]:
    """Run plant and controller for the duration of a `with` block; at its end the controller is stopped first.

    Args:
        options: Options.
        view: View of the progress.
        stop: Request to stop, which may have been made before; None = only signals from now on.

    Raises:
        InputError: The folder of the run cannot be created.
        ChildError: The plant could not start.
        KeyboardInterrupt: The request to stop was made, or a signal arrived, during the start.
    """
    with ExitStack() as stack:
        interrupts = stack.enter_context(Interrupts(stop))
        interrupts.check()
        kept = KeptFolder(options.folder, record=HISTORY_NAME, limit_days=LIMIT_DAYS, limit_bytes=LIMIT_BYTES)
        folder = stack.enter_context(kept).path
        plant = stack.enter_context(Process("plant", _serve(options)))
        listening = plant.next_line(START_LIMIT_S)
        if listening is None:
            raise ChildError("plant", plant.stop())
        o = replace(options, port=int(listening.rpartition(":")[2]))
        operator = stack.enter_context(Operator(o.host, o.port))
        controller = stack.enter_context(Process("controller", _control(o, folder), ends_before=[plant]))
        trial = LiveTrial(o, view, operator, controller, interrupts)
        if o.panel_port is not None:
            panel = Process("panel", _panel(o, folder, o.panel_port, trial.hmi_port()))
            stack.enter_context(panel)
            trial.panel = panel.next_line(START_LIMIT_S) or "the panel did not start; see the message above"
        yield trial


def _link(o: LiveOptions) -> list[str]:
    """Return the options that plant and controller have in common."""
    return ["--io-map", str(o.io_map), "--port", str(o.port), "--host", o.host]


def _serve(o: LiveOptions) -> list[str]:
    """Return the command line of the plant."""
    serve = [
        "plant_sim",
        "serve",
        *_link(o),
        "--machine",
        str(o.machine),
        "--seed",
        str(o.seed),
        "--trays",
        str(o.trays),
    ]
    if o.planting_frequency_per_min is not None:
        serve += ["--planting-frequency", str(o.planting_frequency_per_min)]
    for fault in o.faults:
        serve += ["--fault", fault]
    if o.record is not None:
        serve += ["--record", str(o.record)]
    if not o.real_time:
        serve += ["--lock-step-ms", str(SCAN_MS)]
    return serve


def _control(o: LiveOptions, folder: Path) -> list[str]:
    """Return the command line of the controller."""
    control = ["controller", "run", *_link(o), "--retain", str(folder / "retentive.json"), "--events", "json"]
    control.append("--new-machine")
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
        str(folder / HISTORY_NAME),
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
        exit_code: Exit code of a run that was interrupted or in which a process failed; else None.
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
        self._reported = ReportedEvents()
        self._telemetry: dict[str, float] = operator.telemetry()
        max_ms = options.max_ms
        if max_ms is None and not options.by_hand:
            max_ms = default_max_ms(options.trays)
        self._rule = EndingRule(max_ms, self._is_attended)
        self._noticed_ms: int | None = None
        self.panel = ""
        self.exit_code: int | None = None

    def _is_attended(self) -> bool:
        """Return True if an operator is there, who may answer."""
        if self._options.waits or self._options.by_hand or (sys.stdin is not None and sys.stdin.isatty()):
            return True
        return has_open_page(self.panel)

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
        """Home, start, and wait for the end of the trial; in manual operation, only wait."""
        start_s = time.perf_counter()
        ending = self._ending()
        telemetry = self._last_telemetry()
        at_ms = telemetry["time_ms"] if ending.at_ms is None else ending.at_ms
        return make_report(
            seed=self._options.seed,
            counts=counts_of(telemetry),
            events=self._reported.events,
            reason=ending.reason,
            simulated_s=at_ms / 1000,
            wall_s=round(time.perf_counter() - start_s, 3),
        )

    def _ending(self) -> TrialEnd:
        """Operate the machine until the trial ends."""
        try:
            self._operate()
        except _EndedError as ended:
            return ended.ending
        except KeyboardInterrupt:
            self.exit_code = 0 if self._options.by_hand else INTERRUPTED
            return TrialEnd(None, rule.INTERRUPTED)
        except ChildError as error:
            self.exit_code = error.exit_code or 1
            return TrialEnd(None, str(error))
        except BrokenPipeError:  # also a ConnectionError, but caused by closed standard output
            raise
        except ConnectionError as error:
            return TrialEnd(None, str(error))
        return TrialEnd(None, "")

    def _operate(self) -> None:
        self._until(State.STOPPED)
        if not self._options.by_hand:
            if needs_confirmation(load_machine(self._options.machine)):
                self._confirm_constants()
            self._press("start")
            self._until(State.IDLE)
            self._press("start")
        self._until(State.COMPLETE)

    def _last_telemetry(self) -> dict[str, float]:
        """Return the telemetry at the end; the last one read if the plant does not answer.

        An interrupt may have come between a request and its answer, so that a new connection is used.
        """
        with suppress(OSError), Operator(self._options.host, self._options.port) as observer:
            self._telemetry = observer.telemetry()
        return self._telemetry

    def serve(self) -> None:
        """Keep the processes running until Ctrl-C."""
        while True:
            self._follow(POLL_S)
            self._show()

    def _until(self, state: State) -> None:
        """Wait until the machine is in a state.

        Raises:
            _EndedError: The trial ended first.
        """
        while self._reported.state != state:
            self._follow(POLL_S)
            self._show()
            reported = self._reported
            ending = self._rule.ending(
                int(self._telemetry["time_ms"]),
                complete=reported.state == State.COMPLETE,
                rest=self._rest(),
                state=reported.english_state,
            )
            if ending is not None and reported.state != state:
                raise _EndedError(ending)

    def _rest(self) -> Rest | None:
        """Return the rest of the machine in plant time; in real time, controller and plant have different zeros."""
        rest = self._reported.rest
        if rest is None or not self._options.real_time:
            self._noticed_ms = None
            return rest
        if self._noticed_ms is None:
            self._noticed_ms = int(self._telemetry["time_ms"])
        return Rest(self._noticed_ms, rest.text)

    def _confirm_constants(self) -> None:
        """Press the emergency stop, release it and clear, as the program requires if a machine constant differs."""
        self._press("emergency_stop")
        self._until(State.ABORTED)
        self._press("stop", for_ms=CLEAR_MS)
        self._until(State.STOPPED)

    def _press(self, button: str, for_ms: int = PRESS_MS) -> None:
        """Press a button; a rest without an alarm counts from the time at which the plant has been told."""
        self._operator.press(button, for_ms=for_ms)
        self._telemetry = self._operator.telemetry()
        self._reported.acted(int(self._telemetry["time_ms"]))
        self._noticed_ms = None

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
            self._reported.apply(json.loads(line))

    def _show(self) -> None:
        self._telemetry = self._operator.telemetry()
        counts, elapsed_s = counts_of(self._telemetry), self._telemetry["time_ms"] / 1000
        self._view.show(progress_of(self._reported, counts, elapsed_s=elapsed_s, trays=self._options.trays))
