"""Command line of the plant; by default it serves the plant over Modbus TCP."""

from __future__ import annotations

from collections.abc import Sequence

from controller.common.command_line import CommandEntry, CommandLine
from controller.common.stop_request import StopRequest

COMMAND_LINE = CommandLine(
    package="plant_sim",
    script="transplanter-plant",
    description="Simulated seedling transplanter and its digital twin.",
    commands={
        "serve": CommandEntry(
            "serve the plant as a Modbus TCP or RTU device (default)",
            "plant_sim.cli.serve",
            options="plant_sim.cli.options.serve",
        ),
        "connect": CommandEntry(
            "connect the plant to a PLC that is a Modbus slave or an MC protocol server",
            "plant_sim.cli.connect",
            options="plant_sim.cli.options.connect",
        ),
        "run": CommandEntry(
            "run the paper's trial with plant, controller and panel as processes, and print a report",
            "plant_sim.cli.run",
            options="plant_sim.cli.options.run",
        ),
        "trial": CommandEntry(
            "run the paper's trial in lock step", "plant_sim.cli.trial", options="plant_sim.cli.options.trial"
        ),
        "debug": CommandEntry(
            "record a trial, go back in it, search it, and run on with a change",
            "plant_sim.cli.debug",
            options="plant_sim.cli.options.debug",
        ),
        "hil": CommandEntry(
            "judge any controller on the simulated plant", "plant_sim.cli.hil", options="plant_sim.cli.options.hil"
        ),
        "scenario": CommandEntry(
            "run a scenario and check the result", "plant_sim.cli.scenario", options="plant_sim.cli.options.scenario"
        ),
        "line": CommandEntry(
            "plant rows with a line, from trays or a conveyor to the soil",
            "plant_sim.cli.line",
            options="plant_sim.cli.options.line",
        ),
        "faults": CommandEntry(
            "inject every fault in turn and tabulate how it is detected",
            "plant_sim.cli.faults",
            options="plant_sim.cli.options.faults",
        ),
        "stories": CommandEntry(
            "play random stories of faults and actions, or stories with mutants, for 'controller prove --mutants'",
            "plant_sim.cli.stories",
            options="plant_sim.cli.options.stories",
        ),
        "replay": CommandEntry(
            "drive the plant with captured outputs and compare the inputs",
            "plant_sim.cli.replay",
            options="plant_sim.cli.options.replay",
        ),
        "plot": CommandEntry(
            "draw the timing diagram and the curves of a recording",
            "plant_sim.cli.plot",
            options="plant_sim.cli.options.plot",
        ),
        "air": CommandEntry(
            "compare the air consumption of a run with Table 1 of the paper",
            "plant_sim.cli.air",
            options="plant_sim.cli.options.air",
        ),
        "study": CommandEntry(
            "run the papers' experiments, or custom ones, on the twin",
            "plant_sim.cli.study.command",
            options="plant_sim.cli.options.study",
            extra="studies",
        ),
        "planter": CommandEntry(
            "motion of the chain planter of the cabbage paper",
            "plant_sim.cli.planter",
            options="plant_sim.cli.options.planter",
        ),
        "reproduce": CommandEntry(
            "compute a result again from its provenance and compare it, file by file",
            "plant_sim.cli.reproduce.command",
            options="plant_sim.cli.reproduce.options",
        ),
        "docs": CommandEntry(
            "write the reference tables generated from the plant",
            "plant_sim.cli.docs",
            options="plant_sim.cli.options.docs",
        ),
    },
    default="serve",
    services=frozenset({"serve", "connect", "run", "trial", "hil"}),
)


def main(arguments: Sequence[str] | None = None, stop: StopRequest | None = None) -> int:
    """Run a command; return its exit code. See `CommandLine.run`."""
    return COMMAND_LINE.run(arguments, stop)
