"""Text form of devices and their values."""

from __future__ import annotations

from controller.core.program import Program
from controller.core.rungs import Pulse, PulseFalling
from controller.verify.cells import STOPPED, Cell, cell_of
from controller.verify.timing import LONG


class Names:
    """Names of a program's devices."""

    def __init__(self, program: Program) -> None:
        """Collect the names."""
        self._names = {cell_of(device): device.name for device in program.devices() if device.name}
        edges = [rung.target for rung in program.rungs() if isinstance(rung, Pulse | PulseFalling)]
        self._names |= {Cell("E", n): f"edge memory of {bit} {bit.name}".rstrip() for n, bit in enumerate(edges)}

    def name(self, cell: Cell) -> str:
        """Return the device of a cell with its name: "X10 left.lift_down"."""
        tag = self._names.get(cell) or self._names.get(Cell(cell.kind[0], cell.number), "")
        return f"{cell} {tag}".rstrip()

    def describe(self, cell: Cell, value: int, tick: int = LONG) -> str:
        """Return the value of a cell as text at a tick of its time base, by default that of `ExactTimers.aged`."""
        if cell.kind == "TS":
            timer = self.name(Cell("T", cell.number))
            return f"{timer} stopped" if value == STOPPED else f"{timer} running for {tick - value} counts"
        return f"{self.name(cell)} {'on' if value else 'off'}" if cell.is_bit else f"{self.name(cell)} = {value}"
