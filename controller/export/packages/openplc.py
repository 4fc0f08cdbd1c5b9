"""Package for OpenPLC Runtime v3, whose buffers, Modbus map, storage and clocks were read in its source.

Source: github.com/thiagoralves/OpenPLC_v3, commit bb35f69 (2026-01-08): `webserver/core/ladder.h` (1,024 entries in
every buffer), `utils/glue_generator_src/glue_generator.cpp` (%MX is not connected to anything; an address beyond the
buffer is written to the memory behind it), `modbus.cpp` (map of the Modbus server), `modbus_master.cpp` (devices from
byte 100, 400 bits; the last inputs remain if a device does not respond; the error counter %ML1026 does not count),
`persistent_storage.cpp` (%MW, %MD and %ML; zero is not restored; written every few seconds without synchronising),
`utils.cpp` (%ML1027 UTC in s, %ML1029 lateness of a scan in us), `main.cpp` (the time of TON is the number of scans
times the task period), `webserver/scripts/compile_program.sh` (names of configuration and resource).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.common.modbus.io_map import IoMap, OutputRegister, Point
from controller.core.devices import ANNUNCIATORS
from controller.core.program import Program
from controller.export.packages.first_minutes import KeptMemory, first_minutes
from controller.export.packages.iec import (
    ADDRESSES,
    COMMANDS,
    TEXT,
    addresses_csv,
    configuration,
    constant_bits,
    require_levels,
    safe_levels,
    size_and_losses,
)
from controller.export.packages.package import (
    CONFIRMATION,
    README,
    PackageError,
    PackageReport,
    PackageSource,
    write_files,
)
from controller.export.runtime_parts.inputs import FieldInputs
from controller.export.runtime_parts.memory import KeptDeclaration, KeptSetPoints, RetainedMemory, ShownValues
from controller.export.runtime_parts.openplc_clock import FAULTS, OpenPlcClock
from controller.export.runtime_parts.scan_clock import ScanClock
from controller.export.structured_text import structured_text
from controller.export.structured_text_variables import Variables

BUFFER: Final = 1024
"""Entries of every buffer of the runtime: bytes of %IX and %QX, words of %IW, %QW and %MW."""
DEVICE_BYTE: Final = 100
"""First byte of %IX and %QX, and first word of %IW and %QW, of the Modbus devices."""
DEVICE_BITS: Final = 400
"""Bits of all Modbus devices together."""
COMMAND_BYTE: Final = 200
"""Byte of M400 in %QX; a client sets coil 1600 for M400."""
COMMAND_COIL: Final = 8 * COMMAND_BYTE - COMMANDS[0]
"""Coil of M0, if it had one."""
ALARM_BYTE: Final = 300
"""Byte of S900 in %QX; a client reads coil 2400 for S900."""
REGISTER: Final = 400
"""Word of D0 in %QW; a client reads holding register 500 for D100."""
DECLARATION: Final = "%MW100"
"""Word with the declaration of a new machine, behind the set-points."""
STORAGE_S: Final = 1
"""Period in which the runtime writes its storage, s, as the README of the package demands."""

_LOST: Final = KeptMemory(
    later=4,
    note="After every power-up the memory is lost: alarm S904 until X0 is pressed, or until the machine is declared as "
    "new; the storage keeps this declaration until the machine moves. Later, answer the questions instead: a "
    "declaration conveys the tray out. Rows are unknown: the arms take every row of a tray that is treated as full, "
    "also its empty rows.",
)

_README: Final = """{name}: program for OpenPLC Runtime v3 (commit bb35f69 or later)

{text}  PROGRAM, and CONFIGURATION with a cyclic task of 10 ms
{addresses}  address, type and meaning of every variable with an address

1. Programs > upload {text}. It compiles without changes. Do not change INTERVAL: the program counts it as its clock.
{wiring}
3. Settings > Enable Persistent Storage Thread, {storage_s} s, stores the set-points, and in
   {declaration} the declaration of a new machine. All other values are unknown after every power-up, because the
   runtime stores them too late: the program reports alarm S904 (memory lost), finds its
   positions by homing, and asks about the tray and the claws (guide "Operating the machine", questions).
4. Settings > Enable Modbus Server, for a panel: coils 1600 to 1669 are the commands M400 to M469 (write 1; the program
   resets them), coils 2400 to 2499 show the alarms S900 to S999, holding register 400 + n shows register Dn, and the
   registers 912 to 937 are the set-points D512 to D537. The server has no password: use it on a separate network.
5. Set the output watchdog of the I/O device to 100 ms to 500 ms: if the runtime stops, only the device can switch the
   outputs off.

Supervision: if the scans and the clocks of the runtime differ by more than 200 ms, alarm S902 aborts the machine{link}.

