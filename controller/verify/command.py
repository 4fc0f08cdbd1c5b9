"""The commands ``prove`` and ``replay``: a proof as text or JSON, its traces as files."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable
from pathlib import Path

from controller.core.specification import Specification
from controller.verify.cells import ModelError
from controller.verify.model import Model
from controller.verify.report import Report, prove
from controller.verify.trace import Trace, breaks

__all__ = ["ModelError", "prove_command", "replay_command"]


def prove_command(
    specification: Specification,
    *,
    clock: Callable[[], float],
    goals: Collection[str] | None,
    short: bool,
    as_json: bool,
    traces: Path | None,
) -> tuple[str, bool]:
    """Prove a specification.

    Args:
        specification: What is to be proved.
        clock: Seconds, rising.
        goals: Names of what is to be proved; None = everything.
        short: Leave out traces, steps and ways out.
        as_json: Report as JSON.
        traces: Folder for the traces of what is broken.

    Returns:
        What to print, and whether all is proved.

    Raises:
        ModelError: There is no such goal.
        OSError: The folder cannot be written.
    """
    if traces is not None:
        traces.mkdir(parents=True, exist_ok=True)  # a folder that cannot be is told before the work, not after it
    report = prove(specification, clock=clock, only=goals, short=short)
    if traces is not None:
        _write(report, traces)
    return report.to_json() if as_json else report.text(), report.good


def _write(report: Report, folder: Path) -> None:
    for row in report.rows:
        if row.trace is not None:
            name = re.sub(r"\W+", "-", row.name).strip("-")
            (folder / f"{name}.json").write_text(row.trace.to_json() + "\n", encoding="utf-8")


def replay_command(specification: Specification, path: Path) -> tuple[Iterable[str], bool]:
    """Run a trace on the PLC.

    Args:
        specification: What it was found in.
        path: The trace.

    Returns:
        The scans as text, and whether the goal still holds after them.

    Raises:
        ModelError: It is no trace, or one of another program.
        OSError: The file cannot be read.
    """
    try:
        trace = Trace.from_json(path.read_text(encoding="utf-8"))
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error
    model = Model(specification)
    goal = next((goal for goal in model.goals if goal.name == trace.goal), None)
    if goal is None:
        raise ModelError(f"{path}: the program has no goal {trace.goal!r}; give the rules that were left out")
    try:
        broken = breaks(model.program, trace, goal)
    except (ValueError, IndexError) as error:
        raise ModelError(f"{path}: {error}; give the rules that were left out, or write it anew") from error
    return trace.lines(model.program, goal.holds), not broken
