"""Devices of the field I/O whose answers take longer than a scan period."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from threading import Event as Signal

import pytest

from controller.events.response_times import SCANS, ResponseTimes
from tests.controller.io.field.field_rig import (
    INPUT_TAGS,
    OUTPUT_TAGS,
    SCAN_MS,
    FieldRig,
    at_rest,
    device,
    file_of,
    tcp,
    wires,
)
from tests.controller.io.field.modules import Box
from tests.controller.io.field.servers import TcpModule

ANSWER_S = 0.028
"""Time of an answer, shorter than the default of `timeout_ms`: no answer is missing."""
LINK_LOST = 901
LATE_MS = 200
"""Delay of a scan that exceeds the limit of the link, ms."""


class TwoModules:
    """Two devices on one line, and the totals of their answers."""

    def __init__(self) -> None:
        self.total_s = {"one": 5.0, "two": 0.0}
        self.times = ResponseTimes(SCAN_MS)
        self.scan(0.0, 0.0)

    def scan(self, one_ms: float, two_ms: float, count: int = 1) -> dict[str, str]:
        for _ in range(count):
            self.total_s["one"] += one_ms / 1_000
            self.total_s["two"] += two_ms / 1_000
            self.times.update((label, "the line", total_s) for label, total_s in self.total_s.items())
        return self.times.slow


def test_a_line_is_slow_after_as_many_late_scans_as_stated_and_names_the_slowest_device() -> None:
    """The devices of a line wait for each other: neither of them alone would be too slow."""
    line = TwoModules()
    assert line.scan(4.0, 7.0, SCANS - 1) == {}
    assert line.scan(6.0, 7.0) == {
        "two": "a scan waits 7.0 ms for its answers, those of all devices of its line 11.1 ms, and its period is 10 "
        "ms; use a faster device or line, poll it less often, or give a longer --scan-ms"
    }


def test_one_scan_in_time_begins_the_count_again_and_as_many_end_the_fault() -> None:
    line = TwoModules()
    line.scan(9.0, 9.0, SCANS - 1)
    assert line.scan(5.0, 5.0) == {}
    assert line.scan(9.0, 9.0, SCANS - 1) == {}
    assert line.scan(9.0, 9.5)["two"].startswith(
        "a scan waits 9.0 ms for its answers, those of all devices of its line 18.0"
    )
    assert set(line.scan(1.0, 1.0, SCANS - 1)) == {"two"}
    line.scan(90.0, 9.0)
    assert set(line.scan(1.0, 1.0, SCANS - 1)) == {"two"}
    assert line.scan(1.0, 1.0) == {}


def test_lines_are_judged_separately() -> None:
    times = ResponseTimes(SCAN_MS)
    for scan in range(SCANS + 1):
        times.update([("one", "a", 0.009 * scan), ("two", "b", 0.012 * scan), ("three", "c", 0.003 * scan)])
    assert set(times.slow) == {"two"}
    assert times.slow["two"].startswith("a scan waits 12.0 ms for its answers, and its period is 10 ms; ")


@pytest.fixture
def slow(tmp_path: Path) -> Iterator[FieldRig]:
    """Controller with inputs on one module and outputs on another, whose answers take `ANSWER_S`."""
    fast, late = Box(), Box()
    with ExitStack() as stack:
        first, second = (stack.enter_context(TcpModule(box)) for box in (fast, late))
        path = file_of(
            tmp_path,
            device("sensors", "inputs-only", tcp(first.port), wires(INPUT_TAGS)),
            device("valves", "coils", tcp(second.port), wires(OUTPUT_TAGS)),
        )
        rig = FieldRig(path, [fast, late], scan_ms=SCAN_MS)
        stack.callback(rig.link.close)
        at_rest(fast)
        rig.start()
        late.before_answer = lambda _: [Signal().wait(ANSWER_S)].clear()
        yield rig


def test_a_device_with_answers_of_28_ms_is_named_with_the_figure(slow: FieldRig) -> None:
    """The event names it, and so does the alarm of a link that is lost because the scans are late."""
    slow.scan(SCANS + 1)
    (event,) = slow.events
    assert (event.change, event.text) == ("slow", f"field device {event.device} answers too slowly; scans are late")
    assert event.device.startswith("valves (")
    figure = float(event.detail.removeprefix("a scan waits ").split(" ms")[0])
    assert figure >= 1_000 * ANSWER_S
    assert "and its period is 10 ms; use a faster device" in event.detail
    slow.now_ms += LATE_MS
    slow.scan(2)
    (named,) = (alarm.text.partition(": ")[2] for alarm in slow.alarms if alarm.number == LINK_LOST)
    assert named == event.device
