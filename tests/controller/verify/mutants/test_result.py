"""Mutation score, its tables, and the list of survivors."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from controller.verify.mutants.change import Kind
from controller.verify.mutants.result import (
    Fate,
    MutantResult,
    as_csv,
    as_markdown,
    as_text,
    listed_survivors,
    score,
    with_listed,
)

RESULTS = [
    MutantResult("block: a", Kind.CONTACT, Fate.PROOF, "goal"),
    MutantResult("block: b", Kind.CONTACT, Fate.STORY, "story: counts"),
    MutantResult("block: c | d", Kind.TERM, Fate.DURATION, "time"),
    MutantResult("block: e", Kind.TERM, Fate.EQUIVALENT, "equal"),
    MutantResult("block: f", Kind.PRESET, Fate.OPEN, ""),
]


def test_equivalent_mutants_do_not_count() -> None:
    """Two of the four mutants that are not equivalent are killed."""
    assert score(RESULTS) == pytest.approx(0.5)
    assert score([RESULTS[3]]) == pytest.approx(1.0)


def test_the_text_names_every_survivor() -> None:
    text = as_text(RESULTS, 1.0)
    assert "mutation score 50.0 %" in text
    assert "not classified: block: f (preset changed)" in text
    assert "block: a" not in text


def test_the_csv_file_contains_every_result() -> None:
    rows = list(csv.DictReader(as_csv(RESULTS).splitlines()))
    assert [row["mutant"] for row in rows] == [each.name for each in RESULTS]
    assert rows[0]["evidence"] == "goal"


def test_the_page_contains_scores_and_survivors() -> None:
    page = as_markdown(RESULTS, dict.fromkeys(Kind, 7), "the command")
    assert "| contact inverted | 7 | 2 | 1 | 1 | 0 | 0 | 0 | 100 % |" in page
    assert "| block: c \\| d | duration | time |" in page
    assert "| block: e |" in page


@pytest.mark.parametrize("row", ["block: f,equivalent,I think so", "block: f,liveness, "])
def test_the_list_cannot_replace_a_proof_or_a_reason(tmp_path: Path, row: str) -> None:
    """Equivalence must be proved, and every class requires a reason."""
    path = tmp_path / "list.csv"
    path.write_text(f"mutant,class,reason\n{row}\n", encoding="utf-8")
    with pytest.raises(ValueError, match="line 2"):
        listed_survivors(path)


def test_only_unclassified_survivors_take_their_class_from_the_list(tmp_path: Path) -> None:
    path = tmp_path / "list.csv"
    path.write_text("mutant,class,reason\nblock: f,liveness,waits\nblock: a,gap,none\n", encoding="utf-8")
    results = with_listed(RESULTS, listed_survivors(path))
    assert results[4] == MutantResult("block: f", Kind.PRESET, Fate.LIVENESS, "waits")
    assert results[:4] == RESULTS[:4]
