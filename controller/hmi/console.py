"""The operator's orders as lines of text, for a machine without a panel."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from controller.hmi.alarm_list import AlarmList, AlarmRefusalError
from controller.io.runtime import Runtime
from controller.program.tags import LONGEST_NUMBER, SetPointError

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
    """A line that is no order, or one that cannot be carried out; one line with the remedy."""


class Console:
    """Takes orders line by line; every line, an empty one too, is a sign of life."""

    def __init__(self, runtime: Runtime, alarms: AlarmList) -> None:
        """Give orders to a runtime and its alarm list."""
        self._runtime = runtime
        self._alarms = alarms

    def take(self, line: str) -> None:
        """Carry out one line.

        Raises:
            OrderError: It is no order; nothing has happened.
        """
        self._runtime.heard()
        word, *rest = line.split() or [""]
        try:
            if word:
                self._carry_out(word, rest)
        except (AlarmRefusalError, SetPointError) as error:
            raise OrderError(f"{line.strip()}: {error}") from error

    def _carry_out(self, word: str, rest: list[str]) -> None:
        match word, rest:
            case "set", [text]:
                name, _, value = text.partition("=")
                self._runtime.set_points({name: value})
            case "acknowledge", []:
                self._alarms.acknowledge(by=OPERATOR)
                self._runtime.order(word)
            case "acknowledge", [alarm]:
                self._alarms.acknowledge(_whole(alarm), by=OPERATOR)
            case "shelve", [alarm, minutes]:
                self._alarms.shelve(_whole(alarm), _whole(minutes) * MINUTE_MS, by=OPERATOR)
            case "unshelve", [alarm]:
                self._alarms.unshelve(_whole(alarm), by=OPERATOR)
            case _, []:
                self._order(word)
            case _:
                raise OrderError(f"no order {' '.join([word, *rest])!r}; give {_either(FORMS)}")

    def _order(self, name: str) -> None:
        try:
            self._runtime.order(name)
        except KeyError as error:
            raise OrderError(str(error.args[0])) from error


def _whole(text: str) -> int:
    if not text.isdecimal() or len(text) > LONGEST_NUMBER:
        raise OrderError(f"{text[:20]!r} is no whole number of up to {LONGEST_NUMBER} digits")
    return int(text)


def _either(forms: Iterable[str]) -> str:
    *others, last = forms
    return f"{', '.join(others)} or {last}"
