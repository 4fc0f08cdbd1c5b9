"""Command ``line``: simulate a line that plants rows of seedlings."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from controller.common.errors import InputError
from plant_sim.cli.options import check_seed, warn_of_ratings
from plant_sim.machine.parameters import DEFAULT_MACHINE, load_machine

if TYPE_CHECKING:
    from plant_sim.line.result import LineResult

MOST_METRES = 100_000.0
DEFAULT_METRES = 100.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``line``."""
    parser.add_argument("line", metavar="NAME|FILE", help="cabbage, pepper, combined, or a line file")
    parser.add_argument(
        "--profile", type=Path, default=None, metavar="FILE", help="ground file that replaces the ground of the line"
    )
    parser.add_argument(
        "--metres", type=float, default=DEFAULT_METRES, metavar="N", help="length of each row (default: %(default)g)"
    )
    parser.add_argument("--seed", type=int, default=1, help="seed of all random numbers")
    parser.add_argument("--machine", type=Path, default=DEFAULT_MACHINE, help="parameters of the machine")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--out", type=Path, default=None, metavar="DIR", help="folder for the plants as CSV and Parquet and a picture"
    )


def run(options: argparse.Namespace) -> int:
    """Run the line and print the result.

    Returns:
        0 if every cup and every seedling is accounted for, otherwise 1.

    Raises:
        InputError: An option or a file is invalid.
    """
    from plant_sim.line.command import result_of  # noqa: PLC0415 - imports the twin, which delays the help text

    check_seed(options)
    if not (math.isfinite(options.metres) and 1.0 <= options.metres <= MOST_METRES):
        raise InputError(f"--metres {options.metres:g}: must be 1 to {MOST_METRES:g}")
    machine = warn_of_ratings(load_machine(options.machine))
    write = None if options.out is None else _writer(options.out)
    result = result_of(options.line, profile=options.profile, metres=options.metres, seed=options.seed, machine=machine)
    print(json.dumps(result.record()) if options.json else result.text())
    if write is not None:
        paths = write(result)
        if not options.json:
            print("\n".join(map(str, paths)))
    return 0 if result.run.accounted else 1


def _writer(out: Path) -> Callable[[LineResult], list[Path]]:
    """Create the folder before the run; return the function that writes the files of a result."""
    from plant_sim.line.write import make_folder, write_result  # noqa: PLC0415 - pyarrow and matplotlib are optional

    make_folder(out)
    return lambda result: write_result(result, out)
