"""Parts of a package in Structured Text that several targets share."""

from __future__ import annotations

from typing import Final

from controller.common.document.rendering import csv_text
from controller.core.program import Program
from controller.export.packages.first_minutes import KeptMemory
from controller.export.packages.package import PackageSource
from controller.export.runtime_parts.part import CONSTANT_BITS, LINK_LOST, SCAN_MS
from controller.export.structured_text import ProgramText
from controller.export.structured_text_variables import Variables
from controller.fx.language.instruction import LadderError

TEXT: Final = "transplanter.st"
"""The program."""
ADDRESSES: Final = "addresses.csv"
"""Addresses of the variables."""

RETAINED: Final = KeptMemory(
    later=3,
    note="At the first start the memory is lost: alarm S904 until X0 is pressed, or until the machine is declared as "
    "new, which is refused once the memory is valid. Afterwards the runtime retains rows, claws and tray. A runtime "
    "that does not is asked as at the first start, and about a tray that is seen.",
)
"""Memory of a runtime that retains the variables declared so."""

COMMANDS: Final = range(400, 470)
"""Relays that a panel sets; the program resets them."""
_MOST_NAMES: Final = 5


def require_levels(source: PackageSource) -> None:
    """Check that all outputs are levels.

    Raises:
        LadderError: The program has a pulse train.
    """
    if source.pulses is not None:
        raise LadderError("--stepper plsy: Structured Text has no PLSY; omit it, or choose --target fx2n")


def safe_levels(source: PackageSource) -> dict[int, bool]:
    """Return the raw level of every output in its safe state, by number."""
    return {point.number: point.level(point.safe) for point in source.io_map.outputs}


def configuration(name: str, configuration_: str = "transplanter_plc", resource: str = "main_cpu") -> str:
    """Return the CONFIGURATION that executes a PROGRAM in a cyclic task.

    Args:
        name: Name of the PROGRAM.
        configuration_: Name of the CONFIGURATION.
        resource: Name of the RESOURCE.
    """
    return "\n".join(
        (
            f"CONFIGURATION {configuration_}",
            "",
            f"  RESOURCE {resource} ON PLC",
            f"    TASK scan(INTERVAL := T#{SCAN_MS}ms, PRIORITY := 0);",
            f"    PROGRAM machine WITH scan : {name};",
            "  END_RESOURCE",
            "",
            "END_CONFIGURATION",
            "",
        )
    )


def constant_bits(program: Program, *, link: bool) -> str:
    """Return one line for each system bit that is constantly FALSE, with the reason."""
    reasons = dict(CONSTANT_BITS)
    if not link:
        reasons[LINK_LOST] = "the inputs are terminals of the PLC itself"
    return "\n".join(f"  {bit.name}: {reasons[bit.name]}" for bit in program.system if bit.name in reasons)


def addresses_csv(variables: Variables) -> bytes:
    """Return the table of the variables with an address."""
    rows = (
        (each.name, each.address, each.type, "yes" if each.retain else "no", each.comment)
        for each in variables.all()
        if each.address
    )
    return csv_text(("variable", "address", "type", "retained", "meaning"), rows, end="\r\n").encode()


def size_and_losses(text: ProgramText) -> tuple[str, ...]:
    """Return lines that state the size of a program in Structured Text, and the comments that it cannot contain."""
    every = text.variables.all()
    located = sum(bool(variable.address) for variable in every)
    size = f"{len(text.body.splitlines())} lines, {len(every)} variables, {located} of them with an address"
    lost = [variable.name for variable in every if not variable.comment.isascii()]
    if not lost:
        return (size,)
    names = ", ".join(lost[:_MOST_NAMES]) + (", ..." if len(lost) > _MOST_NAMES else "")
    return size, f"comments of {names}: characters beyond ASCII are written as ?; the I/O map has them"
