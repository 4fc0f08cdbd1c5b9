"""Command line of the plant; by default it serves the plant over Modbus TCP."""

from __future__ import annotations

from collections.abc import Sequence

from controller.common.command_line import CommandLine
from controller.common.stop_request import StopRequest

COMMAND_LINE = CommandLine(
    package="plant_sim",
    script="transplanter-plant",
    description="Simulated seedling transplanter and its digital twin.",
    commands={
        "serve": ("plant_sim.cli.serve", "serve the plant as a Modbus TCP or RTU device (default)"),
        "connect": (
            "plant_sim.cli.connect",
            "connect the plant to a PLC that is a Modbus slave or an MC protocol server",
        ),
        "run": (
            "plant_sim.cli.run",
            "run the paper's trial with plant, controller and panel as processes, and print a report",
        ),
        "trial": ("plant_sim.cli.trial", "run the paper's trial in lock step"),
        "hil": ("plant_sim.cli.hil", "judge any controller on the simulated plant"),
        "scenario": ("plant_sim.cli.scenario", "run a scenario and check the result"),
        "line": ("plant_sim.cli.line", "plant rows with a line, from trays or a conveyor to the soil"),
        "faults": ("plant_sim.cli.faults", "inject every fault in turn and tabulate how it is detected"),
        "stories": (
            "plant_sim.cli.stories",
            "play random stories of faults and actions, or stories with mutants, for 'controller prove --mutants'",
        ),
        "replay": ("plant_sim.cli.replay", "drive the plant with captured outputs and compare the inputs"),
        "plot": ("plant_sim.cli.plot", "draw the timing diagram and the curves of a recording"),
        "air": ("plant_sim.cli.air", "compare the air consumption of a run with Table 1 of the paper"),
        "study": ("plant_sim.cli.study.command", "run the papers' experiments, or custom ones, on the twin"),
        "planter": ("plant_sim.cli.planter", "motion of the chain planter of the cabbage paper"),
        "docs": ("plant_sim.cli.docs", "write the reference tables generated from the plant"),
    },
    default="serve",
    services=frozenset({"serve", "connect", "hil"}),
)


def main(arguments: Sequence[str] | None = None, stop: StopRequest | None = None) -> int:
    """Run a command; return its exit code. See `CommandLine.run`."""
    return COMMAND_LINE.run(arguments, stop)
