"""Reader of program files: GX Works2 CSV, instruction list, or the program part of a GX Developer project (.wpg)."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Final

from controller.fx.language.cpu_model import FX2N, CpuModel
from controller.fx.language.gx_csv import decode_text, read_gx_csv, separator_of
from controller.fx.language.il import read_il
from controller.fx.language.instruction import Ladder
from controller.fx.language.parsing import file_error
from controller.fx.language.wpg import MAGIC, read_wpg

LARGEST_BYTES: Final = 1_000_000
"""Size limit of a program file; a program of 8,000 steps is far smaller."""

_CONTROL: Final = re.compile(r"[\x00-\x08\x0E-\x1A\x7F]")


def load_ladder(path: Path, cpu: CpuModel = FX2N) -> Ladder:
    """Return the program in a GX Works2 CSV file, an instruction list or a .wpg file, detected from its content.

    Raises:
        LadderError: The file cannot be read, is larger than `LARGEST_BYTES`, has another format, or is not a valid
            program of the CPU.
    """
    source = str(path)
    data = _bytes(path, source)
    if path.suffix.lower() == ".wpg" or data.startswith(MAGIC):
        return read_wpg(data, source, cpu)
    decoded = decode_text(data, source)
    text = decoded.text
    if control := _CONTROL.search(text):
        message = f"not a text file (character U+{ord(control[0]):04X}); use an instruction list or a CSV file"
        raise file_error(source, message, text.count("\n", 0, control.start()) + 1)
    separator = separator_of(text)
    ladder = read_il(text, source, cpu) if separator is None else read_gx_csv(data, source, cpu)
    semicolons = ("read as CSV with semicolons between the fields",) if separator == ";" else ()
    return replace(ladder, notes=(*decoded.notes, *semicolons))


def _bytes(path: Path, source: str) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or type(error).__name__
        raise file_error(source, f"cannot be read ({reason}); use an instruction list or a CSV file") from None
    if foreign := _foreign(path, data):
        raise file_error(source, foreign)
    if len(data) > LARGEST_BYTES:
        raise file_error(source, f"larger than {LARGEST_BYTES} bytes; use an instruction list or a CSV file")
    return data


_OLE: Final = bytes.fromhex("d0cf11e0a1b11ae1")
"""First bytes of a compound file, the format of a GX Works2 project (verified with published projects)."""
_PROJECTS: Final = {
    ".gxw": "GX Works2 project; open it in GX Works2 and use Write to CSV File",
    ".gx3": "GX Works3 project; write its program as an instruction list",
    ".gpj": "GX Developer project file; use the file MAIN.wpg of the project, or Write to CSV File in GX Developer",
    ".gps": "GX Developer project file; use the file MAIN.wpg of the project, or Write to CSV File in GX Developer",
    ".wpa": "GX Developer parameter file; use the file MAIN.wpg of the project",
    ".wcd": "GX Developer comment file; use the file MAIN.wpg of the project",
    ".pmw": "FXGP/WIN program; import it in GX Developer and use Write to CSV File",
}
"""Messages for the files of other programs by suffix; all but .gxw, .wpa and .wcd from memory."""


def _foreign(path: Path, data: bytes) -> str | None:
    """Return the message for a file that another program must convert; None = none."""
    message = _PROJECTS.get(path.suffix.lower())
    return message or (_PROJECTS[".gxw"] if data.startswith(_OLE) else None)
