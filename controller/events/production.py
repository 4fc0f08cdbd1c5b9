"""Log of production: events derived from the PLC memory after each scan."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from controller.common.saved import Saved
from controller.core.devices import ANNUNCIATORS
from controller.core.expr import Bit, Word
from controller.core.scan import Plc
from controller.events.kinds import (
    AlarmEvent,
    CycleEvent,
    Event,
    GapCause,
    ModeEvent,
    NextPressEvent,
    QuestionEvent,
    RefusalEvent,
    RowEvent,
    StateEvent,
    TrayEvent,
)
from controller.program.machine import Transplanter
from controller.program.operator.constants import warning_text
from controller.program.operator.next_press import what_to_do
from controller.program.operator.refusals import Refusal, refusal_text
from controller.program.states import HOLDS, Mode, State
from controller.program.tags import IN_PLACE, ROWS, SIDES, Side
from controller.program.texts.operator import MODES, NO_TEXT, REASONS, STATES, Text, question_text

_MIN_WAIT_MS: Final = 50
"""Shortest time at feed that counts as waiting, ms; an arm that does not wait is at feed for one or two scans."""


class _CycleTimer(Saved):
    """Timer of the cycles of one arm, based on its S bits."""

    SAVED = (
        "_centre_ms",
        "_has_tray",
        "_is_at_feed",
        "_is_waiting",
        "_last_ms",
        "_missed",
        "_row",
        "_since_ms",
        "_tray_ms",
        "_waited_ms",
    )

    def __init__(self, machine: Transplanter, side: Side) -> None:
        cycle, self._arm = machine.cycles[side], machine.tags.arms[side]
        self._start, self._end = cycle["approach row"], cycle["wait at feed"]
        self._tray = machine.tags.tray
        self._waiting = tuple(cycle[title].number for title in ("wait to lower", "wait for cups", "release delay"))
        self._side = side
        self._row: int | None = None
        self._since_ms = 0
        self._waited_ms = 0
        self._tray_ms = self._centre_ms = 0
        self._missed = 0
        self._last_ms = 0
        self._is_waiting = self._is_at_feed = self._has_tray = False

    @property
    def devices(self) -> tuple[Bit | Word, ...]:
        """Devices whose changes affect the timing."""
        waiting = (Bit("S", number) for number in self._waiting)
        return (self._start, self._end, *waiting, self._tray.phase)

    def update(self, now_ms: int, plc: Plc) -> CycleEvent | None:
        """Return the cycle that ended in this scan; None if none ended."""
        states = plc.memory.S
        self._add_waits(now_ms - self._last_ms)
        self._last_ms = now_ms
        self._is_waiting = any(states[number] for number in self._waiting)
        self._is_at_feed = states[self._end.number]
        self._has_tray = plc.read(self._tray.phase) == IN_PLACE
        if self._row is None:
            if states[self._start.number]:
                self._row = next(row for row in ROWS if plc.read(self._arm.row_is[row]))
                self._since_ms, self._waited_ms = now_ms, 0
            return None
        if not states[self._end.number] or states[self._start.number]:
            return None
        row, self._row = self._row, None
        missed, before = plc.read(self._arm.missed_cups), self._missed
        self._missed = missed
        cause = self._cause() if missed > before else "none"
        self._tray_ms = self._centre_ms = 0
        return CycleEvent(now_ms, self._side, row, now_ms - self._since_ms, self._waited_ms, missed, cause)

    def interrupt(self) -> None:
        """Discard an aborted cycle."""
        self._row = None
        self._tray_ms = self._centre_ms = 0

    def _add_waits(self, passed_ms: int) -> None:
        """Add the time since the last update to the waiting time for cups, for the tray or for the centre."""
        if self._row is not None:
            if self._is_waiting:
                self._waited_ms += passed_ms
        elif self._is_at_feed and self._has_tray:
            self._centre_ms += passed_ms
        elif self._is_at_feed:
            self._tray_ms += passed_ms

    def _cause(self) -> GapCause:
        if self._tray_ms > _MIN_WAIT_MS:
            return "tray"
        return "centre" if self._centre_ms > _MIN_WAIT_MS else "row"


class ProductionLog(Saved):
    """Generator of events from the changes between scans; an observer of the runtime."""

    SAVED = ("_alarms", "_line_from", "_mode", "_questions", "_refusals", "_rows", "_state", "_told_line", "_trays")

    def __init__(self, machine: Transplanter, report: Callable[[Event], None]) -> None:
        """Create the log for a machine.

        Args:
            machine: Program and its tags.
            report: Listener that receives every event, in order.
        """
        self._machine = machine
        self._report = report
        self._state = 0
        self._trays: int | None = None
        self._rows: dict[Side, int] = {}
        self._mode: int | None = None
        self._refusals = 0
        self._line_from: tuple[int, ...] = ()
        self._told_line = NO_TEXT
        self._alarms: list[int] = []
        self._questions: list[str] = []
        self._cycles = [_CycleTimer(machine, side) for side in SIDES]
        tags = machine.tags
        self._asking = [
            *((f"{side}_loaded", tags.arms[side].ask.number) for side in SIDES),
            *((f"{side}_cups", tags.arms[side].ask_cups.number) for side in SIDES),
            ("tray", tags.tray.ask.number),
        ]

    def save(self) -> Any:
        """Return the current state."""
        return super().save(), [timer.save() for timer in self._cycles]

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        own, timers = saved
        super().restore(own)
        for timer, state in zip(self._cycles, timers, strict=True):
            timer.restore(state)

    @property
    def devices(self) -> tuple[Bit | Word, ...]:
        """Devices that a call depends on; a call after a scan in which none of them has changed has no effect."""
        tags = self._machine.tags
        return (
            *(Bit("S", number) for number in ANNUNCIATORS),
            *(Bit("M", number) for _, number in self._asking),
            *(device for timer in self._cycles for device in timer.devices),
            tags.machine.state,
            tags.machine.mode,
            tags.machine.next_press,
            tags.machine.first_out,
            tags.machine.refusals,
            tags.machine.trays_done,
            *(arm.cycles for arm in tags.arms.values()),
        )

    def __call__(self, now_ms: int, plc: Plc) -> None:
        """Evaluate the memory after a scan."""
        tags = self._machine.tags
        state, refusals = plc.read(tags.machine.state), self._refusals
        entered = state != self._state
        if entered:
            self._state = state
            self._report(self._state_event(now_ms, plc, state))
            if not plc.read(tags.machine.motion):
                for timer in self._cycles:
                    timer.interrupt()
        self._report_operator_actions(now_ms, plc)
        self._report_alarms(now_ms, plc)
        self._report_questions(now_ms, plc)
        self._report_line(now_ms, plc, told=entered or self._refusals != refusals)
        for timer in self._cycles:
            cycle = timer.update(now_ms, plc)
            if cycle is not None:
                self._report(cycle)
        self._report_rows(now_ms, plc)
        trays = plc.read(tags.machine.trays_done)
        if self._trays is not None and trays > self._trays:
            self._report(TrayEvent(now_ms, trays))
        self._trays = trays

    def _report_operator_actions(self, now_ms: int, plc: Plc) -> None:
        """Report a mode change or a refused command."""
        machine, words = self._machine.tags.machine, plc.memory.D
        mode, refusals = words[machine.mode.number], words[machine.refusals.number]
        if mode != self._mode:
            if self._mode is not None or mode != Mode.CONTINUOUS:  # at power-up, a mode that was retained
                self._report(ModeEvent(now_ms, mode, MODES[mode]))
            self._mode = mode
        if refusals != self._refusals:
            self._refusals = refusals
            command = self._machine.tags.commands.numbered(plc.read(machine.refused))
            reason = Refusal(plc.read(machine.refusal))
            text = refusal_text(command, reason)
            self._report(RefusalEvent(now_ms, command.name, reason, text, self._line(plc)))

    def _state_event(self, now_ms: int, plc: Plc, state: int) -> StateEvent:
        reason = NO_TEXT
        if state in (State.SUSPENDING, State.SUSPENDED, *HOLDS):
            reason = REASONS[plc.read(self._machine.tags.machine.reason)]
        return StateEvent(now_ms, state, STATES[state], reason, self._line(plc))

    def _line(self, plc: Plc) -> Text:
        """Return the line that says what to do now; empty if no press is required."""
        return what_to_do(self._machine.tags, self._machine.alarms, plc.read) or NO_TEXT

    def _report_rows(self, now_ms: int, plc: Plc) -> None:
        """Report the rows released in this scan, one event for each arm."""
        for side, arm in self._machine.tags.arms.items():
            rows, before = plc.read(arm.cycles), self._rows.get(side)
            if before is not None and rows > before:
                self._report(RowEvent(now_ms, side, rows))
            self._rows[side] = rows

    def _report_line(self, now_ms: int, plc: Plc, *, told: bool) -> None:
        """Report a changed line, unless an event of this scan has told it."""
        machine = self._machine.tags.machine
        read = tuple(plc.read(word) for word in (machine.next_press, machine.mode, machine.first_out))
        if read == self._line_from:
            return
        before, self._line_from = self._told_line, read
        self._told_line = self._line(plc)
        if not told and self._told_line != before:
            self._report(NextPressEvent(now_ms, read[0], self._told_line))

    def _report_alarms(self, now_ms: int, plc: Plc) -> None:
        alarms = plc.annunciators()
        if alarms == self._alarms:
            return
        for number in sorted({*alarms} ^ {*self._alarms}):
            self._report(AlarmEvent(now_ms, number, number in alarms, self._alarm_text(number, plc)))
        self._alarms = alarms

    def _alarm_text(self, number: int, plc: Plc) -> Text:
        alarms = self._machine.alarms
        text = alarms.of(number).text.message
        if number == alarms.constants.number:
            text = warning_text(text, self._machine.tags.sp, plc.read)
        return text

    def _report_questions(self, now_ms: int, plc: Plc) -> None:
        relays = plc.memory.M
        questions = [name for name, number in self._asking if relays[number]]
        if questions == self._questions:
            return
        for name in sorted({*questions} ^ {*self._questions}):
            self._report(QuestionEvent(now_ms, name, name in questions, question_text(name)))
        self._questions = questions
