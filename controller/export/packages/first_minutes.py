"""First ten minutes with a package: first start, first trial and power cycle, for the README of every package.

Every row of the tables is an action at the terminals and its result. The tests read the rows and perform them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from textwrap import fill
from typing import Final

from controller.common.modbus.io_map import IoMap

SHORT, LONG = "0.2 s", "2.5 s"
"""Durations of a press that starts and of one that answers."""
FIRST_QUESTION: Final = 5
"""Question at the first start without a declaration, with no tray at the sensor."""
SAME_TRAY: Final = 3
"""Question after an emergency stop, whatever memory the runtime has."""
NEW_MACHINE: Final = 458
"""Relay of the command that declares a new machine."""


WIDTH: Final = 120
_WITH_LAMP: Final = (
    "Questions: every 7 s, Y24 repeats as many flashes as the number of the question. Press for 2 s to 10 s, "
    "until Y24 stays on, and release it. A tool or a client can set the relay instead; the program resets it."
)
_WITHOUT_LAMP: Final = (
    "Questions: without the amber lamp, the buttons answer nothing. A tool or a client sets the relay of the answer; "
    "the program resets it. After a power cycle or an emergency stop, press X0, set the relays of the true answers to "
    "questions 1 to 5, and press X0 again: an answer that is not asked has no effect."
)
_INTRODUCTION: Final = """\
THE FIRST TEN MINUTES

With the buttons X0 (start), X24 (stop) and X25 (emergency stop), and the amber lamp Y24 if it is wired; no panel is
needed. Switch the air and the cups on, put full trays into the magazine, and leave no tray at the sensor X15. If a row
ends otherwise than stated, press X25, and read the guide "Operating the machine".
"""


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer to a question.

    Attributes:
        means: Meaning of the answer.
        button: Button that gives it.
        relay: Number of the relay that gives it.
    """

    means: str
    button: str
    relay: int


@dataclass(frozen=True, slots=True)
class Asked:
    """Question of the program.

    Attributes:
        flashes: Number of flashes of the amber lamp.
        text: Question.
        answers: Answers that are possible.
        remedy: What to do if no answer is true.
    """

    flashes: int
    text: str
    answers: tuple[Answer, ...]
    remedy: str = ""


QUESTIONS: Final = (
    Asked(1, "Is the left arm holding seedlings?", (Answer("yes", "X0", 422), Answer("no", "X24", 423))),
    Asked(2, "Is the right arm holding seedlings?", (Answer("yes", "X0", 425), Answer("no", "X24", 426))),
    Asked(
        3,
        "A tray is seen: is it the same one, not moved?",
        (Answer("yes", "X0", 418),),
        "no: put it back to its mark, or remove it",
    ),
    Asked(4, "A tray is seen: treat it as full?", (Answer("yes", "X0", 419),), "no: remove it"),
    Asked(5, "No tray is seen: feed one?", (Answer("yes", "X24", 420),), "no: push the tray under the sensor X15"),
    Asked(6, "Are the cups under the claws empty?", (Answer("yes", "X0", 417),), "no: wait for twelve cups"),
)
"""Questions by the number of flashes; `controller/program/operator/answers.py` asks them."""


@dataclass(frozen=True, slots=True)
class KeptMemory:
    """Retentive memory of a runtime, as the questions show it.

    Attributes:
        later: Question that is always asked after a loss of power in the middle of a trial.
        note: Explanation for the README.
    """

    later: int
    note: str


@dataclass(frozen=True, slots=True)
class TableEntry:
    """Action of a table, its result, the time until it, and the amber lamp."""

    action: str
    result: str
    within_s: int
    lamp: str


