"""Options of the commands that build the machine's program: I/O map, set-points and machine constants at a start."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from pathlib import Path

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from controller.common.yaml_lines import LocatedMapping, read_yaml, shown, unfold
from controller.core.expr import Word
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import Transplanter, build
from controller.program.set_points import SetPointError, SetPoints


class ConstantsError(InputError):
    """Raised for an invalid file of machine constants; the message is one line with file, line, name and remedy."""


def add_io_map(parser: argparse.ArgumentParser) -> None:
    """Add the option for the I/O map."""
    parser.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="I/O map of the machine")


def machine_of(options: argparse.Namespace, *, without: Collection[str] = ()) -> Transplanter:
    """Return the machine's program for the chosen I/O map.

    Args:
        options: Parsed options, including ``io_map``.
        without: Interlock rules to omit.

    Raises:
        IoMapError: The I/O map is invalid.
        RuleError: A rule in `without` is unknown.
    """
    return build(load_io_map(options.io_map), without=without)


def add_start_values(parser: argparse.ArgumentParser, *, example: str) -> None:
    """Add the options ``--set`` and ``--constants``."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="set_points",
        help=f"initial value of a set-point, e.g. {example}; may be repeated",
    )
    parser.add_argument(
        "--constants",
        type=Path,
        default=None,
        metavar="FILE",
        help="YAML file with the machine constants that differ from their defaults; --set has priority",
    )


def start_values(set_points: SetPoints, options: argparse.Namespace) -> dict[Word, int]:
    """Return the values given by both options; ``--set`` has priority.

    Raises:
        ConstantsError: The file is invalid.
        InputError: A value of ``--set`` is invalid.
    """
    constants = {} if options.constants is None else read_constants(set_points, options.constants)
    return {**constants, **_assigned(set_points, options.set_points)}


def read_constants(set_points: SetPoints, path: Path) -> dict[Word, int]:
    """Return the machine constants in a file: a mapping of their names to integers.

    Raises:
        ConstantsError: The file cannot be read, or a name or a value is invalid.
    """
    names = {name for name in set_points.names() if getattr(set_points, name) in set_points.constants}
    located = unfold(read_yaml(path, ConstantsError), depth=1)
    values = {}
    for name, value in located.values.items():
        if name not in names:
            located.add_fault((name,), f"is no machine constant; {suggestion(name, sorted(names))}")
            continue
        try:
            word, number = set_points.checked(name, str(value) if isinstance(value, int) else shown(value))
        except SetPointError as error:
            located.add_fault((name,), str(error))
        else:
            values[word] = number
    _raise_first(path, located)
    return values


def _raise_first(path: Path, located: LocatedMapping) -> None:
    if located.faults:
        raise ConstantsError(f"{path.name}:{min(located.faults)}")


def _assigned(set_points: SetPoints, assignments: Sequence[str]) -> dict[Word, int]:
    values = {}
    for text in assignments:
        name, _, value = text.partition("=")
        try:
            word, number = set_points.checked(name, value)
        except SetPointError as error:
            raise InputError(f"--set {text}: {error}") from error
        values[word] = number
    return values
