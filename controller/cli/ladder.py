"""Command ``ladder``: export the machine's program for an FX2N; check, run and draw any FX2N program."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Final

from controller.cli.machine import add_io_map, machine_of
from controller.common.errors import InputError
from controller.core.expr import Bit
from controller.core.program import Program
from controller.core.rungs import written_devices
from controller.export.instruction_list import POWER_UP, PulseTrain, acting, export
from controller.export.structured_text import structured_text
from controller.fx.drawing.ladder import draw
from controller.fx.engine.parts import parts_of
from controller.fx.engine.running import run as run_stimulus
from controller.fx.engine.stimulus import load_stimulus
from controller.fx.language.check import MOST_STEPS, budget, check, usage
from controller.fx.language.gx_csv import write_gx_csv
from controller.fx.language.il import write_il
from controller.fx.language.instruction import Ladder, LadderError
from controller.fx.language.reading import load_ladder

FORMATS: Final = ("il", "gx-csv", "st")
STEPPER_HZ: Final = 955
"""Pulse frequency for a conveyor speed of 0.2 m/s, Hz: 1.8 degrees per step, gear ratio 3 : 1, 40 mm drum."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the subcommands of ``ladder``."""
    commands = parser.add_subparsers(required=True, metavar="ACTION")
    export_ = commands.add_parser("export", help="write the machine's program for a real PLC")
    export_.set_defaults(action=_export)
    export_.add_argument(
        "--format",
        choices=FORMATS,
        required=True,
        help="instruction list, GX Works2 CSV, or IEC 61131-3 Structured Text",
    )
    export_.add_argument("--out", type=Path, required=True, help="output file")
    export_.add_argument(
        "--stepper",
        choices=("run-bit", "plsy"),
        default="run-bit",
        help="conveyor output Y0: run bit for a drive with its own ramp, or pulse train",
    )
    add_io_map(export_)
    check_ = commands.add_parser("check", help="report probable errors in a program")
    check_.set_defaults(action=_check)
    check_.add_argument("file", type=Path, help="instruction list or GX Works2 CSV")
    run_ = commands.add_parser("run", help="run a program with a stimulus and trace devices scan by scan")
    run_.set_defaults(action=_run)
    run_.add_argument("file", type=Path, help="instruction list or GX Works2 CSV")
    run_.add_argument("--stimulus", type=Path, required=True, help="input changes over time, YAML")
    run_.add_argument("--json", action="store_true", help="print one JSON object")
    draw_ = commands.add_parser("draw", help="draw a program as ladder diagrams and step charts, SVG")
    draw_.set_defaults(action=_draw)
    draw_.add_argument("file", type=Path, help="instruction list or GX Works2 CSV")
    draw_.add_argument("--out", type=Path, required=True, help="output folder")


def run(options: argparse.Namespace) -> int:
    """Run the subcommand and return its exit code.

    Raises:
        LadderError: The program is invalid or cannot be exported.
        StimulusError: The stimulus is invalid.
        InputError: A file cannot be written.
    """
    try:
        code: int = options.action(options)
    except BrokenPipeError:  # raised by standard output, not by a file
        raise
    except OSError as error:
        raise InputError(f"{error.filename}: {error.strerror}; choose another path") from error
    return code


def _export(options: argparse.Namespace) -> int:
    if options.format == "st" and options.stepper == "plsy":
        raise LadderError("--stepper plsy: Structured Text has no PLSY; omit it, or choose --format il or gx-csv")
    program = acting(machine_of(options).program)
    ladder = export(program, stepper_output(program) if options.stepper == "plsy" else None)
    used = usage(ladder)
    if options.format == "st":
        options.out.write_bytes(structured_text(program).encode())
        print(_size(options.out, program), f"as instructions of an FX2N: {used}", sep="\n")
        return 0
    options.out.write_bytes(write_gx_csv(ladder) if options.format == "gx-csv" else write_il(ladder).encode())
    fits = used.steps <= MOST_STEPS
    verdict = "fits" if fits else f"does not fit: more than {MOST_STEPS} steps"
    print(_size(options.out, program), f"FX2N: {used}", *_budget(program, ladder), verdict, sep="\n")
    return 0 if fits else 1


def _check(options: argparse.Namespace) -> int:
    ladder = load_ladder(options.file)
    parts_of(ladder)  # raises if the program cannot be run, which is an error and not a finding
    findings = check(ladder)
    for each in findings:
        print(f"{ladder.source}:{each.line}: {each.severity}: {each.text}")
    errors = sum(each.severity == "error" for each in findings)
    print(f"{usage(ladder)}; {errors} errors, {len(findings) - errors} warnings")
    return 1 if errors else 0


def _run(options: argparse.Namespace) -> int:
    scans = run_stimulus(load_ladder(options.file), load_stimulus(options.stimulus))
    if options.json:
        print(json.dumps({"scans": scans}))
        return 0
    columns = list(scans[0]) if scans else []
    print(" ".join(f"{name:>6}" for name in columns))
    for scan in scans:
        print(" ".join(f"{scan[name]:>6}" for name in columns))
    return 0


def _draw(options: argparse.Namespace) -> int:
    try:
        pictures = draw(load_ladder(options.file))
    except RecursionError:
        raise LadderError(f"{options.file}: a rung is nested too deeply to be drawn; split it with relays") from None
    options.out.mkdir(parents=True, exist_ok=True)
    for name, text in pictures.items():
        (options.out / name).write_text(text, encoding="utf-8")
    print("\n".join(str(options.out / name) for name in pictures))
    return 0


def stepper_output(program: Program) -> PulseTrain:
    """Return the conveyor's stepper output as a pulse train."""
    output = next(
        bit
        for rung in program.rungs()
        for bit in written_devices(rung)
        if isinstance(bit, Bit) and bit.kind == "Y" and bit.name == "tray_run"
    )
    return PulseTrain(output, STEPPER_HZ)


def _size(out: Path, program: Program) -> str:
    """Return one line that states the numbers of blocks, sequences and steps of a program."""
    sequences = list(program.sequences())
    steps = sum(len(sequence.steps) for sequence in sequences)
    return f"{out}: {program.name}, {len(program.blocks)} blocks, {len(sequences)} sequences with {steps} steps"


def _budget(program: Program, ladder: Ladder) -> list[str]:
    """Return one line for each block of an exported program with its number of steps, and one for the free steps."""
    used = budget(ladder, (POWER_UP, *(block.title for block in program.blocks)))
    return [f"{count:>6} {title}" for title, count in (used | {"free": MOST_STEPS - sum(used.values())}).items()]
