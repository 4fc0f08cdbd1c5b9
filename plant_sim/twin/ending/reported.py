"""State, alarms, questions and production of a machine, derived from the controller's events alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Final

from controller.program.states import State
from controller.program.texts.operator import STATES, question_text
from plant_sim.twin.commissioning import default_io_map, program_of
from plant_sim.twin.ending.rule import Rest

Record = Mapping[str, Any]
"""Event of the controller (`controller.events.kinds.as_record`)."""

RESTS: Final = frozenset({State.STOPPED, State.IDLE, State.HELD, State.ABORTED})
"""States that only an operator ends; Suspended ends by itself."""
UNEXPLAINED: Final = "without an alarm or a question"


@cache
def alarm_texts() -> Mapping[int, str]:
    """Return the English text of every alarm of the delivered machine by S number; numbers are permanent."""
    return {alarm.bit.number: alarm.text.message.en for alarm in program_of(default_io_map()).alarms}


def alarm_name(number: int, text: str) -> str:
    """Return the name of an alarm in a report: its number and its text in the alarm table.

    Args:
        number: S number.
        text: Text of an alarm that the delivered machine does not have.
    """
    return f"S{number} {alarm_texts().get(number, text)}"


@dataclass
class ReportedEvents:
    """State, alarms and production derived from the controller's events."""

    events: list[Record] = field(default_factory=list)
    state: int = 0
    state_text: str = "not started"
    trays_done: int = 0
    rows: int = 0
    alarms: dict[int, str] = field(default_factory=dict)
    questions: dict[str, str] = field(default_factory=dict)
    _away: set[str] = field(default_factory=set)
    _rests_since_ms: int | None = None
    _is_explained: bool = False
    _acted_ms: int = 0

    def apply(self, event: Record) -> None:
        """Update from one event."""
        self.events.append(event)
        match event["event"]:
            case "state":
                reason = f" ({event['reason']})" if event["reason"] else ""
                self.state, self.state_text = event["state"], event["text"] + reason
            case "tray":
                self.trays_done = event["trays_done"]
            case "row":
                self.rows += 1
                self._away.add(event["side"])
            case "cycle":
                self._away.discard(event["side"])
            case "alarm":
                _note(self.alarms, event["number"], event)
            case "question":
                _note(self.questions, event["question"], event)
        is_explained = bool(self.alarms or self.questions)
        if self.state not in RESTS:
            self._rests_since_ms = None
        elif self._rests_since_ms is None or is_explained != self._is_explained:
            self._rests_since_ms = event["at_ms"]
        self._is_explained = is_explained

    def acted(self, at_ms: int) -> None:
        """Note that the operator of the trial has pressed a button, which must show its effect."""
        self._acted_ms = at_ms

    @property
    def are_back(self) -> bool:
        """True if each arm that has released a row has completed that cycle."""
        return not self._away

    @property
    def english_state(self) -> str:
        """English name of the state."""
        return STATES[self.state].en if self.state else self.state_text

    @property
    def rest(self) -> Rest | None:
        """Rest of the machine; None if it does not rest.

        Without an alarm or a question it counts from the last button that the operator of the trial has pressed.
        """
        if self._rests_since_ms is None:
            return None
        if not self._is_explained:
            since_ms = max(self._rests_since_ms, self._acted_ms)
            return Rest(since_ms, f"{self.english_state}, {UNEXPLAINED}")
        names = [alarm_name(number, text) for number, text in sorted(self.alarms.items())]
        names += [question_text(name).en for name in self.questions]
        return Rest(self._rests_since_ms, f"{self.english_state}: {'; '.join(names)}")

    @property
    def alarm_line(self) -> str:
        """Numbers and texts of the active alarms in the language of the events."""
        return "; ".join(f"S{number} {text}" for number, text in self.alarms.items())


def _note(active: dict[Any, str], key: int | str, event: Record) -> None:
    """Add what has become active, or remove what has ended."""
    if event["active"]:
        active[key] = event["text"]
    else:
        active.pop(key, None)
