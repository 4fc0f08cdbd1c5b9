"""Execution of a translated program as machine code; operations are executed by Python functions."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache
from typing import Final

from controller.core.memory_region import MemoryRegion
from controller.core.object_code import LoadedModules
from controller.fx.engine.code import TranslatedProgram, interrupt_name
from controller.fx.engine.cpu import call_error, watchdog_error
from controller.fx.engine.execution import Functions
from controller.fx.engine.llvm_part import CALLBACK, OVERDUE, STOPPED, TICK_REGISTERS, TOO_DEEP, FxLayout
from controller.fx.engine.llvm_program import llvm_modules

_ENTRY: Final = "scan"
_CALLBACK: Final = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)


class FxMachineCode:
    """Machine code of a program.

    Attributes:
        layout: Arrangement of its memory.
        scan: Function that executes the program, given the address of the memory region and the time in ms.
        interrupts: Functions of the interrupt routines by name, given the address of the memory region.
    """

    def __init__(self, program: TranslatedProgram) -> None:
        """Load the machine code, compiling the parts that are not in the cache."""
        self.layout = FxLayout(program)
        self._modules = LoadedModules(llvm_modules(program, self.layout))
        self.interrupts: dict[str, Callable[[int], int]] = {
            routine.name: self._modules.function(routine.name, ctypes.c_int64, ctypes.c_void_p)
            for routine in program.interrupts
        }
        self.scan: Callable[[int, int], int] = self._modules.function(
            _ENTRY, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64
        )


@lru_cache(maxsize=16)
def machine_code_of(program: TranslatedProgram) -> FxMachineCode:
    """Return the machine code of a program; all PLCs with the same program share it."""
    return FxMachineCode(program)


class MachineFunctions:
    """Execution of a program as machine code on a memory in one region.

    Attributes:
        memory: All devices.
        activity: Row A.
        driven: Row B.
        leaving: Row L.
        registers: Row W.
        functions: Functions of the instructions that Python executes.
        scan: Function that executes the program, given the address of the memory region and the time in ms.
        address: Address of the memory region.
    """

    def __init__(self, program: TranslatedProgram) -> None:
        self._code = machine_code_of(program)
        self._region = MemoryRegion(self._code.layout)
        rows = self._region.rows
        self.memory = self._region.memory
        self.activity: list[bool] = rows["A"]
        self.driven: list[bool] = rows["B"]
        self.leaving: list[bool] = rows["L"]
        self.registers: list[int] = rows["W"]
        self.scan, self.address = self._code.scan, self._region.address
        self.functions: Functions = {}
        self._exception: BaseException | None = None
        self._callback = _CALLBACK(self._execute)
        self.registers[CALLBACK] = ctypes.cast(self._callback, ctypes.c_void_p).value or 0

    def save(self) -> bytes:
        """Return a copy of the memory region."""
        return bytes(self._region.data)

    def restore(self, saved: bytes) -> None:
        """Restore a copy returned by `save`."""
        ctypes.memmove(self._region.data, saved, len(saved))

    def link(self, functions: Functions) -> None:
        """Set the functions of the instructions that Python executes."""
        self.functions = functions

    def run(self, now_ms: int) -> None:
        """Execute the program from step 0 to END."""
        self._raise_error(self.scan(self.address, now_ms))

    def run_interrupt(self, number: int, now_ms: int) -> None:
        """Execute an interrupt routine."""
        for base_ms, register in TICK_REGISTERS.items():
            self.registers[register] = now_ms // base_ms
        self._raise_error(self._code.interrupts[interrupt_name(number)](self.address))

    def _raise_error(self, result: int) -> None:
        """Raise the error that has stopped the machine code."""
        if result == STOPPED:
            exception, self._exception = self._exception, None
            assert exception is not None  # noqa: S101 - only `_execute` returns this result
            raise exception
        if result == OVERDUE:
            raise watchdog_error()
        if result == TOO_DEEP:
            raise call_error()

    def _execute(self, index: int, drive: int) -> int:
        """Execute an operation; -1 stops the machine code, because an exception cannot pass through it."""
        try:
            function = self.functions[index]
            result = function() if drive < 0 else function(bool(drive))
        except BaseException as exception:  # noqa: BLE001 - raised again by `run`
            self._exception = exception
            return -1
        return result or 0
