"""Facts of the machine for its mimic, from the devices of its program."""

from __future__ import annotations

from typing import Any

from controller.core.devices import Memory
from controller.core.expr import Bit, Expr, Word, evaluate
from controller.program.machine import Transplanter
from controller.program.tags import ROWS, Side

Json = dict[str, Any]


class MachineFacts:
    """Facts of a machine, read from a memory of its program."""

    def __init__(self, machine: Transplanter) -> None:
        """Take the program and its tags."""
        self._machine = machine

    def io(self, memory: Memory) -> Json:
        """Return the raw level of each terminal by address."""
        io_map = self._machine.io_map
        points = (*io_map.inputs, *io_map.outputs)
        return {point.address: int(memory.bits(point.device)[point.number]) for point in points}

    def tray(self, memory: Memory) -> Json:
        """Return the phase of the tray and the motion of its conveyor."""
        tray = self._machine.tags.tray
        return {
            "phase": _read(memory, tray.phase),
            "edge": evaluate(tray.edge, memory),
            "running": evaluate(tray.driven["tray_run"], memory),
            "forward": evaluate(tray.driven["tray_forward"], memory),
        }

    def arm(self, memory: Memory, side: Side) -> Json:
        """Return place, seedlings, rows and step of an arm."""
        arm = self._machine.tags.arms[side]
        sequences = (self._machine.cycles[side], self._machine.homings[side])
        active = [str(bit) for sequence in sequences for bit, _ in sequence if _read(memory, bit)]

        def holds(condition: Expr) -> bool:
            return evaluate(condition, memory)

        return {
            "down": holds(arm.down),
            "up": holds(arm.up),
            "at_feed": holds(arm.at_feed),
            "at_pick": next((row for row in ROWS if holds(arm.at_pick[row])), 0),
            "spread": holds(arm.is_spread),
            "converged": holds(arm.is_converged),
            "loaded": holds(arm.loaded),
            "load_known": holds(arm.claws_known),
            "out_of_service": holds(arm.out_of_service),
            "claws_closed": holds(arm.claws_closed),
            "step": active[-1] if active else None,
            "row": next((row for row in ROWS if holds(arm.row_is[row])), ROWS[0]),
            "rows": {str(row): _read(memory, arm.rows[row]) for row in ROWS},
            "missed_cups": _read(memory, arm.missed_cups),
            "cycles": _read(memory, arm.cycles),
            "cup_count": _read(memory, arm.cup_counter.value),
        }


def _read(memory: Memory, device: Bit | Word) -> int:
    if isinstance(device, Bit):
        return int(memory.bits(device.kind)[device.number])
    return memory.word(device.kind, device.number)
