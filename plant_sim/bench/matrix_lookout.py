"""What tells first that something is broken: an alarm, or the reason for which the machine is Suspended."""

from __future__ import annotations

from typing import NamedTuple

from controller.core.sequence import Sequence
from controller.hmi.production import AlarmEvent, Event, StateEvent
from controller.program.states import Reason, State
from plant_sim.bench.twin import SCAN_MS, Twin

SUSPENSIONS = {
    Reason.NO_TRAY: ("no tray", ""),
    Reason.NO_CUPS_LEFT: ("no cups", "left"),
    Reason.NO_CUPS_RIGHT: ("no cups", "right"),
    Reason.NO_CUPS: ("no cups", ""),
}
"""Name and side of each reason for being Suspended."""


class Signal(NamedTuple):
    """What told first that something is wrong.

    Attributes:
        name: Key of the alarm, or 'no tray' or 'no cups' where the machine is Suspended.
        side: Arm it belongs to; empty if none.
        at_ms: When it came, ms.
        step: The step whose limit it is, as 'sequence: step'; empty if it is no limit.
        in_step_ms: How long the step had been on, ms.
        limit_ms: Limit of the step, ms.
    """

    name: str
    side: str
    at_ms: int
    step: str = ""
    in_step_ms: int = 0
    limit_ms: int = 0

    @property
    def is_in_time(self) -> bool:
        """Whether it came within the limit of its step, and two scans."""
        return not self.step or self.in_step_ms <= self.limit_ms + 2 * SCAN_MS


class _Limit(NamedTuple):
    number: int
    step: str
    ms: int


class Lookout:
    """Sees the first signal after a fault began.

    Attributes:
        signal: It; None while there is none.
    """

    def __init__(self, twin: Twin, from_ms: int) -> None:
        """Look out on a twin from a time on, ms."""
        self.signal: Signal | None = None
        self._from_ms = from_ms
        self._entered_ms: dict[int, int] = {}
        self._told = len(twin.events)
        self._limits = _limits([*twin.machine.cycles.values(), *twin.machine.homings.values(), twin.machine.feeder])
        twin.watch(self._see)

    def _see(self, twin: Twin) -> None:
        states = twin.plc.memory.S
        for limits in self._limits.values():
            for number, _, _ in limits:
                if not states[number]:
                    self._entered_ms.pop(number, None)
                else:
                    self._entered_ms.setdefault(number, twin.now_ms)
        for event in twin.events[self._told :]:
            if self.signal is None and event.at_ms >= self._from_ms:
                self.signal = self._signal(twin, event)
        self._told = len(twin.events)

    def _signal(self, twin: Twin, event: Event) -> Signal | None:
        if isinstance(event, StateEvent) and event.state == State.SUSPENDED:
            name, side = SUSPENSIONS[Reason(twin.plc.read(twin.machine.tags.machine.reason))]
            return Signal(name, side, event.at_ms)
        if not isinstance(event, AlarmEvent) or not event.active:
            return None
        alarm = twin.machine.alarms.of(event.number)
        for number, step, limit_ms in self._limits.get(event.number, ()):
            if number in self._entered_ms:
                in_step_ms = event.at_ms - self._entered_ms[number]
                return Signal(alarm.key, alarm.side or "", event.at_ms, step, in_step_ms, limit_ms)
        return Signal(alarm.key, alarm.side or "", event.at_ms)


def _limits(sequences: list[Sequence]) -> dict[int, list[_Limit]]:
    """The steps with a limit, by the annunciator that tells it."""
    found: dict[int, list[_Limit]] = {}
    for sequence in sequences:
        for bit, step in sequence:
            if step.watch is not None:
                limit = _Limit(bit.number, f"{sequence.name}: {step.title}", step.watch.ms)
                found.setdefault(step.watch.alarm.number, []).append(limit)
    return found
