"""Source, report and files of a package: a folder with a program and the text of how to load it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from controller.common.errors import InputError
from controller.common.modbus.io_map import IoMap
from controller.core.program import Program
from controller.export.instruction_list import PulseTrain

Io = Literal["modbus", "terminals"]

README: Final = "README.txt"
"""Name of the text in every package that describes how to load it."""

CONFIRMATION: Final = """\
Machine constants: if one differs from its default (ladder export --set or --constants), X0 has no effect after each
start of the PLC until X25 has been pressed and released, and X24 pressed for 3 s and released.
"""
"""Operation of a program with machine constants that differ, for the text of every package."""


class PackageError(InputError):
    """Raised for a program that a target cannot hold, or for a folder that cannot be written."""


@dataclass(frozen=True, slots=True)
class PackageSource:
    """Program and choices from which a package is made.

    Attributes:
        program: Complete program of the machine.
        io_map: I/O map of the machine.
        pulses: Output that becomes a pulse train; None = all outputs are levels.
        io: Place of the inputs and outputs: "modbus" = I/O device on a field link, "terminals" = terminals of the PLC;
            None = the usual place of the target.
    """

    program: Program
    io_map: IoMap
    pulses: PulseTrain | None = None
    io: Io | None = None


@dataclass(frozen=True, slots=True)
class PackageReport:
    """Facts about a written package.

    Attributes:
        lines: Size and budget of the program, for the user.
        fits: Whether the target can hold the program.
        complete: Whether all rungs are exported, and not only those that influence an output.
    """

    lines: tuple[str, ...]
    fits: bool = True
    complete: bool = False


def require_terminals(source: PackageSource, target: str) -> None:
    """Check that the inputs and outputs are terminals of the PLC.

    Raises:
        PackageError: They are on a field link.
    """
    if source.io == "modbus":
        raise PackageError(f"--io modbus: target {target} has no supervised field link; omit it")


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the files of a package; if one of them cannot be written, none is changed.

    Args:
        folder: Folder of the package, created if it does not exist; other files in it remain.
        files: Contents by file name.

    Raises:
        PackageError: The folder or a file cannot be written.
    """
    created = not folder.exists()
    new = {folder / f".{name}.new": folder / name for name in files}
    try:
        folder.mkdir(exist_ok=True)
        for (path, final), content in zip(new.items(), files.values(), strict=True):
            if final.is_dir():
                raise IsADirectoryError(None, "is a folder", str(final))
            path.write_bytes(content)
        for path, final in new.items():
            os.replace(path, final)
    except OSError as error:
        for path in new:
            path.unlink(missing_ok=True)
        if created and folder.is_dir():
            folder.rmdir()
        raise PackageError(f"{error.filename}: {error.strerror}; choose another --out folder") from error
