"""Source, report and files of a package: a folder with a program and the text of how to load it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.common.errors import InputError
from controller.core.program import Program
from controller.export.instruction_list import PulseTrain

README: Final = "README.txt"
"""Name of the text in every package that describes how to load it."""


class PackageError(InputError):
    """Raised for a program that a target cannot hold, or for a folder that cannot be written."""


@dataclass(frozen=True, slots=True)
class PackageSource:
    """Program and choices from which a package is made.

    Attributes:
        program: Complete program of the machine.
        pulses: Output that becomes a pulse train; None = all outputs are levels.
    """

    program: Program
    pulses: PulseTrain | None = None


@dataclass(frozen=True, slots=True)
class PackageReport:
    """Facts about a written package.

    Attributes:
        lines: Size and budget of the program, for the user.
        fits: Whether the target can hold the program.
    """

    lines: tuple[str, ...]
    fits: bool = True


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
