"""Production events: states, alarms, questions, rows, cycles, trays, modes, refusals and what to do now."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

from controller.program.tags import Side

GapCause = Literal["none", "tray", "centre", "row"]
"""Cause of missed cups: the arm waited for a tray or for the other arm to leave the centre, or the arm's own motion
took too long; "none" if no cups were missed."""


@dataclass(frozen=True, slots=True)
class StateEvent:
    """Entry into a PackML state.

    Attributes:
        at_ms: Time of the event, ms.
        state: PackML state number.
        text: Name of the state.
        reason: Reason if the state is Suspended or Held; else empty.
        next_press: Line that says what to do now; empty if no press is required.
    """

    at_ms: int
    state: int
    text: str
    reason: str = ""
    next_press: str = ""
    event: str = "state"


@dataclass(frozen=True, slots=True)
class AlarmEvent:
    """Annunciator set or reset."""

    at_ms: int
    number: int
    active: bool
    text: str
    event: str = "alarm"


@dataclass(frozen=True, slots=True)
class QuestionEvent:
    """Operator question asked or answered."""

    at_ms: int
    question: str
    active: bool
    text: str
    event: str = "question"


@dataclass(frozen=True, slots=True)
class CycleEvent:
    """Times of a completed cycle of an arm: a row has been released into the cups, and the arm has returned home.

    Attributes:
        at_ms: End of the cycle, ms.
        side: Arm.
        row: Picked row, 1 to 3.
        cycle_ms: Time from leaving the feed position until the arm is back there, down and converged, ms.
        waiting_ms: Part of this time spent waiting for cups, including the release delay, ms.
        missed_cups: Number of cups missed by the arm since the last reset of the counts.
        gap_cause: Cause of the cups missed since the previous cycle.
    """

    at_ms: int
    side: Side
    row: int
    cycle_ms: int
    waiting_ms: int
    missed_cups: int
    gap_cause: GapCause = "none"
    event: str = "cycle"


@dataclass(frozen=True, slots=True)
class RowEvent:
    """Row of seedlings released over the cups: the one count of rows, whatever becomes of the rest of the cycle.

    Attributes:
        at_ms: Time of the release, ms.
        side: Arm.
        rows: Rows that the arm has released since the last reset of the counts.
    """

    at_ms: int
    side: Side
    rows: int
    event: str = "row"


@dataclass(frozen=True, slots=True)
class TrayEvent:
    """Tray emptied: its last row has been picked."""

    at_ms: int
    trays_done: int
    event: str = "tray"


@dataclass(frozen=True, slots=True)
class ModeEvent:
    """Change of the operating mode."""

    at_ms: int
    mode: int
    text: str
    event: str = "mode"


@dataclass(frozen=True, slots=True)
class RefusalEvent:
    """Refused command or press; it has no effect.

    Attributes:
        at_ms: Time of the event, ms.
        command: Name of the command.
        reason: Number of the reason.
        text: Command and reason.
        next_press: Line that says what to do now; empty if no press is required.
    """

    at_ms: int
    command: str
    reason: int
    text: str
    next_press: str = ""
    event: str = "refusal"


@dataclass(frozen=True, slots=True)
class NextPressEvent:
    """Change of the line that says what to do now, within a state.

    Attributes:
        at_ms: Time of the event, ms.
        press: Number of the next useful press.
        text: The line; empty if no press is required.
    """

    at_ms: int
    press: int
    text: str
    event: str = "next"


Event = (
    StateEvent
    | AlarmEvent
    | QuestionEvent
    | CycleEvent
    | RowEvent
    | TrayEvent
    | ModeEvent
    | RefusalEvent
    | NextPressEvent
)


def as_record(event: Event) -> dict[str, object]:
    """Return an event as a flat record for a file or a pipe."""
    return asdict(event)


def as_sentence(event: Event) -> str:
    """Return an event in words, without its time.

    Examples:
        >>> as_sentence(AlarmEvent(0, 911, True, "left arm not up after clamping"))
        'alarm S911 on: left arm not up after clamping'
        >>> as_sentence(StateEvent(0, 4, "Idle", next_press="press X0 to start"))
        'state Idle; now: press X0 to start'
    """
    match event:
        case StateEvent():
            reason = f", reason {event.reason}" if event.reason else ""
            return f"state {event.text}{reason}{_now(event.next_press)}"
        case AlarmEvent():
            return f"alarm S{event.number} {_level(event.active)}: {event.text}"
        case QuestionEvent():
            return f"question {'asked' if event.active else 'answered'}: {event.text}"
        case CycleEvent():
            missed = f", {event.missed_cups} cups missed ({event.gap_cause})" if event.missed_cups else ""
            times = f"{event.cycle_ms / 1000:.2f} s, of which {event.waiting_ms / 1000:.2f} s waiting for cups"
            return f"cycle of the {event.side} arm with row {event.row} completed in {times}{missed}"
        case RowEvent():
            return f"row {event.rows} of the {event.side} arm released over the cups"
        case TrayEvent():
            return f"tray {event.trays_done} emptied"
        case ModeEvent():
            return f"mode {event.text}"
        case RefusalEvent():
            return f"refused: {event.text}{_now(event.next_press)}"
        case NextPressEvent():
            return f"now: {event.text}" if event.text else "now: no press is required"


def _now(press: str) -> str:
    return f"; now: {press}" if press else ""


def _level(active: bool) -> str:
    return "on" if active else "off"
