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
    own_wires,
    tcp,
    until_back_ms,
    wires,
)
from tests.controller.io.field.modules import Box
from tests.controller.io.field.servers import TcpModule

ANSWER_S = 0.028
"""Time of an answer, shorter than the default of `timeout_ms`: no answer is missing."""
TIMEOUT_MS = 1_000
"""Timeout of the device that is lost, ms; one is waited for, and a busy computer answers within it."""
LINK_LOST = 901
LATE_MS = 200
"""Delay of a scan that exceeds the limit of the link, ms."""


class TwoModules:
    """Two devices on one line, and the totals of their answers."""

    def __init__(self) -> None:
        self.totals = {"one": (7, 5.0), "two": (0, 0.0)}
        self.times = ResponseTimes(SCAN_MS)
        self.scan(None, None)

    def scan(self, one_ms: float | None, two_ms: float | None, count: int = 1) -> dict[str, str]:
        """Scan with the times of the answers of each device; None = it does not answer."""
        for _ in range(count):
            for label, time_ms in (("one", one_ms), ("two", two_ms)):
                if time_ms is not None:
                    answers, total_s = self.totals[label]
                    self.totals[label] = answers + 2, total_s + time_ms / 1_000
            self.times.update((label, "the line", *total) for label, total in self.totals.items())
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


def test_a_slow_device_is_in_time_again_only_when_it_has_answered_in_time() -> None:
    """Lost, it takes no time at all; that is no answer in time."""
    line = TwoModules()
    assert set(line.scan(2.0, 28.0, SCANS)) == {"two"}
    assert set(line.scan(2.0, None, 10 * SCANS)) == {"two"}
    assert set(line.scan(None, None, 10 * SCANS)) == {"two"}
    assert set(line.scan(2.0, 1.0, SCANS - 1)) == {"two"}
    assert line.scan(2.0, 1.0) == {}


def test_a_device_that_is_polled_too_seldom_to_make_many_scans_late_is_not_slow() -> None:
    line = TwoModules()
    for _ in range(2 * SCANS):
        line.scan(2.0, 28.0)
        assert line.scan(2.0, None) == {}


def test_a_second_slow_device_is_named_and_the_first_one_cleared_when_it_is_in_time() -> None:
    line = TwoModules()
    assert set(line.scan(2.0, 28.0, SCANS)) == {"two"}
    assert set(line.scan(90.0, 28.0, SCANS)) == {"one", "two"}
    assert set(line.scan(90.0, SCAN_MS / 2 + 0.1, 2 * SCANS)) == {"one", "two"}, "more than its share of the period"
    assert set(line.scan(90.0, SCAN_MS / 2 - 0.1, SCANS)) == {"one"}
    assert line.scan(1.0, 1.0, SCANS) == {}


def test_lines_are_judged_separately() -> None:
    times = ResponseTimes(SCAN_MS)
    for scan in range(SCANS + 1):
        times.update(
            [("one", "a", scan, 0.009 * scan), ("two", "b", scan, 0.012 * scan), ("three", "c", scan, 0.003 * scan)]
        )
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
    assert (event.change, event.text.en) == ("slow", f"field device {event.device} answers too slowly; scans are late")
    assert event.device.startswith("valves (")
    figure = float(event.detail.removeprefix("a scan waits ").split(" ms")[0])
    assert figure >= 1_000 * ANSWER_S
    assert "and its period is 10 ms; use a faster device" in event.detail
    slow.now_ms += LATE_MS
    slow.scan(2)
    (named,) = (alarm.text.en.partition(": ")[2] for alarm in slow.alarms if alarm.number == LINK_LOST)
    assert named == event.device


def test_a_slow_device_that_is_lost_is_not_in_time_again(tmp_path: Path) -> None:
    """Its timeout is no answer, and a scan without it is none in time; after its return it answers as slowly."""
    box = Box()
    tags = own_wires([*INPUT_TAGS, *OUTPUT_TAGS])
    with ExitStack() as stack:
        module = stack.enter_context(TcpModule(box))
        path = file_of(tmp_path, device("all", "coils", tcp(module.port), tags, timeout_ms=TIMEOUT_MS))
        rig = FieldRig(path, [box], scan_ms=SCAN_MS)
        stack.callback(rig.link.close)
        rig.start()
        box.before_answer = lambda _: [Signal().wait(ANSWER_S)].clear()
        rig.scan(SCANS + 1)
        answered = rig.link.waits
        box.silent = True
        rig.scan()
        assert rig.link.lost
        assert rig.link.waits == answered
        module.unplug()
        rig.scan(2 * SCANS)
        assert [event.change for event in rig.events] == ["slow", "lost"]
        box.silent = False
        module.plug()
        until_back_ms(rig)
        rig.scan(SCANS)
        assert [event.change for event in rig.events] == ["slow", "lost", "back"]
