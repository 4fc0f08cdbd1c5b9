"""Programs as machine code: execution of a scan on a device memory in one region."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import cast

from controller.core.expr import Bit, Expr
from controller.core.llvm_ir import translate, translate_condition
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
        address: Address of the scan function.
        scan: Function that executes one scan, given the address of the memory region, the time in ms, and 1 in the
            first scan or 0 in all others.
    """

    def __init__(self, program: Program) -> None:
        """Load the machine code of a program, compiling the blocks that are not in the cache."""
        self.program = program
        self.layout = MemoryLayout(sum(isinstance(rung, Pulse | PulseFalling) for rung in program.rungs()))
        translation = translate(program, self.layout)
        # kept, because the addresses are valid only while the modules are loaded
        self._modules = LoadedModules(translation.modules)
        self.address = self._modules.address(translation.entry)
        self.scan = self._modules.function(translation.entry, None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)


class MachineCondition:
    """Machine code of a condition over the devices of a program.

    Attributes:
        address: Address of the function; see `translate_condition`.
        holds: The function.
    """

    def __init__(self, expr: Expr, layout: MemoryLayout) -> None:
        """Load the machine code of a condition, compiling it if it is not in the cache."""
        translation = translate_condition(expr, layout)
        self._modules = LoadedModules(translation.modules)
        self.address = self._modules.address(translation.entry)
        self.holds = self._modules.function(translation.entry, ctypes.c_int64, *[ctypes.c_void_p] * 3)


@lru_cache(maxsize=16)
def machine_code_of(program: Program) -> MachineCode:
    """Return the machine code of a program; all PLCs with the same program share it."""
    return MachineCode(program)


@lru_cache(maxsize=256)
def machine_condition_of(condition: Expr, layout: MemoryLayout) -> MachineCondition:
    """Return the machine code of a condition; all PLCs with the same arrangement of their memory share it."""
    return MachineCondition(condition, layout)


class MachineExecution:
    """Execution of a program as machine code on its own device memory.

    Attributes:
        memory: Device memory; its rows are views of one region.
        code: Machine code of the program.
        layout: Arrangement of the region.
        region_address: Address of the region.
        scan_address: Address of the scan function.
    """

    def __init__(self, program: Program) -> None:
        """Create the memory of a PLC and load the machine code of its program."""
        self.code = machine_code_of(program)
        self.layout = self.code.layout
        self._region = MemoryRegion(self.layout)
        self.memory = self._region.memory
        self.region_address = self._region.address
        self.scan_address = self.code.address

    @property
    def region(self) -> memoryview:
        """Device memory as bytes, arranged as in `layout`; writable."""
        return memoryview(self._region.data).cast("B")

    def run(self, now_ms: int, *, first: bool) -> None:
        """Execute all blocks and the END processing with the latched inputs."""
        self.code.scan(self.region_address, now_ms, first)

    def save(self) -> bytes:
        """Return a copy of all devices."""
        return bytes(self._region.data)

    def restore(self, saved: bytes) -> None:
        """Restore a copy returned by `save`."""
        ctypes.memmove(self._region.data, saved, len(saved))

    def copier(self, source: Bit, target: Bit, count: int) -> Callable[[], None]:
        """Return a function that copies consecutive bits, for example from a model of the machine to the X image."""
        origin, to = (self.region_address + self.layout.bit(bit.kind, bit.number) for bit in (source, target))
        return lambda: cast("None", ctypes.memmove(to, origin, count))

    def image_of(self, spans: Iterable[tuple[str, slice]]) -> Callable[[], object]:
        """Return a function that copies spans of the memory for comparison."""
        views: list[memoryview] = []
        for row, span in spans:
            bytes_each = ctypes.sizeof(getattr(self.memory, row)) // len(getattr(self.memory, row))
            view = memoryview(getattr(self.memory, row)).cast("B")
            views.append(view[span.start * bytes_each : span.stop * bytes_each])
        return lambda: b"".join(views)
