"""Package for OpenPLC: Structured Text for its runtime."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from controller.export.instruction_list import acting
from controller.export.packages.package import README, PackageReport, PackageSource, write_files
from controller.export.structured_text import structured_text
from controller.fx.language.instruction import LadderError

TEXT: Final = "transplanter.st"
"""The program."""


def write_package(source: PackageSource, folder: Path) -> PackageReport:
    """Write the package and return its size.

    Raises:
        LadderError: The program has a pulse train.
        PackageError: The folder cannot be written.
    """
    if source.pulses is not None:
        raise LadderError("--stepper plsy: Structured Text has no PLSY; omit it, or choose --target fx2n")
    program = acting(source.program)
    readme = f"{program.name}: Structured Text of IEC 61131-3 without vendor extensions\n\n{TEXT}  the program\n"
    write_files(folder, {TEXT: structured_text(program).encode(), README: readme.encode()})
    return PackageReport(())
