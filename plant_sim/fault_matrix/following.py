"""Operator who knows nothing of the machine but the line that says what to do now, from a stop to Execute.

The register of the next press (`controller.program.operator.next_press`) is all that this operator reads. What a line
asks the operator to look at - claws, cups, a tray - is answered truthfully.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from controller.core.expr import any_of
from controller.program.operator.next_press import NextPress
from controller.program.states import State
from plant_sim.twin.lock_step import CLEAR_MS, SCAN_MS, NotReachedError, Twin
from plant_sim.twin.recovery import HOMING_LIMIT_MS, press_emergency_stop, true_tray

PRESS_MS: Final = 100
"""Duration of a press of X0 that homes or starts, ms."""
ANSWER_MS: Final = 2_300
"""Duration of a press that answers, ms; 2 to 10 s are required."""
SETTLE_MS: Final = 500
"""Time after which the operator reads the line again, ms: debounced inputs, and a question after a stop."""
CUPS_MS: Final = 20_000
"""Longest time in which twelve cups pass, ms."""
READING_MS: Final = 1_000
"""Interval at which the panel that shows the line reads the controller, ms."""
MOST_PRESSES: Final = 4
"""Most presses from a stop to Execute without a question: release X25, clear, home, start."""
PER_QUESTION: Final = 2
"""Most further presses for each question: the answer, and X0 to home again."""
_LIMIT: Final = 20
"""Lines after which the operator gives up."""
_RESTS: Final = (State.STOPPED, State.HELD, State.ABORTED, State.IDLE, State.SUSPENDED, State.COMPLETE, State.EXECUTE)


class Followed(NamedTuple):
    """Presses from a stop to Execute.

    Attributes:
        isolated: True if the machine was isolated before the repair.
        presses: Number of presses and releases of buttons.
        questions: Number of questions answered.
        lines: Numbers of the lines followed, in order.
        why: Reason why Execute was not reached, or why a line was wrong; empty if there is none.
    """

    isolated: bool
    presses: int
    questions: int
    lines: tuple[NextPress, ...]
    why: str

    @property
    def is_short(self) -> bool:
        """True if Execute was reached with at most `MOST_PRESSES`, and `PER_QUESTION` more for each question."""
        return not self.why and self.presses <= MOST_PRESSES + PER_QUESTION * self.questions

    @property
    def names(self) -> str:
        """Names of the lines followed."""
        return ", ".join(line.name for line in self.lines)


def follow(twin: Twin, repair: Callable[[], None], *, isolated: bool) -> Followed:
    """Mend the cause of a stop, follow the line to Execute, and leave the twin as it was before.

    Args:
        twin: Twin at rest after a stop.
        repair: Function that mends the cause.
        isolated: True to isolate the machine first: the emergency stop remains latched during the repair.
    """
    before = twin.snapshot()
    twin.unwatch()
    twin.every(READING_MS, lambda each: each.runtime.panel.read())
    operator = _Follower(twin)
    why = ""
    try:
        if isolated:
            press_emergency_stop(twin)
        repair()
        operator.work()
    except NotReachedError as error:
        why = str(error)
    followed = Followed(isolated, operator.presses, operator.questions, tuple(operator.lines), why)
    twin.restore(before)
    return followed


class _Follower:
    def __init__(self, twin: Twin) -> None:
        self.presses = self.questions = 0
        self.lines: list[NextPress] = []
        self._twin = twin

    def work(self) -> None:
        """Follow the line until the machine is in Execute without a line.

        Raises:
            NotReachedError: A line is refused or has no effect, there is none at rest, or there are too many.
        """
        twin, machine = self._twin, self._twin.machine.tags.machine
        at_rest = any_of(*(machine.state.equals(state) for state in _RESTS))
        works = machine.state.equals(State.EXECUTE)
        while len(self.lines) < _LIMIT:
            twin.run_until(at_rest, within_ms=HOMING_LIMIT_MS, what="rest")
            twin.run_for(SETTLE_MS)
            line = NextPress(twin.plc.read(machine.next_press))
            if line is NextPress.NONE:
                twin.run_until(works, within_ms=CUPS_MS, what="Execute without a line")
                return
            if twin.state is State.COMPLETE and NextPress.START in self.lines:
                return  # there was nothing left to do
            self.lines.append(line)
            refusals = twin.plc.read(machine.refusals)
            self._obey(line)
            if twin.plc.read(machine.refusals) != refusals:
                raise NotReachedError(f"{line.name} is refused; {twin.situation()}")
        raise NotReachedError(f"{_LIMIT} lines followed; {twin.situation()}")

    def _obey(self, line: NextPress) -> None:
        box = self._twin.plant.box
        match line:
            case NextPress.RELEASE_EMERGENCY_STOP:
                box.emergency_stop = False
                self._press("stop", CLEAR_MS, count=2)
            case NextPress.CLEAR:
                self._press("stop", CLEAR_MS)
            case NextPress.REMOVE_FAULT:
                self._press("stop", CLEAR_MS)  # the cause has been mended
            case NextPress.CONFIRM_CONSTANTS:
                self._press("emergency_stop", PRESS_MS, count=2)
            case NextPress.RELEASE_STOP:
                box.stop = False
                self.presses += 1
                self._twin.run_for(SETTLE_MS)
            case (
                NextPress.HOME | NextPress.START | NextPress.SEARCH_TRAY | NextPress.REPAIR_AND_HOME | NextPress.RESUME
            ):
                self._press("start", PRESS_MS)
            case _ if line in _ANSWERS:
                self.questions += 1
                _ANSWERS[line](self)
            case _:
                raise NotReachedError(f"{line.name} has no button; {self._twin.situation()}")

    def _press(self, button: str, for_ms: int, *, count: int = 1) -> None:
        self._twin.press(button, for_ms=for_ms)
        self._twin.run_for(for_ms + 10 * SCAN_MS)
        self.presses += count

    def answer(self, *, yes: bool) -> None:
        """Hold X0 for yes, X24 for no."""
        self._press("start" if yes else "stop", ANSWER_MS)

    def answer_loaded(self, side: str) -> None:
        """Answer whether an arm holds seedlings."""
        self.answer(yes=bool(self._twin.plant.arms[side].grip.held))

    def answer_tray_seen(self, *uses: str) -> None:
        """Accept the tray that the sensor sees, or take it off."""
        if true_tray(self._twin) in uses:
            self.answer(yes=True)
        else:
            self._take_tray_off()

    def _take_tray_off(self) -> None:
        """Take off the tray that the sensor sees."""
        conveyor = self._twin.plant.conveyor
        for number in conveyor.in_beam:
            conveyor.take_off(number)

    def answer_no_tray(self) -> None:
        """Have a tray fed."""
        self.answer(yes=False)

    def answer_cups(self) -> None:
        """Wait for twelve cups."""
        question = self._twin.machine.tags.machine.question
        asked = question.equals(self._twin.plc.read(question))
        self._twin.run_until(~asked, within_ms=CUPS_MS, what="twelve cups")


_ANSWERS: Final[Mapping[NextPress, Callable[[_Follower], None]]] = {
    NextPress.ANSWER_LEFT_LOADED: lambda follower: follower.answer_loaded("left"),
    NextPress.ANSWER_RIGHT_LOADED: lambda follower: follower.answer_loaded("right"),
    NextPress.ANSWER_SAME_TRAY: lambda follower: follower.answer_tray_seen("same", "full"),
    NextPress.ANSWER_FULL_TRAY: lambda follower: follower.answer_tray_seen("full"),
    NextPress.ANSWER_NO_TRAY: _Follower.answer_no_tray,
    NextPress.ANSWER_CUPS_EMPTY: _Follower.answer_cups,
}
