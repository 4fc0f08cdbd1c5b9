"""Parts of the nightly and the weekly tests, and the reasons why a test is not in the default run.

The table is ``parts.yaml``. A part is a list of test files and folders, and each nightly or weekly test belongs to
exactly one part. Every test function without a case in the default run is listed with a reason, or its file is if that
holds for all its functions. A run of all tests checks the table (plugin of pytest).
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import pytest
import yaml

from tests.paths import ROOT
from tests.sampling import MORE_EXAMPLES, NIGHTLY, WEEKLY

TABLE: Final = Path(__file__).with_name("parts.yaml")
MARKS: Final = (NIGHTLY, WEEKLY)


class PartError(Exception):
    """An unknown part, or a table that does not fit the tests."""


@dataclass(frozen=True)
class Part:
    """Tests that are run together, in at most 20 minutes on two cores if they are nightly.

    Attributes:
        mark: ``nightly`` or ``weekly``.
        name: Name on the command line.
        paths: Test files and folders, relative to the root.
    """

    mark: str
    name: str
    paths: tuple[str, ...]

    def contains(self, file: str) -> bool:
        """Return whether a test file, given relative to the root, belongs to the part."""
        return any(file == path or file.startswith(f"{path}/") for path in self.paths)

    def selection(self) -> tuple[str, ...]:
        """Return the options and paths with which pytest runs the part."""
        by_night = f"({NIGHTLY} or {MORE_EXAMPLES}) and not {WEEKLY}"  # a weekly test in a file of nightly ones
        marks = by_night if self.mark == NIGHTLY else self.mark
        return ("-m", marks, *self.paths)


@cache
def table() -> Mapping[str, Any]:
    """Return the content of ``parts.yaml``."""
    content: dict[str, Any] = yaml.safe_load(TABLE.read_text(encoding="utf-8"))
    return content


def parts(mark: str, name: str | None = None) -> list[Part]:
    """Return the parts of a mark, or only the one with a name.

    Raises:
        PartError: There is no part with this name.
    """
    found = [Part(mark, str(each), tuple(paths)) for each, paths in table()[mark].items()]
    if name is None:
        return found
    named = [part for part in found if part.name == name]
    if not named:
        names = ", ".join(part.name for part in found)
        raise PartError(f"unknown {mark} part {name!r}; the parts are {names}. Give options of pytest before --{mark}")
    return named


def part_of(commit: str) -> Part:
    """Return the nightly part that belongs to a commit, given by its hash; every part belongs to equally many."""
    found = parts(NIGHTLY)
    return found[int(commit, 16) % len(found)]


@dataclass(frozen=True)
class Case:
    """Collected case of a test function.

    Attributes:
        file: Test file, relative to the root.
        function: Identifier of the function, without parameters.
        marks: Its marks among `MARKS`; none for a case of the default run.
    """

    file: str
    function: str
    marks: frozenset[str]


def problems(cases: Iterable[Case], content: Mapping[str, Any]) -> list[str]:
    """Return a line for each case without a part, and for each missing or outdated reason, with the remedy."""
    found = []
    by_function: dict[str, set[frozenset[str]]] = {}
    for case in cases:
        by_function.setdefault(case.function, set()).add(case.marks)
        for mark in sorted(case.marks):
            owners = sum(Part(mark, name, tuple(paths)).contains(case.file) for name, paths in content[mark].items())
            if owners != 1:
                found.append(f"{case.file}: in {owners} {mark} parts; list it in exactly one")
    outside = {function for function, marks in by_function.items() if frozenset() not in marks}
    reasons: Mapping[str, str] = content["reasons"]
    covered = {
        name: {function for function in by_function if f"{function}::".startswith(f"{name}::")} for name in reasons
    }
    unexplained = outside.difference(*covered.values())
    found += [f"{name}: no case in the default run; give the reason" for name in unexplained]
    outdated = [name for name, functions in covered.items() if not functions or not functions <= outside]
    found += [f"{name}: has a case in the default run, or is gone; delete it" for name in outdated]
    return sorted({f"{TABLE.name}: {line}" for line in found})


class TableCheck(pytest.Item):
    """Test that ``parts.yaml`` fits all collected tests."""

    def __init__(self, *, found: list[str], **others: Any) -> None:
        super().__init__(**others)
        self.found = found

    def runtest(self) -> None:
        """Raise an error with the problems, if there are any."""
        if self.found:
            raise PartError("\n".join(self.found))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> str:
        """Return the problems without a traceback."""
        return str(excinfo.value) if isinstance(excinfo.value, PartError) else str(super().repr_failure(excinfo, style))

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return the place and the name of the test in reports."""
        return TABLE, 0, self.name


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(session: pytest.Session, items: list[pytest.Item]) -> None:
    """Add the check of the table to a run that collects all tests; before the marks select some of them."""
    place = TABLE.relative_to(ROOT).as_posix()
    cases = [
        Case(
            item.nodeid.partition("::")[0],
            item.nodeid.partition("[")[0],
            frozenset(mark for mark in MARKS if item.get_closest_marker(mark)),
        )
        for item in items
        if isinstance(item, pytest.Function)
    ]
    items.append(TableCheck.from_parent(session, name=TABLE.name, nodeid=place, found=problems(cases, table())))


if __name__ == "__main__":
    sys.stdout.write(f"{part_of(sys.argv[1]).name}\n")
