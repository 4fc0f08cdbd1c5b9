"""Packages in Structured Text, run by the test runner on the simulated plant."""

from __future__ import annotations

from codecs import BOM_UTF16_LE
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from xml.etree import ElementTree as Xml

from controller.cli.ladder.export import TARGETS
from controller.core.expr import Word
from controller.export.packages.package import Io, PackageSource
from controller.export.runtime_parts.part import SCAN_MS
from controller.fx.engine.plc import FxPlc
from controller.fx.language.instruction import Ladder
from controller.program.states import State
from plant_sim.links.io_module import IoModule
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.ladder.trial import INDICATORS
from plant_sim.twin.process import Process
from tests.controller.export.st_runner import StPlc, StProgram
from tests.controller.program.interlock_scene import MACHINE

LIMIT_S: Final = 60.0
NAMESPACE: Final = "{http://www.plcopen.org/xml/tc6_0200}"
MOVERS: Final = tuple(point.number for point in MACHINE.io_map.outputs if point.tag not in INDICATORS)
"""Numbers of the outputs that move the machine."""
FROM_ZERO: Final = (
    ("start", 12, State.HELD),
    ("stop", 250, State.STOPPED),
    ("start", 12, State.IDLE),
    ("start", 12, State.COMPLETE),
)
"""Presses of a trial that begins without memory: button, duration in scans, and the state at the end of which the next
press begins. X24 answers that there is no tray."""
UTC_S: Final = 1_700_000_000
"""UTC at the start of a test, s."""


@cache
def package(target: str, io: Io | None = None) -> Mapping[str, str]:
    """Return the files of a package by name."""
    return files_of(target, PackageSource(MACHINE.program, MACHINE.io_map, io=io))


def files_of(target: str, source: PackageSource) -> dict[str, str]:
    """Write a package; return its files by name."""
    with TemporaryDirectory() as folder:
        TARGETS[target](source, Path(folder))
        return files_in(Path(folder))


def files_in(folder: Path) -> dict[str, str]:
    """Return the files of a written package by name."""
    return {path.name: _text(path.read_bytes()) for path in folder.iterdir()}


def _text(content: bytes) -> str:
    return content.decode("utf-16" if content.startswith(BOM_UTF16_LE) else "utf-8")


@dataclass(frozen=True)
class Places:
    """Addresses of a target.

    Attributes:
        device_byte: First byte of inputs and outputs.
        register: Address of D0, without its number.
        alarms: Byte of S900.
        link_word: Address of the word that changes with every exchange; empty = none.
        by_offset: True if the outputs are in the order of their Modbus offsets, which begin at 0.
        storage: Area whose words the runtime stores, although they are not declared as retained; empty = none.
    """

    device_byte: int
    register: tuple[str, int]
    alarms: str
    link_word: str = ""
    by_offset: bool = False
    storage: str = ""


PLACES: Final = {
    "plain": Places(0, ("MW", 1000), "MX1212.4"),
    "openplc": Places(100, ("QW", 400), "QX300.0", "IW100", by_offset=True, storage="MW"),
    "codesys": Places(0, ("MW", 1000), "MX1212.4", "IW100"),
}


@cache
def program(target: str) -> StProgram:
    """Return the parsed program of a package."""
    return parsed_program(target, package(target))


def parsed_program(target: str, files: Mapping[str, str]) -> StProgram:
    """Return the parsed program of a package from its files by name."""
    return StProgram(text_of_xml(files["transplanter.xml"]) if target == "codesys" else files["transplanter.st"])


