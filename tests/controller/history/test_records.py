"""Events, alarm changes and cycles of a history in one sequence, by time, kind, alarm and text."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.events.alarm_list import AlarmChange
from controller.events.alarm_states import AlarmState
from controller.events.kinds import CycleEvent, RefusalEvent, RowEvent, TrayEvent
from controller.history.query import HistoryReader, RecordFilter
from controller.program.texts.operator import Text
from tests.controller.history.history_rig import WALL_MS, history

CAME = AlarmChange(10, 905, "left.slide", AlarmState.NORMAL, AlarmState.UNACKNOWLEDGED, None, Text.plain("Left slide"))
SEEN = AlarmChange(
    30, 905, "left.slide", AlarmState.UNACKNOWLEDGED, AlarmState.ACKNOWLEDGED, "Li", Text.plain("Left slide")
)
WRITTEN = (
    TrayEvent(0, 1),
    CAME,
    RefusalEvent(20, "hold", 3, Text.plain("cannot hold: the machine is not running")),
    SEEN,
    CycleEvent(40, "right", 7, 5_200, 300, 1),
    RowEvent(50, "left", 905),
)
"""Records with the ids 2 to 7, of which the first has the time WALL_MS + 1."""


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> HistoryReader:
    path = tmp_path_factory.mktemp("records") / "history.sqlite"
    with history(path) as writer:
        for event in WRITTEN:
            writer.write(event)
        writer.audit("p", "w", "a", "1", "done", 60)
    return HistoryReader(path)


def ids(reader: HistoryReader, chosen: RecordFilter, last: int = 100, before_id: int | None = None) -> list[object]:
    return [row["id"] for row in reader.records(chosen, last, before_id)]


def test_all_records_are_in_the_order_of_their_ids_with_the_values_of_their_tables(reader: HistoryReader) -> None:
    row, cycle, seen, refusal, came, tray = reader.records(RecordFilter())
    assert [record["id"] for record in (row, cycle, seen, refusal, came, tray)] == [7, 6, 5, 4, 3, 2]
    assert (row["kind"], row["number"], row["detail"]) == ("row", 905, {"side": "left"})
    assert (cycle["kind"], cycle["number"], cycle["side"]) == ("cycle", 7, "right")
    assert (cycle["cycle_ms"], cycle["waiting_ms"], cycle["missed_cups"]) == (5_200, 300, 1)
    assert (seen["kind"], seen["number"], seen["text"]) == ("alarm", 905, "Left slide")
    assert (seen["before"], seen["after"], seen["by_whom"]) == ("unacknowledged", "acknowledged", "Li")
    assert (refusal["kind"], refusal["number"], refusal["detail"]) == ("refusal", 3, {"command": "hold"})
    assert came["by_whom"] is None
    assert (tray["kind"], tray["utc_ms"]) == ("tray", WALL_MS + 1)


@pytest.mark.parametrize(
    ("chosen", "expected"),
    [
        (RecordFilter(since_ms=WALL_MS + 3), [7, 6, 5, 4]),
        (RecordFilter(until_ms=WALL_MS + 3), [3, 2]),
        (RecordFilter(since_ms=WALL_MS + 2, until_ms=WALL_MS + 4), [4, 3]),
        (RecordFilter(kind="alarm"), [5, 3]),
        (RecordFilter(kind="cycle"), [6]),
        (RecordFilter(kind="refusal"), [4]),
        (RecordFilter(kind="other"), []),
        (RecordFilter(number=905), [5, 3]),
        (RecordFilter(number=7), []),
        (RecordFilter(text="SLIDE"), [5, 3]),
        (RecordFilter(text="cannot hold"), [4]),
        (RecordFilter(text="%"), []),
        (RecordFilter(kind="alarm", text="slide", since_ms=WALL_MS + 3), [5]),
    ],
)
def test_records_are_chosen_by_time_kind_alarm_and_text(
    chosen: RecordFilter, expected: list[int], reader: HistoryReader
) -> None:
    assert ids(reader, chosen) == expected


def test_records_are_read_page_by_page(reader: HistoryReader) -> None:
    assert ids(reader, RecordFilter(), last=4) == [7, 6, 5, 4]
    assert ids(reader, RecordFilter(), last=4, before_id=4) == [3, 2]
    assert ids(reader, RecordFilter(kind="alarm"), last=1, before_id=5) == [3]


def test_a_missing_history_has_no_records(tmp_path: Path) -> None:
    assert HistoryReader(tmp_path / "none.sqlite").records(RecordFilter()) == []
