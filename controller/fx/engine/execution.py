"""Interface between the FX2N and the execution of its program."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from typing import Any, Protocol

from controller.core.devices import Memory
from controller.fx.engine.code import TranslatedProgram

Functions = Mapping[int, Callable[..., int | None]]
"""Functions of the instructions that Python executes, by index of the instruction."""


class FxExecution(Protocol):
    """Execution of one translated program on its own memory.

    Attributes:
        memory: All devices; E contains the stored levels for edge detection.
        activity: Row A: previous activity of the steps.
        driven: Row B: activity of each operation with a drive state.
        leaving: Row L: states that a transfer has left in this scan.
        registers: Row W.
    """

    memory: Memory
    activity: list[bool]
    driven: list[bool]
    leaving: list[bool]
    registers: list[int]

    @property
    def functions(self) -> Functions:
        """Functions of the instructions that Python executes."""

    def save(self) -> Any:
        """Return a copy of the memory that `ObjectState` does not find; None if there is none."""

    def restore(self, saved: Any) -> None:
        """Restore a copy returned by `save`."""

    def link(self, functions: Functions) -> None:
        """Set the functions of the instructions that Python executes."""

    def run(self, now_ms: int) -> None:
        """Execute the program from step 0 to END.

        Raises:
            CpuError: The scan took too long, or subroutines are nested too deeply.
        """

    def run_interrupt(self, number: int, now_ms: int) -> None:
        """Execute an interrupt routine.

        Raises:
            CpuError: The routine took too long, or subroutines are nested too deeply.
        """


FxExecutionFactory = Callable[[TranslatedProgram], FxExecution]


def fastest_execution(program: TranslatedProgram) -> FxExecution:
    """Return the execution as machine code if llvmlite is installed, and as Python functions otherwise."""
    if find_spec("llvmlite") is None:
        from controller.fx.engine.python_functions import PythonFunctions  # noqa: PLC0415 - only one is required

        return PythonFunctions(program)
    from controller.fx.engine.machine_functions import MachineFunctions  # noqa: PLC0415 - requires llvmlite

    return MachineFunctions(program)