def text_of_xml(xml: str) -> str:
    """Return the PROGRAM of a PLCopen file, with the addresses that the documentation of its variables names."""
    project = Xml.fromstring(xml)  # noqa: S314 - written by the project
    lines: dict[bool, list[str]] = {False: [], True: []}
    for group in project.iter():
        if group.tag in (f"{NAMESPACE}localVars", f"{NAMESPACE}globalVars"):
            for variable in group:
                (kind,) = next(variable.iter(f"{NAMESPACE}type"))
                type_ = kind.get("name") or kind.tag.removeprefix(NAMESPACE)
                value = next((f" := {v.get('value')}" for v in variable.iter(f"{NAMESPACE}simpleValue")), "")
                text = "".join(variable.itertext())
                place = address_of(variable.get("name", ""), text)
                lines[group.get("persistent") == "true"].append(f"    {variable.get('name')}{place} : {type_}{value};")
    (statements,) = project.iter(f"{NAMESPACE}ST")
    (body,) = statements
    (pou,) = project.iter(f"{NAMESPACE}pou")
    sections = ["VAR", *lines[False], "END_VAR", "", "VAR RETAIN", *lines[True], "END_VAR"]
    return "\n".join([f"PROGRAM {pou.get('name')}", *sections, "", body.text or "", "", "END_PROGRAM", ""])


def address_of(name: str, documentation: str) -> str:
    """Return the address to which a test maps a variable of CODESYS."""
    if name == "link_word":
        return " AT %IW100"
    device = documentation.removeprefix("terminal ").partition(":")[0]
    kind, digits = device[:1], device[1:]
    if not digits.isdigit():
        return ""
    number = int(digits, 8) if kind in "XY" else int(digits)
    if kind == "X":
        return f" AT %IX{number // 8}.{number % 8}" if name.endswith("_terminal") else ""
    if kind == "Y":
        return f" AT %QX{number // 8}.{number % 8}"
    if kind == "S":
        return f" AT %MX{1100 + number // 8}.{number % 8}"
    return f" AT %MW{1000 + number}" if kind == "D" and number < 8000 else ""


@contextmanager
def plant_process(*options: str, seed: int, trays: int) -> Iterator[int]:
    """Serve a plant in another process; yield its port."""
    arguments = ["plant_sim", "serve", "--port", "0", "--seed", str(seed), "--trays", str(trays), *options]
    with Process("plant", arguments) as process:
        line = process.lines.get(timeout=LIMIT_S)
        assert line is not None, "the plant did not start"
        yield int(line.rpartition(":")[2])


