"""Options of the commands that build the machine's program: I/O map, set-points and machine constants at a start."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from dataclasses import fields
from pathlib import Path

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from controller.common.yaml_lines import LocatedMapping, read_yaml, shown, unfold
from controller.core.expr import Word
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import Transplanter, build
from controller.program.requirements.travel_times import MachineData, TravelTimes, TravelTimesError, check_time, misfits
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
    add_set_points(parser, example=example)
    add_constants(parser, help_="; --set has priority")


def add_set_points(parser: argparse.ArgumentParser, *, example: str) -> None:
    """Add the option ``--set``; `assigned` reads it."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="set_points",
        help=f"initial value of a set-point, e.g. {example}; may be repeated",
    )


def add_constants(parser: argparse.ArgumentParser, *, help_: str = "") -> None:
    """Add the option ``--constants``."""
    parser.add_argument(
        "--constants",
        type=Path,
        default=None,
        metavar="FILE",
        help=f"YAML file with the machine constants and travel times that differ from their defaults{help_}",
    )


def start_values(machine: Transplanter, options: argparse.Namespace) -> dict[Word, int]:
    """Return the set-points given by both options, which fit the machine; ``--set`` has priority.

    Raises:
        ConstantsError: The file is invalid.
        InputError: A value of ``--set`` is invalid, or a time of the program does not fit the machine.
    """
    given = read_constants(machine.tags.sp, options.constants)
    values = {**given.values, **_words(machine.tags.sp, options.set_points)}
    lines = misfits(machine.program, machine.tags, MachineData(given.times, values))
    if lines:
        source = "the delivered machine" if options.constants is None else options.constants.name
        others = "" if len(lines) == 1 else f", and {len(lines) - 1} more"
        raise InputError(
            f"{source}: {lines[0]}{others}; correct the value in --set or --constants that is wrong, or change the "
            "program, if none is"
        )
    return values


def read_constants(set_points: SetPoints, path: Path | None) -> MachineData:
    """Return the contents of a constants file: a mapping of names to integers.

    Args:
        set_points: Set-points of the program.
        path: Path of the file; None = no file.

    Raises:
        ConstantsError: The file cannot be read, or a name or a value is invalid.
    """
    if path is None:
        return MachineData()
    constants = {name for name in set_points.names() if getattr(set_points, name) in set_points.constants}
    times = {each.name for each in fields(TravelTimes)}
    located = unfold(read_yaml(path, ConstantsError), depth=1)
    values: dict[Word, int] = {}
    given: dict[str, int] = {}
    for name, value in located.values.items():
        try:
            if name in times:
                given[name] = check_time(name, value)
            elif name in constants:
                word, number = set_points.checked(name, str(value) if isinstance(value, int) else shown(value))
                values[word] = number
            else:
                known = sorted({*constants, *times})
                located.add_fault((name,), f"is no machine constant or travel time; {suggestion(name, known)}")
        except SetPointError as error:
            located.add_fault((name,), str(error))
        except TravelTimesError as error:
            located.add_fault((name,), str(error).removeprefix(f"{name}: "))
    _raise_first(path, located)
    try:
        return MachineData(TravelTimes(**given), values)
    except TravelTimesError as error:
        raise ConstantsError(f"{path.name}: {error}") from error


def _raise_first(path: Path, located: LocatedMapping) -> None:
    if located.faults:
        raise ConstantsError(f"{path.name}:{min(located.faults)}")


def _words(set_points: SetPoints, assignments: Sequence[str]) -> dict[Word, int]:
    return {getattr(set_points, name): value for name, value in assigned(set_points, assignments).items()}


def assigned(set_points: SetPoints, assignments: Sequence[str]) -> dict[str, int]:
    """Return the values of ``--set`` by name of the set-point.

    Raises:
        InputError: A value is invalid.
    """
    values = {}
    for text in assignments:
        name, _, value = text.partition("=")
        try:
            _, values[name] = set_points.checked(name, value)
        except SetPointError as error:
            raise InputError(f"--set {text}: {error}") from error
    return values
