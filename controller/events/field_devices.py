"""Events of the devices of the field I/O, and their names in the alarm of the field link."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol, TypeVar

from controller.core.scan import Plc
from controller.events.alarm_list import AlarmChange
from controller.events.kinds import AlarmEvent, Event
from controller.events.response_times import ResponseTimes
from controller.program.machine import Transplanter
from controller.program.texts.field import FIELD_CHANGES, NAMED, FieldChange
from controller.program.texts.operator import Text

E = TypeVar("E", bound=Event | AlarmChange)
_PAIRS: Final[tuple[tuple[FieldChange, FieldChange], ...]] = (
    ("lost", "back"),
    ("tripped", "reset"),
    ("slow", "prompt"),
)


@dataclass(frozen=True, slots=True)
class FieldEvent:
    """Change of one device of the field I/O.

    Attributes:
        at_ms: Time of the event, ms.
        device: Name and address of the device.
        change: lost, back, tripped, reset, gap, slow or prompt.
        text: Message for the operator.
        detail: Technical reason in English; empty = none.
    """

    at_ms: int
    device: str
    change: FieldChange
    text: Text
    detail: str = ""
    event: str = "field"


class FieldDevices(Protocol):
    """Devices of the field I/O that are not in order."""

    @property
    def lost(self) -> Mapping[str, str]:
        """Reason of each device that does not respond, by its label."""

    @property
    def tripped(self) -> tuple[str, ...]:
        """Labels of the devices whose output watchdog has tripped."""

    @property
    def gaps(self) -> tuple[str, ...]:
        """Labels of the devices whose output watchdog may have tripped between two confirmed writes."""

    @property
    def waits(self) -> Sequence[tuple[str, str, int, float]]:
        """Label, line, number of answers, total time that scans have waited for them, s, by device."""


class FieldReport:
    """Observer that reports the devices that are lost, tripped or too slow, and their return."""

    def __init__(
        self,
        devices: FieldDevices,
        machine: Transplanter,
        report: Callable[[FieldEvent], None],
        *,
        scan_ms: int | None = None,
    ) -> None:
        """Create the observer.

        Args:
            devices: Devices of the field I/O.
            machine: Program and its tags.
            report: Listener that receives every event.
            scan_ms: Scan period with which the times of the answers are compared, ms; None = they are not, because a
                response takes no simulated time.
        """
        self._devices = devices
        self._alarm = machine.alarms.link_lost.number
        self._lost = machine.tags.system.link_lost
        self._report = report
        self._times = None if scan_ms is None else ResponseTimes(scan_ms)
        self._gaps: tuple[str, ...] = ()
        self._shown: dict[FieldChange, frozenset[str]] = {begin: frozenset() for begin, _ in _PAIRS}

    def __call__(self, now_ms: int, plc: Plc) -> None:
        """Report changes after a scan; an interruption within the timeout of the link is not reported."""
        lost = dict(self._devices.lost)
        is_lost = bool(plc.read(self._lost))
        new = {name for name in lost if is_lost or name in self._shown["lost"]}
        slow: Mapping[str, str] = {}
        if self._times is not None:
            self._times.update(self._devices.waits)
            slow = self._times.slow
        details: dict[FieldChange, Mapping[str, str]] = {"lost": lost, "slow": slow}
        found: dict[FieldChange, frozenset[str]] = {
            "lost": frozenset(new),
            "tripped": frozenset(self._devices.tripped),
            "slow": frozenset(slow),
        }
        for begin, end in _PAIRS:
            for name in sorted(found[begin] - self._shown[begin]):
                self._tell(now_ms, name, begin, details.get(begin, {}).get(name, ""))
            for name in sorted(self._shown[begin] - found[begin]):
                self._tell(now_ms, name, end)
            self._shown[begin] = found[begin]
        gaps = self._devices.gaps  # they are forgotten in the next scan, which aborts the machine
        for name in gaps:
            self._tell(now_ms, name, "gap")
        self._gaps = gaps or (self._gaps if is_lost else ())

    def _tell(self, now_ms: int, name: str, change: FieldChange, detail: str = "") -> None:
        text = FIELD_CHANGES[change].filled(device=Text.plain(name))
        self._report(FieldEvent(now_ms, name, change, text, detail))

    def named(self, event: E) -> E:
        """Return an event with the names of the devices if it is the alarm of the field link, otherwise unchanged."""
        if not isinstance(event, AlarmEvent | AlarmChange) or event.number != self._alarm:
            return event
        faulty = (*self._devices.lost, *self._devices.tripped) or self._gaps or sorted(self._shown["slow"])
        devices = ", ".join(faulty)
        if not devices:
            return event
        text = NAMED.filled(message=event.text, devices=Text.plain(devices))
        return replace(event, text=text)
