"""Questions by flashes of the amber lamp: what an operator counts, and the button of the true answer."""

from __future__ import annotations

import pytest

from plant_sim.twin.ladder.question_lamp import (
    CUPS_EMPTY,
    FULL_TRAY,
    LEFT_LOADED,
    NO_TRAY,
    PAUSE_MS,
    PERIOD_MS,
    RIGHT_LOADED,
    SAME_TRAY,
    QuestionLamp,
    asked_arm,
    button_of,
)

SCAN_MS = 10
FLASH_MS = 300


def look(lamp: QuestionLamp, flashes: int, *, now_ms: int = 0, until_ms: int = PERIOD_MS) -> int:
    """Let the lamp flash, and then be dark; return the time of the end, ms."""
    for at_ms in range(0, until_ms, SCAN_MS):
        flash, phase_ms = divmod(at_ms, 2 * FLASH_MS)
        lamp.update(now_ms + at_ms, is_lit=flash < flashes and phase_ms < FLASH_MS)
    return now_ms + until_ms


@pytest.mark.parametrize("flashes", range(1, 7))
def test_the_flashes_of_a_complete_group_are_counted(flashes: int) -> None:
    """The first group is not counted, because its beginning may have been missed."""
    lamp = QuestionLamp()
    now_ms = look(lamp, flashes)
    assert lamp.flashes == 0
    end_ms = look(lamp, flashes, now_ms=now_ms, until_ms=2 * FLASH_MS * flashes - FLASH_MS + PAUSE_MS)
    assert lamp.flashes == 0, "the pause is not over"
    lamp.update(end_ms, is_lit=False)
    assert lamp.flashes == flashes


def test_a_question_is_over_when_the_lamp_stays_dark() -> None:
    lamp = QuestionLamp()
    now_ms = look(lamp, 5, now_ms=look(lamp, 5))
    assert lamp.flashes == 5
    now_ms = look(lamp, 0, now_ms=now_ms, until_ms=PERIOD_MS)
    assert lamp.flashes == 5
    look(lamp, 0, now_ms=now_ms, until_ms=PERIOD_MS)
    assert lamp.flashes == 0


def test_another_question_replaces_the_first_one() -> None:
    lamp = QuestionLamp()
    now_ms = look(lamp, 2, now_ms=look(lamp, 2))
    look(lamp, 4, now_ms=now_ms)
    assert lamp.flashes == 4


def test_a_lamp_that_is_lit_steadily_asks_nothing() -> None:
    lamp = QuestionLamp()
    for at_ms in range(0, 4 * PERIOD_MS, SCAN_MS):
        lamp.update(at_ms, is_lit=at_ms > PERIOD_MS)
    assert lamp.flashes == 0


@pytest.mark.parametrize(
    ("question", "holds", "button"),
    [
        (LEFT_LOADED, True, "start"),
        (LEFT_LOADED, False, "stop"),
        (RIGHT_LOADED, True, "start"),
        (RIGHT_LOADED, False, "stop"),
        (SAME_TRAY, False, "start"),
        (FULL_TRAY, False, "start"),
        (NO_TRAY, False, "stop"),
        (CUPS_EMPTY, False, "start"),
    ],
)
def test_the_button_of_the_true_answer(question: int, holds: bool, button: str) -> None:
    assert button_of(question, holds=holds) == button
    assert asked_arm(question) == {LEFT_LOADED: "left", RIGHT_LOADED: "right"}.get(question)
