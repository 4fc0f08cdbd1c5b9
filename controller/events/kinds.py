"""Production events: states, alarms, questions, rows, cycles, trays, modes, refusals and what to do now.

An event carries its texts in both languages; whoever writes it selects one.
"""

from __future__ import annotations

from dataclasses import Field, asdict, dataclass
from typing import Any, ClassVar, Literal, Protocol

from controller.program.tags import Side
from controller.program.texts.events import CAUSES, EVENTS
from controller.program.texts.operator import NO_TEXT, SIDES, Language, Text

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
    text: Text
    reason: Text = NO_TEXT
    next_press: Text = NO_TEXT
    event: str = "state"


@dataclass(frozen=True, slots=True)
class AlarmEvent:
    """Annunciator set or reset."""

    at_ms: int
    number: int
    active: bool
    text: Text
    event: str = "alarm"


@dataclass(frozen=True, slots=True)
class QuestionEvent:
    """Operator question asked or answered."""

    at_ms: int
    question: str
    active: bool
    text: Text
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
    text: Text
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
    text: Text
    next_press: Text = NO_TEXT
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
    text: Text
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


class EventRecord(Protocol):
    """Event that can be written as a record: a dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


def as_record(event: EventRecord, language: Language = "en") -> dict[str, Any]:
    """Return an event as a flat record for a file or a pipe, with its texts in one language."""
    return {
        name: getattr(value, language) if isinstance(value, Text) else value for name, value in asdict(event).items()
    }


def as_sentence(event: Event) -> Text:
    """Return an event in words, without its time.

    Examples:
        >>> as_sentence(AlarmEvent(0, 911, True, Text("left arm not up", "左臂未上升"))).en
        'alarm S911 on: left arm not up'
        >>> as_sentence(StateEvent(0, 4, Text("Idle", "待机"), next_press=Text("press X0 to start", "按 X0 启动"))).zh
        '状态 待机；下一步：按 X0 启动'
    """
    match event:
        case StateEvent():
            reason = EVENTS["reason"].filled(reason=event.reason) if event.reason.en else NO_TEXT
            return _joined(EVENTS["state"].filled(state=event.text), reason, _then(event.next_press))
        case AlarmEvent():
            key = "alarm_on" if event.active else "alarm_off"
            return EVENTS[key].filled(number=Text.plain(f"S{event.number}"), message=event.text)
        case QuestionEvent():
            return EVENTS["asked" if event.active else "answered"].filled(message=event.text)
        case CycleEvent():
            return _joined(_cycle(event), _missed(event))
        case RowEvent():
            return EVENTS["row"].filled(row=Text.plain(event.rows), side=SIDES[event.side])
        case TrayEvent():
            return EVENTS["tray"].filled(number=Text.plain(event.trays_done))
        case ModeEvent():
            return EVENTS["mode"].filled(mode=event.text)
        case RefusalEvent():
            return _joined(EVENTS["refused"].filled(message=event.text), _then(event.next_press))
        case NextPressEvent():
            return EVENTS["now"].filled(press=event.text) if event.text.en else EVENTS["nothing"]


def _cycle(event: CycleEvent) -> Text:
    cycle, waiting = (Text.plain(f"{time_ms / 1000:.2f}") for time_ms in (event.cycle_ms, event.waiting_ms))
    return EVENTS["cycle"].filled(side=SIDES[event.side], row=Text.plain(event.row), cycle=cycle, waiting=waiting)


def _missed(event: CycleEvent) -> Text:
    if event.gap_cause == "none":
        return NO_TEXT
    return EVENTS["missed"].filled(count=Text.plain(event.missed_cups), cause=CAUSES[event.gap_cause])


def _then(press: Text) -> Text:
    return _joined(EVENTS["then"], EVENTS["now"].filled(press=press)) if press.en else NO_TEXT


def _joined(*parts: Text) -> Text:
    return Text("".join(part.en for part in parts), "".join(part.zh for part in parts))