class PackageRig:
    """Package on the plant, with clocks and a link that a test can disturb.

    Attributes:
        plc: PLC that runs the package.
        module: I/O module of the plant.
        clock_ms: Time of the runtime that a TON measures, ms.
        utc_ms: UTC of the runtime since the start, ms.
        late_us: Lateness that the runtime reports, us.
        link_ms: Word of the I/O device.
    """

    def __init__(self, target: str, plc: StPlc, *, seed: int = 1, trays: int = 2) -> None:
        """Connect a PLC that has never run to a plant; nothing is set."""
        self._places = PLACES[target]
        self.plc = plc
        self.module = IoModule(Plant(MACHINE.io_map, load_machine(), seed=seed, trays=trays), MACHINE.io_map)
        self.clock_ms = self.utc_ms = self.late_us = self.link_ms = 0

    def _register(self, number: int) -> str:
        area, first = self._places.register
        return f"{area}{first + number}"

    def read(self, word: Word) -> int:
        """Return the value of a register."""
        return self.plc.read(self._register(word.number))

    def write(self, word: Word, value: int) -> None:
        """Write a register."""
        self.plc.write(self._register(word.number), value)

    @property
    def state(self) -> State:
        """PackML state."""
        return State(self.read(MACHINE.tags.machine.state))

    def set_relay(self, place: str) -> None:
        """Set a command relay at the place that the README names: a coil, an address or a variable of a list."""
        kind, _, rest = place.partition(" ")
        if kind == "coil":
            self._set(f"QX{int(rest) // 8}.{int(rest) % 8}")
        elif place.startswith("%"):
            self._set(place.removeprefix("%"))
        else:
            name = f"v_{place.partition('.')[2]}"
            assert self.plc.values[name] is False
            self.plc.values[name] = True

    def _set(self, address: str) -> None:
        assert self.plc.read(address) == 0
        self.plc.write(address, 1)

    def is_in(self, state: State) -> bool:
        """Return whether the machine is in a PackML state."""
        return self.state is state

    def alarm(self, number: int) -> bool:
        """Return whether an alarm is on."""
        area, byte, bit = self._places.alarms[:2], *map(int, self._places.alarms[2:].split("."))
        position = byte * 8 + bit + number - 900
        return bool(self.plc.read(f"{area}{position // 8}.{position % 8}"))

    def power_cycle(self, *, memory_lost: bool = False) -> None:
        """Cycle the power; the memory is what the README of the package says that the runtime keeps, or none."""
        area = self._places.storage
        stored = self.plc.words(area) if area and not memory_lost else {}
        self.plc.power_cycle(memory_lost=memory_lost)
        for place, value in stored.items():
            if value:  # the runtime does not restore zeros
                self.plc.write(place, value)

    def outputs(self, levels: Sequence[bool]) -> list[bool]:
        """Run one scan with these inputs and return the outputs."""
        if self._places.link_word:
            self.plc.write(self._places.link_word, self.link_ms % 32_768)
        self.plc.write("ML1027", UTC_S + self.utc_ms // 1_000)
        self.plc.write("ML1029", self.late_us)
        coils, image = self.plc.scan(self.clock_ms, levels), MACHINE.io_map.safe_outputs()
        for point in MACHINE.io_map.outputs:
            image[point.number] = coils[point.offset if self._places.by_offset else point.number]
        return image

    def scan(self, *, clock_ms: int = SCAN_MS, utc_ms: int = SCAN_MS, link_ms: int = SCAN_MS) -> list[bool]:
        """Run one scan, advance the plant by one period and the clocks by the given times; return the outputs."""
        image = self.outputs(self.module.inputs())
        self.module.write_outputs(0, image)
        self.module.advance(SCAN_MS)
        self.clock_ms += clock_ms
        self.utc_ms += utc_ms
        self.link_ms += link_ms
        return image


class FxRig:
    """Instruction list on the simulated FX2N at the terminals of the plant.

    Attributes:
        module: I/O module of the plant.
    """

    def __init__(self, ladder: Ladder, *, trays: int = 1) -> None:
        """Connect a PLC that has never run to a plant; nothing is set."""
        self._plc = FxPlc(ladder)
        self._now_ms = 0
        self.module = IoModule(Plant(MACHINE.io_map, load_machine(), seed=1, trays=trays), MACHINE.io_map)

    def read(self, word: Word) -> int:
        """Return the value of a register."""
        return self._plc.memory.D[word.number]

    def write(self, word: Word, value: int) -> None:
        """Write a register."""
        self._plc.memory.D[word.number] = value

    def set_relay(self, place: str) -> None:
        """Set a command relay, which the README names by its number only, with a tool."""
        self._plc.memory.M[int(place.removeprefix("M"))] = True

    def scan(self) -> list[bool]:
        """Run one scan and advance the plant by one period; return the outputs."""
        image = self._plc.scan(self._now_ms, self.module.inputs())[: MACHINE.io_map.output_count]
        self.module.write_outputs(0, image)
        self.module.advance(SCAN_MS)
        self._now_ms += SCAN_MS
        return image

    def power_cycle(self, *, memory_lost: bool = False) -> None:
        """Cycle the power; the latched devices are kept, but the memory is lost if the battery is low."""
        self._plc.battery_low = memory_lost
        self._plc.power_cycle()


def rig(target: str, mutate: tuple[str, str] | None = None) -> PackageRig:
    """Return a package on a plant, optionally with one replacement in its code."""

    def damaged(source: str) -> str:
        if mutate is None:
            return source
        assert source.count(mutate[0]) == 1, mutate[0]
        return source.replace(*mutate)

    return PackageRig(target, program(target).plc(damaged, PLACES[target].device_byte))


def homing(target: str, mutate: tuple[str, str] | None = None) -> PackageRig:
    """Return a package whose machine is homing, with coils on."""
    machine = rig(target, mutate)
    image: list[bool] = []
    for n in range(300):
        machine.module.plant.box.start = 1 < n < 14
        image = machine.scan()
        if n > 30 and any(image[number] for number in MOVERS):
            break
    assert machine.is_in(State.RESETTING)
    assert any(image[number] for number in MOVERS)
    return machine
