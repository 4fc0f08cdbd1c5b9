"""Command ``ladder sizes``: the page of sizes is that of the program, and the guides state its figures."""

from __future__ import annotations

import re

import pytest

from controller.cli.ladder.sizes import fitted_maps, size_cells, size_of, size_table
from controller.common.declarations import DeclarationError
from tests.paths import DOCS, ROOT
from tests.wiring import DELIVERED, wired

PAGE = (DOCS / "reference/ladder-sizes.md").read_text(encoding="utf-8")
ROWS = {cells[0]: cells[1:] for line in PAGE.splitlines() if (cells := line.strip("| ").split(" | "))[1:]}
REMEDY = "run .venv/bin/python -m controller ladder sizes --out docs/reference"


def test_the_page_has_the_sizes_of_the_delivered_map_and_of_a_guard() -> None:
    maps = dict(fitted_maps(DELIVERED))
    base = size_of(DELIVERED)
    for name in ("the I/O map", "with `guard`"):
        used = base if maps[name] is DELIVERED else size_of(maps[name])
        assert ROWS[name] == list(size_cells(name, used, base)[1:]), REMEDY


@pytest.mark.nightly
def test_the_page_is_the_table_of_every_optional_point() -> None:
    assert size_table(DELIVERED) == PAGE, REMEDY


def test_every_optional_point_has_a_row_and_the_last_row_has_them_all() -> None:
    maps = dict(fitted_maps(DELIVERED))
    assert list(maps) == list(ROWS)[1:]
    assert "left.cup_filled" in maps["with `cup_filled`"]
    assert "right.cup_filled" in maps["with `cup_filled`"]
    assert "guard" not in maps["with `cup_filled`"]
    last = maps["with every optional point"]
    assert not last.unwired
    assert not last.unwired_registers
    assert "lamp_amber" not in maps["without `lamp_amber`"]


def test_a_map_that_is_wired_by_name_is_the_map_of_the_file() -> None:
    assert DELIVERED.with_wired(()) == DELIVERED
    assert DELIVERED.with_wired([point.tag for point in DELIVERED.inputs]) == DELIVERED
    assert wired("guard").with_unwired(["guard"]).inputs == DELIVERED.inputs
    with pytest.raises(DeclarationError, match="no point or output register gurad"):
        DELIVERED.with_wired(["gurad"])


def test_the_delivered_program_fits_and_the_guides_state_its_steps() -> None:
    steps, memory = ROWS["the I/O map"][0], ROWS["the I/O map"][-1]
    assert memory == "FX2N"
    for path in (ROOT / "README.md", DOCS / "ladder.md"):
        assert f"uses {steps} of the 8,000" in path.read_text(encoding="utf-8")
    ladder = " ".join((DOCS / "ladder.md").read_text(encoding="utf-8").split())
    assert f"Without the amber lamp, it uses {ROWS['without `lamp_amber`'][0]}" in ladder
    yields = [ROWS[f"with `{part}`"][1] for part in ("claw_pressure", "seedling_beam", "cup_filled")]
    together = ROWS["with `claw_pressure`, `seedling_beam`, `cup_filled`"][1]
    stated = re.search(r"take (\d+) more steps: (\d+) for the pressure switches, (\d+) for the beams, (\d+)", ladder)
    assert stated is not None
    assert [f"+{number}" for number in stated.groups()] == [together, *yields]
    both = ROWS["with `ground_pulse`, `planter_speed`"][1]
    assert f"with the ground sensor, the program requires {both.removeprefix('+')} additional steps" in ladder
