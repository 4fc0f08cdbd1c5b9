"""Fault schedule: faults start and end at the exact millisecond."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from controller.common.saved import Saved
from plant_sim.faults.catalogue import FAULTS
from plant_sim.faults.fault import Fault
from plant_sim.faults.kind import FaultableMachine, FaultError, read_value, write_value


class _ActiveFault(NamedTuple):
    """Active fault with the original values of its part."""

    fault: Fault
    part: Any
    original: dict[str, Any]


class FaultSchedule(Saved):
    """Fault schedule of a machine.

    The code that advances plant time must stop at `next_ms` and call `advance` at that time.

    Attributes:
        next_ms: Time of the next start or end of a fault, ms; None if there is none.
        activated: All faults activated so far, in order.
    """

    SAVED = ("_active", "_pending", "activated", "next_ms")

    def __init__(self, machine: FaultableMachine, faults: Iterable[Fault] = ()) -> None:
        """Schedule faults; those already due are activated immediately.

        Args:
            machine: Machine in which they are injected.
            faults: All faults.

        Raises:
            FaultError: The machine has no such part, or two faults change the same value at the same time.
        """
        self._machine = machine
        self._pending: list[Fault] = []
        self._active: list[_ActiveFault] = []
        self.next_ms: int | None = None
        self.activated: list[Fault] = []
        for fault in faults:
            self._schedule(fault)
        self.advance(machine.time_ms)

    @property
    def active(self) -> list[Fault]:
        """Active faults in the order of activation."""
        return [each.fault for each in self._active]

    @property
    def listed(self) -> tuple[Fault, ...]:
        """Active faults in the order of activation, then the scheduled ones."""
        return (*self.active, *self._pending)

    def add(self, fault: Fault) -> None:
        """Schedule another fault; if it is due, it is activated immediately.

        Raises:
            FaultError: The machine has no such part, another fault changes the same value at the same time, or the
                fault has already ended.
        """
        self._schedule(fault)
        self.advance(self._machine.time_ms)

    def clear(self, name: str) -> None:
        """Clear an active fault before its end, or cancel a scheduled one.

        Args:
            name: Kind and target, for example ``stuck_off:left.lift_up``.

        Raises:
            FaultError: There is no such fault, or it is permanent.
        """
        pending = [fault for fault in self._pending if fault.name == name]
        active = [each for each in self._active if each.fault.name == name]
        if not pending and not active:
            known = ", ".join(fault.name for fault in (*self.active, *self._pending)) or "none"
            raise FaultError(f"{name}: neither active nor scheduled; current faults: {known}")
        if any(FAULTS[each.fault.kind].permanent for each in active):
            raise FaultError(f"{name}: is permanent and cannot be cleared")
        for fault in pending:
            self._pending.remove(fault)
        for each in active:
            self._clear(each)
        self._update_next()

    def advance(self, now_ms: int) -> None:
        """Process all starts and ends that are due, in chronological order; at equal times, ends precede starts.

        Args:
            now_ms: Plant time, ms.
        """
        while self.next_ms is not None and self.next_ms <= now_ms:
            at_ms = self.next_ms
            for active in [each for each in self._active if each.fault.end_ms == at_ms]:
                self._clear(active)
            for fault in [each for each in self._pending if each.start_ms <= at_ms]:
                self._activate(fault)
            self._update_next()

    def _schedule(self, fault: Fault) -> None:
        """Validate a fault against the machine and the other faults, and schedule it."""
        now_ms = self._machine.time_ms
        FAULTS[fault.kind].part(self._machine, fault.target)
        if fault.end_ms is not None and fault.end_ms <= now_ms:
            raise FaultError(f"{fault}: ends before the current time, {now_ms} ms; specify a later end")
        if FAULTS[fault.kind].permanent and now_ms > 0:
            raise FaultError(f"{fault}: must be set before the run; add it at plant time 0")
        for other in (*self.active, *self._pending):
            if fault.overlaps(other):
                raise FaultError(f"{fault}: changes the same value as {other}; end one before the other starts")
        self._pending.append(fault)
        self._update_next()

    def _update_next(self) -> None:
        starts = [fault.start_ms for fault in self._pending]
        ends = [each.fault.end_ms for each in self._active if each.fault.end_ms is not None]
        self.next_ms = min((*starts, *ends), default=None)

    def _activate(self, fault: Fault) -> None:
        self._pending.remove(fault)
        self.activated.append(fault)
        kind = FAULTS[fault.kind]
        part = kind.part(self._machine, fault.target)
        original = {path: read_value(part, path) for path in kind.changes}
        for path, value in original.items():
            write_value(part, path, kind.faulty_value(value, fault.size or 0.0))
        self._active.append(_ActiveFault(fault, part, original))

    def _clear(self, active: _ActiveFault) -> None:
        self._active.remove(active)
        for path, value in active.original.items():
            write_value(active.part, path, value)
