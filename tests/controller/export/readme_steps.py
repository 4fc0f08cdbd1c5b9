"""Tables of the README of a package, and their performance at the terminals of the plant."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from tests.controller.export.terminals import BLINKS, REST_MS, Rig, Terminals

ANSWER_MS: Final = 2_500
"""Duration of a press that answers, as in the table of the answers, ms."""
MOST_ANSWERS: Final = 4
"""Homings within which all questions must be answered."""
BUTTONS: Final = {"X0": "start", "X24": "stop", "X25": "emergency_stop"}
FIRST: Final = "First start and first trial:"
NEW: Final = "New machine, declared once at installation:"
CYCLE: Final = "Power cycle in the middle of a trial:"
STOP: Final = "Emergency stop in the middle of a trial:"
"""Titles of the tables."""


@dataclass(frozen=True)
class Step:
    """Row of a table."""

    action: str
    result: str
    within_ms: int
    lamp: str


def table(readme: str, title: str) -> list[Step]:
    """Return the rows of the table under a title."""
    _, found, after = readme.partition(f"\n{title}\n")
    assert found, title
    lines = after.partition("\n\n")[0].splitlines()
    rows = [[cell.strip() for cell in line.split("|")] for line in lines]
    assert rows[0] == ["do", "the machine", "within", "Y24"]
    return [Step(action, result, _ms(within), lamp) for action, result, within, lamp in rows[2:]]


def _ms(text: str) -> int:
    number, unit = text.split()
    assert unit == "s"
    return round(float(number) * 1_000)


def answers(readme: str) -> Mapping[tuple[int, str], tuple[str, str]]:
    """Return button and relay of each answer, by the number of the question and the meaning of the answer."""
    found: dict[tuple[int, str], tuple[str, str]] = {}
    question = 0
    for line in readme.partition("\nQuestions: ")[2].splitlines():
        if number := re.match(r"  (\d)  ", line):
            question = int(number[1])
        elif answer := re.fullmatch(r"     (yes|no): (?:press (X\d+) for 2\.5 s, or )?set (M\d+) \(.+\)", line):
            found[question, answer[1]] = (answer[2] or "", answer[3])
    return found


def perform(steps: Iterable[Step], rig: Rig, readme: str = "") -> list[str]:
    """Perform the rows of a table; return the differences from its results, each with its row.

    Args:
        steps: Rows.
        rig: PLC on the plant.
        readme: Text with the answers, for rows in which the operator answers.
    """
    operator = Terminals(rig)
    return [f"{step}: {fault}" for step in steps for fault in _faults(operator, step, readme)]


def _faults(operator: Terminals, step: Step, readme: str) -> Iterable[str]:
    if found := re.fullmatch(r"answer, press X0 for ([\d.]+ s), and repeat until Y24 is off", step.action):
        asked = _answer(operator, answers(readme), _ms(found[1]))
        if not re.search(rf"; [{''.join(map(str, asked)) or '-'}] flashes: ", step.result):
            yield f"asked: {asked}"
        return
    for_ms = _act(operator, step.action)
    kind = step.result.partition(",")[0]
    works = kind == "takes seedlings from the tray"
    reached = operator.takes(step.within_ms) if works else operator.rests(step.within_ms, for_ms)
    if not (works or kind == "stands still") or not reached:
        yield f"not {kind}"
    if step.lamp != "-" and (lamp := _lamp(operator.flashes())) != step.lamp:
        yield f"Y24: {lamp}"


def _answer(operator: Terminals, given: Mapping[tuple[int, str], tuple[str, str]], press_ms: int) -> list[int]:
    """Answer questions truly and home until none is asked; return the questions."""
    asked: list[int] = []
    for _ in range(MOST_ANSWERS):
        while (question := operator.flashes()) > 0:
            asked.append(question)
            operator.press(BUTTONS[given[question, operator.truth(question)][0]], ANSWER_MS)
        operator.press("start", press_ms)
        if operator.rests(60_000) and operator.flashes() == 0:
            return asked
    raise AssertionError(asked)


def _act(operator: Terminals, action: str) -> int:
    """Perform an action; return the time after which a machine without motion stands still, ms."""
    if action == "switch the PLC on":
        operator.run(1_000)
    elif found := re.fullmatch(r"press (X\d+) for ([\d.]+ s)", action):
        operator.press(BUTTONS[found[1]], _ms(found[2]))
    elif found := re.fullmatch(r"set (M\d+) \((.+)\)", action):
        operator.set_relay(found[1], found[2])
    elif found := re.fullmatch(r"switch the PLC off for (\d+ s)", action):
        operator.switch_off(_ms(found[1]))
    elif found := re.fullmatch(r"wait for (\d+ s)", action):
        operator.run(_ms(found[1]))
    elif found := re.fullmatch(r"wait until nothing has moved for (\d+ s)", action):
        return _ms(found[1])
    else:
        raise AssertionError(action)
    return REST_MS


def _lamp(flashes: int) -> str:
    return {0: "off", BLINKS: "blinks"}.get(flashes, f"{flashes} flashes")
