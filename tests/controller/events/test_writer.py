"""Event output: text and JSON formats, order, and a closed pipe."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from controller.events.kinds import StateEvent, TrayEvent
from controller.events.writer import EventWriter, ServingEvent
from controller.program.texts.operator import Language, Text

STOPPED = StateEvent(10, 2, Text("Stopped", "已停止"), next_press=Text("press X0 to reset and home", "按 X0 复位"))
EVENTS = (
    ServingEvent(0, 5021),
    STOPPED,
    TrayEvent(1_234, 1),
)
TEXT = (
    "        0 ms  serving  hmi_port=5021",
    "       10 ms  state    state=2  text=Stopped  reason=  next_press=press X0 to reset and home",
    "     1234 ms  tray     trays_done=1",
)


def lines(path: Path, form: str, language: Language = "en") -> list[str]:
    with path.open("w", encoding="utf-8") as out:
        writer = EventWriter(form, out, language)
        for event in EVENTS:
            writer.write(event)
        writer.close()
    return path.read_text(encoding="utf-8").splitlines()


def test_text_output_is_one_line_per_event_in_order(tmp_path: Path) -> None:
    assert tuple(lines(tmp_path / "events", "text")) == TEXT


def test_json_output_is_one_object_per_line(tmp_path: Path) -> None:
    records = [json.loads(line) for line in lines(tmp_path / "events", "json")]
    assert [record["event"] for record in records] == ["serving", "state", "tray"]
    assert records[2] == {"at_ms": 1_234, "trays_done": 1, "event": "tray"}


def test_texts_are_written_in_the_selected_language(tmp_path: Path) -> None:
    record = json.loads(lines(tmp_path / "events", "json", "zh")[1])
    assert (record["text"], record["reason"], record["next_press"]) == ("已停止", "", "按 X0 复位")
    assert "text=已停止  reason=  next_press=按 X0 复位" in lines(tmp_path / "events", "text", "zh")[1]


@pytest.mark.parametrize("count", [1, 3])
def test_a_closed_pipe_is_not_an_error(count: int) -> None:
    """If the reader has closed the pipe, closing an output with buffered text raises no error."""
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w", encoding="utf-8") as out:
        writer = EventWriter("text", out)
        for event in EVENTS[:count]:
            writer.write(event)
        writer.close()
