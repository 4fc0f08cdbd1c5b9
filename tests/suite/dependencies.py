"""Graph of the files that each source file of the repository depends on."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import Final, TypeVar

from tests.paths import ROOT
from tests.suite.facts import ROOTS, WHOLE_TREE, Facts, command_table, places_of
from tests.suite.facts_store import STORE, facts_of_all

_SOURCES: Final = ("controller/", "plant_sim/", "scripts/benchmark/", "tests/")
"""Folders of the source files whose facts are read; the other scripts decide how every test runs."""
_CONFTEST: Final = "conftest.py"
_PATHS: Final = "tests/paths.py"
"""File that declares the folders and reads none of them."""
Item = TypeVar("Item")
_IMPORT: Final = re.compile(rf"^\s*(?:from|import) ((?:{'|'.join(ROOTS)})[\w.]*)", re.MULTILINE)


@dataclass(frozen=True)
class Commands:
    """Command line of a package: modules of each command, and the command that runs if none is named."""

    modules: Mapping[str, list[str]]
    default: str


@dataclass(frozen=True)
class Dependencies:
    """Files of the repository and the dependencies between them.

    Attributes:
        facts: Facts of each source file.
        users: Files that depend directly on a file; a file that does not exist may have users.
        folders: Folders of which all files are read, each with the test files that read them.
        names: Test files and sources that name a file, by the last part of its name.
    """

    facts: Mapping[str, Facts]
    users: Mapping[str, frozenset[str]]
    folders: Mapping[str, frozenset[str]]
    names: Mapping[str, frozenset[tuple[str, str]]]

    def is_test(self, path: str) -> bool:
        """Return whether pytest collects tests from a file: test functions of a test file, or doctests of any file."""
        return path in self.facts and self.facts[path].tests > 0 and not path.endswith(_CONFTEST)

    def users_of(self, path: str) -> set[str]:
        """Return the files that run the code of a file: they import it, or name it in a text."""
        named = {user for end, user in self.names.get(path.rpartition("/")[2], ()) if f"/{path}".endswith(f"/{end}")}
        return {*self.users.get(path, ()), *named} - {path}

    def readers_of(self, path: str) -> set[str]:
        """Return the files that read a file as data: with its folder, or as modules of the folder it belongs to."""
        folders = {WHOLE_TREE, path, *map(str, PurePosixPath(path).parents)} & set(self.folders)
        beside = set[str]() if path.endswith(".py") else self._modules_beside(path)
        return {reader for folder in folders for reader in self.folders[folder]} | beside

    def _modules_beside(self, path: str) -> set[str]:
        """Return the modules of the folder of a data file, or of the nearest folder above it that has any."""
        for folder in PurePosixPath(path).parents[:-1]:
            if modules := {name for name in self.facts if PurePosixPath(name).parent == folder}:
                return modules
        return set()


def tracked(root: Path) -> list[str]:
    """Return the files of a checkout, including new ones that git does not ignore."""
    git = shutil.which("git")
    assert git is not None, "git is not installed"
    command = [git, "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listing = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True).stdout
    return sorted(name for name in set(filter(None, listing.split("\0"))) if (root / name).is_file())


@cache
def own_dependencies() -> Dependencies:
    """Return the dependencies between the files of this checkout, read once."""
    return dependencies(ROOT, STORE)


def dependencies(root: Path, store: Path | None = None) -> Dependencies:
    """Return the dependencies between the files of a checkout.

    Args:
        root: Root of the checkout.
        store: File that keeps the facts of each source file between runs; None to read all files.
    """
    names = tracked(root)
    texts = {name: (root / name).read_text(encoding="utf-8") for name in names if name.endswith((".py", ".md"))}
    sources = {name: text for name, text in texts.items() if name.endswith(".py") and name.startswith(_SOURCES)}
    facts = facts_of_all(sources, store)
    graph = _Graph(facts, _command_lines(sources))
    for name in facts:
        graph.add_source(name)
    for name, text in texts.items():
        if name not in facts:
            graph.use(name, {place for module in _IMPORT.findall(text) for place in places_of(module)})
    return Dependencies(facts, _frozen(graph.users), _frozen(graph.folders), _frozen(graph.names))


def _frozen(sets: Mapping[str, set[Item]]) -> dict[str, frozenset[Item]]:
    return {key: frozenset(items) for key, items in sets.items()}


def _command_lines(sources: Mapping[str, str]) -> dict[str, Commands]:
    tables = (command_table(text) for name, text in sources.items() if name.endswith("/cli/main.py"))
    return {package: Commands(modules, default) for package, modules, default in filter(None, tables)}


class _Graph:
    """Dependencies under construction."""

    def __init__(self, facts: Mapping[str, Facts], lines: Mapping[str, Commands]) -> None:
        self.users = defaultdict[str, set[str]](set)
        self.folders = defaultdict[str, set[str]](set)
        self.names = defaultdict[str, set[tuple[str, str]]](set)
        self._facts = facts
        self._lines = lines

    def use(self, user: str, paths: set[str]) -> None:
        for path in paths:
            self.users[path].add(user)

    def add_source(self, name: str) -> None:
        own = self._facts[name]
        self.use(name, {*own.modules})
        for end in own.files:
            self.names[end.rpartition("/")[2]].add((end.lstrip("/"), name))
        for folder in own.folders if name.startswith("tests/") and name != _PATHS else ():
            self.folders[folder].add(name)
        if not name.startswith("tests/"):
            if own.packages and self._starts_processes(own):
                self.use(name, self._started([own], complete_if_unknown=False))
        elif own.tests:
            rigs = [self._facts[rig] for rig in self._rigs(name)]
            self.use(name, self._started(rigs))
            above = [f"{folder}/{_CONFTEST}" for folder in PurePosixPath(name).parents]
            self.use(name, {path for path in above if path in self._facts and self._facts[path].fixtures})

    def _starts_processes(self, own: Facts) -> bool:
        """Return whether a file or one that it imports starts processes."""
        return own.starts_processes or any(
            self._facts[place].starts_processes for place in own.modules if place in self._facts
        )

    def _rigs(self, name: str) -> set[str]:
        """Return the files below ``tests`` that a test file imports, including itself."""
        found, new = set[str](), {name}
        while new:
            found |= new
            places = {place for each in new for place in self._facts[each].modules if place.startswith("tests/")}
            new = {place for place in places if place in self._facts} - found
        return found

    def _started(self, files: list[Facts], *, complete_if_unknown: bool = True) -> set[str]:
        """Return the modules of the commands that files start, as a process or by the main function.

        A command is started if its name is a word of the files; the default command, if a list of arguments may begin
        with an option. Every command of a package is started if the files use its complete command line.

        Args:
            files: Facts of the files.
            complete_if_unknown: Start every command of a package if the files name none.
        """
        words = self._command_words(files)
        complete = {package for each in files for package in each.lines}
        packages = complete | {package for each in files for package in each.mains}
        if any(self._starts_processes(each) for each in files):
            packages |= {package for each in files for package in each.packages}
            packages |= {before for before, _ in words}
        started = set[str]()
        for package in sorted(packages & set(self._lines)):
            line = self._lines[package]
            names = {word for before, word in words if before in {"", package}} & set(line.modules)
            if package in complete or (complete_if_unknown and not names):
                names = set(line.modules)
            elif any(each.option_first for each in files):
                names.add(line.default)
            modules = {f"{package}.__main__", f"{package}.cli.main", *chain(*(line.modules[name] for name in names))}
            started |= {place for module in modules for place in places_of(module)}
        return started

    def _command_words(self, files: list[Facts]) -> set[tuple[str, str]]:
        """Return words that may be commands, each with the package that is named before it, or with an empty text.

        The word after the name of a command is that of a subcommand.
        """
        commands = {name for line in self._lines.values() for name in line.modules}
        words = {pair for each in files for pair in each.words}
        return {(before if before in self._lines else "", word) for before, word in words if before not in commands}
