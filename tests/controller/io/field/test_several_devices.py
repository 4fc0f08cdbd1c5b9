"""Several devices: served at the same time, lost and returned, poll groups, TLS and serial lines."""

from __future__ import annotations

import json
import socket
import ssl
import threading
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
import trustme

from controller.common.errors import InputError
from controller.io.connection import REOPEN_MS
from controller.io.link import LinkError, OutputsTakenError
from controller.program.states import State
from plant_sim.twin.process import Process
from tests.controller.common.modbus_rig import ALL_OFF, Rig
from tests.controller.io.field.field_rig import (
    INPUT_TAGS,
    IO_MAP,
    OUTPUT_TAGS,
    PATIENT_MS,
    SCAN_MS,
    FieldRig,
    at_rest,
    device,
    file_of,
    tcp,
    wires,
)
from tests.controller.io.field.modules import Beckhoff, Box, SerialModules, TcpModule, crc
from tests.wiring import wired

BACK_MS = 500
"""Time from the return of a device to its use, ms (issue)."""
HALF = len(OUTPUT_TAGS) // 2


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


class Field:
    """Sensors, left valves and right valves, each in a box of its own."""

    def __init__(self, stack: ExitStack, folder: Path, *, timeout_ms: int = PATIENT_MS, wait_ms: int = 0) -> None:
        self.boxes = [Box(), Box(), Box()]
        self.modules = [stack.enter_context(TcpModule(box)) for box in self.boxes]
        tags = (INPUT_TAGS, OUTPUT_TAGS[:HALF], OUTPUT_TAGS[HALF:])
        names = (("sensors", "inputs-only"), ("valves", "coils"), ("claws", "coils"))
        entries = [
            device(name, profile, tcp(module.port), wires(each), timeout_ms=timeout_ms)
            for (name, profile), module, each in zip(names, self.modules, tags, strict=True)
        ]
        self.rig = FieldRig(file_of(folder, *entries), list(self.boxes), wait_ms=wait_ms)
        stack.callback(self.rig.link.close)
        at_rest(self.boxes[0])

    def outputs(self) -> list[bool]:
        return self.boxes[1].outputs[:HALF] + self.boxes[2].outputs[: len(OUTPUT_TAGS) - HALF]


@pytest.fixture
def field(stack: ExitStack, tmp_path: Path) -> Field:
    field = Field(stack, tmp_path)
    field.rig.start()
    return field


def until_back_ms(rig: FieldRig) -> int:
    """Scan until the link is not lost any more; return the time, ms."""
    before_ms = rig.now_ms
    while rig.runtime.link_lost:
        rig.scan()
    return rig.now_ms - before_ms


def test_the_image_is_composed_of_the_devices(field: Field) -> None:
    link = field.rig.link
    for number, point in enumerate(IO_MAP.outputs):
        link.write_outputs([n == point.number for n in range(IO_MAP.output_count)])
        assert [n for n, level in enumerate(field.outputs()) if level] == [number]
    field.boxes[0].inputs[: len(INPUT_TAGS)] = [True] * len(INPUT_TAGS)
    assert all(link.read_inputs()[point.number] for point in IO_MAP.inputs)


def test_devices_on_different_connections_are_served_at_the_same_time(field: Field) -> None:
    """Each device answers only when the other one has its request; in turn, the exchange would never end."""
    meeting = threading.Barrier(2)

    def meet(pdu: bytes) -> None:
        if pdu[0] == 15:
            meeting.wait(timeout=PATIENT_MS / 1_000)

    for box in field.boxes[1:]:
        box.before_answer = meet
    field.rig.link.write_outputs([True] * IO_MAP.output_count)
    assert all(field.outputs())


