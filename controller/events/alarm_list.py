"""Operator's alarm list: annunciators with the states of ISA-18.2, evaluated after each scan.

The ladder latches and resets the annunciators. Acknowledging and shelving affect only the list, not the PLC: an
alarm that stops work does so regardless of its state in the list.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Final

from controller.core.expr import Word, evaluate
from controller.core.scan import Plc
from controller.events.alarm_load import AlarmLoad, is_activation
from controller.events.alarm_states import AlarmState
from controller.program.alarms.table import Alarm, Severity
from controller.program.texts.alarms.handling import ALARM_REFUSALS
from controller.program.texts.operator import Text

LONGEST_SHELF_MS: Final = 8 * 3_600_000
"""Longest shelving time, ms: one shift, so that each shift makes its own decision."""


_RANK: Final = {
    AlarmState.UNACKNOWLEDGED: 0,
    AlarmState.LATCHED_UNACKNOWLEDGED: 0,
    AlarmState.RETURNED_UNACKNOWLEDGED: 1,
    AlarmState.ACKNOWLEDGED: 2,
    AlarmState.LATCHED_ACKNOWLEDGED: 2,
    AlarmState.SHELVED: 3,
}
"""Sort order of the states in the list; normal alarms are not listed."""


class AlarmRefusalError(ValueError):
    """Raised for a refused action on the alarm list; nothing has been changed.

    Attributes:
        reason: Reason and remedy; the exception message is its English text.
    """

    def __init__(self, key: str, **values: object) -> None:
        """Format the reason stored under this key in `texts.alarms.handling.ALARM_REFUSALS`."""
        reason = ALARM_REFUSALS[key]
        self.reason = Text(reason.en.format(**values), reason.zh.format(**values))
        super().__init__(self.reason.en)


@dataclass(frozen=True, slots=True)
class AlarmChange:
    """Change of the state of an alarm or of its shelving time.

    Attributes:
        at_ms: Time of the scan, ms.
        number: Number of the annunciator.
        key: Key of the alarm.
        before: Previous state.
        after: New state.
        by: Name of the operator; None = the machine.
        text: Message of the alarm.
        shelved_until_ms: End of the shelving time, ms; None unless the alarm is shelved.
    """

    at_ms: int
    number: int
    key: str
    before: AlarmState
    after: AlarmState
    by: str | None
    text: Text
    shelved_until_ms: int | None = None
    event: str = "alarm_state"


@dataclass(frozen=True, slots=True)
class AlarmRow:
    """Row of the alarm list.

    Attributes:
        alarm: Alarm with its texts.
        state: State; never normal.
        first_out: True if this alarm was the first to stop work in the current episode.
        follows: Number of the first-out alarm whose consequence this alarm is, and under which it is folded; None if
            it stands for itself.
        activations: Number of activations within a minute up to the last one; see `AlarmLoad`.
        came_ms: Time of the last activation, ms; None if the alarm was shelved before its first activation.
        went_ms: Time at which the cause cleared, ms; None while the cause is present.
        acknowledged_ms: Time of the acknowledgement, ms; None if not acknowledged.
        shelved_until_ms: End of the shelving time, ms; None unless the alarm is shelved.
    """

    alarm: Alarm
    state: AlarmState
    first_out: bool
    follows: int | None
    activations: int
    came_ms: int | None
    went_ms: int | None
    acknowledged_ms: int | None
    shelved_until_ms: int | None


class _AlarmEntry:
    """Alarm with the variables from which its state is derived."""

    def __init__(self, alarm: Alarm) -> None:
        self.alarm = alarm
        self.state = AlarmState.NORMAL
        self.came_ms: int | None = None
        self.went_ms: int | None = None
        self.acknowledged_ms: int | None = None
        self.shelved_until_ms: int | None = None
        self.follows: int | None = None
        self.activations = 0
        self._set = False
        self._has_cause = False
        self._acknowledged = True  # a normal alarm does not need an acknowledgement

    def derived(self) -> AlarmState:
        """Return the state derived from the variables."""
        if self.shelved_until_ms is not None:
            return AlarmState.SHELVED
        if not self._set:
            return AlarmState.NORMAL if self._acknowledged else AlarmState.RETURNED_UNACKNOWLEDGED
        if self._has_cause:
            return AlarmState.ACKNOWLEDGED if self._acknowledged else AlarmState.UNACKNOWLEDGED
        return AlarmState.LATCHED_ACKNOWLEDGED if self._acknowledged else AlarmState.LATCHED_UNACKNOWLEDGED

    def update(self, now_ms: int, plc: Plc) -> bool:
        """Evaluate the annunciator and its cause; a cause that recurs counts as a new alarm.

        Returns:
            True if anything has changed.
        """
        is_set = plc.memory.S[self.alarm.bit.number]
        has_cause = is_set and self.alarm.cause is not None and evaluate(self.alarm.cause, plc.memory)
        shelf_expired = self.shelved_until_ms is not None and now_ms >= self.shelved_until_ms
        if (is_set, has_cause) == (self._set, self._has_cause) and not shelf_expired:
            return False
        if (is_set and not self._set) or (has_cause and not self._has_cause):
            self.came_ms, self.went_ms = now_ms, None
            self._acknowledged, self.acknowledged_ms = False, None
        if not has_cause and self.came_ms is not None and self.went_ms is None:
            self.went_ms = now_ms
        self._set, self._has_cause = is_set, has_cause
        if shelf_expired:
            self.unshelve()
        return True

    def acknowledge(self, now_ms: int) -> None:
        """Acknowledge the alarm; no effect on a shelved alarm, because it is not displayed."""
        if self.shelved_until_ms is None and not self._acknowledged:
            self._acknowledged, self.acknowledged_ms = True, now_ms

    def unshelve(self) -> None:
        """End the shelving; an alarm that is still set must be acknowledged again."""
        self.shelved_until_ms = None
        self._acknowledged, self.acknowledged_ms = not self._set, None


class AlarmList:
    """States of all alarms, with acknowledgement and shelving; an observer of the runtime.

    Actions are thread-safe. They are checked immediately and take effect in the next scan, before its new alarms are
    listed, so that an alarm cannot be acknowledged before it appears in the list. After a restart the list is empty:
    annunciators that are still set must be acknowledged again, and nothing is shelved.
    """

    def __init__(
        self,
        alarms: Iterable[Alarm],
        first_out: Word,
        report: Callable[[AlarmChange], None],
    ) -> None:
        """Create the list for the alarms of a program.

        Args:
            alarms: Alarm table.
            first_out: Word with the number of the first annunciator that stopped work; 0 = none.
            report: Listener that receives every change, in order, in the thread of the scan.
        """
        self._entries = {alarm.bit.number: _AlarmEntry(alarm) for alarm in alarms}
        self._first_out_word = first_out
        self._report = report
        self._actions: deque[Callable[[int], None]] = deque()
        self._listed: set[int] = set()
        self._first_out = 0
        self._load = AlarmLoad()
        self._rows: tuple[AlarmRow, ...] = ()

    def __call__(self, now_ms: int, plc: Plc) -> None:
        """Evaluate the memory after a scan; `now_ms` is the time of the scan."""
        active = plc.annunciators()
        if not (active or self._listed or self._actions):
            return
        changed = False
        first_out = plc.read(self._first_out_word)
        while self._actions:
            self._actions.popleft()(now_ms)
            changed = True
        for number in sorted(self._listed.union(active) & self._entries.keys()):
            entry = self._entries[number]
            if entry.update(now_ms, plc):
                changed = True
                if entry.came_ms == now_ms:
                    entry.follows = first_out if first_out not in (0, number) and is_foldable(entry.alarm) else None
                self._update_state(entry, now_ms)
        if changed:
            # the first-out alarm of an episode is retained after the reset, until the next episode starts
            self._first_out = first_out or self._first_out
            self._rows = self._sorted_rows()

    def rows(self) -> tuple[AlarmRow, ...]:
        """Return the alarm list as of the last scan.

        The first-out alarm is followed by its consequences, then by the unacknowledged, the returned-to-normal
        unacknowledged, the acknowledged and the shelved alarms; each group is sorted by severity.
        """
        return self._rows

    @property
    def load(self) -> AlarmLoad:
        """Counter of the activations since the start."""
        return self._load

    def acknowledge(self, number: int | None = None, *, by: str) -> None:
        """Acknowledge an alarm; no effect on an alarm that does not need an acknowledgement.

        Args:
            number: Number of the annunciator; None = all listed alarms.
            by: Name of the operator.

        Raises:
            AlarmRefusalError: The alarm is unknown, or the name is missing.
        """
        _check_name(by)
        if number is not None:
            self._entry(number)
        self._actions.append(partial(self._acknowledge, number, by))

    def shelve(self, number: int, for_ms: int, *, by: str) -> None:
        """Shelve a warning for a limited time; if it is already shelved, the time restarts.

        Args:
            number: Number of the annunciator.
            for_ms: Shelving time, 1 ms to `LONGEST_SHELF_MS`; the alarm returns automatically at its end.
            by: Name of the operator.

        Raises:
            AlarmRefusalError: The alarm is unknown, is a safety alarm or stops work, the time is out of range, or the
                name is missing.
        """
        _check_name(by)
        entry = self._entry(number)
        if entry.alarm.safety:
            raise AlarmRefusalError("safety", number=number)
        if entry.alarm.stops_work:
            raise AlarmRefusalError("stops_work", number=number)
        if not 1 <= for_ms <= LONGEST_SHELF_MS:
            raise AlarmRefusalError("time", limit=LONGEST_SHELF_MS // 3_600_000, for_ms=for_ms)
        self._actions.append(partial(self._shelve, entry, for_ms, by))

    def unshelve(self, number: int, *, by: str) -> None:
        """End the shelving of an alarm early; no effect on an alarm that is not shelved.

        Args:
            number: Number of the annunciator.
            by: Name of the operator.

        Raises:
            AlarmRefusalError: The alarm is unknown, or the name is missing.
        """
        _check_name(by)
        self._actions.append(partial(self._unshelve, self._entry(number), by))

    def _entry(self, number: int) -> _AlarmEntry:
        if number not in self._entries:
            raise AlarmRefusalError("unknown", number=number)
        return self._entries[number]

    def _acknowledge(self, number: int | None, by: str, now_ms: int) -> None:
        for listed in sorted(self._listed) if number is None else [number]:
            self._entries[listed].acknowledge(now_ms)
            self._update_state(self._entries[listed], now_ms, by)

    def _shelve(self, entry: _AlarmEntry, for_ms: int, by: str, now_ms: int) -> None:
        entry.shelved_until_ms = now_ms + for_ms
        self._change(entry, now_ms, by)

    def _unshelve(self, entry: _AlarmEntry, by: str, now_ms: int) -> None:
        if entry.shelved_until_ms is not None:
            entry.unshelve()
            self._update_state(entry, now_ms, by)

    def _update_state(self, entry: _AlarmEntry, now_ms: int, by: str | None = None) -> None:
        """Set an alarm to its derived state; report the change, if any."""
        if entry.derived() != entry.state:
            self._change(entry, now_ms, by)

    def _change(self, entry: _AlarmEntry, now_ms: int, by: str | None) -> None:
        before, entry.state = entry.state, entry.derived()
        number, alarm = entry.alarm.bit.number, entry.alarm
        if entry.state is AlarmState.NORMAL:
            self._listed.discard(number)
        else:
            self._listed.add(number)
        if is_activation(before, entry.state):
            entry.activations = self._load.announce(number, now_ms)
        until_ms = entry.shelved_until_ms
        self._report(AlarmChange(now_ms, number, alarm.key, before, entry.state, by, alarm.text.message, until_ms))

    def _sorted_rows(self) -> tuple[AlarmRow, ...]:
        rows = [
            AlarmRow(
                entry.alarm,
                entry.state,
                number == self._first_out,
                entry.follows if number != self._first_out and entry.follows in self._listed else None,
                entry.activations,
                entry.came_ms,
                entry.went_ms,
                entry.acknowledged_ms,
                entry.shelved_until_ms,
            )
            for number, entry in ((number, self._entries[number]) for number in self._listed)
        ]
        return tuple(sorted(rows, key=self._position))

    def _position(self, row: AlarmRow) -> tuple[bool, bool, int, int, int]:
        """Return the sort key of a row."""
        return not row.first_out, row.follows != self._first_out, _RANK[row.state], *row.alarm.rank


def is_foldable(alarm: Alarm) -> bool:
    """Return True if an alarm may be folded under the first-out alarm: a fault that stops work.

    A safety alarm and a warning have actions of their own, so they are never folded.
    """
    return alarm.stops_work and alarm.severity is Severity.FAULT


def _check_name(by: str) -> None:
    if not by.strip():
        raise AlarmRefusalError("nobody")
