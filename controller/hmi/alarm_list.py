"""The operator's alarm list: annunciators by the states of ISA-18.2, seen in the PLC's memory after each scan.

The ladder latches and resets the annunciators. Acknowledging and shelving are between the list and the operator:
they change nothing in the PLC, so an alarm that stops work stops it whatever its state in the list.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Final

from controller.core.expr import Word, evaluate
from controller.core.scan import Plc
from controller.program.alarm_texts import ALARM_REFUSALS, ALARM_STATES
from controller.program.alarms import Alarm
from controller.program.texts import Language, Text

LONGEST_SHELF_MS: Final = 8 * 3_600_000
"""One shift: whoever comes after it decides anew."""


class AlarmState(StrEnum):
    """Alarm states of ISA-18.2 (FX.md 5).

    *Latched* means that the cause has gone and the annunciator waits for the reset. Nothing here is suppressed by
    design or out of service: an alarm of a point that is not wired has no rung that could set it, so it stays normal.
    """

    NORMAL = "normal"
    UNACKNOWLEDGED = "unacknowledged"
    ACKNOWLEDGED = "acknowledged"
    RETURNED_UNACKNOWLEDGED = "returned_unacknowledged"
    LATCHED_UNACKNOWLEDGED = "latched_unacknowledged"
    LATCHED_ACKNOWLEDGED = "latched_acknowledged"
    SHELVED = "shelved"

    @property
    def text(self) -> Text:
        """What the operator reads."""
        return ALARM_STATES[self.value]


_RANK: Final = {
    AlarmState.UNACKNOWLEDGED: 0,
    AlarmState.LATCHED_UNACKNOWLEDGED: 0,
    AlarmState.RETURNED_UNACKNOWLEDGED: 1,
    AlarmState.ACKNOWLEDGED: 2,
    AlarmState.LATCHED_ACKNOWLEDGED: 2,
    AlarmState.SHELVED: 3,
}
"""Place in the list; what is normal is not in it."""


class AlarmRefusalError(ValueError):
    """An action on the alarm list that is refused; nothing has happened.

    Attributes:
        reason: Why, and what to do instead; the message is its English.
    """

    def __init__(self, key: str, **values: object) -> None:
        """Fill the values into the reason of this key in `alarm_texts.ALARM_REFUSALS`."""
        reason = ALARM_REFUSALS[key]
        self.reason = Text(reason.en.format(**values), reason.zh.format(**values))
        super().__init__(self.reason.en)


@dataclass(frozen=True, slots=True)
class AlarmChange:
    """An alarm changed its state, or its shelf was given a new end.

    Attributes:
        at_ms: Time of the scan, ms.
        number: Number of its annunciator.
        key: Key of its text.
        before: State it left.
        after: State it is in.
        by: Who did it; None = the machine.
        text: The alarm's message.
        shelved_until_ms: End of the shelf, ms; None unless it is shelved now.
    """

    at_ms: int
    number: int
    key: str
    before: AlarmState
    after: AlarmState
    by: str | None
    text: str
    shelved_until_ms: int | None = None
    event: str = "alarm_state"


@dataclass(frozen=True, slots=True)
class AlarmRow:
    """One line of the list.

    Attributes:
        alarm: The alarm with its texts.
        state: Its state, never normal.
        first_out: Whether it was the first to stop work in this episode.
        came_ms: When it came last, ms; None if it was shelved before it ever came.
        went_ms: When its cause went, ms; None while the cause lasts.
        acknowledged_ms: When it was acknowledged, ms; None if it has not been.
        shelved_until_ms: End of the shelf, ms; None unless it is shelved.
    """

    alarm: Alarm
    state: AlarmState
    first_out: bool
    came_ms: int | None
    went_ms: int | None
    acknowledged_ms: int | None
    shelved_until_ms: int | None


class _Entry:
    """One alarm with its memory; its state follows from four facts."""

    def __init__(self, alarm: Alarm) -> None:
        self.alarm = alarm
        self.state = AlarmState.NORMAL
        self.came_ms: int | None = None
        self.went_ms: int | None = None
        self.acknowledged_ms: int | None = None
        self.shelved_until_ms: int | None = None
        self._set = False
        self._caused = False
        self._acknowledged = True  # there is nothing to acknowledge

    def derived(self) -> AlarmState:
        """Return the state that the facts make."""
        if self.shelved_until_ms is not None:
            return AlarmState.SHELVED
        if not self._set:
            return AlarmState.NORMAL if self._acknowledged else AlarmState.RETURNED_UNACKNOWLEDGED
        if self._caused:
            return AlarmState.ACKNOWLEDGED if self._acknowledged else AlarmState.UNACKNOWLEDGED
        return AlarmState.LATCHED_ACKNOWLEDGED if self._acknowledged else AlarmState.LATCHED_UNACKNOWLEDGED

    def see(self, now_ms: int, plc: Plc) -> bool:
        """Look at the annunciator and its cause; a cause that comes back is a new alarm.

        Returns:
            Whether anything is other than before.
        """
        is_set = plc.memory.S[self.alarm.bit.number]
        caused = is_set and self.alarm.cause is not None and evaluate(self.alarm.cause, plc.memory)
        shelf_over = self.shelved_until_ms is not None and now_ms >= self.shelved_until_ms
        if (is_set, caused) == (self._set, self._caused) and not shelf_over:
            return False
        if (is_set and not self._set) or (caused and not self._caused):
            self.came_ms, self.went_ms = now_ms, None
            self._acknowledged, self.acknowledged_ms = False, None
        if not caused and self.came_ms is not None and self.went_ms is None:
            self.went_ms = now_ms
        self._set, self._caused = is_set, caused
        if shelf_over:
            self.unshelve()
        return True

    def acknowledge(self, now_ms: int) -> None:
        """Take note that somebody has seen it; what is shelved is not shown and cannot have been seen."""
        if self.shelved_until_ms is None and not self._acknowledged:
            self._acknowledged, self.acknowledged_ms = True, now_ms

    def unshelve(self) -> None:
        """Bring it back: announced anew if it is still set, acknowledged before or not."""
        self.shelved_until_ms = None
        self._acknowledged, self.acknowledged_ms = not self._set, None


class AlarmList:
    """States of all alarms, and what operators do with them; an observer of the runtime.

    Actions may come from any thread. They are checked at once and take effect with the next scan, before that scan's
    own alarms: nobody acknowledges what nobody can have seen. A restart begins with an empty list: annunciators that
    are still set are announced anew, and nothing is shelved.
    """

    def __init__(
        self,
        alarms: Iterable[Alarm],
        first_out: Word,
        tell: Callable[[AlarmChange], None],
        language: Language = "en",
    ) -> None:
        """Watch the alarms of a program.

        Args:
            alarms: The alarm table.
            first_out: Word with the number of the first annunciator that stopped work; 0 = none.
            tell: Receives every change, in order, in the thread of the scan.
            language: Language of the messages told.
        """
        self._entries = {alarm.bit.number: _Entry(alarm) for alarm in alarms}
        self._first_out_word = first_out
        self._tell = tell
        self._language: Language = language
        self._actions: deque[Callable[[int], None]] = deque()
        self._listed: set[int] = set()
        self._first_out = 0
        self._rows: tuple[AlarmRow, ...] = ()

    def __call__(self, now_ms: int, plc: Plc) -> None:
        """Look at the memory after a scan; `now_ms` is the scan's time."""
        active = plc.annunciators()
        if not (active or self._listed or self._actions):
            return
        news = False
        while self._actions:
            self._actions.popleft()(now_ms)
            news = True
        for number in sorted(self._listed.union(active) & self._entries.keys()):
            entry = self._entries[number]
            if entry.see(now_ms, plc):
                news = True
                self._settle(entry, now_ms)
        if news:
            # kept past the reset: the first of the episode until another one begins
            self._first_out = plc.read(self._first_out_word) or self._first_out
            self._rows = self._sorted_rows()

    def rows(self) -> tuple[AlarmRow, ...]:
        """Return the list after the last scan: the first-out, then the unacknowledged, each by severity.

        Behind them come those that went unacknowledged, the acknowledged, and the shelved.
        """
        return self._rows

    def acknowledge(self, number: int | None = None, *, by: str) -> None:
        """Acknowledge an alarm; one that waits for nobody's acknowledgement stays as it is.

        Args:
            number: Number of its annunciator; None = all that are in the list.
            by: Who does it.

        Raises:
            AlarmRefusalError: There is no such alarm, or nobody is named.
        """
        _named(by)
        if number is not None:
            self._entry(number)
        self._actions.append(partial(self._acknowledge, number, by))

    def shelve(self, number: int, for_ms: int, *, by: str) -> None:
        """Take a warning out of the way for a time; on one that is shelved already, the time begins anew.

        Args:
            number: Number of its annunciator.
            for_ms: How long, 1 ms to `LONGEST_SHELF_MS`; then it comes back by itself.
            by: Who does it.

        Raises:
            AlarmRefusalError: There is no such alarm, it is a safety alarm or stops work, the time is out of range, or
                nobody is named.
        """
        _named(by)
        entry = self._entry(number)
        if entry.alarm.safety:
            raise AlarmRefusalError("safety", number=number)
        if entry.alarm.stops_work:
            raise AlarmRefusalError("stops_work", number=number)
        if not 1 <= for_ms <= LONGEST_SHELF_MS:
            raise AlarmRefusalError("time", limit=LONGEST_SHELF_MS // 3_600_000, for_ms=for_ms)
        self._actions.append(partial(self._shelve, entry, for_ms, by))

    def unshelve(self, number: int, *, by: str) -> None:
        """End a shelf before its time; an alarm that is not shelved stays as it is.

        Args:
            number: Number of its annunciator.
            by: Who does it.

        Raises:
            AlarmRefusalError: There is no such alarm, or nobody is named.
        """
        _named(by)
        self._actions.append(partial(self._unshelve, self._entry(number), by))

    def _entry(self, number: int) -> _Entry:
        if number not in self._entries:
            raise AlarmRefusalError("unknown", number=number)
        return self._entries[number]

    def _acknowledge(self, number: int | None, by: str, now_ms: int) -> None:
        for listed in sorted(self._listed) if number is None else [number]:
            self._entries[listed].acknowledge(now_ms)
            self._settle(self._entries[listed], now_ms, by)

    def _shelve(self, entry: _Entry, for_ms: int, by: str, now_ms: int) -> None:
        entry.shelved_until_ms = now_ms + for_ms
        self._change(entry, now_ms, by)

    def _unshelve(self, entry: _Entry, by: str, now_ms: int) -> None:
        if entry.shelved_until_ms is not None:
            entry.unshelve()
            self._settle(entry, now_ms, by)

    def _settle(self, entry: _Entry, now_ms: int, by: str | None = None) -> None:
        """Put an alarm into the state its facts make, and tell if that is another one."""
        if entry.derived() != entry.state:
            self._change(entry, now_ms, by)

    def _change(self, entry: _Entry, now_ms: int, by: str | None) -> None:
        before, entry.state = entry.state, entry.derived()
        number, alarm = entry.alarm.bit.number, entry.alarm
        if entry.state is AlarmState.NORMAL:
            self._listed.discard(number)
        else:
            self._listed.add(number)
        text = getattr(alarm.text, self._language)
        self._tell(AlarmChange(now_ms, number, alarm.key, before, entry.state, by, text, entry.shelved_until_ms))

    def _sorted_rows(self) -> tuple[AlarmRow, ...]:
        rows = [
            AlarmRow(
                entry.alarm,
                entry.state,
                number == self._first_out,
                entry.came_ms,
                entry.went_ms,
                entry.acknowledged_ms,
                entry.shelved_until_ms,
            )
            for number, entry in ((number, self._entries[number]) for number in self._listed)
        ]
        return tuple(sorted(rows, key=lambda row: (not row.first_out, _RANK[row.state], row.alarm.bit.number)))


def _named(by: str) -> None:
    if not by.strip():
        raise AlarmRefusalError("nobody")
