"""Command ``replay``: run a trace of ``prove --traces`` on the PLC."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

from controller.cli.machine import machine_of
from controller.common.errors import InputError
from controller.core.specification import Specification
from controller.program.requirements.proof import specification as specification_of
from controller.verify.cells import ModelError
from controller.verify.model import Model
from controller.verify.trace import Trace, breaks


def run(options: argparse.Namespace) -> int:
    """Print the scans; return 0 if the goal of the trace holds after the last scan, otherwise 1."""
    specification = specification_of(machine_of(options, without=options.without))
    try:
        lines, holds = replay_command(specification, options.trace)
    except ModelError as error:
        raise InputError(str(error)) from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{options.trace}: {error}; specify a trace written by 'prove --traces'") from error
    print("\n".join(lines))
    print("the requirement holds" if holds else "the requirement is violated")
    return 0 if holds else 1


def replay_command(specification: Specification, path: Path) -> tuple[Iterable[str], bool]:
    """Run a trace on the PLC.

    Args:
        specification: Specification to which the trace belongs.
        path: Trace file.

    Returns:
        The scans as text, and True if the goal of the trace holds after the last scan.

    Raises:
        ModelError: The file is not a trace, or belongs to another program.
        OSError: The file cannot be read.
    """
    try:
        trace = Trace.from_json(path.read_text(encoding="utf-8"))
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error
    model = Model(specification)
    goal = next((goal for goal in model.goals if goal.name == trace.goal), None)
    if goal is None:
        raise ModelError(f"{path}: the program has no goal {trace.goal!r}; specify the omitted rules with --without")
    try:
        broken = breaks(model.program, trace, goal)
    except (ValueError, IndexError) as error:
        raise ModelError(
            f"{path}: {error}; specify the omitted rules with --without, or regenerate the trace"
        ) from error
    return trace.lines(model.program, goal.holds), not broken
