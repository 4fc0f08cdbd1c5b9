"""Hazard table: every requirement it names is proved, and every proved requirement has its place in it."""

from __future__ import annotations

import re

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.requirements.proof import specification
from controller.program.requirements.time_limit import time_limit
from tests.paths import DOCS
from tests.wiring import wired

PAGE = DOCS / "safety.md"
MACHINE = build(load_io_map(DEFAULT_IO_MAP))
OPTIONAL_POINTS = wired("guard", "horn")
REQUIREMENTS = {
    name.removeprefix("left: ").removeprefix("right: ")
    for name in (requirement.name for requirement in specification(build(OPTIONAL_POINTS)).requirements)
}
NOT_REQUIREMENTS = {"air_pressure_ok", "guard", "hold", "suspend", "--allow-forcing"}
"""Inputs, commands and options named in the column of the program."""
HEADING = ["hazard", "standard", "program", "hardware", "left"]


def rows() -> list[list[str]]:
    """Return the rows of all tables of the page."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("| ")]
    return [row for row in cells if row != HEADING]


def test_named_requirements_are_those_of_the_proof() -> None:
    """A requirement in the column of the program has the name under which it is proved, and none is left out."""
    named = {name for row in rows() for name in re.findall(r"`([^`]+)`", row[HEADING.index("program")])}
    assert named - NOT_REQUIREMENTS == REQUIREMENTS
    assert named >= NOT_REQUIREMENTS


def test_every_row_has_all_columns() -> None:
    """A hazard without a measure says so with a word, not with an empty cell."""
    table = rows()
    assert len(table) > 20
    assert [row for row in table if len(row) != len(HEADING) or not all(row)] == []


def test_the_page_says_that_it_is_no_safety_device() -> None:
    """The first sentence states it; the longest duration of homing is that of the proof."""
    text = PAGE.read_text(encoding="utf-8")
    assert text.startswith("# Hazards\n\n**This program is not a safety PLC.**")
    assert "does not replace a safety relay" in text
    assert f"for up to {time_limit(MACHINE).ms / 1000:.1f} s" in text
