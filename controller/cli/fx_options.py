"""Options of the commands that run a third-party FX program: the CPU and its peripherals."""

from __future__ import annotations

import argparse
from pathlib import Path

from controller.fx.engine.peripherals.peripherals import Peripherals, load_peripherals
from controller.fx.language.cpu_model import CPU_MODELS, FX2N, CpuModel

PROGRAM_FILE = "FX program: instruction list, GX Works2 CSV or GX Developer .wpg"


def add_cpu(parser: argparse._ActionsContainer) -> None:
    """Add the option ``--cpu``."""
    parser.add_argument(
        "--cpu", choices=tuple(CPU_MODELS), default=FX2N.key, help=f"CPU of the program (default {FX2N.key})"
    )


def cpu_of(options: argparse.Namespace) -> CpuModel:
    """Return the CPU chosen by the option."""
    return CPU_MODELS[options.cpu]


def add_modules(parser: argparse._ActionsContainer) -> None:
    """Add the option ``--modules``."""
    parser.add_argument(
        "--modules",
        type=Path,
        default=None,
        metavar="FILE",
        help="special function modules (FROM, TO) and serial line (RS) of the FX program, YAML",
    )


def peripherals_of(options: argparse.Namespace) -> Peripherals:
    """Return the peripherals of the option; without it, no modules and no partner on the serial line.

    Raises:
        PeripheralError: The file is invalid.
    """
    return Peripherals() if options.modules is None else load_peripherals(options.modules)
