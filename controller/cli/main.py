"""Command line of the controller; the default command runs the machine's program on a field link."""

from __future__ import annotations

from collections.abc import Sequence

from controller.common.command_line import CommandLine
from controller.common.stop_request import StopRequest

COMMAND_LINE = CommandLine(
    package="controller",
    script="transplanter-controller",
    description="Soft PLC of the seedling transplanter.",
    commands={
        "run": ("controller.cli.run", "run the machine's program on a field link (default)"),
        "check-io": ("controller.cli.check_io", "check the wire of every point, with a report to sign"),
        "prove": ("controller.cli.prove", "prove that no scan violates a safety requirement, for any inputs"),
        "replay": ("controller.cli.replay", "run a trace written by 'prove --traces' on the PLC and show the result"),
        "capture": ("controller.cli.capture", "capture field traffic, and replay it on the program"),
        "ladder": ("controller.cli.ladder", "FX2N: export the machine's program; check, run or draw any program"),
        "history": ("controller.cli.history", "show or export the recorded alarms, events, cycles and audit trail"),
        "panel": ("controller.cli.panel", "serve the operator's page, as a Modbus client of a running controller"),
        "tags": ("controller.cli.tags", "write the list of Modbus tags for panel builders"),
        "docs": ("controller.cli.docs", "write the reference tables generated from the program"),
    },
    default="run",
    services=frozenset({"run", "panel", "check-io", "capture"}),
)


def main(arguments: Sequence[str] | None = None, stop: StopRequest | None = None) -> int:
    """Run a command and return its exit code; see `CommandLine.run`."""
    return COMMAND_LINE.run(arguments, stop)
