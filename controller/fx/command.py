"""The command ``ladder``: export the machine's program, check, run and draw anybody's."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Final

from controller.core.program import Program
from controller.fx.check import MOST_STEPS, check, usage
from controller.fx.draw import draw
from controller.fx.export import PulseTrain, acting, export
from controller.fx.gx_csv import write_gx_csv
from controller.fx.il import write_il
from controller.fx.instruction import LadderError
from controller.fx.parts import parts_of
from controller.fx.reading import load_ladder
from controller.fx.running import run
from controller.fx.stimulus import load_stimulus
from controller.fx.structured_text import structured_text

FORMATS: Final = ("il", "gx-csv", "st")
STEPPER_HZ: Final = 955
"""Pulses a second for 0.2 m/s of the conveyor: 1.8 degrees a step, gear 3 : 1, drum of 40 mm."""

Answer = tuple[str, int]
"""What to print, and the exit code."""


class LadderCommand:
    """The subcommands; each gives what to print and the exit code.

    They raise `LadderError` and `StimulusError` with lines that name the place, and `OSError` where a file cannot be
    written.
    """

    def __init__(self, program_of: Callable[[Path], Program], stepper: Callable[[Program], PulseTrain]) -> None:
        """Take what the room above knows.

        Args:
            program_of: Returns the machine's program for the wires in a file.
            stepper: Returns the machine's stepper output as a train of pulses, at `STEPPER_HZ`.
        """
        self._program_of = program_of
        self._stepper = stepper

    def add_to(self, parser: argparse.ArgumentParser, io_map: Path) -> None:
        """Add the subcommands to the parser of ``ladder``."""
        commands = parser.add_subparsers(required=True, metavar="ACTION")
        export_ = commands.add_parser("export", help="write the machine's program for a real PLC")
        export_.set_defaults(action=self._export)
        export_.add_argument("--format", choices=FORMATS, required=True,
                             help="instruction list, GX Works2 CSV, or IEC 61131-3 Structured Text")  # fmt: skip
        export_.add_argument("--out", type=Path, required=True, help="file to write")
        export_.add_argument("--stepper", choices=("run-bit", "plsy"), default="run-bit",
                             help="conveyor: Y0 as the run bit of a drive with its own ramp, or as pulses")  # fmt: skip
        export_.add_argument("--io-map", type=Path, default=io_map, help="the wires")
        check_ = commands.add_parser("check", help="look for what is suspicious in a program")
        check_.set_defaults(action=self._check)
        check_.add_argument("file", type=Path, help="instruction list or GX Works2 CSV")
        run_ = commands.add_parser("run", help="run a program on a stimulus and trace devices scan by scan")
        run_.set_defaults(action=self._run)
        run_.add_argument("file", type=Path, help="instruction list or GX Works2 CSV")
        run_.add_argument("--stimulus", type=Path, required=True, help="what happens at the inputs, YAML")
        run_.add_argument("--json", action="store_true", help="print one JSON object")
        draw_ = commands.add_parser("draw", help="draw a program as ladder and step charts, SVG")
        draw_.set_defaults(action=self._draw)
        draw_.add_argument("file", type=Path, help="instruction list or GX Works2 CSV")
        draw_.add_argument("--out", type=Path, required=True, help="folder for the pictures")

    def _export(self, options: argparse.Namespace) -> Answer:
        if options.format == "st" and options.stepper == "plsy":
            raise LadderError("--stepper plsy: only an FX2N has PLSY; leave it out, or take the format il or gx-csv")
        program = acting(self._program_of(options.io_map))
        ladder = export(program, self._stepper(program) if options.stepper == "plsy" else None)
        if options.format == "st":
            options.out.write_bytes(structured_text(program).encode())
            return "\n".join([_size(options.out, program), f"as instructions of an FX2N: {usage(ladder)}"]), 0
        options.out.write_bytes(write_gx_csv(ladder) if options.format == "gx-csv" else write_il(ladder).encode())
        used = usage(ladder)
        fits = used.steps <= MOST_STEPS
        verdict = "fits" if fits else f"does not fit: more than {MOST_STEPS} steps"
        return "\n".join([_size(options.out, program), f"FX2N: {used}", verdict]), 0 if fits else 1

    def _check(self, options: argparse.Namespace) -> Answer:
        ladder = load_ladder(options.file)
        parts_of(ladder)  # what cannot be run is told as an error, not found
        findings = check(ladder)
        lines = [f"{ladder.source}:{each.line}: {each.severity}: {each.text}" for each in findings]
        errors = sum(each.severity == "error" for each in findings)
        lines.append(f"{usage(ladder)}; {errors} errors, {len(findings) - errors} warnings")
        return "\n".join(lines), 1 if errors else 0

    def _run(self, options: argparse.Namespace) -> Answer:
        ladder, stimulus = load_ladder(options.file), load_stimulus(options.stimulus)
        scans = run(ladder, stimulus)
        if options.json:
            return json.dumps({"scans": scans}), 0
        columns = list(scans[0]) if scans else []
        lines = [" ".join(f"{name:>6}" for name in columns)]
        return "\n".join(lines + [" ".join(f"{scan[name]:>6}" for name in columns) for scan in scans]), 0

    def _draw(self, options: argparse.Namespace) -> Answer:
        try:
            pictures = draw(load_ladder(options.file))
        except RecursionError:
            raise LadderError(f"{options.file}: a rung is nested too deep to be drawn; divide it by relays") from None
        options.out.mkdir(parents=True, exist_ok=True)
        for name, text in pictures.items():
            (options.out / name).write_text(text, encoding="utf-8")
        return "\n".join(str(options.out / name) for name in pictures), 0


def _size(out: Path, program: Program) -> str:
    """Return what an export holds."""
    sequences = list(program.sequences())
    steps = sum(len(sequence.steps) for sequence in sequences)
    return f"{out}: {program.name}, {len(program.blocks)} blocks, {len(sequences)} sequences with {steps} steps"
