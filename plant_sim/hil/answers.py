"""Answers of an operator who reads the amber lamp and sees the machine.

The reference program asks its questions by flashes and takes presses of X0 (yes) and X24 (no) of 2 to 10 s as answers
(docs/operating.md, "Answers with X0 and X24"). A program without questions leaves the lamp alone.
"""

from __future__ import annotations

from typing import Final

from plant_sim.hil.bench import Bench
from plant_sim.hil.procedure import Procedure

LAMP: Final = "lamp_amber"
PERIOD_MS: Final = 7_000
"""Period after which the lamp repeats its flashes, ms."""
HOLD_MS: Final = 2_200
"""Duration of a press that answers, ms; 2 to 10 s are required."""
LEFT_LOADED, RIGHT_LOADED, SAME_TRAY, FULL_TRAY, NO_TRAY, CUPS_EMPTY = range(1, 7)


def has_lamp(bench: Bench) -> bool:
    """Return True if the amber lamp is wired, without which nothing can be asked."""
    return LAMP in bench.module.plant.indicators


def answer(bench: Bench) -> Procedure:
    """Count the flashes of the lamp in two periods and answer the question truly; no effect without flashes."""
    if not has_lamp(bench):
        return
    lit = bench.module.plant.indicators
    rises_ms: list[int] = []
    was_lit = lit[LAMP]
    end_ms = bench.now_ms + 2 * PERIOD_MS

    def watch() -> bool:
        nonlocal was_lit
        if lit[LAMP] and not was_lit:
            rises_ms.append(bench.now_ms)
        was_lit = lit[LAMP]
        return False

    yield from bench.reached(watch, end_ms - bench.now_ms)
    question = _flashes(rises_ms)
    if question:
        yield from bench.hold("start" if _is_yes(bench, question) else "stop", HOLD_MS)
        yield from bench.pause(1_000)


def _flashes(rises_ms: list[int]) -> int:
    """Return the number of flashes of a complete group; 0 if there is none."""
    groups: list[list[int]] = []
    for at_ms in rises_ms:
        if not groups or at_ms - groups[-1][-1] > PERIOD_MS // 4:
            groups.append([])
        groups[-1].append(at_ms)
    return len(groups[1]) if len(groups) > 1 else 0


def _is_yes(bench: Bench, question: int) -> bool:
    if question in (LEFT_LOADED, RIGHT_LOADED):
        return bench.view.holds("left" if question == LEFT_LOADED else "right")
    return question in (SAME_TRAY, FULL_TRAY, CUPS_EMPTY)
