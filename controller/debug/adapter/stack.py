"""Call stack of a position: rung, block and scan, and below them the active steps of the step charts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from controller.debug.adapter.listed_program import ListedProgram
from controller.debug.commands import Debugger


def frames(debugger: Debugger, program: ListedProgram) -> list[dict[str, Any]]:
    """Return the frames of the protocol, with lines from 1."""
    found = enumerate(_places(debugger), start=1)
    return [
        {"id": number, "name": name, "source": program.source, "line": program.line(at), "column": 1}
        for number, (name, at) in found
    ]


def _places(debugger: Debugger) -> Iterator[tuple[str, int]]:
    """Yield the text and the instruction of each frame."""
    line, (scan, at) = debugger.line, debugger.position
    line.seek(scan)
    machine = line.machine
    instructions = machine.ladder.instructions
    time = f"scan {scan}, {machine.now_ms / 1000:.2f} s"
    if at is None:
        yield f"END of {time}" if scan else "before scan 1", len(instructions) - 1
    else:
        reference = debugger.stepper.reference
        yield f"rung {reference.rung_at(at)}, step {reference.step_numbers[at]}", at
        titles = [start for start in machine.ladder.titles if start <= at]
        if titles:
            yield " ".join(reference.title_at(at).split()), max(titles)
        yield f"scan {scan + 1}, after {time}", 0
    charts = {str(each.operands[0]): at for at, each in enumerate(instructions) if each.name == "STL"}
    for signal in machine.steps():
        if signal.read() and signal.name in charts:
            yield f"{signal.name} {signal.tag}".strip(), charts[signal.name]
