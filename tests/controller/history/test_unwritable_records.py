"""Records that can never be written: they do not block those behind them."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from controller.common.supervision.failures import dropped
from controller.events.kinds import QuestionEvent
from controller.history.file import MIN_LIMIT_BYTES, HistoryFile, HistoryRow, RecordError
from controller.program.texts.operator import Text
from tests.controller.common.supervision.failure_rig import fresh_counts
from tests.controller.history.history_rig import history, is_sound, table

POISONS = ["\ud800", 1 << 63, object(), "x" * MIN_LIMIT_BYTES, ("a", "b")]


@pytest.fixture(autouse=True)
def _counts(monkeypatch: pytest.MonkeyPatch) -> None:
    fresh_counts(monkeypatch)


@pytest.mark.parametrize("poison", POISONS, ids=lambda poison: type(poison).__name__)
@pytest.mark.parametrize("place", [0, 9])
def test_such_a_record_is_dropped_counted_and_told_once_and_the_others_are_written(
    place: int, poison: object, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "history.sqlite"
    with history(path, limit_bytes=MIN_LIMIT_BYTES) as writer:
        for number in range(10):
            text = Text(poison, poison) if number == place else Text.plain("text")  # type: ignore[arg-type]
            writer.write(QuestionEvent(number, "tray", active=True, text=text))
    *rows, lost = table(path, "events")
    assert [row["at_ms"] for row in rows] == [number for number in range(10) if number != place]
    assert (lost["kind"], lost["number"]) == ("history", 1)
    assert "a record of the table events can never be written" in str(lost["text"])
    assert (writer.dropped, dropped("history"), writer.error) == (1, 1, None)
    assert len([record for record in caplog.records if record.levelno >= logging.ERROR]) == 1
    assert is_sound(path)


def test_many_such_records_do_not_fill_the_log(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "history.sqlite"
    with history(path) as writer:
        for number in range(120):
            writer.write(
                QuestionEvent(number, "tray", active=True, text=Text.plain("\ud800" if number % 6 else "text"))
            )
    assert [row["at_ms"] for row in table(path, "events")][:-1] == [*range(0, 120, 6)]
    assert (writer.dropped, dropped("history")) == (100, 100)
    assert len(caplog.records) == 3


def test_the_largest_record_is_written(tmp_path: Path) -> None:
    """There is room for it even in a full file."""
    file = HistoryFile(tmp_path / "history.sqlite", MIN_LIMIT_BYTES)
    file.append([HistoryRow("runs", 0, 0, ("p", "v"))])
    filler = HistoryRow("events", 0, 0, ("question", 1, "x" * (file.batch_bytes - 100), ""))
    largest = HistoryRow("events", 0, 0, ("question", 1, "x" * (file.record_bytes - 64 - len("question")), ""))
    for row in [filler] * 70 + [largest] * 5:
        file.append([row])
    with pytest.raises(RecordError):
        file.append([largest._replace(values=("question", 1, "x" * file.record_bytes, ""))])
    file.close()
    assert table(tmp_path / "history.sqlite", "events")[-1]["text"] == largest.values[2]
