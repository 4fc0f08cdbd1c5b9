"""Package for CODESYS 3.5: PLCopen XML with program, variable lists and task, and the same as text.

Source: CODESYS Development System, help pages *Variable: PERSISTENT* and *Object: Persistent Variable List*
(content.helpme-codesys.com): persistent variables are kept if they are declared in the persistent variable list, and
have no address. TON measures the system time of the runtime (general knowledge).
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from controller.export.packages.first_minutes import first_minutes
from controller.export.packages.iec import (
    COMMANDS,
    RETAINED,
    TEXT,
    constant_bits,
    require_levels,
    safe_levels,
    size_and_losses,
)
from controller.export.packages.package import CONFIRMATION, README, PackageReport, PackageSource, write_files
from controller.export.packages.plcopen_xml import plcopen_xml
from controller.export.runtime_parts.inputs import FieldInputs
from controller.export.runtime_parts.memory import RetainedMemory
from controller.export.runtime_parts.part import SCAN_MS
from controller.export.runtime_parts.scan_clock import SCAN_LIMIT_MS, ScanClock
from controller.export.structured_text import ProgramText, structured_text
from controller.export.structured_text_variables import INDENT, Variable, Variables

XML: Final = "transplanter.xml"
"""The project."""
TERMINALS, ORDERS, PERSISTENT = "Terminals", "Commands", "PersistentVars"
"""Names of the global variable lists."""

_README: Final = """{name}: program for CODESYS 3.5

{xml}  PLCopen XML: program, global variable lists and task
{text}  the same as text, in case an object is missing after the import

1. Create a project with your device, select its Application, then Project > Import PLCopenXML > {xml}.
2. Check that the following objects exist; paste a missing one from {text}:
   program {program}; lists {terminals}, {orders} and {persistent} (a persistent variable list); task MainTask: cyclic,
   10 ms, priority 1, watchdog 200 ms, which calls {program}. Do not change 10 ms: the program counts it as its clock.
3. I/O mapping of the device: map each channel to an existing variable of {terminals}.{link}
4. {persistent} needs a device with retentive memory. After a loss of this memory, the program reports alarm S904.
5. A panel writes TRUE to the variables of {orders}; the program resets them. Set-points are in {persistent}.
6. Set the output watchdog of the I/O device to 100 ms to 500 ms, and *Behaviour for outputs in stop* to *Set all
   outputs to default*.

Supervision: if the scans and the time of the runtime differ by more than 200 ms, alarm S902 aborts the machine.

{minutes}
{confirmation}
The file has been checked against the schema of PLCopen. It has not yet been imported into CODESYS.

System bits that are constant on this target:
{constants}
"""
_LINK: Final = """
   link_word is a register of the I/O device that changes with every exchange; if it does not change for 100 ms, alarm
   S901 aborts the machine. If the inputs are terminals of the PLC itself, export with --io terminals."""


def unlocated(kind: str, number: int) -> str:
    """Return no address: channels are mapped to variables, and persistent variables cannot have one."""
    del kind, number
    return ""


def write_package(source: PackageSource, folder: Path) -> PackageReport:
    """Write the package and return its size.

    Raises:
        LadderError: The program has a pulse train.
        PackageError: The folder cannot be written.
    """
    require_levels(source)
    program, modbus = source.program, source.io != "terminals"
    variables = Variables(program, unlocated, safe_levels(source))
    parts = (
        FieldInputs(program, lambda _: "", "" if modbus else None),
        ScanClock(program),
        RetainedMemory(program, retained=True),
    )
    text = structured_text(program, parts=parts, variables=variables)
    devices = {(d.kind, d.number): d for d in program.devices()}
    words = {variables.device(word) for word in program.output_words}
    terminals = {variables.device(d) for (kind, _), d in devices.items() if kind == "Y"} | words
    names_of = {n: variables.device(d) for (kind, n), d in devices.items() if kind == "M" and n in COMMANDS}
    orders = set(names_of.values())
    every = variables.all()
    lists = {
        TERMINALS: [v for v in every if v.name in terminals or v.name.endswith("_terminal") or v.name == "link_word"],
        ORDERS: [v for v in every if v.name in orders],
        PERSISTENT: [v for v in every if v.retain],
    }
    names = {v.name for members in lists.values() for v in members}
    local = [v for v in every if v.name not in names]
    xml = plcopen_xml(text, local, lists, PERSISTENT, interval_ms=SCAN_MS, watchdog_ms=SCAN_LIMIT_MS)
    readme = _README.format(
        name=program.name,
        xml=XML,
        text=TEXT,
        program=text.name,
        terminals=TERMINALS,
        orders=ORDERS,
        persistent=PERSISTENT,
        link=_LINK if modbus else "",
        minutes=first_minutes(source.io_map, RETAINED, lambda number: f"{ORDERS}.{names_of[number]}"),
        confirmation=CONFIRMATION,
        constants=constant_bits(program, link=modbus),
    )
    write_files(folder, {XML: xml.encode(), TEXT: _objects(text, local, lists).encode(), README: readme.encode()})
    return PackageReport(size_and_losses(text), complete=True)


def _objects(text: ProgramText, local: list[Variable], lists: dict[str, list[Variable]]) -> str:
    """Return the objects of the project as text, each under its name."""
    parts = []
    for name, members in lists.items():
        kept = " PERSISTENT RETAIN" if name == PERSISTENT else ""
        parts.append(f"(* list {name} *)\n{_declared(f'VAR_GLOBAL{kept}', members)}")
    parts.append(f"(* program {text.name} *)\nPROGRAM {text.name}\n{_declared('VAR', local)}\n\n{text.body}")
    return "\n\n".join(parts) + "\n\nEND_PROGRAM\n"


def _declared(section: str, variables: list[Variable]) -> str:
    return "\n".join([section, *(f"{INDENT}{variable}" for variable in variables), "END_VAR"])
