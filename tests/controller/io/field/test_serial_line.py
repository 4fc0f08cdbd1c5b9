"""Field devices on serial lines."""

from __future__ import annotations

import errno
import termios
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from controller.io.link import LinkError
from controller.program.states import State
from tests.controller.io.field.field_rig import (
    INPUT_TAGS,
    OUTPUT_TAGS,
    FieldRig,
    at_rest,
    device,
    file_of,
    until_back_ms,
    wires,
)
from tests.controller.io.field.modules import Box
from tests.controller.io.field.servers import SerialModules, crc

BACK_MS = 500
"""Time from the return of a device to its use, ms (issue)."""


LINES = "lines:\n  - {name: bus, device: %s, baud: 115200, frame: 8N1}\n"


class Bus:
    """Sensors and valves as units 1 and 2 of one serial line."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self.boxes = {1: Box(), 2: Box()}
        self.line = stack.enter_context(SerialModules(str(folder / "tty"), self.boxes))
        path = file_of(
            folder,
            device("sensors", "inputs-only", "line: bus", wires(INPUT_TAGS), "unit: 1"),
            device("valves", "coils", "line: bus", wires(OUTPUT_TAGS), "unit: 2"),
            lines=LINES % self.line.path,
        )
        self.rig = FieldRig(path, [])
        stack.callback(self.rig.link.close)
        at_rest(self.boxes[1])

    @contextmanager
    def impatient(self) -> Iterator[None]:
        """Limit the wait for an answer to 200 ms while no valid one comes."""
        plans = {unit: unit.plan for unit in self.rig.link.devices}
        for unit, plan in plans.items():
            unit.plan = replace(plan, timeout_ms=200)
        yield
        for unit, plan in plans.items():
            unit.plan = plan


READ_OF_THE_FIRST_INPUT = b"\x02\x00\x00\x00\x01"
"""Request that shows whether the adapter returns what is sent."""


def with_checksum(body: bytes) -> bytes:
    return body + crc(body)


def test_two_units_on_one_serial_line(stack: ExitStack, tmp_path: Path) -> None:
    bus = Bus(stack, tmp_path)
    bus.rig.start()
    bus.rig.move()
    assert any(bus.boxes[2].outputs)
    bus.rig.scan(10)
    assert (bus.rig.is_aborted, bus.rig.events) == (False, [])


def test_an_adapter_that_vanishes_while_it_is_opened_is_a_lost_device(
    stack: ExitStack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = Bus(stack, tmp_path)
    bus.rig.start()

    def flush(port: object) -> None:
        raise termios.error(errno.EIO, "Input/output error")

    bus.line.unplug()
    bus.line.plug()
    monkeypatch.setattr("serial.Serial._reset_input_buffer", flush)
    bus.rig.scan(15)
    assert bus.rig.is_aborted
    assert {event.change for event in bus.rig.events} == {"lost"}


def test_an_unplugged_serial_adapter_comes_back_by_itself(stack: ExitStack, tmp_path: Path) -> None:
    """The device file vanishes and returns, as with a USB adapter; both units are named."""
    bus = Bus(stack, tmp_path)
    rig = bus.rig
    rig.start()
    bus.line.unplug()
    rig.scan(20)
    assert rig.is_aborted
    assert {event.device.split()[0] for event in rig.events} == {"sensors", "valves"}
    rig.scan(50)
    bus.line.plug()
    assert until_back_ms(rig) <= BACK_MS
    rig.scan(50)
    assert rig.state == State.ABORTED
    rig.order("clear")
    rig.scan(3)
    assert rig.state == State.STOPPED


def test_a_late_serial_answer_is_not_the_answer_to_a_later_request(stack: ExitStack, tmp_path: Path) -> None:
    """An answer that arrives after its timeout is read before the echo, and not taken for a later one."""
    bus = Bus(stack, tmp_path)
    link, sensors = bus.rig.link, bus.boxes[1]
    link.open()
    old = link.read_inputs()
    held: list[bytes] = []

    def hold(frame: bytes) -> list[bytes]:
        held.append(frame)
        return []

    bus.line.alter = hold
    with bus.impatient(), pytest.raises(LinkError, match="no valid answer within 200 ms"):
        link.read_inputs()
    sensors.inputs[0] ^= True

    def release(frame: bytes) -> list[bytes]:
        late = [*held]
        held.clear()
        return [*late, frame]

    bus.line.alter = release
    link.open()
    assert link.read_inputs() != old


@pytest.mark.parametrize(
    "alter",
    [
        pytest.param(lambda frame: [bytes([frame[0] ^ 1]) + frame[1:]], id="other unit, wrong checksum"),
        pytest.param(lambda frame: [with_checksum(b"\x07" + frame[1:-2])], id="other unit"),
        pytest.param(lambda frame: [frame[:-1] + bytes([frame[-1] ^ 1])], id="wrong checksum"),
        pytest.param(lambda frame: [frame[:4] + bytes([frame[4] ^ 1]) + frame[5:]], id="inverted bit"),
        pytest.param(lambda frame: [frame[:-3]], id="short"),
        pytest.param(lambda frame: [b"\x55\xaa\x13"], id="garbage"),
        pytest.param(
            lambda frame: [frame[:1] + b"\x01" + frame[2:-2] + crc(frame[:1] + b"\x01" + frame[2:-2])], id="fn"
        ),
    ],
)
def test_an_invalid_serial_answer_is_an_error(alter: object, stack: ExitStack, tmp_path: Path) -> None:
    bus = Bus(stack, tmp_path)
    link = bus.rig.link
    link.open()
    bus.line.alter = alter  # type: ignore[assignment]
    with bus.impatient(), pytest.raises(LinkError, match="sensors"):
        link.read_inputs()
    bus.line.alter = lambda frame: [frame]
    link.open()
    assert link.read_inputs()


def test_noise_before_a_serial_answer_is_skipped(stack: ExitStack, tmp_path: Path) -> None:
    bus = Bus(stack, tmp_path)
    bus.rig.link.open()
    bus.line.alter = lambda frame: [b"\x00\xff\x55" + frame]
    assert bus.rig.link.read_inputs()


def test_a_device_without_an_echo_is_used_with_a_quiet_time(stack: ExitStack, tmp_path: Path) -> None:
    box = Box()
    at_rest(box)
    line = stack.enter_context(SerialModules(str(tmp_path / "tty"), {1: box}))
    tags = wires(INPUT_TAGS)[:-1] + ", " + wires(OUTPUT_TAGS)[1:]
    entry = device("cabinet", "coils", "line: bus", tags, "echo: false")
    rig = FieldRig(file_of(tmp_path, entry, lines=LINES % line.path), [])
    stack.callback(rig.link.close)
    rig.link.open()
    assert box.requests == [READ_OF_THE_FIRST_INPUT]
    assert rig.link.read_inputs()


def as_sent(frame: bytes) -> bytes:
    return frame


def settings_of(bus: Bus) -> list[object]:
    """Open the link, move the machine for some scans, and return what the valves have received."""
    bus.rig.start()
    bus.rig.move()
    return list(bus.boxes[2].outputs)


def test_an_adapter_that_returns_what_is_sent_is_named_once_and_changes_nothing(
    stack: ExitStack, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bus = Bus(stack, tmp_path)
    bus.line.returned = as_sent
    assert any(settings_of(bus))
    bus.rig.scan(10)
    bus.line.unplug()
    bus.rig.scan(20)
    bus.line.plug()
    until_back_ms(bus.rig)
    bus.rig.scan(10)
    assert {event.change for event in bus.rig.events} == {"lost", "back"}
    told = [record.getMessage() for record in caplog.records if "returns what is sent" in record.getMessage()]
    assert told == [f"{bus.line.path}: the adapter returns what is sent; the returned bytes are removed"]


def test_a_silent_device_behind_an_adapter_that_returns_what_is_sent_is_not_reachable(
    stack: ExitStack, tmp_path: Path
) -> None:
    """The request of the echo (function 8) comes back from the adapter, and the valves answer nothing."""
    bus = Bus(stack, tmp_path)
    bus.line.returned = as_sent
    del bus.boxes[2]
    with bus.impatient(), pytest.raises(LinkError, match=r"valves .*: no valid answer within 200 ms"):
        bus.rig.link.open()
    assert [device.is_open for device in bus.rig.link.devices] == [True, False]


def test_a_request_that_comes_back_damaged_is_a_failed_exchange(stack: ExitStack, tmp_path: Path) -> None:
    """The unit has received it perhaps as damaged as the adapter has."""
    bus = Bus(stack, tmp_path)
    bus.line.returned = as_sent
    link = bus.rig.link
    link.open()
    assert link.read_inputs()
    for damaged in (lambda frame: frame[:3] + bytes([frame[3] ^ 1]) + frame[4:], lambda frame: frame[:-1]):
        bus.line.returned = damaged
        with bus.impatient(), pytest.raises(LinkError, match="no valid answer within 200 ms"):
            link.read_inputs()
        bus.line.returned = as_sent
        link.open()
        assert link.read_inputs()


def test_an_adapter_that_is_replaced_while_the_line_is_open(stack: ExitStack, tmp_path: Path) -> None:
    """Behind a port that remains open; in both directions, the link is right again when it has been opened."""
    bus = Bus(stack, tmp_path)
    link = bus.rig.link
    for returned in (as_sent, lambda _frame: b"", as_sent):
        bus.line.returned = returned
        with bus.impatient():
            link.open()
            assert link.read_inputs()
            link.write_outputs(link.read_outputs())
