"""Command line of the controller; the default command runs the machine's program on a field link."""

from __future__ import annotations

from collections.abc import Sequence

from controller.common.command_line import CommandEntry, CommandLine
from controller.common.stop_request import StopRequest

COMMAND_LINE = CommandLine(
    package="controller",
    script="transplanter-controller",
    description="Soft PLC of the seedling transplanter.",
    commands={
        "run": CommandEntry("run the machine's program on a field link (default)", "controller.cli.run"),
        "check-io": CommandEntry("check the wire of every point, with a report to sign", "controller.cli.check_io"),
        "prove": CommandEntry(
            "prove that no scan violates a safety requirement, for any inputs",
            "controller.cli.prove",
            options="controller.cli.options.prove",
            extra="verify",
        ),
        "replay": CommandEntry(
            "run a trace written by 'prove --traces' on the PLC and show the result",
            "controller.cli.replay",
            options="controller.cli.options.replay",
            extra="verify",
        ),
        "capture": CommandEntry("capture field traffic, and replay it on the program", "controller.cli.capture"),
        "ladder": CommandEntry(
            "FX2N: export the machine's program; check, run or draw any program", "controller.cli.ladder.command"
        ),
        "history": CommandEntry(
            "show or export the recorded alarms, events, cycles and audit trail", "controller.cli.history"
        ),
        "panel": CommandEntry(
            "serve the operator's page, as a Modbus client of a running controller",
            "controller.cli.panel",
            options="controller.cli.options.panel",
        ),
        "tags": CommandEntry("write the list of Modbus tags for panel builders", "controller.cli.tags"),
        "docs": CommandEntry("write the reference tables generated from the program", "controller.cli.docs"),
    },
    default="run",
    services=frozenset({"run", "panel", "check-io", "capture"}),
)


def main(arguments: Sequence[str] | None = None, stop: StopRequest | None = None) -> int:
    """Run a command and return its exit code; see `CommandLine.run`."""
    return COMMAND_LINE.run(arguments, stop)
