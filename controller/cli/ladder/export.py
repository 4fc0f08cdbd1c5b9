"""Command ``ladder export``: the machine's program as a package for a real PLC."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from controller.cli.machine import add_io_map, add_start_values, machine_of, start_values
from controller.core.expr import Bit
from controller.core.program import Program
from controller.core.rungs import written_devices
from controller.export.instruction_list import PulseTrain, acting
from controller.export.packages import codesys, fx2n, openplc, plain
from controller.export.packages.package import PackageReport, PackageSource

TARGETS: Final[Mapping[str, Callable[[PackageSource, Path], PackageReport]]] = {
    "openplc": openplc.write_package,
    "codesys": codesys.write_package,
    "fx2n": fx2n.write_package,
    "plain": plain.write_package,
}
"""Function that writes the package, by target."""
STEPPER_HZ: Final = 955
"""Pulse frequency for a conveyor speed of 0.2 m/s, Hz: 1.8 degrees per step, gear ratio 3 : 1, 40 mm drum."""


def add_export(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand ``export`` with its options."""
    export_ = commands.add_parser("export", help="write the machine's program as a package for a real PLC")
    export_.set_defaults(action=_export)
    export_.add_argument(
        "--target",
        choices=tuple(TARGETS),
        required=True,
        help="OpenPLC runtime, CODESYS, MELSEC FX2N, or plain IEC 61131-3 Structured Text",
    )
    export_.add_argument("--out", type=Path, required=True, help="output folder")
    export_.add_argument(
        "--stepper",
        choices=("run-bit", "plsy"),
        default="run-bit",
        help="conveyor output Y0: run bit for a drive with its own ramp, or pulse train (fx2n)",
    )
    export_.add_argument(
        "--io",
        choices=("modbus", "terminals"),
        help="inputs and outputs on a supervised field link, or terminals of the PLC itself; "
        "default: modbus for openplc and codesys, terminals for fx2n and plain",
    )
    add_start_values(export_, example="arms_may_meet=1")
    add_io_map(export_)


def _export(options: argparse.Namespace) -> int:
    machine = machine_of(options)
    program = machine.program.with_set_points(start_values(machine, options))
    pulses = stepper_output(program) if options.stepper == "plsy" else None
    report = TARGETS[options.target](PackageSource(program, machine.io_map, pulses, options.io), options.out)
    exported = program if report.complete else acting(program)
    print(_size(options.out, exported), *report.lines, sep="\n")
    return 0 if report.fits else 1


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
