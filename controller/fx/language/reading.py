"""Reader of program files in either format (GX Works2 CSV or instruction list)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from controller.fx.language.cpu_model import FX2N, CpuModel
from controller.fx.language.gx_csv import COLUMNS, decode_text, read_gx_csv
from controller.fx.language.il import read_il
from controller.fx.language.instruction import Ladder
from controller.fx.language.parsing import file_error

LARGEST_BYTES: Final = 1_000_000
"""Size limit of a program file; a program of 8,000 steps is far smaller."""

_CONTROL: Final = re.compile(r"[\x00-\x08\x0E-\x1A\x7F]")
_SEPARATOR: Final = re.compile(r"[\t,]")
_COMMENT_MARKS: Final = (";", "//", "'", "(*")


def load_ladder(path: Path, cpu: CpuModel = FX2N) -> Ladder:
    """Return the program in a file: a GX Works2 CSV file or an instruction list, detected from its content.

    Raises:
        LadderError: The file cannot be read, is larger than `LARGEST_BYTES`, is not text, or is not an FX2N program.
    """
    source = str(path)
    data = _bytes(path, source)
    text = decode_text(data, source)
    if control := _CONTROL.search(text):
        message = f"not a text file (character U+{ord(control[0]):04X}); use an instruction list or a CSV file"
        raise file_error(source, message, text.count("\n", 0, control.start()) + 1)
    return read_gx_csv(data, source, cpu) if _is_csv(text) else read_il(text, source, cpu)


def _bytes(path: Path, source: str) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or type(error).__name__
        raise file_error(source, f"cannot be read ({reason}); use an instruction list or a CSV file") from None
    if len(data) > LARGEST_BYTES:
        raise file_error(source, f"larger than {LARGEST_BYTES} bytes; use an instruction list or a CSV file")
    return data


def _is_csv(text: str) -> bool:
    """Return whether text is CSV: it begins with a quotation mark, or its third line has seven columns."""
    if text.lstrip().startswith('"'):
        return True
    head = text.split("\n", 3)[2:3]
    return any(not line.startswith(_COMMENT_MARKS) and len(_SEPARATOR.split(line)) == len(COLUMNS) for line in head)
