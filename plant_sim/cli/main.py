"""Command line of the plant; by default it serves the plant over Modbus TCP."""

from __future__ import annotations

import signal
from collections.abc import Sequence

from controller.common.command_line import CommandLine

COMMAND_LINE = CommandLine(
    package="plant_sim",
    script="transplanter-plant",
    description="The seedling transplanter in software.",
    commands={
        "serve": ("plant_sim.cli.serve", "serve the plant as a Modbus TCP device (default)"),
        "run": (
            "plant_sim.cli.run",
            "plant and controller in two processes: the paper's trial, with progress and report",
        ),
        "trial": ("plant_sim.cli.trial", "the paper's trial in lock step"),
        "scenario": ("plant_sim.cli.scenario", "run a scenario file and check the result"),
        "faults": ("plant_sim.cli.faults", "inject every fault in turn and tabulate how it is detected"),
        "plot": ("plant_sim.cli.plot", "draw the timing diagram and the curves of a recording"),
        "air": ("plant_sim.cli.air", "air consumption: Table 1 of the paper beside that of a run"),
        "study": ("plant_sim.cli.study", "the papers' experiments, or custom ones, on the twin"),
        "bench": ("plant_sim.cli.bench", "measure the speeds that the project promises, as ratios in one run"),
        "docs": ("plant_sim.cli.docs", "write the reference tables generated from the plant"),
    },
    default="serve",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code. SIGTERM ends it like Ctrl-C."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    return COMMAND_LINE.run(arguments)
