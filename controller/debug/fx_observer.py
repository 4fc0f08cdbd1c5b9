"""Scans of a recorded run of an FX program as they were executed, observed in the PLC itself.

The scan is executed twice from the state in which it began: with the observed program in place of the execution of the
PLC, and then as recorded. It therefore depends on the same drive states of applied instructions, terminals between two
scans, special function modules and serial line.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from controller.core.devices import Memory
from controller.debug.machine import copied
from controller.debug.scan_observer import ScanObserver
from controller.debug.timeline import RunTimeline
from controller.fx.observation.observed_plc import ObservedFunctions, observed

if TYPE_CHECKING:
    from controller.debug.fx_machine import FxMachine


class FxScanObserver(ScanObserver):
    """Observer of the scans of an FX program, for its recorded run and its branches."""

    def __init__(self, machine: FxMachine) -> None:
        """Translate the program.

        Raises:
            LadderError: The program contains a part that the engine does not support.
        """
        self._machine = machine
        super().__init__(machine, ObservedFunctions(machine.ladder, machine.running.plc.execution))

    def _execute(self, line: RunTimeline, scan: int) -> tuple[Memory, Memory]:
        return line.execute(scan, self._observed), line.machine.memory

    def _observed(self) -> Memory:
        """Execute the next scan with records; return the devices at its END, with the PLC in the state before it."""
        machine, running = self._machine, self._machine.running
        saved = machine.save()
        try:
            with observed(running.plc, self.records):
                running.scan()
            return copied(running.plc.memory)
        finally:
            machine.restore(saved)
