"""Package with portable Structured Text: PROGRAM and CONFIGURATION without vendor extensions, for any IEC runtime."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from controller.export.packages.first_minutes import first_minutes
from controller.export.packages.iec import (
    ADDRESSES,
    RETAINED,
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
    PackageReport,
    PackageSource,
    require_terminals,
    write_files,
)
from controller.export.runtime_parts.inputs import FieldInputs
from controller.export.runtime_parts.memory import RetainedMemory
from controller.export.runtime_parts.scan_clock import ScanClock
from controller.export.structured_text import structured_text
from controller.export.structured_text_variables import Variables, address

_README: Final = """{name}: Structured Text of IEC 61131-3 without vendor extensions

{text}  PROGRAM, and CONFIGURATION with a cyclic task of 10 ms
{addresses}  address, type and meaning of every variable with an address

1. Import {text}, or paste the PROGRAM and create a cyclic task of 10 ms. Do not change the period: the program counts
   it as its clock.
2. Wire inputs and outputs to %IX and %QX as in {addresses} (X12 is %IX1.2), or change the addresses.
3. The memory takes %MX0.0 to %MX1224.7 and %MW1000 to %MW1564. If the runtime has less memory, or if %MW counts bytes,
   use a package for the runtime, or remove the addresses.
4. The runtime must retain VAR RETAIN. After a loss of this memory, the program reports alarm S904.

{minutes}
{confirmation}
System bits that are constant on this target:
{constants}
"""


def terminal(number: int) -> str:
    """Return the address of an input terminal."""
    return address("X", number)


def locate(kind: str, number: int) -> str:
    """Return the address of a device; the inputs are filtered and therefore not at their terminals."""
    return "" if kind == "X" else address(kind, number)


def write_package(source: PackageSource, folder: Path) -> PackageReport:
    """Write the package and return its size.

    Raises:
        LadderError: The program has a pulse train.
        PackageError: The folder cannot be written, or the inputs are to be on a field link.
    """
    require_levels(source)
    require_terminals(source, "plain")
    program = source.program
    parts = (FieldInputs(program, terminal), ScanClock(program), RetainedMemory(program, retained=True))
    text = structured_text(program, parts=parts, variables=Variables(program, locate, safe_levels(source)))
    readme = _README.format(
        name=program.name,
        text=TEXT,
        addresses=ADDRESSES,
        minutes=first_minutes(source.io_map, RETAINED, lambda number: address("M", number)),
        confirmation=CONFIRMATION,
        constants=constant_bits(program, link=False),
    )
    files = {
        TEXT: f"{text}\n{configuration(text.name)}".encode(),
        ADDRESSES: addresses_csv(text.variables),
        README: readme.encode(),
    }
    write_files(folder, files)
    return PackageReport(size_and_losses(text), complete=True)
