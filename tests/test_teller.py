"""Events as lines: their two forms, their order, and a reader that has gone."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from controller.hmi.production import StateEvent, TrayEvent
from controller.hmi.teller import ServingEvent, Teller

EVENTS = (ServingEvent(0, 5021), StateEvent(10, 2, "Stopped"), TrayEvent(1_234, 1))
TEXT = (
    "        0 ms  serving  hmi_port=5021",
    "       10 ms  state    state=2  text=Stopped  reason=",
    "     1234 ms  tray     trays_done=1",
)


def lines(path: Path, form: str) -> list[str]:
    with path.open("w", encoding="utf-8") as out:
        teller = Teller(form, out)
        for event in EVENTS:
            teller.tell(event)
        teller.close()
    return path.read_text(encoding="utf-8").splitlines()


def test_text_is_a_line_an_event_in_the_order_told(tmp_path: Path) -> None:
    assert tuple(lines(tmp_path / "events", "text")) == TEXT


def test_json_is_an_object_a_line(tmp_path: Path) -> None:
    records = [json.loads(line) for line in lines(tmp_path / "events", "json")]
    assert [record["event"] for record in records] == ["serving", "state", "tray"]
    assert records[2] == {"at_ms": 1_234, "trays_done": 1, "event": "tray"}


@pytest.mark.parametrize("count", [1, 3])
def test_a_reader_that_has_gone_is_told_nothing_more_and_stops_nobody(count: int) -> None:
    """What was begun for it must not fail again when the output is closed."""
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w", encoding="utf-8") as out:
        teller = Teller("text", out)
        for event in EVENTS[:count]:
            teller.tell(event)
        teller.close()
