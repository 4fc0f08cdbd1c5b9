"""Device comment files, as the "Write to CSV File" command of GX Works2 writes them (fx2n.md 2.4).

The files are UTF-16LE with a byte order mark, tabs and quoted fields: a title row, a header row and one row for each
device with a comment. The limits of 32 characters in a project and of 16 characters in an FX2N are from memory.
"""

from __future__ import annotations

import csv
import io
from codecs import BOM_UTF16_LE
from collections.abc import Iterator
from typing import Final
from unicodedata import east_asian_width

from controller.core.devices import SIZES
from controller.fx.language.check import devices_of
from controller.fx.language.gx_csv import gx_text
from controller.fx.language.instruction import DeviceOperand, Ladder
from controller.fx.language.parsing import one_line
from controller.fx.language.special_devices import PROVIDED

MOST_CHARACTERS: Final = 32
"""Longest comment of GX Works2, in half-width characters; other characters count twice (from memory)."""
PLC_CHARACTERS: Final = 16
"""Characters of a comment that an FX2N stores (from memory)."""
COLUMNS: Final = ("Device Name", "Comment")
_CUT: Final = "..."


def write_gx_comments(ladder: Ladder, *, title: str = "COMMENT") -> bytes:
    """Return the comment file of a program: every device that it uses, in the order X, Y, M, S, T, C, D.

    A step without a comment has its title as comment, a special device its function. Longer comments are shortened.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text, delimiter="\t", quoting=csv.QUOTE_ALL, lineterminator="\r\n")
    writer.writerow((one_line(title),))
    writer.writerow(COLUMNS)
    writer.writerows((gx_text(device), shortened(comment)) for device, comment in commented_devices(ladder))
    return BOM_UTF16_LE + text.getvalue().encode("utf-16-le")


def commented_devices(ladder: Ladder) -> Iterator[tuple[DeviceOperand, str]]:
    """Yield each device that a program uses with its full comment; devices without any comment are omitted."""
    titles = {
        str(instruction.operands[0]): ladder.titles[at]
        for at, instruction in enumerate(ladder.instructions)
        if instruction.name == "STL" and at in ladder.titles
    }
    comments = _special_functions() | titles | ladder.comments
    order = [*SIZES, "R"]
    for kind, number in sorted(devices_of(ladder), key=lambda key: (order.index(key[0]), key[1])):
        device = DeviceOperand(kind, number)
        comment = one_line(comments.get(str(device), ""))
        if comment:
            yield device, comment


def shortened(comment: str) -> str:
    """Return a comment of at most `MOST_CHARACTERS` half-width characters; a longer one is cut and ends with "...".

    Examples:
        >>> shortened("right.alarm: the slide does not leave row 3")
        'right.alarm: the slide does n...'
    """
    if _width(comment) <= MOST_CHARACTERS:
        return comment
    while _width(comment) > MOST_CHARACTERS - len(_CUT):
        comment = comment[:-1]
    return comment.rstrip() + _CUT


def _width(text: str) -> int:
    return sum(2 if east_asian_width(character) in "WFA" else 1 for character in text)


def _special_functions() -> dict[str, str]:
    """Return the function of each special device by its FX name."""
    functions: dict[str, str] = {}
    for names, function in PROVIDED.items():
        for name in names.split():
            first, _, last = name.partition("-")
            kind = first[0]
            numbers = range(int(first[1:]), int((last or first)[1:]) + 1)
            functions |= {f"{kind}{number}": function.partition(":")[0] for number in numbers}
    return functions
