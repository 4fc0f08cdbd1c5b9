"""Questions that a program asks with the amber lamp, as an operator reads and answers them.

The reference program asks by groups of flashes and takes presses of X0 and X24 of 2 to 10 s as answers
(docs/operating.md, "Answers with X0 and X24"). A program without questions leaves the lamp alone.
"""

from __future__ import annotations

from typing import Final

from controller.program.tags import SIDES, Side

LAMP: Final = "lamp_amber"
PERIOD_MS: Final = 7_000
"""Period after which the lamp repeats its flashes, ms."""
PAUSE_MS: Final = PERIOD_MS // 4
"""Time without light that separates two groups of flashes, ms."""
ANSWER_MS: Final = 2_200
"""Duration of a press that answers, ms; 2 to 10 s are required."""
LEFT_LOADED, RIGHT_LOADED, SAME_TRAY, FULL_TRAY, NO_TRAY, CUPS_EMPTY = range(1, 7)


class QuestionLamp:
    """Counter of the flashes in a group that begins and ends with a pause.

    Attributes:
        flashes: Flashes of the last complete group, since the lamp has been dark for less than two periods; 0 = none.
    """

    def __init__(self) -> None:
        """Create a counter that has not seen the lamp yet."""
        self.flashes = 0
        self._is_lit = True
        self._changed_ms: int | None = None
        self._counted = -1  # flashes of the present group; -1 = its beginning was not seen

    def update(self, now_ms: int, *, is_lit: bool) -> None:
        """Take the level of the lamp."""
        if self._changed_ms is None or is_lit != self._is_lit:
            dark_ms = 0 if self._changed_ms is None or self._is_lit else now_ms - self._changed_ms
            if is_lit and dark_ms >= PAUSE_MS:
                self._counted = 1
            elif is_lit and self._counted > 0:
                self._counted += 1
            self._is_lit, self._changed_ms = is_lit, now_ms
        if is_lit:
            return
        dark_ms = now_ms - self._changed_ms
        if dark_ms >= 2 * PERIOD_MS:
            self.flashes, self._counted = 0, -1
        elif dark_ms >= PAUSE_MS and self._counted > 0:
            self.flashes, self._counted = self._counted, 0


def asked_arm(question: int) -> Side | None:
    """Return the arm whose claws a question is about; None = it is about something else."""
    return {LEFT_LOADED: SIDES[0], RIGHT_LOADED: SIDES[1]}.get(question)


def button_of(question: int, *, holds: bool) -> str:
    """Return the button of the true answer to a question.

    Args:
        question: Number of flashes.
        holds: Whether the arm that it is about holds seedlings.
    """
    is_yes = question != NO_TRAY if asked_arm(question) is None else holds
    return "start" if is_yes else "stop"
