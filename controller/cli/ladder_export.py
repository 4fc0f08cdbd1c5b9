"""Command ``ladder export``: the machine's program for a real PLC."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from controller.cli.machine import add_io_map, machine_of
from controller.core.expr import Bit
from controller.core.program import Program
from controller.core.rungs import written_devices
from controller.export.instruction_list import POWER_UP, PulseTrain, acting, export
from controller.export.structured_text import structured_text
from controller.fx.language.check import MOST_STEPS, budget, usage
from controller.fx.language.gx_csv import write_gx_csv
from controller.fx.language.il import write_il
from controller.fx.language.instruction import Ladder, LadderError

FORMATS: Final = ("il", "gx-csv", "st")
STEPPER_HZ: Final = 955
"""Pulse frequency for a conveyor speed of 0.2 m/s, Hz: 1.8 degrees per step, gear ratio 3 : 1, 40 mm drum."""


def add_export(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand ``export`` with its options."""
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
