"""A program from a file, whichever of the two text formats it has."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from controller.fx.gx_csv import COLUMNS, decoded, read_gx_csv
from controller.fx.il import read_il
from controller.fx.instruction import Ladder
from controller.fx.parsing import file_error

LARGEST_BYTES: Final = 1_000_000
"""Far above any program of 8,000 steps."""

_CONTROL: Final = re.compile(r"[\x00-\x08\x0E-\x1A\x7F]")
_SEPARATOR: Final = re.compile(r"[\t,]")
_COMMENT_MARKS: Final = (";", "//", "'", "(*")


def load_ladder(path: Path) -> Ladder:
    """Return the program in a file: a CSV file of GX Works2 or an instruction list, told apart by what it holds.

    Raises:
        LadderError: It cannot be read, is larger than `LARGEST_BYTES`, is no text, or is no program of an FX2N.
    """
    source = str(path)
    data = _bytes(path, source)
    text = decoded(data, source)
    if found := _CONTROL.search(text):
        wrong = f"is no text (character U+{ord(found[0]):04X}); name an instruction list or a CSV file"
        raise file_error(source, wrong, text.count("\n", 0, found.start()) + 1)
    return read_gx_csv(data, source) if _is_csv(text) else read_il(text, source)


def _bytes(path: Path, source: str) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or type(error).__name__
        raise file_error(source, f"cannot be read ({reason}); name an instruction list or a CSV file") from None
    if len(data) > LARGEST_BYTES:
        raise file_error(source, f"is larger than {LARGEST_BYTES} bytes; name an instruction list or a CSV file")
    return data


def _is_csv(text: str) -> bool:
    """Tell whether a text is a CSV file: it begins with a quotation mark, or its third line names seven columns."""
    if text.lstrip().startswith('"'):
        return True
    head = text.split("\n", 3)[2:3]
    return any(not line.startswith(_COMMENT_MARKS) and len(_SEPARATOR.split(line)) == len(COLUMNS) for line in head)
