"""Fault matrix: cases of single sizes with expectations of their own, and the selection of rows by part."""

from __future__ import annotations

from functools import cache

import pytest

from plant_sim.fault_matrix.cases import SIZES, subjects
from plant_sim.fault_matrix.expected import FURTHER_CASES, Expectation
from plant_sim.fault_matrix.judge import expectation
from plant_sim.faults import FaultError
from plant_sim.machine.plant import Plant
from plant_sim.twin.lock_step import Twin

OWN = Expectation(frozenset({"lift from row"}))


@cache
def plant() -> Plant:
    return Twin().plant


def test_a_further_case_follows_those_of_its_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    before = subjects(plant())
    monkeypatch.setitem(FURTHER_CASES, "slow_valve:lift=4000 ms", OWN)
    after = subjects(plant())
    (row,) = [subject for subject in after if subject not in before]
    assert (str(row), row.targets) == ("slow_valve:lift=4", ("left.lift", "right.lift"))
    assert [subject for subject in after if subject != row] == before
    assert after[after.index(row) - 1].kind == "slow_valve"
    assert expectation(row) == OWN


def test_a_further_case_belongs_to_one_part_and_has_no_other_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(FURTHER_CASES, "slow_valve:lift=4", OWN)
    assert {subject.size for subject in subjects(plant(), ["slow_valve:slide"])} == {*SIZES["slow_valve"]}
    assert [subject.size for subject in subjects(plant(), ["slow_valve:lift"], [0.5])] == [0.05, 0.25]
    *_, row = subjects(plant(), ["slow_valve:right.lift"])
    assert (row.size, row.targets) == (4, ("right.lift",))


def test_a_further_case_of_a_listed_size_replaces_its_expectation_only(monkeypatch: pytest.MonkeyPatch) -> None:
    before = subjects(plant())
    monkeypatch.setitem(FURTHER_CASES, "slow_valve:lift=0.5", OWN)
    assert subjects(plant()) == before
    assert [expectation(subject) == OWN for subject in subjects(plant(), ["slow_valve:lift"])] == [False, True]


def test_a_part_selects_the_rows_of_both_arms() -> None:
    rows = subjects(plant(), ["slow_valve:lift"])
    assert rows == [subject for subject in subjects(plant()) if (subject.kind, subject.part) == ("slow_valve", "lift")]
    assert [subject.targets for subject in rows] == [("left.lift", "right.lift")] * 2
    assert subjects(plant(), ["missing_cells:tray"]) == subjects(plant(), ["missing_cells"])


@pytest.mark.parametrize(
    ("key", "complaint"),
    [
        ("slow_valve:lfit=4", "FURTHER_CASES: slow_valve:lfit: is not a part of the matrix; did you mean lift?"),
        (
            "slow_valve:left.lift=4",
            "FURTHER_CASES: slow_valve:left.lift: is not a part of the matrix; did you mean lift",
        ),
        ("slow_valve:lift=4@5s..", "FURTHER_CASES: slow_valve:lift=4@5s..: the times are random; remove them"),
        ("slow_valv:lift=4", "slow_valv: unknown fault; did you mean slow_valve?"),
        ("slow_valve:lift=1 min", "slow_valve:lift: size must be 0.001 to 10 s, not 60"),
        ("slow_valve:lift", "slow_valve:lift: requires a size"),
    ],
)
def test_a_key_that_is_no_row_is_rejected_in_one_line(
    key: str, complaint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(FURTHER_CASES, key, OWN)
    with pytest.raises(FaultError) as error:
        subjects(plant())
    assert str(error.value).startswith(complaint)
