"""Limits: conditions that the program cannot exclude are listed, and the list is neither too short nor too long."""

from __future__ import annotations

from dataclasses import replace

import pytest

from controller.core.expr import Expr, all_of, any_of
from controller.core.rungs import Out
from controller.core.specification import Limit
from controller.program.tags import SIDES
from controller.verify.induction import CAUSE_LINES
from controller.verify.report import Report, Result, prove
from tests.controller.core.core_rig import x, y
from tests.controller.verify.proof_rig import SOUND, seconds
from tests.controller.verify.verify_rig import report_of, specification_of
from tests.sampling import first_of


def with_limit(condition: Expr) -> Report:
    """Return the report of a motor that runs only while X0 is on and X1 is off, with one listed limit."""
    sound = specification_of(Out(y(0), when=x(0) & ~x(1)), never=y(0) & x(1))
    limit = Limit("the limit", "X0 is believed", "a second switch", condition)
    return report_of(replace(sound, assumptions=("the motor stops at once",), limits=(limit,)))


def test_a_listed_limit_has_a_scan_that_shows_it() -> None:
    report = with_limit(y(0) & x(0))
    row = report.rows[-1]
    assert (row.name, row.result, report.good) == ("the limit", Result.LISTED, True)
    assert any("Y0 on" in line for line in row.lines)
    assert "remedy: a second switch" in report.text()


@pytest.mark.parametrize("inputs", [2, 20])
def test_the_cause_of_a_limit_has_few_lines(inputs: int) -> None:
    """It lists what is on, and counts what is off."""
    on, off = all_of(*(x(n) for n in range(inputs))), ~any_of(*(x(n) for n in range(30, 30 + inputs)))
    sound = specification_of(Out(y(0), when=on & off), never=y(0) & x(30))
    row = report_of(replace(sound, limits=(Limit("the limit", "believed", "a switch", y(0)),))).rows[-1]
    assert row.cause[:2] == ("reason: believed", "remedy: a switch")
    assert row.cause[2] == "in the first scan at the first power-up, sufficient:"
    listed = min(inputs, CAUSE_LINES - 4)
    more = [f"  and {inputs - listed} other values"] if inputs > listed else []
    assert row.cause[3 + listed :] == (*more, f"  and {inputs} devices that are off or 0", "  then: Y0 on")
    assert len(row.cause) <= 2 + CAUSE_LINES


def test_a_limit_that_is_proved_must_leave_the_list() -> None:
    report = with_limit(y(0) & x(1))
    assert (report.rows[-1].result, report.good) == (Result.DELISTED, False)


def test_a_requirement_that_is_not_proved_is_not_excused_by_a_limit() -> None:
    sound = specification_of(Out(y(0), when=x(0)), never=y(0) & x(1))
    limited = replace(sound, limits=(Limit("the limit", "X0 is believed", "a second switch", y(0) & x(1)),))
    assert not report_of(limited).good


def test_the_assumptions_are_the_first_lines_of_the_report() -> None:
    assert with_limit(y(0)).text().startswith("assumption 1: the motor stops at once\n")
    assert len(SOUND.assumptions) == 6


def test_both_arms_have_the_same_limits() -> None:
    left, right = ([each.name for each in SOUND.limits if each.name.startswith(side)] for side in SIDES)
    assert [name.removeprefix("left") for name in left] == [name.removeprefix("right") for name in right]
    assert len(left) == 7


@pytest.mark.nightly
@pytest.mark.parametrize("name", first_of(["left: inward, possibly past a row", *(each.name for each in SOUND.limits)]))
def test_no_limit_of_the_machine_can_be_proved(name: str) -> None:
    report = prove(SOUND, clock=seconds, only={name})
    row = next(row for row in report.rows if row.name == name)
    assert row.result is Result.LISTED
    assert row.trace is not None
