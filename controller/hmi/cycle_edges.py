"""Every edge of an arm's cycle, scan by scan: its inputs, steps and outputs, for a timing diagram."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from controller.core.devices import device_name
from controller.core.scan import Plc
from controller.hmi.production import CycleEvent
from controller.program.machine import Transplanter
from controller.program.tags import SIDES, Side

Edge = tuple[int, str, int]
"""Time since the begin of the cycle, ms; FX device; its raw level from then on."""

MOST_EDGES: Final = 2_000
"""Longest list of one cycle, ten times what a cycle has: a trembling switch does not fill the memory."""


class CycleEdges:
    """Records the edges of the cycles of both arms; an observer of the runtime, in front of the production log.

    A cycle begins in the scan that turns its first step on, as the production log sees it. Its list starts with the
    levels of the scan before, at 0 ms, and goes on with the edges, within a scan in the order of a scan: inputs, steps,
    outputs. Inputs and outputs are the arm's own, its cup counter among them, as raw levels of the terminals.
    """

    def __init__(self, machine: Transplanter) -> None:
        """Watch a machine."""
        self._inputs = machine.io_map.input_count
        self._outputs = machine.io_map.output_count
        numbers = {side: [bit.number for bit in machine.cycles[side].bits.values()] for side in SIDES}
        self._steps = [slice(min(numbers[side]), max(numbers[side]) + 1) for side in SIDES]
        places = [
            *(("X", number) for number in range(self._inputs)),
            *(("S", number) for steps in self._steps for number in range(steps.start, steps.stop)),
            *(("Y", number) for number in range(self._outputs)),
        ]
        points = {
            side: {(point.device, point.number) for point in (*machine.io_map.inputs, *machine.io_map.outputs)
                   if point.tag.startswith(f"{side}.")}
            for side in SIDES
        }  # fmt: skip
        self._arms: dict[Side, _ArmEdges] = {}
        for side in SIDES:
            own = points[side] | {("S", number) for number in numbers[side]}
            cycle = machine.cycles[side]
            self._arms[side] = _ArmEdges(
                [(index, device_name(*place)) for index, place in enumerate(places) if place in own],
                places.index(("S", cycle["approach row"].number)),
                places.index(("S", cycle["wait at feed"].number)),
            )
        self._image: list[bool] | None = None

    def __call__(self, now_ms: int, plc: Plc) -> None:
        """Look at the memory after a scan; where nothing has changed, one comparison of lists."""
        memory = plc.memory
        image = memory.X[: self._inputs]
        for steps in self._steps:
            image += memory.S[steps]
        image += memory.Y[: self._outputs]
        before, self._image = self._image, image
        if before is not None and image != before:
            for arm in self._arms.values():
                arm.see(now_ms, before, image)

    def of(self, event: CycleEvent) -> tuple[Edge, ...]:
        """Return the edges of a cycle that ended in this scan; none if its begin was not seen."""
        return self._arms[event.side].edges_since(event.at_ms - event.cycle_ms)


class _ArmEdges:
    """The edges of one arm's last cycle."""

    def __init__(self, devices: list[tuple[int, str]], start: int, end: int) -> None:
        """Take the arm's devices with their places in the image, and the places of its first step and of its home."""
        self._devices = devices
        self._start, self._end = start, end
        self._edges: list[Edge] = []
        self._since_ms: int | None = None
        self._recording = False

    def see(self, now_ms: int, before: Sequence[bool], after: Sequence[bool]) -> None:
        """Take what has changed in a scan."""
        if after[self._start] and not before[self._start]:
            self._since_ms, self._recording = now_ms, True
            self._edges = [(0, name, int(before[index])) for index, name in self._devices]
        if self._since_ms is None or not self._recording:
            return
        at_ms = now_ms - self._since_ms
        self._edges += [
            (at_ms, name, int(after[index])) for index, name in self._devices if after[index] != before[index]
        ]
        del self._edges[MOST_EDGES:]
        home = after[self._end] and not after[self._start]
        self._recording = not home and len(self._edges) < MOST_EDGES

    def edges_since(self, since_ms: int) -> tuple[Edge, ...]:
        """Return the edges of the cycle that began then."""
        return tuple(self._edges) if since_ms == self._since_ms else ()
