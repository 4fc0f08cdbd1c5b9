"""Several devices: served at the same time, lost and returned, poll groups."""

from __future__ import annotations

import json
import threading
from contextlib import ExitStack
from pathlib import Path

import pytest

from controller.io.connection import REOPEN_MS
from controller.io.link import OutputsTakenError
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
    own_wires,
    tcp,
    until_back_ms,
    wires,
)
from tests.controller.io.field.modules import Beckhoff, Box
from tests.controller.io.field.servers import TcpModule
from tests.real_time import WAIT_S
from tests.retained import retained
from tests.sampling import first_of, one_in
from tests.wiring import wired

BACK_MS = 500
"""Time from the return of a device to its use, ms (issue)."""
HALF = len(OUTPUT_TAGS) // 2
WATCHDOG = "watchdog_ms: 6000"
SILENCE_MS = 250
"""Time limit of a device that falls silent, ms: each attempt to reach it takes as long."""


class Field:
    """Sensors, left valves and right valves, each in a box of its own.

    The time limit of an answer is that of the devices of which one does not answer; the others may be late.
    """

    def __init__(
        self,
        stack: ExitStack,
        folder: Path,
        *,
        timeout_ms: int = PATIENT_MS,
        timed: tuple[int, ...] = (0, 1, 2),
        wait_ms: int = 0,
    ) -> None:
        self.boxes = [Box(), Box(), Box()]
        self.modules = [stack.enter_context(TcpModule(box)) for box in self.boxes]
        tags = (INPUT_TAGS, OUTPUT_TAGS[:HALF], OUTPUT_TAGS[HALF:])
        names = (("sensors", "inputs-only"), ("valves", "coils"), ("claws", "coils"))
        entries = [
            device(
                name, profile, tcp(module.port), wires(each), timeout_ms=timeout_ms if number in timed else PATIENT_MS
            )
            for number, ((name, profile), module, each) in enumerate(zip(names, self.modules, tags, strict=True))
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


@pytest.mark.parametrize("lost", one_in(2, [0, 1, 2]))
@pytest.mark.parametrize("way", ["unplugged", "silent"])
def test_a_lost_device_makes_the_outputs_of_all_devices_safe(
    lost: int, way: str, stack: ExitStack, tmp_path: Path
) -> None:
    """Latched and named; the other devices are written safe by the controller, the lost one by its own watchdog."""
    field = Field(stack, tmp_path, timeout_ms=PATIENT_MS if way == "unplugged" else SILENCE_MS, timed=(lost,))
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
    assert name in alarm.text.en
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
    rig = FieldRig(tmp_path / "field.yaml", [])
    stack.callback(rig.link.close)
    rig.start()
    field.modules[1].unplug()
    rig.scan(15)
    assert "valves" in rig.alarms[0].text.zh
    assert rig.alarms[0].text.zh.startswith("现场通信中断")
    assert rig.events[0].text.zh == f"现场设备 {rig.events[0].device} 通信中断，全部输出已切断"


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
    first = own_wires([*INPUT_TAGS, *OUTPUT_TAGS[:HALF]])
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


class Drive(Box):
    """Box with one holding register, the speed of a drive."""

    speed = 0

    def write(self, table: str, offset: int, value: int, client: object) -> None:
        self.speed = value


@pytest.mark.parametrize("way", ["exit", "loss", "other master"])
def test_a_register_is_made_safe_although_the_outputs_of_another_device_cannot_be_written(
    way: str, stack: ExitStack, tmp_path: Path
) -> None:
    plant, drive = stack.enter_context(Rig()), Drive()
    module = stack.enter_context(TcpModule(drive))
    tags = own_wires([*INPUT_TAGS, *OUTPUT_TAGS])
    path = file_of(
        tmp_path,
        device("plant", "coils", tcp(plant.server.port), tags),
        device("drive", "coils", tcp(module.port), "{planter_speed: 0}"),
    )
    rig = FieldRig(path, [], wired("planter_speed"))
    stack.callback(rig.link.close)
    rig.start()
    rig.link.write_registers([456])
    assert drive.speed == 456
    if way == "other master":
        rig.link.devices[0].line.close()
        plant.client().ask(ALL_OFF)
        rig.link.open()
        with pytest.raises(OutputsTakenError, match="plant"):
            rig.link.write_outputs(rig.io_map.safe_outputs())
    else:
        plant.thread.call(plant.server.end)
        if way == "exit":
            assert not rig.runtime.write_safe_outputs()
        else:
            rig.scan(12)
    assert drive.speed == 0


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


# ---- the command -----------------------------------------------------------------------------------------------


def next_event(controller: Process, **wanted: object) -> dict[str, object]:
    """Return the next event of the controller with these values."""
    while True:
        line = controller.next_line(WAIT_S)
        assert line is not None, f"the controller ended before {wanted}"
        event: dict[str, object] = json.loads(line)
        if wanted.items() <= event.items():
            return event


def test_the_command_with_two_devices(stack: ExitStack, tmp_path: Path) -> None:
    """A process on two devices: a device is unplugged and returns; the event and the alarm name it; clean end."""
    boxes = [Box(), Box()]
    at_rest(boxes[0])
    sensors, valves = (stack.enter_context(TcpModule(box)) for box in boxes)
    path = file_of(
        tmp_path,
        device("sensors", "inputs-only", tcp(sensors.port), wires(INPUT_TAGS), timeout_ms=PATIENT_MS),
        device("valves", "coils", tcp(valves.port), wires(OUTPUT_TAGS), WATCHDOG, timeout_ms=PATIENT_MS),
    )
    retain = retained(tmp_path / "retentive.json")
    options = ["--field", str(path), *retain, "--events", "json", "--no-hmi", "--link-limit-ms", "500"]
    controller = stack.enter_context(Process("controller", ["controller", "run", *options, "--simulated-time"]))
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


@pytest.mark.parametrize(
    ("lost", "code", "said"),
    first_of(
        [
            (1, 1, "stopped, outputs NOT written: no response from field I/O valves ({}); those of all other devices"),
            (0, 0, "stopped, outputs set to their safe levels; "),
        ]
    ),
    ids=["outputs", "inputs"],
)
def test_the_last_line_names_the_devices_that_were_not_written(
    lost: int, code: int, said: str, stack: ExitStack, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    boxes = (Box(), Box(), Box())
    modules = [stack.enter_context(TcpModule(box)) for box in boxes]
    tags = (INPUT_TAGS, OUTPUT_TAGS[:HALF], OUTPUT_TAGS[HALF:])
    names = (("sensors", "inputs-only"), ("valves", "coils"), ("claws", "coils"))
    entries = [
        device(*name, tcp(module.port), wires(each), *([] if each is INPUT_TAGS else [WATCHDOG]), timeout_ms=PATIENT_MS)
        for name, module, each in zip(names, modules, tags, strict=True)
    ]
    options = ["--field", str(file_of(tmp_path, *entries)), *retained(tmp_path / "retentive.json")]
    more = ["--events", "json", "--no-hmi", "--link-limit-ms", "500", "--simulated-time"]
    controller = stack.enter_context(Process("controller", ["controller", "run", *options, *more]))
    next_event(controller, event="state", state=int(State.STOPPED))
    modules[lost].unplug()
    next_event(controller, event="field", change="lost")
    assert controller.stop() == code
    assert said.format(f"127.0.0.1:{modules[lost].port}") in capfd.readouterr().err
