"""Steps by instruction and rung within the scans of a recorded run."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.common.errors import InputError
from controller.debug.commands import Debugger
from controller.debug.machine import RunPosition
from controller.debug.stepping import Stepper, StepUnit, last_of
from controller.debug.timeline import RunTimeline
from tests.controller.debug.step_program import on, recorded


@pytest.fixture
def line(tmp_path: Path) -> RunTimeline:
    return recorded(tmp_path)


def positions(line: RunTimeline, unit: StepUnit) -> list[RunPosition]:
    """Return every position of a run, from its beginning on."""
    stepper, found = Stepper(line.machine.observer), [RunPosition(line.first)]
    while (following := stepper.forward(line, found[-1], unit)) != found[-1]:
        found.append(following)
    return found


@pytest.mark.parametrize("unit", StepUnit)
def test_steps_back_are_the_steps_forward_in_reverse(unit: StepUnit, line: RunTimeline) -> None:
    there = positions(line, unit)
    assert {scan for scan, _ in there} == set(range(line.last + 1))
    stepper, back = Stepper(line.machine.observer), [there[-1]]
    while (before := stepper.back(line, back[-1], unit)) != back[-1]:
        back.append(before)
    assert back == there[::-1]


def test_a_rung_of_a_step_is_entered_only_while_the_step_is_active(line: RunTimeline) -> None:
    rungs = Stepper(line.machine.observer).reference
    motor = next(at for at, each in enumerate(line.machine.ladder.instructions) if str(each) == "OUT Y1")
    entered = [scan + 1 for scan, at in positions(line, StepUnit.RUNG) if at == rungs.rungs[rungs.rung_at(motor)].first]
    off = {scan + 1 for scan in on(line, "Y1") if scan < line.last}  # the scan after is executed without power
    assert entered == sorted({*on(line, "Y1"), *off}) != []


def test_a_rung_behind_a_jump_is_skipped(line: RunTimeline) -> None:
    counter = next(at for at, each in enumerate(line.machine.ladder.instructions) if str(each) == "LDP X0")
    entered = [scan + 1 for scan, at in positions(line, StepUnit.INSTRUCTION) if at == counter]
    assert entered == [scan for scan in range(1, line.last + 1) if scan not in on(line, "X1")]


def test_every_scan_is_recomputed_as_it_was(line: RunTimeline) -> None:
    observer = line.machine.observer
    assert [observer.observe(line, scan).differing for scan in range(1, line.last + 1)] == [()] * line.last
    with pytest.raises(InputError, match="not recorded"):
        observer.observe(line, line.last + 1)


def test_a_scan_that_is_not_the_recorded_one_is_named(line: RunTimeline, monkeypatch: pytest.MonkeyPatch) -> None:
    observer = line.machine.observer
    run = observer.records.run

    def damaged(now_ms: int) -> None:
        run(now_ms)
        observer.records.memory.CV[0] = 7

    monkeypatch.setattr(observer.records, "run", damaged)
    assert observer.observe(line, 20).differing == ("C0",)


def test_the_console_goes_by_rung_and_to_a_rung(line: RunTimeline) -> None:
    debugger = Debugger(line)
    steps = ["goto 6", "until rung 4", "forward 1 instruction", "back 2 rungs", "forward 9 rungs", "forward 1 scan"]
    answers = [list(debugger.execute(step)) for step in steps]
    assert answers[1] == [
        "scan 6, 0.60 s; scan 7 before rung 4, step 8: run",
        "  8 OUT Y1                         driven",
        "  9 OUT T0 K3                      driven",
    ]
    assert answers[2][0].startswith("scan 6, 0.60 s; scan 7 before rung 4, step 9")
    assert debugger.scan == 8
    assert last_of(debugger.stepper.to_rung(line, RunPosition(line.last), 4)) is None
    assert list(debugger.execute("until rung 4"))[-1].startswith("  9 OUT T0")


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("until rung 99", r"rung 99: no such rung; choose one from 0 to \d+"),
        ("back 1 lap", "back 1 lap: write back N scan, step, rung or instruction"),
    ],
)
def test_an_invalid_step_has_a_clear_answer(command: str, answer: str, line: RunTimeline) -> None:
    with pytest.raises(InputError, match=answer):
        list(Debugger(line).execute(command))
