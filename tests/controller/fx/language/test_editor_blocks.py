"""Drawn size of ladder blocks, as the editor of GX Works2 counts lines and cells."""

from __future__ import annotations

import pytest

from controller.fx.language.editor_blocks import MOST_LINES, EditorBlock, editor_blocks
from controller.fx.language.il import read_il
from tests.controller.export.fx_equality import EXPORTED


def sizes(text: str) -> list[tuple[int, int]]:
    """Return the lines and the widest part of each block, without the one of END."""
    return [(block.lines, block.widest) for block in editor_blocks(read_il(text))][:-1]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("LD X0\nOUT Y0", (1, 1)),
        ("LD X0\nOR X1\nAND X2\nOUT Y0", (2, 1)),
        ("LD X0\nOUT Y0\nOUT Y1\nSET M1", (3, 1)),
        ("LD X0\nOUT Y0\nAND X1\nOUT Y1", (2, 1)),
        ("LD X0\nMPS\nAND X1\nOUT Y0\nMRD\nAND X2\nOUT Y1\nMPP\nLD X3\nOR X4\nANB\nOUT Y2", (4, 1)),
        ("LD X0\n" + "AND X1\n" * 10 + "OUT Y0", (1, 1)),
        ("LD X0\n" + "AND X1\n" * 11 + "OUT Y0", (2, 1)),
        ("LD X0\n" + "AND X1\n" * 21 + "OUT Y0", (2, 1)),
        ("LD X0\n" + "AND X1\n" * 22 + "OUT Y0", (3, 1)),
        ("LD X0\n" + "AND X1\n" * 8 + "MOV K1 D0", (1, 1)),
        ("LD X0\n" + "AND X1\n" * 9 + "MOV K1 D0", (2, 1)),
        ("LD> D0 K1\nAND< D1 K2\nAND= D2 K3\nAND X0\nOUT Y0", (1, 3)),
        ("LD> D0 K1\nAND< D1 K2\nAND= D2 K3\nAND= D3 K4\nOUT Y0", (2, 3)),
        ("LD X0\n" + "AND X1\n" * 11 + "LD X2\nOR X3\nOR X4\nANB\nOUT Y0", (4, 1)),
    ],
)
def test_lines_and_cells(text: str, expected: tuple[int, int]) -> None:
    assert sizes(f"{text}\nEND") == [expected]


def test_a_block_ends_where_the_next_contact_starts_at_the_left_rail() -> None:
    assert sizes("LD X0\nOUT Y0\nLD X1\nOUT Y1\nSTL S0\nOUT Y2\nSET Y3\nLD X2\nSET S1\nRET\nEND") == [
        (1, 1),
        (1, 1),
        (1, 1),
        (2, 0),
        (1, 1),
        (1, 1),
    ]


def test_every_block_of_the_exported_program_can_be_edited() -> None:
    blocks = list(editor_blocks(EXPORTED))
    assert max(block.lines for block in blocks) == MOST_LINES, "the limit is used"
    assert [block for block in blocks if not block.fits] == []
    assert not EditorBlock(0, MOST_LINES + 1, 1).fits
