"""Programs as machine code: execution of a scan on a device memory in one region."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable
from functools import lru_cache

from controller.core.llvm_ir import translate
from controller.core.memory_layout import MemoryLayout
from controller.core.memory_region import MemoryRegion
from controller.core.object_code import LoadedModules
from controller.core.program import Program
from controller.core.rungs import Pulse, PulseFalling


class MachineCode:
    """Machine code of a program.

    Attributes:
        program: Program that was compiled.
        layout: Arrangement of its device memory.
        scan: Function that executes one scan, given the address of the memory region, the time in ms, and 1 in the
            first scan or 0 in all others.
    """

    def __init__(self, program: Program) -> None:
        """Load the machine code of a program, compiling the blocks that are not in the cache."""
        self.program = program
        self.layout = MemoryLayout(sum(isinstance(rung, Pulse | PulseFalling) for rung in program.rungs()))
        translation = translate(program, self.layout)
        self._modules = LoadedModules(translation.modules)
        self.scan = self._modules.function(translation.entry, None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)


@lru_cache(maxsize=16)
def machine_code_of(program: Program) -> MachineCode:
    """Return the machine code of a program; all PLCs with the same program share it."""
    return MachineCode(program)


class MachineExecution:
    """Execution of a program as machine code on its own device memory.

    Attributes:
        memory: Device memory; its rows are views of one region.
    """

    def __init__(self, program: Program) -> None:
        """Create the memory of a PLC and load the machine code of its program."""
        self._code = machine_code_of(program)
        self._region = MemoryRegion(self._code.layout)
        self.memory = self._region.memory

    def run(self, now_ms: int, *, first: bool) -> None:
        """Execute all blocks and the END processing with the latched inputs."""
        self._code.scan(self._region.address, now_ms, first)

    def image_of(self, spans: Iterable[tuple[str, slice]]) -> Callable[[], object]:
        """Return a function that copies spans of the memory for comparison."""
        views: list[memoryview] = []
        for row, span in spans:
            bytes_each = ctypes.sizeof(getattr(self.memory, row)) // len(getattr(self.memory, row))
            view = memoryview(getattr(self.memory, row)).cast("B")
            views.append(view[span.start * bytes_each : span.stop * bytes_each])
        return lambda: b"".join(views)
