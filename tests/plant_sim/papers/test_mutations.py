"""Checks of the papers' items have teeth: they fail when the calculation behind the item is changed."""

from __future__ import annotations

import random
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pytest
import yaml

from plant_sim.common.paper_items import PaperItem, PaperName
from tests.paths import ROOT
from tests.plant_sim.papers.claims import ITEMS, QUICK, SLOW, TESTS
from tests.suite.planting import SourceCopy

HERE: Final = Path(__file__).parent
LIST: Final = HERE / "mutations.yaml"
CHECK: Final = "tests/plant_sim/papers/test_items.py::test_the_quick_commands_of_an_item_print_its_results"
SAMPLE: Final = 10
SEED: Final = 43
LIMIT_S: Final = 900
ONE_TEST_FAILED: Final = 1


@dataclass(frozen=True)
class Mutation:
    """Change of the calculation behind an item.

    Attributes:
        file: Changed source or data file, relative to the root.
        old: Unique fragment of the file.
        new: Its replacement.
    """

    file: str
    old: str
    new: str


def load() -> dict[tuple[str, str], Mutation]:
    """Return the mutations by paper and item."""
    content: dict[str, dict[str, Any]] = yaml.safe_load(LIST.read_text(encoding="utf-8"))
    return {(paper, item): Mutation(**entry) for paper, items in content.items() for item, entry in items.items()}


MUTATIONS: Final = load()


def is_quick(item: PaperItem) -> bool:
    return any(command not in SLOW - QUICK for command in item.commands)


def is_calculated(item: PaperItem) -> bool:
    """Return True for a figure or table that is not only described."""
    return item.item.startswith(("Figure", "Table")) and item.state != "described" and is_quick(item)


NEEDED: Final = [
    (paper, item) for paper, item in ITEMS if item.state == "reproduced" or item.item.startswith("Equation")
]
OTHERS: Final = [(paper, item) for paper, item in ITEMS if is_calculated(item) and (paper, item) not in NEEDED]
DRAWN: Final = random.Random(SEED).sample(OTHERS, SAMPLE)


def test_every_reproduced_item_and_every_equation_has_a_mutation_and_so_has_every_calculated_figure_and_table() -> None:
    assert {(paper, item.item) for paper, item in (*NEEDED, *OTHERS)} == MUTATIONS.keys()
    equations = [item.item for _, item in NEEDED if item.item.startswith("Equation")]
    assert len(equations) == 5 + 12


@pytest.mark.parametrize("key", MUTATIONS, ids=" ".join)
def test_a_mutation_applies_to_one_place(key: tuple[str, str]) -> None:
    mutation = MUTATIONS[key]
    assert (ROOT / mutation.file).read_text(encoding="utf-8").count(mutation.old) == 1
    assert mutation.old != mutation.new


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> SourceCopy:
    return SourceCopy(tmp_path_factory.mktemp("mutations"), ROOT)


@pytest.mark.nightly
@pytest.mark.timeout(LIMIT_S)
@pytest.mark.parametrize(("paper", "item"), [*NEEDED, *DRAWN], ids=lambda each: getattr(each, "item", each))
def test_the_checks_of_an_item_fail_with_its_mutation(copy: SourceCopy, paper: PaperName, item: PaperItem) -> None:
    mutation = MUTATIONS[paper, item.item]
    text = (copy.root / mutation.file).read_text(encoding="utf-8")
    named = [command.split()[1] for command in item.commands if command.startswith(TESTS)]
    with copy.planted(mutation.file, text.replace(mutation.old, mutation.new)):
        outcome = copy.run([f"{CHECK}[{paper}-{item.item}]", *named], LIMIT_S, marks="not weekly")
    assert outcome.code == ONE_TEST_FAILED, outcome.output[-2_000:]
    assert "AssertionError" in outcome.output or "assert " in outcome.output, outcome.output[-2_000:]