def test_devices_are_prepared_at_the_same_time(stack: ExitStack, tmp_path: Path) -> None:
    """Two couplers with settings; a scan that connects them again waits for the slower one, not for both."""
    meeting = threading.Barrier(2)
    boxes = [Beckhoff(), Beckhoff()]
    modules = [stack.enter_context(TcpModule(box)) for box in boxes]
    tags = (INPUT_TAGS, OUTPUT_TAGS)
    entries = [
        device(name, "beckhoff-ek9000", tcp(module.port), wires(each), "watchdog_ms: 300")
        for name, module, each in zip("ab", modules, tags, strict=True)
    ]
    rig = FieldRig(file_of(tmp_path, *entries), [])
    stack.callback(rig.link.close)

    def meet(pdu: bytes) -> None:
        meeting.wait(timeout=PATIENT_MS / 1_000)

    for box in boxes:
        box.before_answer = meet
    rig.link.open()
    assert [box.write_lock for box in boxes] == [1, 1]


@pytest.mark.parametrize("lost", [0, 1, 2])
@pytest.mark.parametrize("way", ["unplugged", "silent"])
def test_a_lost_device_makes_the_outputs_of_all_devices_safe(
    lost: int, way: str, stack: ExitStack, tmp_path: Path
) -> None:
    """Latched and named; the other devices are written safe by the controller, the lost one by its own watchdog."""
    field = Field(stack, tmp_path, timeout_ms=PATIENT_MS if way == "unplugged" else 100)
    rig, name = field.rig, ("sensors", "valves", "claws")[lost]
    rig.start()
    rig.move()
    rig.runtime.link.write_outputs([True] * IO_MAP.output_count)  # no output is safe already
    rig.runtime.ownership.doubt()
    if way == "unplugged":
        field.modules[lost].unplug()
    else:
        field.boxes[lost].silent = True
    rig.scan(12)
    assert rig.is_aborted
    others = [box for n, box in enumerate(field.boxes) if n not in (0, lost)]
    assert not any(any(box.outputs) for box in others)
    (event,) = rig.events
    assert (event.change, event.device) == ("lost", f"{name} (127.0.0.1:{field.modules[lost].port})")
    (alarm,) = rig.alarms
    assert name in alarm.text
    assert rig.machine.alarms.of(alarm.number).key == "link_lost"
    field.boxes[lost].outputs = [False] * len(field.boxes[lost].outputs)
    field.boxes[lost].silent = False
    if way == "unplugged":
        field.modules[lost].plug()
    assert until_back_ms(rig) <= BACK_MS
    assert rig.events[-1].change == "back"
    rig.scan(200)
    assert rig.state == State.ABORTED
    assert not any(field.outputs())
    rig.order("clear")
    rig.scan(3)
    assert (rig.state, rig.taken) == (State.STOPPED, "")


def test_the_name_of_the_device_is_in_the_chinese_alarm(stack: ExitStack, tmp_path: Path) -> None:
    field = Field(stack, tmp_path)
    rig = FieldRig(tmp_path / "field.yaml", [], language="zh")
    stack.callback(rig.link.close)
    rig.start()
    field.modules[1].unplug()
    rig.scan(15)
    assert "valves" in rig.alarms[0].text
    assert rig.alarms[0].text.startswith("现场通信中断")
    assert rig.events[0].text == f"现场设备 {rig.events[0].device} 通信中断，全部输出已切断"


