"""Program on a field file, scanned in simulated time, with simulated modules."""

from __future__ import annotations

from pathlib import Path

from controller.common.modbus.io_map import IoMap
from controller.core.retentive_store import MemoryStore
from controller.core.scan import Plc
from controller.events.alarm_list import AlarmChange
from controller.events.field_devices import FieldEvent, FieldReport
from controller.events.kinds import AlarmEvent, Event
from controller.events.production import ProductionLog
from controller.io.field.field_file import load_field
from controller.io.field.link import DevicesLink
from controller.io.output_guard import ModbusOutputGuard
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.states import State
from plant_sim.twin.commissioning import program_of
from tests.controller.common.modbus_rig import make_module
from tests.controller.io.field.modules import Box

IO_MAP = load_io_map(DEFAULT_IO_MAP)
INPUT_TAGS = [point.tag for point in IO_MAP.inputs]
OUTPUT_TAGS = [point.tag for point in IO_MAP.outputs]
SCAN_MS = 10
PATIENT_MS = 5_000
"""Timeout for expected responses, ms; long enough for a slow computer."""
_LEVELS = make_module().inputs()
AT_REST = [point.tag for point in IO_MAP.inputs if _LEVELS[point.number]]
"""Inputs that are on at a machine at rest."""


def wires(tags: list[str], first: int = 0) -> str:
    """Return the wires of a device, at consecutive offsets."""
    return "{" + ", ".join(f"{tag}: {first + n}" for n, tag in enumerate(tags)) + "}"


def own_wires(tags: list[str]) -> str:
    """Return the wires of a device, at the offsets of the I/O map."""
    return "{" + ", ".join(f"{tag}: {IO_MAP[tag].offset}" for tag in tags) + "}"


def device(name: str, profile: str, way: str, tags: str, *more: str, timeout_ms: int = PATIENT_MS) -> str:
    """Return the entry of a device."""
    lines = [f"name: {name}", f"profile: {profile}", way, f"timeout_ms: {timeout_ms}", *more, f"wires: {tags}"]
    return "  - " + "\n    ".join(lines) + "\n"


def tcp(port: int) -> str:
    return f"tcp: {{host: 127.0.0.1, port: {port}}}"


def file_of(folder: Path, *devices: str, lines: str = "") -> Path:
    path = folder / "field.yaml"
    path.write_text(lines + "devices:\n" + "".join(devices), encoding="utf-8")
    return path


class FieldRig:
    """Controller on the devices of a field file, and the boxes whose time passes with its scans.

    Attributes:
        events: Events of the field devices.
        alarms: Alarm events.
    """

    def __init__(
        self,
        path: Path,
        boxes: list[Box],
        io_map: IoMap = IO_MAP,
        wait_ms: int = 0,
        scan_ms: int | None = None,
    ) -> None:
        self.io_map = io_map
        self.boxes = boxes
        self.now_ms = 0
        self.link = DevicesLink(load_field(path, io_map), io_map, now_s=lambda: self.now_ms / 1_000)
        self.machine = program_of(io_map)
        self.plc = Plc(self.machine.program)
        self.guard = ModbusOutputGuard(self.link, every=5)
        self.runtime = Runtime(
            self.machine,
            self.plc,
            self.link,
            DirectRetentiveWriter(MemoryStore()),
            link_wait_ms=wait_ms,
            guard=self.guard,
            modules=self.link,
        )
        self.events: list[FieldEvent] = []
        self.alarms: list[AlarmEvent] = []
        report = FieldReport(self.link, self.machine, self.events.append, scan_ms=scan_ms)

        def publish(event: Event | AlarmChange) -> None:
            named = report.named(event)
            if isinstance(named, AlarmEvent) and named.active:
                self.alarms.append(named)

        self.runtime.observers += [report, ProductionLog(self.machine, publish)]

    def start(self) -> None:
        """Connect, as the command does, and scan once."""
        self.link.open()
        self.link.read_inputs()
        self.guard.identify()
        self.scan()

    def scan(self, count: int = 1) -> None:
        for _ in range(count):
            self.runtime.tick(self.now_ms)
            self.now_ms += SCAN_MS
            for box in self.boxes:
                box.advance(SCAN_MS)

    def order(self, command: str) -> None:
        self.runtime.order(command)
        self.scan()

    def move(self) -> None:
        """Reset a machine at rest, so that an output is on."""
        self.order("reset")
        for _ in range(300):
            if any(self.runtime.released):
                return
            self.scan()
        raise AssertionError("no output has been switched on")

    @property
    def state(self) -> int:
        return self.plc.read(self.machine.tags.machine.state)

    @property
    def is_aborted(self) -> bool:
        return self.state in (State.ABORTING, State.ABORTED)

    @property
    def taken(self) -> str:
        return self.runtime.ownership.taken


def at_rest(box: Box, tags: list[str] = INPUT_TAGS) -> None:
    """Set the inputs of a machine at rest, at consecutive offsets."""
    for number, tag in enumerate(tags):
        box.inputs[number] = tag in AT_REST


def until_back_ms(rig: FieldRig) -> int:
    """Scan until the link is not lost any more; return the time, ms."""
    before_ms = rig.now_ms
    while rig.runtime.link_lost:
        rig.scan()
    return rig.now_ms - before_ms
