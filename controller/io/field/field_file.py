"""Reader of a field file, which assigns every wire of the I/O map to a device and a place in it.

An invalid file is rejected with a one-line message that contains the file, the line, the key, the problem and the
remedy.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.common.errors import InputError
from controller.common.files.trust import secret_exposure
from controller.common.modbus.client_requests import WORD_TABLES
from controller.common.modbus.io_map import IoMap, ModbusTable, OutputRegister, Point
from controller.common.modbus.rtu import SerialLine
from controller.common.suggestion import suggestion
from controller.common.yaml_lines import KeyPath, LocatedMapping, read_yaml, unfold
from controller.common.yaml_model import validated
from controller.io.field.profiles import profiles
from controller.io.field.schema import DeviceEntry, FieldEntry, LineEntry, ModuleTraits, TcpEntry, TlsEntry

_DEPTH: Final = 6
_POINTS_A_REGISTER: Final = 16
_LAST_OFFSET: Final = 65_535
SLOW_WIRES: Final = frozenset(
    {"air_pressure_ok", "magazine_empty", "horn", "lamp_red", "lamp_amber", "lamp_green", "planter_speed"}
)
"""Wires that may be exchanged every n-th scan: no motion and no count waits for them."""
LineSettings = TcpEntry | SerialLine
"""Settings of a connection, with TLS if it is a `TlsEntry`, or of a serial line."""


class FieldFileError(InputError):
    """Raised for an invalid field file; the message is one line with file, line, key, problem and remedy."""


@dataclass(frozen=True)
class DevicePlan:
    """Device of the field with its wires.

    Attributes:
        name: Name for messages; empty if there is only one device, given by its address.
        line: Settings of its line; devices with equal settings share the line.
        unit: Unit identifier.
        timeout_ms: Timeout of an answer, ms.
        traits: Properties of the module.
        inputs: X number and offset of each input.
        outputs: Y number and offset of each output.
        registers: D number and offset of each output register.
        poll_every: Number of scans from one exchange to the next.
        watchdog_ms: Time of the output watchdog of the module, ms; None = not stated.
        echo: True if an RTU device answers function 8, be it with an exception.
        model: Values with which the report of its model must begin.
        file_line: Line of the entry in the field file, from 1; 0 if there is none.
    """

    name: str
    line: LineSettings
    unit: int
    timeout_ms: int
    traits: ModuleTraits
    inputs: tuple[tuple[int, int], ...]
    outputs: tuple[tuple[int, int], ...]
    registers: tuple[tuple[int, int], ...]
    poll_every: int = 1
    watchdog_ms: int | None = None
    echo: bool = True
    model: tuple[int, ...] = ()
    file_line: int = 0

    @property
    def drives(self) -> bool:
        """True if the device has outputs or output registers."""
        return bool(self.outputs or self.registers)


@dataclass(frozen=True)
class FieldPlan:
    """Devices of the field.

    Attributes:
        devices: Devices, in the order of the file.
        path: Path of the file; None if there is none.
    """

    devices: tuple[DevicePlan, ...]
    path: Path | None = None

    @property
    def wait_ms(self) -> int:
        """Longest time that a scan waits for a device that does not respond, ms; times on a serial line are added."""
        times: dict[LineSettings, int] = {}
        for device in self.devices:
            before = times.get(device.line, 0)
            is_serial = isinstance(device.line, SerialLine)
            times[device.line] = before + device.timeout_ms if is_serial else max(before, device.timeout_ms)
        return max(times.values())


def one_device(
    io_map: IoMap,
    host: str,
    port: int,
    *,
    unit: int,
    timeout_ms: int,
    profile: str = "coils",
    watchdog_ms: int | None = None,
) -> FieldPlan:
    """Return the plan of one device that has all points at the offsets of the I/O map.

    Args:
        io_map: I/O map.
        host: Name or address of the device.
        port: TCP port.
        unit: Unit identifier.
        timeout_ms: Timeout of an answer, ms.
        profile: Profile whose points are bits.
        watchdog_ms: Time of the output watchdog of the device, ms; None = not stated.
    """
    device = DevicePlan(
        name="",
        line=TcpEntry.model_construct(host=host, port=port),
        unit=unit,
        timeout_ms=timeout_ms,
        traits=profiles()[profile],
        inputs=tuple((point.number, point.offset) for point in io_map.inputs),
        outputs=tuple((point.number, point.offset) for point in io_map.outputs),
        registers=tuple((register.number, register.offset) for register in io_map.registers),
        watchdog_ms=watchdog_ms,
    )
    return FieldPlan((device,))


def load_field(path: Path, io_map: IoMap) -> FieldPlan:
    """Read and check a field file.

    Args:
        path: Path of the file.
        io_map: I/O map, whose wired points must each have a place.

    Raises:
        FieldFileError: The file cannot be read or is invalid; the fault with the lowest line is reported.
    """
    located = unfold(read_yaml(path, FieldFileError), _DEPTH)
    entry = validated(FieldEntry, located)
    plan = None if entry is None or located.faults else _FieldReader(path, io_map, located, entry).plan()
    if plan is None:
        raise FieldFileError(f"{path}:{min(located.faults, key=lambda fault: fault.line)}")
    return plan


class _FieldReader:
    """Checks of one file that concern several entries or the I/O map."""

    def __init__(self, path: Path, io_map: IoMap, located: LocatedMapping, entry: FieldEntry) -> None:
        self._path = path
        self._entry = entry
        self._located = located
        points: tuple[Point | OutputRegister, ...] = (*io_map.inputs, *io_map.outputs, *io_map.registers)
        unwired: tuple[Point | OutputRegister, ...] = (*io_map.unwired, *io_map.unwired_registers)
        self._wires = {each.tag: each for each in points}
        self._unwired = {each.tag for each in unwired}
        self._map_path = io_map.path
        self._lines: dict[str, SerialLine] = {}
        self._assigned: dict[object, tuple[int, str]] = {}  # line and name of the first user of a name, wire or place

    def plan(self) -> FieldPlan | None:
        """Return the plan; None if a fault has been recorded."""
        for index, line in enumerate(self._entry.lines):
            self._read_line(index, line)
        devices = [self._read_device(index, device) for index, device in enumerate(self._entry.devices)]
        missing = [tag for tag in self._wires if ("wire", tag) not in self._assigned]
        if missing and not self._located.faults:
            self._fault(("devices",), f"missing {', '.join(missing)}; assign each wire to a device")
        if self._located.faults:
            return None
        return FieldPlan(tuple(device for device in devices if device is not None), self._path)

    def _fault(self, path: KeyPath, text: str) -> None:
        self._located.add_fault(path, text)

    def _claim(self, key: object, path: KeyPath, what: str, remedy: str) -> None:
        """Record the user of a name, a wire or a place; report a fault if it has one."""
        line, name = self._assigned.setdefault(key, (self._located.line_of(path), str(path[-1])))
        if (line, name) != (self._located.line_of(path), str(path[-1])):
            self._fault(path, f"{what} is already used on line {line}; {remedy}")

    def _read_line(self, index: int, line: LineEntry) -> None:
        path = ("lines", index)
        self._claim(("line", line.name), (*path, "name"), line.name, "choose another name")
        remedy = "describe a serial line once, with one baud rate and frame, and name it in each device"
        self._claim(("file", line.device), (*path, "device"), line.device, remedy)
        self._lines[line.name] = SerialLine(line.device, line.baud, line.frame[1], int(line.frame[2]))

    def _read_device(self, index: int, device: DeviceEntry) -> DevicePlan | None:
        path = ("devices", index)
        self._claim(("device", device.name), (*path, "name"), device.name, "choose another name")
        line = self._line_of(path, device)
        known = profiles()
        if device.profile not in known:
            text = f"{device.profile!r} is no profile; {suggestion(device.profile, known)}"
            self._fault((*path, "profile"), text)
            return None
        traits = known[device.profile].merged(device)
        if line is None or not self._is_consistent(path, device, traits):
            return None
        wires = [(self._wires[tag], offset) for tag, offset in device.wires.items() if self._is_wire(path, tag, device)]
        places: dict[str, list[tuple[int, int]]] = {"X": [], "Y": [], "D": []}
        for point, offset in wires:
            places[point.device].append((point.number, offset))
        plan = DevicePlan(
            name=device.name,
            line=line,
            unit=device.unit,
            timeout_ms=device.timeout_ms,
            traits=traits,
            inputs=tuple(places["X"]),
            outputs=tuple(places["Y"]),
            registers=tuple(places["D"]),
            poll_every=device.poll_every,
            watchdog_ms=device.watchdog_ms,
            echo=device.echo,
            model=tuple(device.model),
            file_line=self._located.line_of(path),
        )
        for point, offset in wires:
            self._check_place((*path, "wires", point.tag), point, plan, offset)
        return plan

    def _line_of(self, path: KeyPath, device: DeviceEntry) -> LineSettings | None:
        ways = [name for name in ("tcp", "tls", "line") if getattr(device, name) is not None]
        if len(ways) != 1:
            self._fault(path, f"has {' and '.join(ways) or 'no tcp, tls or line'}; write one of tcp, tls, line")
            return None
        if device.tls is not None:
            return self._with_files((*path, "tls"), device.tls)
        if device.tcp is not None:
            return device.tcp
        if device.line not in self._lines:
            remedy = suggestion(str(device.line), self._lines, "describe it under lines")
            self._fault((*path, "line"), f"{device.line!r} is no serial line; {remedy}")
            return None
        if not 1 <= device.unit <= 247:
            self._fault((*path, "unit"), f"{device.unit} cannot be used on a serial line; write 1 to 247")
        return self._lines[device.line]

    def _with_files(self, path: KeyPath, tls: TlsEntry) -> TlsEntry:
        """Return the settings with paths of files that are relative to the field file."""
        files: dict[str, str] = {}
        for key in ("ca", "certificate", "key"):
            name = getattr(tls, key)
            if name is not None:
                files[key] = str(self._path.parent / name)
                if not Path(files[key]).is_file():
                    self._fault((*path, key), f"{name} is no file; write the path of a PEM file")
                elif key == "key" and (problem := secret_exposure(Path(files[key]))):
                    self._fault((*path, key), problem)
        if (tls.certificate is None) != (tls.key is None):
            self._fault(path, "has only one of certificate and key; write both or none")
        return tls.model_copy(update=files)

    def _is_consistent(self, path: KeyPath, device: DeviceEntry, traits: ModuleTraits) -> bool:
        before = len(self._located.faults)
        if traits.has_watchdog_setting and device.watchdog_ms is None:
            self._fault(
                path, f"watchdog_ms is missing; write the time of the output watchdog that {device.profile} sets"
            )
        if traits.watchdog == "set" and not traits.has_watchdog_setting:
            text = "no setting has watchdog_unit_ms; add it, or write watchdog: tool if the tool of the module sets it"
            self._fault((*path, "settings"), text)
        if device.watchdog_ms is not None and traits.watchdog == "none" and not traits.has_watchdog_setting:
            text = "the module has no output watchdog; delete the key, or write watchdog: tool if its tool sets one"
            self._fault((*path, "watchdog_ms"), text)
        units = [each.watchdog_unit_ms for each in traits.settings or () if each.watchdog_unit_ms is not None]
        if units and (device.watchdog_ms or 0) % units[0] != 0:
            self._fault(
                (*path, "watchdog_ms"), f"{device.watchdog_ms} is no multiple of {units[0]} ms; write a multiple"
            )
        if (traits.trip is None) != (not traits.reset):
            self._fault(path, "has only one of trip and reset; write both, see the manual of the module")
        if device.profile == "outputs-safe-mode" and traits.trip is None:
            self._fault(
                path, "trip and reset are missing; write the flag of the safe mode and the register that clears it"
            )
        if len(device.model) > (0 if traits.reports is None else traits.reports.count):
            text = f"the module reports {0 if traits.reports is None else traits.reports.count} registers of its model"
            self._fault((*path, "model"), f"{text}; delete values, or write reports: with the registers of the module")
        if device.reports is not None and len(device.reports.begins) > device.reports.count:
            text = f"has more values than count = {device.reports.count}; delete values, or correct count"
            self._fault((*path, "reports", "begins"), text)
        for number, setting in enumerate(device.settings or ()):
            if (setting.value is None) == (setting.watchdog_unit_ms is None):
                self._fault((*path, "settings", number), "write one of value and watchdog_unit_ms")
        if not device.wires:
            self._fault((*path, "wires"), "is empty; assign wires to the device or delete it")
        return len(self._located.faults) == before

    def _is_wire(self, path: KeyPath, tag: str, device: DeviceEntry) -> bool:
        place = (*path, "wires", tag)
        if tag in self._unwired and tag not in self._wires:
            self._fault(place, f"is not wired in {self._map_path}; write wired: true there or delete this line")
        elif tag not in self._wires:
            self._fault(place, f"is no wire of {self._map_path}; {suggestion(tag, self._wires, 'delete the line')}")
        elif device.poll_every > 1 and tag not in SLOW_WIRES:
            text = f"must be exchanged in every scan; move it to a device entry with poll_every: 1 ({device.name} has "
            self._fault(place, f"{text}{device.poll_every})")
        else:
            return True
        return False

    def _check_place(self, path: KeyPath, point: Point | OutputRegister, plan: DevicePlan, offset: int) -> None:
        """Check that a wire has one place, which is not in use."""
        self._claim(("wire", point.tag), path, point.tag, "delete one of the two lines")
        place = place_of(point.device, offset, plan.traits)
        if place is None:
            kind = "inputs" if point.device == "X" else "outputs"
            self._fault(path, f"device {plan.name} has no {kind}; move the wire to another device")
            return
        table, register, bit = place
        area = plan.traits.outputs if point.device == "Y" else None
        shift = 0 if area is None or area.read_back is None else area.read_back - area.first
        if max(register, register + shift) > _LAST_OFFSET:
            self._fault(path, f"{offset} is beyond the last register; write a smaller offset")
        endpoint = (plan.line.host, plan.line.port) if isinstance(plan.line, TcpEntry) else plan.line
        what = f"{table} {register}" if bit is None else f"{table} {register}, bit {bit}"
        self._claim((endpoint, plan.unit, table, register, bit), path, what, "choose a free one")
        if table in WORD_TABLES:
            self._check_word((endpoint, plan.unit, table, register), path, plan.name if bit is not None else point.tag)

    def _check_word(self, key: object, path: KeyPath, user: str) -> None:
        """Check that a packed register is neither an output register nor shared by two device entries."""
        line, owner = self._assigned.setdefault(key, (self._located.line_of(path), user))
        if owner != user:
            self._fault(path, f"is in a register that is already used on line {line}; choose another register")


def place_of(letter: str, offset: int, traits: ModuleTraits) -> tuple[ModbusTable, int, int | None] | None:
    """Return table, offset and bit of a point; the bit is None in a table of bits, and for an output register.

    Args:
        letter: X, Y or D.
        offset: Offset of the wire in the field file.
        traits: Properties of the module.

    Returns:
        The place; None if the module has no such points.
    """
    if letter == "D":
        return ModbusTable.HOLDING_REGISTER, offset, None
    area = traits.inputs if letter == "X" else traits.outputs
    if area is None:
        return None
    table = ModbusTable(area.table)
    if table not in WORD_TABLES:
        return table, area.first + offset, None
    register, bit = divmod(offset, _POINTS_A_REGISTER)
    if traits.byte_order == "high_first":
        bit ^= 8
    if traits.bit_order == "high_first":
        bit ^= 7
    return table, area.first + register, bit
