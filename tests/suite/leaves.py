"""Leaf packages: those whose change selects tests of at most a minute.

``python -m tests.suite.leaves FILE...`` prints them as a table. Each file contains JSON lines with a test and its
processor time in s, as written by ``scripts/test --test-times FILE``.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

from tests.suite.dependencies import Dependencies, own_dependencies
from tests.suite.selection import selected

LIMIT_S: Final = 60.0
CORES: Final = 2
CHECKS_S: Final = 4.0
"""Duration of the static checks after a change of one module, with the caches of the previous run."""


@dataclass(frozen=True)
class Package:
    """Package with the tests that a change of all its modules selects.

    Attributes:
        name: Folder of the package.
        files: Number of selected test files.
        duration_s: Processor time of the selected tests divided by the cores, and the static checks, s.
    """

    name: str
    files: int
    duration_s: float


def read_durations(paths: Iterable[Path]) -> dict[str, float]:
    """Return the processor time of each test file, s.

    Raises:
        ValueError: A file cannot be read, or a line is not a measurement.
    """
    durations_s = defaultdict[str, float](float)
    for path in paths:
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except OSError as error:
            raise ValueError(f"{path}: {error.strerror}; give a file of measurements") from error
        for number, line in enumerate(lines, start=1):
            try:
                test, used_s = json.loads(line)
                durations_s[test.partition("::")[0]] += used_s
            except (ValueError, TypeError, AttributeError) as error:
                raise ValueError(f"{path}: line {number}: not a measurement of a test; delete the line") from error
    return durations_s


def packages(graph: Dependencies, durations_s: Mapping[str, float]) -> list[Package]:
    """Return all packages, in alphabetical order."""
    modules = defaultdict[str, list[Path]](list)
    for name in graph.facts:
        if not name.startswith("tests/"):
            modules[str(PurePosixPath(name).parent)].append(Path(name))
    found = list[Package]()
    for folder, paths in sorted(modules.items()):
        files = [file.as_posix() for file in selected(graph, paths).files]
        duration_s = CHECKS_S + sum(durations_s.get(file, 0.0) for file in files) / CORES
        found.append(Package(folder, len(files), duration_s))
    return found


def table(found: Iterable[Package]) -> str:
    """Return the table of the leaf packages."""
    rows = (
        f"| `{each.name}/` | {each.files} | {each.duration_s:.0f} |\n" for each in found if each.duration_s <= LIMIT_S
    )
    return "".join(["| Package | Test files | Duration, s |\n|---|---|---|\n", *rows])


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.suite.leaves", description=__doc__)
    parser.add_argument("durations", nargs="+", type=Path, metavar="FILE", help="measurements of a run of all tests")
    try:
        durations_s = read_durations(parser.parse_args(arguments).durations)
    except ValueError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    sys.stdout.write(table(packages(own_dependencies(), durations_s)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
