"""Interface of a runtime part, and the tags of the system bits that the parts write."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from controller.core.expr import Bit
from controller.core.program import Program
from controller.export.structured_text_variables import Variables

SCAN_MS: Final = 10
"""Period of the task that executes the program, ms (our decision: the period of the controller)."""

LINK_LOST, SCAN_FAULT, MEMORY_LOST = "link lost", "scan fault", "memory lost"
CONSTANT_BITS: Final[Mapping[str, str]] = {
    "outputs held": "the runtime does not report when a value has been stored",
    "store fault": "the runtime does not report an error of its memory",
    "panel silent": "the runtime does not report how often a panel reads",
    "outputs taken": "the runtime does not read outputs back",
    "outputs contested": "the runtime does not report the writes of other masters",
    "panel shown": "the runtime does not report how often a panel reads",
}
"""Reason why a system bit is constantly FALSE on a target, by tag."""


@dataclass(frozen=True, slots=True)
class RuntimePart:
    """Statements before and after the blocks of the machine's program in every scan.

    Attributes:
        program: The program.
    """

    program: Program

    def begin(self, variables: Variables) -> list[str]:
        """Declare the variables of the part and return the lines before the program."""
        del variables
        return []

    def end(self, variables: Variables) -> list[str]:
        """Return the lines after the program."""
        del variables
        return []


def system_bit(program: Program, tag: str) -> Bit:
    """Return the system bit with this tag."""
    return next(bit for bit in program.system if bit.name == tag)