def first_minutes(io_map: IoMap, memory: KeptMemory, coil: Callable[[int], str]) -> str:
    """Return the section of the README.

    Args:
        io_map: I/O map; without an amber lamp, questions are answered by relays.
        memory: Questions that the memory of the runtime leads to.
        coil: Function that returns the place of a command relay for a client or a tool.
    """
    lamp = io_map.get("lamp_amber") is not None
    works = TableEntry(f"press X0 for {SHORT}", "takes seedlings from the tray", 20, "-")
    ends = TableEntry("wait until nothing has moved for 20 s", "stands still, the trays are empty", 600, "blinks")
    busy = TableEntry("wait for 15 s", "takes seedlings from the tray", 20, "-")
    trial = [
        TableEntry("switch the PLC on", "stands still", 20, "off"),
        *_start(coil, lamp=lamp),
        works,
        ends,
    ]
    later = replace(works, within_s=120)  # after a loss of memory, the arms first close on rows that are empty
    cycle = [busy, TableEntry("switch the PLC off for 1 s", "stands still", 20, "-"), _again(memory.later), later, ends]
    stop = [
        busy,
        TableEntry("press X25 for 5 s", "stands still, at once", 10, "off"),
        TableEntry("press X24 for 3.5 s", "stands still", 20, "-"),
        _again(SAME_TRAY),
        later,
        ends,
    ]
    declared = [
        TableEntry("switch the PLC on", "stands still, its memory is lost", 20, "off"),
        TableEntry(_set(NEW_MACHINE, coil), "stands still, its memory is valid", 20, "off"),
        TableEntry(
            f"press X0 for {SHORT}", "stands still, ready; any tray has left, and the next one has come", 120, "off"
        ),
        works,
        ends,
    ]
    tables = {
        "First start and first trial": trial,
        "New machine, declared once at installation": declared,
    }
    if lamp:
        tables |= {"Power cycle in the middle of a trial": cycle, "Emergency stop in the middle of a trial": stop}
    parts = [line for title, rows in tables.items() for line in (f"{title}:", *_table(rows, lamp=lamp), "")]
    return "\n".join((_INTRODUCTION, *parts, fill(memory.note, WIDTH), "", *_questions(coil, lamp=lamp), ""))


def _again(least: int) -> TableEntry:
    """Return the row from an interrupted trial to Idle, with the question that is always asked."""
    answered = f"stands still, ready; {least} flashes: {_question(least).text}"
    return TableEntry(f"answer, press X0 for {SHORT}, and repeat until Y24 is off", answered, 300, "off")


def _question(number: int) -> Asked:
    return next(each for each in QUESTIONS if each.flashes == number)


def _start(coil: Callable[[int], str], *, lamp: bool) -> list[TableEntry]:
    """Return the rows from Stopped to Idle, with the question about the memory that is lost."""
    home = f"press X0 for {SHORT}"
    question = _question(FIRST_QUESTION)
    answer = question.answers[0]
    act = f"press {answer.button} for {LONG}" if lamp else _set(answer.relay, coil)
    return [
        TableEntry(home, f"stands still, asks: {question.text}", 60, f"{question.flashes} flashes"),
        TableEntry(act, f"stands still, answered: {answer.means}", 20, "off"),
        TableEntry(home, "stands still, ready", 60, "off"),
    ]


def _set(relay: int, coil: Callable[[int], str]) -> str:
    """Return the action that gives a command by its relay."""
    return f"set M{relay} ({coil(relay)})"


def _table(rows: Sequence[TableEntry], *, lamp: bool) -> list[str]:
    cells = [("do", "the machine", "within", "Y24")]
    cells += [(row.action, row.result, f"{row.within_s} s", row.lamp if lamp else "-") for row in rows]
    widths = [max(len(row[column]) for row in cells) for column in range(4)]
    lines = [
        "  " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in cells
    ]
    return [lines[0], "  " + "-+-".join("-" * width for width in widths), *lines[1:]]


def _questions(coil: Callable[[int], str], *, lamp: bool) -> list[str]:
    """Return the text about the questions and the table of their answers."""
    rows = [fill(_WITH_LAMP if lamp else _WITHOUT_LAMP, WIDTH)]
    for each in QUESTIONS:
        rows.append(f"  {each.flashes}  {each.text}")
        for answer in each.answers:
            button = f"press {answer.button} for {LONG}, or " if lamp else ""
            rows.append(f"     {answer.means}: {button}{_set(answer.relay, coil)}")
        if each.remedy:
            rows.append(f"     {each.remedy}")
    return rows
