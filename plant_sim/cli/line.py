"""Command ``line``: simulate a line that plants rows of seedlings."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from plant_sim.cli.reproduce.origin import print_json, provenance_of
from plant_sim.cli.settings import changed_machine, warn_of_ratings, with_changes
from plant_sim.common.picture_form import PictureForm, check_picture_options, picture_form
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.machine.parameters import load_machine

if TYPE_CHECKING:
    from plant_sim.line.result import LineResult


def run(options: argparse.Namespace) -> int:
    """Run the line and print the result.

    Returns:
        0 if every cup and every seedling is accounted for, otherwise 1.

    Raises:
        InputError: An option or a file is invalid.
    """
    from plant_sim.line.command import line_result  # noqa: PLC0415 - imports the twin, which delays the help text

    check_picture_options(options)
    provenance = provenance_of(options)
    machine = warn_of_ratings(load_machine(options.machine))
    write = None if options.out is None else _writer(options.out, provenance, picture_form(options))
    result = line_result(
        options.line,
        profile=options.profile,
        metres=options.metres,
        seed=options.seed,
        machine=machine,
        repeat=options.repeat,
    )
    if options.json:
        print_json(with_changes(options, result.record()), provenance)
    else:
        changed = changed_machine(options) if result.is_fed_by_arms else []
        print("\n".join([*changed, result.text()]))
    if write is not None:
        paths = write(result)
        if not options.json:
            print("\n".join(map(str, paths)))
    return 0 if result.run.accounted else 1


def _writer(out: Path, provenance: Provenance, form: PictureForm) -> Callable[[LineResult], list[Path]]:
    """Check the folder before the run; return the function that writes the files of a result."""
    from plant_sim.line.write import check_folder, write_result  # noqa: PLC0415 - pyarrow and matplotlib are optional

    check_folder(out)
    return lambda result: write_result(result, out, provenance, form)
