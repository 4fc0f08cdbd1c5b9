"""Signals of a fault: the first one, an alarm or the reason for the Suspended state, and the alarms that are listed."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from controller.core.expr import Bit, Word, leaves
from controller.core.sequence import Sequence
from controller.events.alarm_list import AlarmChange, AlarmList
from controller.events.kinds import AlarmEvent, Event, StateEvent
from controller.program.states import Reason, State
from plant_sim.twin.lock_step import SCAN_MS, Twin

SUSPENSIONS = {
    Reason.NO_TRAY: ("no tray", ""),
    Reason.NO_CUPS_LEFT: ("no cups", "left"),
    Reason.NO_CUPS_RIGHT: ("no cups", "right"),
    Reason.NO_CUPS: ("no cups", ""),
}
"""Name and side of each reason for the Suspended state."""


class Signal(NamedTuple):
    """First signal of a fault.

    Attributes:
        name: Key of the alarm, or 'no tray' or 'no cups' for a Suspended machine.
        side: Arm to which the alarm belongs; empty if it belongs to no arm.
        at_ms: Time of the signal, ms.
        step: Step that timed out, as 'sequence: step'; empty if the signal is not a step timeout.
        in_step_ms: Time since the step became active, ms.
        limit_ms: Timeout of the step, ms.
    """

    name: str
    side: str
    at_ms: int
    step: str = ""
    in_step_ms: int = 0
    limit_ms: int = 0

    @property
    def is_in_time(self) -> bool:
        """True if the signal occurred within the timeout of its step plus two scans."""
        return not self.step or self.in_step_ms <= self.limit_ms + 2 * SCAN_MS


class _Limit(NamedTuple):
    number: int
    step: str
    ms: int


class FirstSignal:
    """Observer of the first signal after the start of a fault.

    Attributes:
        signal: First signal; None if there has been none.
        entered_ms: Time of entry into the active steps that have a timeout, ms, by number of the step.
    """

    def __init__(self, twin: Twin, from_ms: int, *, entered_ms: Mapping[int, int] = MappingProxyType({})) -> None:
        """Initialise an observer that ignores the signals of a twin before `from_ms`.

        Args:
            twin: The twin.
            from_ms: Time of the start of the fault, ms.
            entered_ms: Times of entry into the steps that are already active, ms.
        """
        self.signal: Signal | None = None
        self._from_ms = from_ms
        self.entered_ms = dict(entered_ms)
        self._event_count = len(twin.events)
        self._limits = _limits([*twin.machine.cycles.values(), *twin.machine.homings.values(), twin.machine.feeder])
        steps = (Bit("S", limit.number) for limits in self._limits.values() for limit in limits)
        twin.watch(self._update, devices=steps)

    def _update(self, twin: Twin) -> None:
        states = twin.plc.memory.S
        for limits in self._limits.values():
            for number, _, _ in limits:
                if not states[number]:
                    self.entered_ms.pop(number, None)
                else:
                    self.entered_ms.setdefault(number, twin.now_ms)
        for event in twin.events[self._event_count :]:
            if self.signal is None and event.at_ms >= self._from_ms:
                self.signal = self._signal(twin, event)
        self._event_count = len(twin.events)

    def _signal(self, twin: Twin, event: Event) -> Signal | None:
        if isinstance(event, StateEvent) and event.state == State.SUSPENDED:
            name, side = SUSPENSIONS[Reason(twin.plc.read(twin.machine.tags.machine.reason))]
            return Signal(name, side, event.at_ms)
        if not isinstance(event, AlarmEvent) or not event.active:
            return None
        alarm = twin.machine.alarms.of(event.number)
        for number, step, limit_ms in self._limits.get(event.number, ()):
            if number in self.entered_ms:
                in_step_ms = event.at_ms - self.entered_ms[number]
                return Signal(alarm.key, alarm.side or "", event.at_ms, step, in_step_ms, limit_ms)
        return Signal(alarm.key, alarm.side or "", event.at_ms)


class ListedAlarms:
    """Observer of the operator's alarm list after the start of a fault.

    Attributes:
        folded: Alarms that have been folded under the first-out alarm.
        beside: Alarms that have been listed beside another one instead of being folded under the first-out alarm.
    """

    def __init__(self, twin: Twin, from_ms: int) -> None:
        """Initialise an observer that ignores the alarms of a twin before `from_ms`, ms."""
        alarms = twin.machine.alarms
        first_out = twin.machine.tags.machine.first_out
        self.folded: set[str] = set()
        self.beside: set[str] = set()
        self._from_ms = from_ms
        self._is_repaired = False
        self._alarms = AlarmList(alarms, first_out, self._ignore)
        causes = [device for alarm in alarms if alarm.cause is not None for device in leaves(alarm.cause)]
        devices = (*(alarm.bit for alarm in alarms), first_out, *causes)
        twin.watch(self._update, devices=[device for device in devices if isinstance(device, Bit | Word)])

    @property
    def most(self) -> int:
        """Largest number of activations within ten minutes."""
        return self._alarms.load.peak

    def repaired(self) -> None:
        """State that the operator has acted: later alarms are no consequences of the fault alone."""
        self._is_repaired = True

    def _update(self, twin: Twin) -> None:
        self._alarms(twin.now_ms, twin.plc)
        if not self._is_repaired and twin.now_ms >= self._from_ms:
            _, *others = self._alarms.rows() or (None,)
            self.folded.update(row.alarm.key for row in others if row.follows is not None)
            self.beside.update(row.alarm.key for row in others if row.follows is None)

    def _ignore(self, _: AlarmChange) -> None:
        """Receive the changes, which are not needed here."""


def _limits(sequences: list[Sequence]) -> dict[int, list[_Limit]]:
    """Return the steps that have a timeout, keyed by the annunciator of the timeout."""
    limits: dict[int, list[_Limit]] = {}
    for sequence in sequences:
        for bit, step in sequence:
            if step.watch is not None:
                limit = _Limit(bit.number, f"{sequence.name}: {step.title}", step.watch.ms)
                limits.setdefault(step.watch.alarm.number, []).append(limit)
    return limits
