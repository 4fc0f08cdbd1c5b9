"""Answers of an operator who reads the amber lamp and sees the machine.

The reference program asks its questions by flashes and takes presses of X0 (yes) and X24 (no) of 2 to 10 s as answers
(docs/operating.md, "Answers with X0 and X24"). A program without questions leaves the lamp alone.
"""

from __future__ import annotations

from collections.abc import Generator

from plant_sim.hil.bench import Bench
from plant_sim.hil.procedure import Wait
from plant_sim.twin.ladder.question_lamp import ANSWER_MS, LAMP, PAUSE_MS, PERIOD_MS, asked_arm, button_of


def has_lamp(bench: Bench) -> bool:
    """Return True if the amber lamp is wired, without which nothing can be asked."""
    return LAMP in bench.module.plant.indicators


def answer(bench: Bench) -> Generator[Wait, bool, bool]:
    """Count the flashes of the lamp and answer the question truly; return whether there was one."""
    if not has_lamp(bench):
        return False
    question = yield from _flashes(bench)
    if question:
        arm = asked_arm(question)
        button = button_of(question, holds=arm is not None and bench.view.holds(arm))
        yield from bench.hold(button, ANSWER_MS)
        yield from bench.pause(1_000)
    return bool(question)


def _flashes(bench: Bench) -> Generator[Wait, bool, int]:
    """Return the number of flashes of a group that begins and ends with a pause; 0 = none within two periods."""
    lit = bench.module.plant.indicators
    end_ms = bench.now_ms + 2 * PERIOD_MS
    number, paused = 0, False
    while bench.now_ms < end_ms:
        if not (yield from bench.reached(lambda: not lit[LAMP], PERIOD_MS)):
            return 0
        if (yield from bench.reached(lambda: lit[LAMP], PAUSE_MS)):
            number += 1
        elif paused:
            return number
        elif (yield from bench.reached(lambda: lit[LAMP], PERIOD_MS)):
            number, paused = 1, True
        else:
            return 0
    return 0
