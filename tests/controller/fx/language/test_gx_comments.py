"""Device comment files of GX Works2."""

from __future__ import annotations

import csv
import io

import pytest

from controller.fx.language.check import devices_of
from controller.fx.language.gx_comments import COLUMNS, MOST_CHARACTERS, commented_devices, shortened, write_gx_comments
from controller.fx.language.gx_csv import gx_text
from controller.fx.language.il import read_il
from controller.fx.language.instruction import DeviceOperand
from tests.controller.export.fx_equality import EXPORTED

PROGRAM = """
; X10 = start button
; M0 = a comment that is longer than thirty-two characters
; D5 = count
; homing
LD X10
OR M8013
OUT M0
MOV K4M20 D5
LD M1
SET S20
STL S20
OUT Y1
RET
END
"""


def rows(data: bytes) -> list[list[str]]:
    """Return the rows of a comment file, which must be UTF-16LE with a byte order mark and quoted fields."""
    assert data.startswith(b"\xff\xfe")
    text = data[2:].decode("utf-16-le")
    assert text.endswith('"\r\n')
    return list(csv.reader(io.StringIO(text, newline=""), delimiter="\t", strict=True))


def test_a_comment_file_has_a_title_a_header_and_a_row_for_each_device_with_a_comment() -> None:
    ladder = read_il(PROGRAM.replace("STL S20", "; lower the arm\nSTL S20"))
    assert rows(write_gx_comments(ladder, title="arm")) == [
        ["arm"],
        ["Device Name", "Comment"],
        ["X010", "start button"],
        ["M0", "a comment that is longer than..."],
        ["M8013", "clocks of 10 ms, 100 ms, 1 s..."],
        ["S20", "lower the arm"],
        ["D5", "count"],
    ]


def test_every_device_of_the_exported_program_has_a_comment() -> None:
    (title, header, *devices) = rows(write_gx_comments(EXPORTED))
    assert (len(title), tuple(header)) == (1, COLUMNS)
    named = [name for name, _ in devices]
    used = {gx_text(DeviceOperand(kind, number)) for kind, number in devices_of(EXPORTED)}
    assert used - set(named) == {"S0", "S999"}, "only the ends of the zone reset of all steps"
    assert len(set(named)) == len(named)
    assert all(0 < len(comment) <= MOST_CHARACTERS for _, comment in devices)
    full = {gx_text(device): comment for device, comment in commented_devices(EXPORTED)}
    assert all(comment == full[name] or comment.endswith("...") for name, comment in devices)


@pytest.mark.parametrize(
    ("comment", "expected"),
    [
        ("x" * 32, "x" * 32),
        ("x" * 33, "x" * 29 + "..."),
        ("夹" * 16, "夹" * 16),
        ("夹" * 17, "夹" * 14 + "..."),
    ],
)
def test_long_comments_are_shortened_to_the_width_of_32_half_width_characters(comment: str, expected: str) -> None:
    assert shortened(comment) == expected
