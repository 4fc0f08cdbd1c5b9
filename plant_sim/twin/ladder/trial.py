"""Trial of a third-party FX program in place of the controller, operated through the push buttons only."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Final

from controller.common.document.rendering import reference_table
from controller.common.modbus.io_map import IoMap
from controller.common.stop_request import StopRequest
from controller.fx.engine.execution import fastest_execution
from controller.fx.engine.peripherals.peripherals import Peripherals
from controller.fx.engine.plc import FxPlc
from controller.fx.language.instruction import DeviceOperand, Ladder, LadderError
from controller.fx.language.reading import load_ladder
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.faults import Fault
from plant_sim.links.io_module import IoModule
from plant_sim.machine.parameters import Machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.commissioning import default_io_map, default_parameters
from plant_sim.twin.ending.rule import INTERRUPTED, EndingRule, TrialEnd, default_max_ms
from plant_sim.twin.ladder.annunciators import AnnunciatorNames, AnnunciatorRest
from plant_sim.twin.ladder.question_lamp import ANSWER_MS, LAMP, QuestionLamp, asked_arm, button_of
from plant_sim.twin.ladder.recording import LadderRecorder
from plant_sim.twin.ladder.scan_timing import (
    NO_WATCHDOG_MS,
    ScanEstimate,
    ScanMonitor,
    ScanTiming,
    TrialClock,
)
from plant_sim.twin.lock_step import CLEAR_MS
from plant_sim.twin.report import account_text

__all__ = ["LadderError", "LadderReport", "ScanRow", "load_ladder", "run_ladder_trial", "table"]

PRESS_MS: Final = 200
PRESS_SCANS: Final = 3
"""Shortest press in scans: without samples between the scans, the input filter passes a level in the second one."""
IDLE_LIMIT_MS: Final = 20_000
"""Idle time after which the operator presses the start button, or the trial ends. Twelve cups at 45 cups/min
take 16 s."""
MAX_PRESSES: Final = 10
INDICATORS: Final = ("horn", "lamp_red", "lamp_amber", "lamp_green")


@dataclass(frozen=True, slots=True)
class LadderReport:
    """Result of a trial with an FX program.

    Attributes:
        counts: Final location of the seedlings.
        presses: Number of presses of the start button.
        incidents: Incidents in the plant, one line each.
        simulated_s: Simulated time, s.
        error: CPU error that stopped the program; empty if none.
        reason: Reason for an incomplete trial; empty if it completed.
        alarms: Names of the annunciators that were on, in the order of their first activation.
        scan_estimate: Estimated scan time on a real FX2N; None = not estimated.
    """

    counts: SeedlingCounts
    presses: int
    incidents: tuple[str, ...]
    simulated_s: float
    error: str
    reason: str = ""
    alarms: tuple[str, ...] = ()
    scan_estimate: ScanEstimate | None = None

    def __repr__(self) -> str:
        end = f", did not complete: {self.reason}" if self.reason else ""
        return (
            f"<LadderReport: {self.counts.in_cups} of {self.counts.total} seedlings in cups, incidents "
            f"{len(self.incidents)}, {self.simulated_s:.1f} s of machine time{end}>"
        )

    @property
    def completed(self) -> bool:
        """True if every seedling has left the trays and claws without an incident or a CPU error."""
        return not (self.counts.in_tray or self.counts.in_claw or self.incidents or self.error or self.reason)

    def record(self) -> dict[str, object]:
        """Return the report as a flat record."""
        counts = asdict(self.counts)
        return {
            "completed": self.completed,
            **counts,
            "presses": self.presses,
            "incidents": list(self.incidents),
            "simulated_s": self.simulated_s,
            "error": self.error,
            "reason": self.reason,
            "alarms": list(self.alarms),
            **({} if self.scan_estimate is None else {"scan_estimate": asdict(self.scan_estimate)}),
        }

    def text(self) -> str:
        """Return the report in a few lines."""
        lines = [
            *([f"the trial did not complete: {self.reason}"] if self.reason else []),
            account_text(self.counts),
            f"{self.simulated_s:.1f} s simulated, start pressed {self.presses} times",
            *(f"alarm {name}" for name in self.alarms),
            *self.incidents,
            *([] if self.scan_estimate is None else [str(self.scan_estimate)]),
        ]
        return "\n".join(lines)


def run_ladder_trial(
    ladder: Ladder,
    *,
    seed: int,
    trays: int = 2,
    io_map: IoMap | None = None,
    parameters: Machine | None = None,
    values: Mapping[DeviceOperand, int] | None = None,
    timing: ScanTiming | None = None,
    estimates: bool = False,
    peripherals: Peripherals | None = None,
    faults: Iterable[Fault] = (),
    rule: EndingRule | None = None,
    stop: StopRequest | None = None,
    recorder: LadderRecorder | None = None,
) -> LadderReport:
    """Run an FX program on the plant until all motion has stopped, or the trial ends by its rule.

    The operator presses the start button whenever nothing has moved for `IDLE_LIMIT_MS` and seedlings remain. If the
    amber lamp asks a question, the operator answers it instead; if a press has moved nothing without a question, the
    operator confirms machine constants before the next one.

    Args:
        ladder: The program; it drives the terminals of the I/O map.
        seed: Seed of the plant.
        trays: Trays in the magazine, 72 seedlings each.
        io_map: I/O map; None = the default map.
        parameters: Machine parameters; None = the defaults.
        values: Values written to registers and relays after the first scan, as with a programming tool.
        timing: Scan time of the PLC, with terminals that are sampled between scans as in an FX2N; None = a scan every
            `SCAN_MS`, which also samples the terminals.
        estimates: True to estimate the scan time of a real FX2N, which takes a few seconds.
        peripherals: Special function modules and serial line; None = none.
        faults: Faults of the plant.
        rule: Rule by which the trial ends; None = without an operator, and with the default time limit.
        stop: Request to stop the trial; None = none.
        recorder: Recorder of the trial, without a timing; None = none.

    Raises:
        LadderError: The program cannot be run.
    """
    io_map = io_map or default_io_map()
    plant = Plant(io_map, parameters or default_parameters(), seed=seed, trays=trays, faults=faults)
    module = IoModule(plant, io_map, watchdog_ms=NO_WATCHDOG_MS)
    plc = FxPlc(ladder, execution=fastest_execution, peripherals=peripherals)
    movers = [point for point in io_map.outputs if point.tag not in INDICATORS]
    operator = _Operator(plant)
    still_ms, now_ms = IDLE_LIMIT_MS - PRESS_MS, 0  # first press soon after start
    clock, monitor = TrialClock(timing, seed), ScanMonitor(estimates)
    rule = rule or EndingRule(default_max_ms(trays))
    names = AnnunciatorNames(ladder)
    rest, ending = AnnunciatorRest(names), None
    if recorder is not None:
        recorder.begin(plc, module, clock)
    while plc.error is None and ending is None:
        image = plc.scan(now_ms, module.inputs())[: io_map.output_count]
        if now_ms == 0:
            _write(plc, values or {})
        module.write_outputs(0, image)
        if recorder is not None:
            recorder.scanned(now_ms)
        monitor.note(plc)
        scan_ms = clock.next_ms(plc)
        moves = any(point.active(image[point.number]) for point in movers)
        still_ms = 0 if moves else still_ms + scan_ms
        operator.look(now_ms, moves=moves)
        is_idle, complete = still_ms >= IDLE_LIMIT_MS, False
        if is_idle:
            counts = plant.counts()
            complete = not (counts.in_tray or counts.in_claw)
            if operator.acts == MAX_PRESSES and not complete:
                ending = TrialEnd(None, f"buttons pressed {MAX_PRESSES} times, and seedlings are left")
                break
        ending = rule.ending(
            now_ms,
            complete=complete,
            rest=rest.of(plc, now_ms, moves=moves),
            state="the machine moves" if moves else "nothing moves",
        )
        if stop is not None and stop.is_set():
            ending = TrialEnd(None, INTERRUPTED)
        if ending is not None:
            break
        if is_idle:
            still_ms = 0
            rest.forget(plc)
            operator.plan(now_ms, max(PRESS_MS, PRESS_SCANS * scan_ms))
        operator.act(now_ms)
        if recorder is not None:
            recorder.acted()
        clock.advance(module, plc, now_ms, scan_ms)
        now_ms += scan_ms
    incidents = tuple(f"{event.kind.value}: {event.text}, at {event.time_ms} ms" for event in plant.events)
    error, simulated_s = str(plc.error or ""), now_ms / 1_000
    return LadderReport(
        plant.counts(),
        operator.presses,
        incidents,
        simulated_s,
        error,
        reason=error if ending is None else ending.reason,
        alarms=tuple(map(names, monitor.alarms)),
        scan_estimate=monitor.estimate,
    )


@dataclass(slots=True)
class _Operator:
    """Operator who knows the push buttons and the amber lamp, but not the program.

    Attributes:
        plant: The plant with its push buttons and lamps.
        acts: Number of presses that order something or answer a question, including a planned one.
        presses: Number of those of the start button.
        moved: Whether anything has moved since power-up.
    """

    plant: Plant
    acts: int = 0
    presses: int = 0
    moved: bool = False
    _was_start: bool = False
    _lamp: QuestionLamp = field(default_factory=QuestionLamp)
    _changes: list[tuple[int, str, bool]] = field(default_factory=list)

    def look(self, now_ms: int, *, moves: bool) -> None:
        """Note whether anything moves, and the flashes of the lamp."""
        self.moved |= moves
        self._lamp.update(now_ms, is_lit=self.plant.indicators.get(LAMP, False))

    def plan(self, now_ms: int, press_ms: int) -> None:
        """Plan the answer to a question, otherwise a press of X0; X25 and X24 before it if one moved nothing.

        A program with lost memory asks whether to feed a tray, and X24 is the answer. One whose machine constants
        differ from their defaults waits for X25, and then for X24.
        """
        if question := self._lamp.flashes:
            side = asked_arm(question)
            holds = side is not None and bool(self.plant.arms[side].grip.held)
            presses = [(button_of(question, holds=holds), ANSWER_MS)]
        elif self._was_start and not self.moved:
            presses = [("emergency_stop", press_ms), ("stop", CLEAR_MS), ("start", press_ms)]
        else:
            presses = [("start", press_ms)]
        self._was_start = presses[0][0] == "start" and not question
        for button, for_ms in presses:
            self._changes += [(now_ms, button, True), (now_ms + for_ms, button, False)]
            now_ms += for_ms + press_ms
        self.acts += 1
        self.presses += presses[-1][0] == "start"

    def act(self, now_ms: int) -> None:
        """Press and release the buttons whose time has come."""
        while self._changes and self._changes[0][0] <= now_ms:
            _, button, pressed = self._changes.pop(0)
            setattr(self.plant.box, button, pressed)


def _write(plc: FxPlc, values: Mapping[DeviceOperand, int]) -> None:
    for device, value in values.items():
        if device.kind == "D":
            plc.memory.D[device.number] = value
        else:
            plc.memory.bits(device.kind)[device.number] = bool(value)


@dataclass(frozen=True, slots=True)
class ScanRow:
    """Trials with one scan timing.

    Attributes:
        timing: Scan time.
        reports: One report for each seed.
    """

    timing: ScanTiming
    reports: Sequence[LadderReport]

    def record(self) -> dict[str, object]:
        """Return the row as a flat record: sums over the trials."""
        counts = [report.counts for report in self.reports]
        alarms = Counter(alarm.split()[0] for report in self.reports for alarm in report.alarms)
        return {
            **asdict(self.timing),
            "trials": len(self.reports),
            "completed": sum(report.completed for report in self.reports),
            "total": sum(each.total for each in counts),
            "in_cups": sum(each.in_cups for each in counts),
            "P": sum(each.P for each in counts),
            "D": sum(each.D for each in counts),
            "T": sum(each.T for each in counts),
            "left": sum(each.in_tray + each.in_claw for each in counts),
            "incidents": sum(len(report.incidents) for report in self.reports),
            "alarms": dict(sorted(alarms.items())),
            "errors": sum(bool(report.error) for report in self.reports),
        }


def table(rows: Sequence[ScanRow]) -> str:
    """Return a Markdown table."""
    heading = ("scan, ms", "completed", "in cups", "P", "D", "T", "left", "incidents", "alarms (trials)")
    return reference_table(heading, *(_cells(row) for row in rows))


def _cells(row: ScanRow) -> Iterator[object]:
    cells = row.record()
    yield _scan(row.timing)
    yield f"{cells['completed']} of {cells['trials']}"
    yield from (cells[key] for key in ("in_cups", "P", "D", "T", "left", "incidents"))
    alarms = cells["alarms"]
    assert isinstance(alarms, dict)  # noqa: S101 - narrows the union
    yield ", ".join(f"{name} ({count})" for name, count in alarms.items()) or "–"


def _scan(timing: ScanTiming) -> str:
    """Return a scan timing in a few characters.

    Examples:
        >>> _scan(ScanTiming(12, 2, 80)), _scan(ScanTiming(10))
        ('12 ± 2, one in 1000: 80', '10')
    """
    mean = f"{timing.period_ms} ± {timing.jitter_ms}" if timing.jitter_ms else f"{timing.period_ms}"
    return f"{mean}, one in {timing.long_every}: {timing.long_ms}" if timing.long_ms else mean
