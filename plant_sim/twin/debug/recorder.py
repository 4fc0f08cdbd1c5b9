"""Recorder of a twin: states at intervals, and all that enters from outside between two scans."""

from __future__ import annotations

from collections.abc import Callable

from controller.common.errors import InputError
from controller.debug.timeline import INTERVAL, LENGTH, RunTimeline
from plant_sim.twin.debug.machine import TwinMachine
from plant_sim.twin.debug.outside import MovedByHand, OutsideState, PowerCycle, action_between, outside_of
from plant_sim.twin.lock_step import SCAN_MS, Twin


class TwinRecorder:
    """Recorder that observes a twin from its present state on, and does not affect it.

    Attributes:
        twin: The twin.
        timeline: The recorded run.
    """

    def __init__(self, twin: Twin, *, length: int = LENGTH, interval: int = INTERVAL) -> None:
        """Attach a recorder to a twin.

        Args:
            twin: The twin; it executes machine code and has no other recorder.
            length: Number of scans to keep.
            interval: Scans between two stored states.
        """
        self.twin = twin
        self._machine = TwinMachine(twin)
        self.timeline = RunTimeline(self._machine, length=length, interval=interval)
        self._left, self._left_ms = outside_of(twin), self._times
        self._begun_ms = twin.now_ms
        twin.recorder = self

    def begin(self, until_ms: int) -> int:
        """Record what has entered; return the time of the next stored state, if it is earlier, ms.

        Writes of clients enter here, so that they are recorded for the scan that takes them.
        """
        self._machine.owner = None
        self.twin.runtime.writes.take()
        self._note(self._left)
        scan, now_ms = self._machine.scan, self.twin.now_ms
        self._begun_ms = now_ms
        return min(until_ms, now_ms + (self.timeline.due(scan) - scan) * SCAN_MS)

    def end(self) -> None:
        """Count the scans, and store the state if it is due."""
        machine = self._machine
        scans = (self.twin.now_ms - self._begun_ms) // SCAN_MS
        if scans:
            self.twin.runtime.writes.settle()
        machine.scan += scans
        self._begun_ms = self.twin.now_ms
        self._left, self._left_ms = outside_of(self.twin), self._times
        if machine.scan % self.timeline.interval == 0:
            self.timeline.keep()
            machine.owner = None

    def watch(self, call: Callable[[], None]) -> None:
        """Call the watchers; what they order is recorded for the next scan.

        Raises:
            InputError: A watcher moves the plant within a scan.
        """
        before = outside_of(self.twin)
        call()
        after = outside_of(self.twin)
        if before == after:
            return
        if _at_once(before) != _at_once(after):
            raise InputError("the run cannot be recorded: a monitor changes the plant within a scan")
        action = action_between(before, after, self._machine.execution)
        if action is not None:
            scans = (self.twin.now_ms - self._begun_ms) // SCAN_MS + 1
            self.timeline.note(action, after=self._machine.scan + scans)

    def switch_off(self, off_ms: int) -> None:
        """Record what has entered, and a power cycle."""
        self._machine.owner = None
        self._note(self._left)
        self.timeline.note(PowerCycle(off_ms))

    def switch_on(self) -> None:
        """Store the state, because it takes long to switch the controller on."""
        self.timeline.keep()
        self._machine.owner = None
        self._left, self._left_ms = outside_of(self.twin), self._times

    def close(self) -> RunTimeline:
        """End the recording and return the recorded run."""
        self.twin.recorder = None
        self.twin.unwatch()
        self.timeline.keep()
        return self.timeline

    @property
    def _times(self) -> tuple[int, int]:
        """Time of the plant and of the controller, ms."""
        return self.twin.plant.time_ms, self.twin.now_ms

    def _note(self, before: OutsideState) -> None:
        if self._times != self._left_ms:
            self.timeline.note(MovedByHand(self._machine.save()))
            self._left_ms = self._times
            return
        action = action_between(before, outside_of(self.twin), self._machine.execution)
        if action is not None:
            self.timeline.note(action)


def _at_once(outside: OutsideState) -> tuple[object, ...]:
    """Return the part of the state that acts on the plant before the next scan."""
    plant = outside.box, outside.faults, outside.state, outside.params, outside.frequency_per_min, outside.bridged
    return (*plant, outside.conveyor)