def test_two_lost_devices_are_both_named_and_return_in_turn(field: Field) -> None:
    rig = field.rig
    for module in field.modules[1:]:
        module.unplug()
    rig.scan(15)
    assert {event.device.split()[0] for event in rig.events} == {"valves", "claws"}
    field.modules[2].plug()
    rig.scan(2 * REOPEN_MS // SCAN_MS)
    assert rig.runtime.link_lost, "one device is still lost"
    assert rig.events[-1].device.startswith("claws")
    assert rig.events[-1].change == "back"
    field.modules[1].plug()
    rig.scan(2 * REOPEN_MS // SCAN_MS)
    assert not rig.runtime.link_lost


def test_a_short_interruption_is_bridged_and_not_reported(field: Field) -> None:
    rig = field.rig
    rig.move()
    before = field.outputs()
    field.modules[1].unplug()
    rig.scan(3)
    field.modules[1].plug()
    rig.scan(5)
    assert (rig.is_aborted, rig.events, rig.taken) == (False, [], "")
    assert any(before)


def test_a_device_that_boots_accepts_connections_before_it_answers(stack: ExitStack, tmp_path: Path) -> None:
    field = Field(stack, tmp_path, timeout_ms=100)
    rig = field.rig
    rig.start()
    field.modules[1].unplug()
    rig.scan(15)
    field.boxes[1].silent = True
    field.modules[1].plug()
    rig.scan(3 * REOPEN_MS // SCAN_MS)
    assert rig.runtime.link_lost
    field.boxes[1].silent = False
    assert until_back_ms(rig) <= BACK_MS


def test_the_safe_outputs_are_written_on_exit_although_a_device_is_lost(field: Field) -> None:
    rig = field.rig
    rig.link.write_outputs([True] * IO_MAP.output_count)
    field.modules[1].unplug()
    assert not rig.runtime.write_safe_outputs()
    assert not any(field.boxes[2].outputs)


def test_another_master_at_one_device_makes_all_devices_safe(field: Field) -> None:
    rig = field.rig
    rig.move()
    rig.scan(2)
    field.boxes[2].outputs[0] ^= True
    rig.scan()
    assert "changed by another master" in rig.taken
    assert not any(field.outputs())


def test_a_device_that_lends_its_outputs_to_another_master_makes_the_others_safe(
    stack: ExitStack, tmp_path: Path
) -> None:
    """The first half of the outputs is at the plant, which lends them; the second half is in a box."""
    plant = stack.enter_context(Rig())
    box = Box()
    module = stack.enter_context(TcpModule(box))
    first = wires(INPUT_TAGS)[:-1] + ", " + wires(OUTPUT_TAGS[:HALF])[1:]
    path = file_of(
        tmp_path,
        device("plant", "coils", tcp(plant.server.port), first),
        device("claws", "coils", tcp(module.port), wires(OUTPUT_TAGS[HALF:])),
    )
    rig = FieldRig(path, [])
    stack.callback(rig.link.close)
    rig.start()
    rig.link.write_outputs([True] * IO_MAP.output_count)
    assert any(box.outputs)
    rig.link.devices[0].line.close()
    plant.client().ask(ALL_OFF)
    rig.link.open()
    with pytest.raises(OutputsTakenError, match="plant"):
        rig.link.write_outputs([True] * IO_MAP.output_count)
    assert not any(box.outputs)


# ---- poll groups -----------------------------------------------------------------------------------------------


def test_a_slow_device_is_polled_in_every_nth_scan_and_made_safe_at_once(stack: ExitStack, tmp_path: Path) -> None:
    io_map = wired("air_pressure_ok", "lamp_red")
    fast, slow = Box(), Box()
    first, second = (stack.enter_context(TcpModule(box)) for box in (fast, slow))
    tags = wires(INPUT_TAGS)[:-1] + ", " + wires(OUTPUT_TAGS)[1:]
    path = file_of(
        tmp_path,
        device("machine", "coils", tcp(first.port), tags),
        device("lamps", "coils", tcp(second.port), "{air_pressure_ok: 3, lamp_red: 5}", "poll_every: 10"),
    )
    rig = FieldRig(path, [], io_map)
    stack.callback(rig.link.close)
    at_rest(fast)
    slow.inputs[3] = True
    rig.start()
    rig.scan(5)
    slow.requests.clear()
    rig.scan(40)
    assert [pdu[0] for pdu in slow.requests].count(2) == 4
    assert [pdu[0] for pdu in slow.requests].count(15) == 4
    point = io_map["lamp_red"]
    image = [number == point.number for number in range(io_map.output_count)]
    rig.link.write_outputs(image)
    assert slow.outputs[5], "a change is written in the same scan"
    rig.link.write_outputs(io_map.safe_outputs())
    assert not slow.outputs[5]


# ---- TLS -------------------------------------------------------------------------------------------------------


class Security:
    """Certificate authority and certificates of both sides."""

    def __init__(self, folder: Path) -> None:
        self.authority = trustme.CA()
        self.authority.cert_pem.write_to_path(folder / "ca.pem")
        client = self.authority.issue_cert("controller@farm.example")
        client.cert_chain_pems[0].write_to_path(folder / "own.pem")
        client.private_key_pem.write_to_path(folder / "own.key")
        self.context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        self.context.verify_mode = ssl.CERT_REQUIRED
        self.authority.configure_trust(self.context)
        self.authority.issue_cert("io.farm.example").configure_cert(self.context)

    def wrap(self, plain: socket.socket) -> socket.socket:
        return self.context.wrap_socket(plain, server_side=True)


def tls_way(port: int, *more: str) -> str:
    names = ["ca: ca.pem", "certificate: own.pem", "key: own.key", *more]
    return f"tls: {{host: 127.0.0.1, port: {port}, {', '.join(names)}}}"


def one_box(stack: ExitStack, folder: Path, way: str, timeout_ms: int = PATIENT_MS) -> FieldRig:
    tags = wires(INPUT_TAGS)[:-1] + ", " + wires(OUTPUT_TAGS)[1:]
    rig = FieldRig(file_of(folder, device("cabinet", "coils", way, tags, timeout_ms=timeout_ms)), [])
    stack.callback(rig.link.close)
    return rig


def test_a_device_with_tls(stack: ExitStack, tmp_path: Path) -> None:
    box = Box()
    at_rest(box)
    module = stack.enter_context(TcpModule(box, Security(tmp_path).wrap))
    rig = one_box(stack, tmp_path, tls_way(module.port, "server_name: io.farm.example"))
    rig.start()
    rig.move()
    assert any(box.outputs)
    rig.scan(20)
    assert (rig.is_aborted, rig.events) == (False, [])


def test_a_tls_handshake_longer_than_the_timeout_is_continued(stack: ExitStack, tmp_path: Path) -> None:
    """A small device computes for longer than the timeout of an answer; the scan must not wait for it."""
    security, go, connections = Security(tmp_path), threading.Event(), [0]
    box = Box()

    def wrap(plain: socket.socket) -> socket.socket:
        connections[0] += 1
        go.wait(PATIENT_MS / 1_000)
        return security.wrap(plain)

    module = stack.enter_context(TcpModule(box, wrap))
    way = tls_way(module.port, "server_name: io.farm.example")
    link = one_box(stack, tmp_path, way, timeout_ms=200).link
    for _ in range(2):
        with pytest.raises(LinkError, match="the TLS handshake is not complete"):
            link.open()
    go.set()
    for _ in range(100):
        with suppress(LinkError):
            link.open()
            break
    assert link.read_inputs()
    assert connections == [1]


def test_a_device_with_another_name_is_not_used(stack: ExitStack, tmp_path: Path) -> None:
    box = Box()
    module = stack.enter_context(TcpModule(box, Security(tmp_path).wrap))
    rig = one_box(stack, tmp_path, tls_way(module.port, "server_name: other.farm.example"))
    with pytest.raises(LinkError, match="cabinet"):
        rig.link.open()
    assert box.requests == []


def test_an_invalid_certificate_is_reported_at_the_start(stack: ExitStack, tmp_path: Path) -> None:
    Security(tmp_path)
    (tmp_path / "own.key").write_text("no key", encoding="utf-8")
    with pytest.raises(InputError, match=r"own\.key") as error:
        one_box(stack, tmp_path, tls_way(802))
    assert "\n" not in str(error.value)


# ---- serial lines ----------------------------------------------------------------------------------------------


LINES = "lines:\n  - {name: bus, device: %s, baud: 115200, frame: 8N1}\n"


class Bus:
    """Sensors and valves as units 1 and 2 of one serial line."""

    def __init__(self, stack: ExitStack, folder: Path, timeout_ms: int = PATIENT_MS) -> None:
        self.boxes = {1: Box(), 2: Box()}
        self.line = stack.enter_context(SerialModules(str(folder / "tty"), self.boxes))
        path = file_of(
            folder,
            device("sensors", "inputs-only", "line: bus", wires(INPUT_TAGS), "unit: 1", timeout_ms=timeout_ms),
            device("valves", "coils", "line: bus", wires(OUTPUT_TAGS), "unit: 2", timeout_ms=timeout_ms),
            lines=LINES % self.line.path,
        )
        self.rig = FieldRig(path, [])
        stack.callback(self.rig.link.close)
        at_rest(self.boxes[1])


def with_checksum(body: bytes) -> bytes:
    return body + crc(body)


def test_two_units_on_one_serial_line(stack: ExitStack, tmp_path: Path) -> None:
    bus = Bus(stack, tmp_path)
    bus.rig.start()
    bus.rig.move()
    assert any(bus.boxes[2].outputs)
    bus.rig.scan(10)
    assert (bus.rig.is_aborted, bus.rig.events) == (False, [])


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
    bus = Bus(stack, tmp_path, timeout_ms=200)
    link, sensors = bus.rig.link, bus.boxes[1]
    link.open()
    old = link.read_inputs()
    held: list[bytes] = []

    def hold(frame: bytes) -> list[bytes]:
        held.append(frame)
        return []

    bus.line.alter = hold
    with pytest.raises(LinkError, match="no valid answer within 200 ms"):
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
    bus = Bus(stack, tmp_path, timeout_ms=200)
    link = bus.rig.link
    link.open()
    bus.line.alter = alter  # type: ignore[assignment]
    with pytest.raises(LinkError, match="sensors"):
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
    assert box.requests == []
    assert rig.link.read_inputs()


# ---- the command -----------------------------------------------------------------------------------------------


def next_event(controller: Process, **wanted: object) -> dict[str, object]:
    """Return the next event of the controller with these values."""
    while True:
        line = controller.lines.get(timeout=60)
        assert line is not None, f"the controller ended before {wanted}"
        event: dict[str, object] = json.loads(line)
        if wanted.items() <= event.items():
            return event


def test_the_command_in_real_time(stack: ExitStack, tmp_path: Path) -> None:
    """A process on two devices: a device is unplugged and returns; the event and the alarm name it; clean end."""
    boxes = [Box(), Box()]
    at_rest(boxes[0])
    sensors, valves = (stack.enter_context(TcpModule(box)) for box in boxes)
    path = file_of(
        tmp_path,
        device("sensors", "inputs-only", tcp(sensors.port), wires(INPUT_TAGS), timeout_ms=200),
        device("valves", "coils", tcp(valves.port), wires(OUTPUT_TAGS), timeout_ms=200),
    )
    retain = str(tmp_path / "retentive.json")
    options = ["--field", str(path), "--retain", retain, "--events", "json", "--no-hmi", "--link-limit-ms", "500"]
    controller = stack.enter_context(Process("controller", ["controller", "run", *options]))
    next_event(controller, event="state", state=int(State.STOPPED))
    boxes[1].outputs = [True] * len(boxes[1].outputs)
    valves.unplug()
    name = f"valves (127.0.0.1:{valves.port})"
    assert next_event(controller, event="field")["device"] == name
    assert name in str(next_event(controller, event="alarm", active=True)["text"])
    valves.plug()
    assert next_event(controller, event="field", change="back")["device"] == name
    assert controller.stop() == 0
    assert not any(boxes[1].outputs[: len(OUTPUT_TAGS)])
