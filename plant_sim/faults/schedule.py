"""When faults begin and end: each strikes and is mended at its exact millisecond."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from plant_sim.faults.catalogue import FAULTS
from plant_sim.faults.fault import Fault
from plant_sim.faults.kind import Breakable, FaultError, read_value, write_value


class _Broken(NamedTuple):
    """A fault in force, and what the values it changed were."""

    fault: Fault
    part: Any
    sound: dict[str, Any]


class FaultSchedule:
    """The faults of a machine.

    Whoever lets time pass must stop at `next_ms` and call `advance` there.

    Attributes:
        next_ms: When the next fault begins or ends, ms; None: never.
        struck: Every fault that has struck so far, in order.
    """

    def __init__(self, machine: Breakable, faults: Iterable[Fault] = ()) -> None:
        """Take up faults; those that begin now strike at once.

        Args:
            machine: What they strike.
            faults: All of them.

        Raises:
            FaultError: the machine has no such part, or two change the same thing at the same time.
        """
        self._machine = machine
        self._waiting: list[Fault] = []
        self._broken: list[_Broken] = []
        self.next_ms: int | None = None
        self.struck: list[Fault] = []
        for fault in faults:
            self._admit(fault)
        self.advance(machine.time_ms)

    @property
    def active(self) -> list[Fault]:
        """The faults in force, in the order in which they struck."""
        return [broken.fault for broken in self._broken]

    def add(self, fault: Fault) -> None:
        """Take up one more fault; if it begins now or earlier, it strikes at once.

        Raises:
            FaultError: as at the start, or its time is over.
        """
        self._admit(fault)
        self.advance(self._machine.time_ms)

    def mend(self, name: str) -> None:
        """End a fault before its time, or keep it from beginning.

        Args:
            name: Kind and target, as ``stuck_off:left.lift_up``.

        Raises:
            FaultError: there is none, or it cannot be mended.
        """
        waiting = [fault for fault in self._waiting if fault.name == name]
        broken = [each for each in self._broken if each.fault.name == name]
        if not waiting and not broken:
            known = ", ".join(fault.name for fault in (*self.active, *self._waiting)) or "none"
            raise FaultError(f"{name}: is not broken; there is {known}")
        if any(FAULTS[each.fault.kind].lasts for each in broken):
            raise FaultError(f"{name}: is decided before the run; it cannot be mended")
        for fault in waiting:
            self._waiting.remove(fault)
        for each in broken:
            self._mend(each)
        self._look_ahead()

    def advance(self, now_ms: int) -> None:
        """Let everything begin and end that is due, in the order of its time; at one time, ends come first.

        Args:
            now_ms: Plant time, ms.
        """
        while self.next_ms is not None and self.next_ms <= now_ms:
            at_ms = self.next_ms
            for broken in [each for each in self._broken if each.fault.end_ms == at_ms]:
                self._mend(broken)
            for fault in [each for each in self._waiting if each.start_ms <= at_ms]:
                self._strike(fault)
            self._look_ahead()

    def _admit(self, fault: Fault) -> None:
        """Check a fault against the machine and the others, and let it wait for its time."""
        now_ms = self._machine.time_ms
        FAULTS[fault.kind].part(self._machine, fault.target)
        if fault.end_ms is not None and fault.end_ms <= now_ms:
            raise FaultError(f"{fault}: is over at {now_ms} ms; let it end later")
        if FAULTS[fault.kind].lasts and now_ms > 0:
            raise FaultError(f"{fault}: is decided before the run; give it before time passes")
        for other in (*self.active, *self._waiting):
            if fault.overlaps(other):
                raise FaultError(f"{fault}: changes the same as {other}; let one end before the other begins")
        self._waiting.append(fault)
        self._look_ahead()

    def _look_ahead(self) -> None:
        starts = [fault.start_ms for fault in self._waiting]
        ends = [each.fault.end_ms for each in self._broken if each.fault.end_ms is not None]
        self.next_ms = min((*starts, *ends), default=None)

    def _strike(self, fault: Fault) -> None:
        self._waiting.remove(fault)
        self.struck.append(fault)
        kind = FAULTS[fault.kind]
        part = kind.part(self._machine, fault.target)
        sound = {path: read_value(part, path) for path in kind.changes}
        for path, value in sound.items():
            write_value(part, path, kind.broken(value, fault.size or 0.0))
        self._broken.append(_Broken(fault, part, sound))

    def _mend(self, broken: _Broken) -> None:
        self._broken.remove(broken)
        for path, value in broken.sound.items():
            write_value(broken.part, path, value)
