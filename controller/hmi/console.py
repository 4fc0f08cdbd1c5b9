"""Text console: operator orders line by line, for a machine without a panel."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from controller.events.alarm_list import AlarmList, AlarmRefusalError
from controller.io.runtime import Runtime
from controller.program.set_points import LONGEST_NUMBER, SetPointError

OPERATOR: Final = "console"
MINUTE_MS: Final = 60_000
FORMS: Final = (
    "a command of the table",
    "set NAME=VALUE",
    "acknowledge [ALARM]",
    "shelve ALARM MINUTES",
    "unshelve ALARM",
)


class OrderError(ValueError):
    """Raised for an unknown or refused order; the message is one line with the remedy."""


class Console:
    """Line interpreter; every line, including an empty one, also counts as an operator heartbeat."""

    def __init__(self, runtime: Runtime, alarms: AlarmList) -> None:
        """Initialise a console for a runtime and its alarm list."""
        self._runtime = runtime
        self._alarms = alarms

    def execute(self, line: str) -> None:
        """Execute one line.

        Raises:
            OrderError: The order is unknown or refused; nothing has changed.
        """
        self._runtime.panel_heartbeat()
        word, *rest = line.split() or [""]
        try:
            if word:
                self._dispatch(word, rest)
        except (AlarmRefusalError, SetPointError) as error:
            raise OrderError(f"{line.strip()}: {error}") from error

    def _dispatch(self, word: str, rest: list[str]) -> None:
        match word, rest:
            case "set", [text]:
                name, _, value = text.partition("=")
                self._runtime.set_points({name: value})
            case "acknowledge", []:
                self._alarms.acknowledge(by=OPERATOR)
                self._runtime.order(word)
            case "acknowledge", [alarm]:
                self._alarms.acknowledge(_whole_number(alarm), by=OPERATOR)
            case "shelve", [alarm, minutes]:
                self._alarms.shelve(_whole_number(alarm), _whole_number(minutes) * MINUTE_MS, by=OPERATOR)
            case "unshelve", [alarm]:
                self._alarms.unshelve(_whole_number(alarm), by=OPERATOR)
            case _, []:
                self._order(word)
            case _:
                raise OrderError(f"unknown order {' '.join([word, *rest])!r}; expected {_either(FORMS)}")

    def _order(self, name: str) -> None:
        try:
            self._runtime.order(name)
        except KeyError as error:
            raise OrderError(str(error.args[0])) from error


def _whole_number(text: str) -> int:
    if not text.isdecimal() or len(text) > LONGEST_NUMBER:
        raise OrderError(f"{text[:20]!r} is not a whole number of up to {LONGEST_NUMBER} digits")
    return int(text)


def _either(forms: Iterable[str]) -> str:
    *others, last = forms
    return f"{', '.join(others)} or {last}"
