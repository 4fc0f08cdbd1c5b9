"""Records of the history: the table of an event, and the values of its columns."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Final

from controller.events.alarm_list import AlarmChange
from controller.events.cycle_edges import Edge
from controller.events.kinds import (
    CycleEvent,
    Event,
    ModeEvent,
    NextPressEvent,
    QuestionEvent,
    RefusalEvent,
    RowEvent,
    StateEvent,
    TrayEvent,
    as_record,
)
from controller.program.texts.operator import Language

LONGEST_TEXT: Final = 1_000
"""Maximum length of an external text, characters."""

EdgesOf = Callable[[CycleEvent], Sequence[Edge]]


def values_of(
    event: Event | AlarmChange, edges_of: EdgesOf, language: Language
) -> tuple[str, tuple[str | int | None, ...]]:
    """Return the table of an event and the values of the columns specific to that table, in one language."""
    number: int
    details: tuple[str, ...] = ()
    match event:
        case AlarmChange():
            by = None if event.by is None else external_text(event.by)
            return "alarms", (
                event.number,
                event.key,
                event.before.value,
                event.after.value,
                by,
                getattr(event.text, language),
                event.shelved_until_ms,
            )
        case CycleEvent():
            edges = json.dumps(edges_of(event), separators=(",", ":"))
            return "cycles", (
                event.side,
                event.row,
                event.cycle_ms,
                event.waiting_ms,
                event.missed_cups,
                event.gap_cause,
                edges,
            )
        case StateEvent():
            number, details = event.state, ("reason",)
        case RefusalEvent():
            number, details = event.reason, ("command",)
        case QuestionEvent():
            number, details = int(event.active), ("question", "active")
        case ModeEvent():
            number = event.mode
        case TrayEvent():
            number = event.trays_done
        case RowEvent():
            number, details = event.rows, ("side",)
        case NextPressEvent():
            number = event.press
        case _:
            raise TypeError(f"no history table for {event}")
    record = as_record(event, language)
    detail = {name: record[name] for name in details if record[name] != ""}
    return "events", (event.event, number, record.get("text", ""), json_text(detail))


def external_text(text: str) -> str:
    """Return an external text, truncated and made encodable as UTF-8."""
    return text[:LONGEST_TEXT].encode(errors="replace").decode()


def json_text(detail: dict[str, object]) -> str:
    """Return the JSON text of a detail."""
    return json.dumps(detail, ensure_ascii=False, separators=(",", ":"))
