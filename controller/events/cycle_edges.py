"""Edges of the inputs, steps and outputs of an arm during a cycle, scan by scan, for a timing diagram."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from controller.core.devices import device_name
from controller.core.scan import Plc
from controller.events.kinds import CycleEvent
from controller.program.machine import Transplanter
from controller.program.tags import SIDES, Side

Edge = tuple[int, str, int]
"""Edge: time since the start of the cycle in ms, FX device, raw level of the device after the edge."""

MAX_EDGES: Final = 2_000
"""Maximum number of edges of one cycle, ten times the usual number. It limits the memory used for a bouncing switch."""


class CycleEdges:
    """Recorder of the edges of both arms' cycles; an observer of the runtime, called before the production log.

    As in the production log, a cycle starts in the scan that sets its first step. The list of edges
    starts with the levels of the previous scan, at time 0. Edges of one scan are in the order of execution: inputs,
    steps, outputs. Only the inputs and outputs of the arm, including its cup sensor, are recorded; their levels
    are raw terminal levels.
    """

    def __init__(self, machine: Transplanter) -> None:
        """Create a recorder for a machine."""
        self._inputs = machine.io_map.input_count
        self._outputs = machine.io_map.output_count
        numbers = {side: [bit.number for bit in machine.cycles[side].bits.values()] for side in SIDES}
        self._steps = [slice(min(numbers[side]), max(numbers[side]) + 1) for side in SIDES]
        devices = [
            *(("X", number) for number in range(self._inputs)),
            *(("S", number) for steps in self._steps for number in range(steps.start, steps.stop)),
            *(("Y", number) for number in range(self._outputs)),
        ]
        points = {
            side: {
                (point.device, point.number)
                for point in (*machine.io_map.inputs, *machine.io_map.outputs)
                if point.tag.startswith(f"{side}.")
            }
            for side in SIDES
        }
        self._arms: dict[Side, _ArmEdges] = {}
        for side in SIDES:
            arm_devices = points[side] | {("S", number) for number in numbers[side]}
            cycle = machine.cycles[side]
            self._arms[side] = _ArmEdges(
                [(index, device_name(*device)) for index, device in enumerate(devices) if device in arm_devices],
                devices.index(("S", cycle["approach row"].number)),
                devices.index(("S", cycle["wait at feed"].number)),
            )
        self._image: list[bool] | None = None

    def __call__(self, now_ms: int, plc: Plc) -> None:
        """Evaluate the memory after a scan; if nothing has changed, only one list comparison is made."""
        memory = plc.memory
        image = memory.X[: self._inputs]
        for steps in self._steps:
            image += memory.S[steps]
        image += memory.Y[: self._outputs]
        before, self._image = self._image, image
        if before is not None and image != before:
            for arm in self._arms.values():
                arm.update(now_ms, before, image)

    def of(self, event: CycleEvent) -> tuple[Edge, ...]:
        """Return the edges of a cycle that ended in this scan; empty if its start was not recorded."""
        return self._arms[event.side].edges_since(event.at_ms - event.cycle_ms)


class _ArmEdges:
    """Edges of the most recent cycle of one arm."""

    def __init__(self, devices: list[tuple[int, str]], start: int, end: int) -> None:
        """Create a recorder for one arm.

        Args:
            devices: Index in the image and FX name of each device of the arm.
            start: Index of the first step of the cycle.
            end: Index of the home step.
        """
        self._devices = devices
        self._start, self._end = start, end
        self._edges: list[Edge] = []
        self._since_ms: int | None = None
        self._recording = False

    def update(self, now_ms: int, before: Sequence[bool], after: Sequence[bool]) -> None:
        """Record the changes in a scan."""
        if after[self._start] and not before[self._start]:
            self._since_ms, self._recording = now_ms, True
            self._edges = [(0, name, int(before[index])) for index, name in self._devices]
        if self._since_ms is None or not self._recording:
            return
        at_ms = now_ms - self._since_ms
        self._edges += [
            (at_ms, name, int(after[index])) for index, name in self._devices if after[index] != before[index]
        ]
        del self._edges[MAX_EDGES:]
        home = after[self._end] and not after[self._start]
        self._recording = not home and len(self._edges) < MAX_EDGES

    def edges_since(self, since_ms: int) -> tuple[Edge, ...]:
        """Return the edges of the cycle that started at this time; empty if there is none."""
        return tuple(self._edges) if since_ms == self._since_ms else ()
