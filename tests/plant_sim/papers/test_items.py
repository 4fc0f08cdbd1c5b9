"""Page of the papers' figures, equations and tables: completeness, and every result in the output of its command."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from pathlib import Path
from typing import Final

import pytest

from controller.cli.main import COMMAND_LINE as CONTROLLER
from controller.common.errors import InputError
from plant_sim.cli.docs import papers_page
from plant_sim.cli.main import COMMAND_LINE as PLANT
from plant_sim.common.paper_items import ITEM_STATES, PaperItem, PaperName, paper_items, read_paper_items
from tests.paths import DOCS, ROOT
from tests.plant_sim.papers.claims import ITEMS, QUICK, SLOW, TESTS, check
from tests.sampling import one_in

PRINTED: Final[dict[PaperName, list[str]]] = {
    "pepper": [
        *(f"Figure {number}" for number in range(1, 9)),
        *(f"Figure 9{panel}" for panel in "abc"),
        *(f"Equation {number}" for number in range(1, 6)),
        *(f"Table {number}" for number in range(1, 6)),
    ],
    "cabbage": [
        *(f"Figure {number}" for number in range(1, 10)),
        *(f"Figure 10{panel}" for panel in "ab"),
        *(f"Figure 11{panel}" for panel in "abcd"),
        "Figure 12",
        *(f"Equation {number}" for number in range(1, 13)),
        *(f"Table {number}" for number in range(1, 4)),
    ],
}
"""Captions and numbered equations counted in the papers: [P] 9 figures, 5 equations, 5 tables; [K] 12, 12 and 3.

Panels have separate items where the text refers to each of them: [P] 3.3, [K] Fig. 10 and 3.2.2 to 3.2.3.
"""
LINES: Final = {"controller": CONTROLLER, "plant_sim": PLANT}
COMMANDS: Final = sorted({command for _, item in ITEMS for command in item.commands})


@pytest.mark.parametrize("paper", PRINTED)
def test_every_figure_equation_and_table_is_listed_once(paper: PaperName) -> None:
    listed = [item.item for item in paper_items(paper)]
    assert [name for name in listed if not name.startswith("Section")] == PRINTED[paper]
    assert max(Counter(listed).values()) == 1


@pytest.mark.parametrize(("paper", "item"), ITEMS, ids=lambda each: getattr(each, "item", each))
def test_the_state_of_an_item_is_supported(paper: PaperName, item: PaperItem) -> None:
    if item.state == "not reproducible":
        assert not item.commands
    elif item.state == "described":
        assert item.pages
    else:
        assert item.commands
        assert item.pages
    texts = (item.item, item.subject, item.result, item.erratum)
    assert not any("|" in text or "\n" in text for text in texts), f"{paper}: not a cell of a table"
    for page in item.pages:
        assert (DOCS / page.partition("#")[0]).is_file(), page


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_can_be_parsed_and_supports_a_result(command: str) -> None:
    program, *words = shlex.split(command)
    if program == TESTS:
        (path,) = words
        assert "def test_" in (ROOT / path).read_text(encoding="utf-8")
        return
    LINES[program].parser().parse_args(words)
    for paper, item in ITEMS:
        assert command not in item.commands or item.commands[command], f"{paper}, {item.item}: no text of the output"


@pytest.mark.parametrize(
    "command", one_in(8, [each for each in COMMANDS if each not in SLOW and not each.startswith(TESTS)])
)
def test_a_command_prints_the_stated_results(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check(command, ITEMS, tmp_path, capsys)


@pytest.mark.nightly
@pytest.mark.timeout(1_200)
@pytest.mark.parametrize("command", sorted(SLOW))
def test_a_slow_command_prints_the_stated_results(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command in COMMANDS
    check(command, ITEMS, tmp_path, capsys)


@pytest.mark.nightly
@pytest.mark.parametrize(("paper", "item"), ITEMS, ids=lambda each: getattr(each, "item", each))
def test_the_quick_commands_of_an_item_print_its_results(
    paper: PaperName, item: PaperItem, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The test that fails with a mutation of the item (test_mutations.py)."""
    for number, command in enumerate(item.commands):
        if command not in SLOW - QUICK and not command.startswith(TESTS):
            check(command, [(paper, item)], tmp_path / str(number), capsys)


# --- page and data file -------------------------------------------------------------------------


def test_the_page_has_a_row_for_every_item_and_the_totals() -> None:
    page = papers_page()
    for _, item in ITEMS:
        assert f"| {item.item} | {item.subject} | {item.state} | " in page
    assert len(re.findall(r"^\| (?:Figure|Equation|Table|Section) ", page, re.MULTILINE)) == len(ITEMS)
    for state in ITEM_STATES:
        pepper, cabbage = (sum(item.state == state for item in paper_items(paper)) for paper in PRINTED)
        assert f"| {state} | {pepper} | {cabbage} |\n" in page


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- item: Figur 1\n  subject: s\n  state: described\n  result: r\n", "entry 0.item: "),
        ("- item: Figure 1\n  subject: s\n  state: done\n  result: r\n", "entry 0.state: "),
        ("- item: Figure 1\n  subject: s\n  state: described\n", "entry 0.result: "),
        ("- item: Figure 1\n  subject: s\n  state: described\n  result: r\n  errata: e\n", "entry 0.errata: "),
        ("- {\n", "cannot be read"),
    ],
)
def test_an_invalid_data_file_is_rejected(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "items.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=rf"^{re.escape(f'{path}: {message}')}"):
        read_paper_items(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_paper_items(tmp_path / "missing.yaml")