{minutes}
{confirmation}
System bits that are constant on this target:
{constants}
"""
_MODBUS: Final = """2. Slave Devices > Add: Generic Modbus TCP Device, the first one in the list.
   Discrete inputs: start {inputs_start}, size {inputs}. Coils: start {coils_start}, size {coils}. Input registers:
   start and size of one register that changes with every exchange (plant_sim: start 1, size 1).
   Holding registers, write: start {registers_start}, size {registers}; read: 0.
   Settings: Slave Polling Period 5 ms, timeout 50 ms. The default of 100 ms is too slow: alarm S901."""
_TERMINALS: Final = (
    """2. Hardware: choose the board. Its inputs are %IX0.0 to {last_input}, its outputs %QX0.0 to {last_output}."""
)


@dataclass(frozen=True, slots=True)
class OpenPlcMap:
    """Addresses of the devices in the memory of the runtime.

    Attributes:
        io_map: I/O map of the machine.
        modbus: True if the inputs and outputs are those of the first Modbus device.
    """

    io_map: IoMap
    modbus: bool

    def bit(self, area: str, points: Sequence[Point], number: int) -> str:
        """Return the address of an input or output: the Modbus offset within the device, or the terminal."""
        index, first = number, 0
        if self.modbus:
            offsets = {point.number: point.offset for point in points}
            index, first = offsets[number] - min(offsets.values()), DEVICE_BYTE
        return f"%{area}X{first + index // 8}.{index % 8}"

    def terminal(self, number: int) -> str:
        """Return the address of an input."""
        return self.bit("I", self.io_map.inputs, number)

    def locate(self, kind: str, number: int) -> str:
        """Return the address of a variable; most variables have none."""
        if kind == "Y":
            return self.bit("Q", self.io_map.outputs, number)
        if kind == "M" and number in COMMANDS:
            return f"%QX{COMMAND_BYTE + (number - COMMANDS[0]) // 8}.{(number - COMMANDS[0]) % 8}"
        if kind == "D" and number in (registers := {r.number: r.offset for r in self.io_map.registers}):
            first = DEVICE_BYTE if self.modbus else 0
            return f"%QW{first + registers[number] - min(registers.values())}"
        return ""

    def check(self) -> None:
        """Check that the runtime has an address for every input, output and output register.

        Raises:
            PackageError: The offsets in the I/O map extend over more than the runtime exchanges.
        """
        if self.modbus:
            kinds: tuple[Sequence[Point | OutputRegister], ...]
            kinds = (self.io_map.inputs, self.io_map.outputs, self.io_map.registers)
            for entries in kinds:
                first = min((entry.offset for entry in entries), default=0)
                for entry in entries:
                    if entry.offset - first >= DEVICE_BITS:
                        raise PackageError(
                            f"{self.io_map.path}:{entry.line}: {entry.tag}: modbus.offset: {entry.offset} is "
                            f"{entry.offset - first} after the first one, but OpenPLC exchanges {DEVICE_BITS} in a "
                            f"row; choose an offset below {first + DEVICE_BITS}"
                        )


def shown(program: Program) -> ShownValues:
    """Return the part that shows alarms and registers; set-points and output registers have their own addresses."""
    hidden = {word.number for word, _ in program.set_points} | {word.number for word in program.output_words}

    def place(kind: str, number: int) -> str:
        if kind == "S" and number in ANNUNCIATORS:
            return f"%QX{ALARM_BYTE + (number - ANNUNCIATORS[0]) // 8}.{(number - ANNUNCIATORS[0]) % 8}"
        if kind == "D" and number not in hidden and number < BUFFER - REGISTER:
            return f"%QW{REGISTER + number}"
        return ""

    return ShownValues(program, place)


def write_package(source: PackageSource, folder: Path) -> PackageReport:
    """Write the package and return its size.

    Raises:
        LadderError: The program has a pulse train.
        PackageError: The runtime has no address for an input or output, or the folder cannot be written.
    """
    require_levels(source)
    program, modbus = source.program, source.io != "terminals"
    places = OpenPlcMap(source.io_map, modbus)
    places.check()
    set_points = {word.number for word, _ in program.set_points}

    def locate(kind: str, number: int) -> str:
        return f"%QW{REGISTER + number}" if kind == "D" and number in set_points else places.locate(kind, number)

    parts = (
        FieldInputs(program, places.terminal, f"%IW{DEVICE_BYTE}" if modbus else None),
        OpenPlcClock(program),
        ScanClock(program, FAULTS),
        RetainedMemory(program, retained=False),
        KeptDeclaration(program, DECLARATION),
        KeptSetPoints(program, lambda index: f"%MW{index}"),
        shown(program),
    )
    variables = Variables(program, locate, safe_levels(source), retain=False)
    text = structured_text(program, parts=parts, variables=variables)
    readme = _README.format(
        name=program.name,
        text=TEXT,
        addresses=ADDRESSES,
        wiring=_wiring(places),
        storage_s=STORAGE_S,
        declaration=DECLARATION,
        link=", and if the I/O device does not respond for 100 ms, alarm S901" if modbus else "",
        minutes=first_minutes(source.io_map, _LOST, lambda number: f"coil {COMMAND_COIL + number}"),
        confirmation=CONFIRMATION,
        constants=constant_bits(program, link=modbus),
    )
    files = {
        TEXT: f"{text}\n{configuration(text.name, 'Config0', 'Res0')}".encode(),
        ADDRESSES: addresses_csv(text.variables),
        README: readme.encode(),
    }
    write_files(folder, files)
    return PackageReport(size_and_losses(text), complete=True)


def _wiring(places: OpenPlcMap) -> str:
    inputs, outputs, registers = places.io_map.inputs, places.io_map.outputs, places.io_map.registers
    if not places.modbus:
        return _TERMINALS.format(
            last_input=places.terminal(inputs[-1].number), last_output=places.locate("Y", outputs[-1].number)
        )
    spans = [[entry.offset for entry in entries] or [0] for entries in (inputs, outputs, registers)]
    sizes = [max(span) - min(span) + 1 for span in spans]
    return _MODBUS.format(
        inputs_start=min(spans[0]),
        inputs=sizes[0],
        coils_start=min(spans[1]),
        coils=sizes[1],
        registers_start=min(spans[2]),
        registers=sizes[2] if registers else 0,
    )
