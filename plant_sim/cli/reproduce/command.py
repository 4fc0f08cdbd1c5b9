"""Command ``reproduce``: compute a result again and compare it with the original, file by file."""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path

from controller.common.command_line import USAGE_ERROR
from controller.common.errors import InputError
from controller.common.stop_request import INTERRUPTED
from plant_sim.cli.main import COMMAND_LINE
from plant_sim.cli.reproduce.comparison import ResultComparison, environment_changes
from plant_sim.cli.reproduce.recorded_run import read_run
from plant_sim.common.provenance.result_files import environment


def run(options: argparse.Namespace) -> int:
    """Reproduce a result in a new folder.

    Returns:
        0 if all files are equal; 1 if one differs; 2 if the command refused a setting; 130 after Ctrl-C.

    Raises:
        InputError: The provenance is refused, or the folder for the new result is not new.
    """
    recorded = read_run(options.folder, COMMAND_LINE)
    out = _new_folder(options.out)
    with contextlib.redirect_stdout(sys.stderr):  # standard output is for the comparison
        code = COMMAND_LINE.run(recorded.arguments_to(out), options.stop)
    if code in {USAGE_ERROR, INTERRUPTED}:
        return code
    changes = environment_changes(recorded.environment, environment())
    comparison = ResultComparison(recorded, out, is_exact=not changes)
    for line in (*changes, *comparison.lines()):
        print(line)
    return 0 if comparison.is_equal else 1


def _new_folder(folder: Path) -> Path:
    if folder.exists() or folder.is_symlink():
        raise InputError(f"--out {folder}: exists; specify a new folder")
    if not folder.absolute().parent.is_dir():
        raise InputError(f"--out {folder}: its parent folder does not exist; create it or specify another folder")
    return folder
