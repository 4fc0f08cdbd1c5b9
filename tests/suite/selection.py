"""Test files that a change can affect, found through the static dependencies between the files of the repository.

``python -m tests.suite.selection [REV] [--verbose]`` prints them for the difference between the checkout and a
revision, which includes files that git does not know yet.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Final

from tests.paths import ROOT
from tests.suite.dependencies import Dependencies, own_dependencies

_DECIDES: Final = ("pyproject.toml", "scripts", ".ci", "tests/suite")
"""Files and folders that decide how every test runs."""
_DECIDES_NOTHING: Final = "scripts/benchmark/"
"""Folder among these whose files affect only the tests that depend on them."""


@dataclass(frozen=True)
class Selection:
    """Test files to run.

    Attributes:
        files: Test files, relative to the root of the repository; each with the reason, which is the chain of files
            from the test file to the changed one. Empty if `all` is given.
        all: Changed file because of which every test runs, or None.
    """

    files: Mapping[Path, tuple[Path, ...]] = field(default_factory=dict)
    all: Path | None = None


def selected(graph: Dependencies, changed: Iterable[Path]) -> Selection:
    """Return the test files that changed files, given relative to the root, can affect."""
    paths = sorted({path.as_posix() for path in changed})
    for path in paths:
        if decides_all(path):
            return Selection(all=Path(path))
    return Selection(_tests(graph, paths, {path: graph.users_of(path) | graph.readers_of(path) for path in paths}))


def executing(graph: Dependencies, file: Path) -> Mapping[Path, tuple[Path, ...]]:
    """Return the test files that can execute a source file, without those that only read its text."""
    path = file.as_posix()
    return _tests(graph, [path], {path: graph.users_of(path)})


def _tests(graph: Dependencies, paths: Sequence[str], direct: Mapping[str, set[str]]) -> dict[Path, tuple[Path, ...]]:
    """Return the test files among files and their users, direct or not, each with the shortest chain to a file."""
    chains: dict[str, tuple[str, ...]] = {path: (path,) for path in paths}
    new = {user: path for path in paths for user in sorted(direct[path])}
    while new := {user: path for user, path in new.items() if user not in chains}:
        chains |= {user: (user, *chains[path]) for user, path in new.items()}
        new = {user: path for path in new for user in sorted(graph.users_of(path))}
    return {Path(path): tuple(map(Path, chain)) for path, chain in sorted(chains.items()) if graph.is_test(path)}


def decides_all(path: str) -> bool:
    """Return whether a changed file decides how every test runs."""
    decides = any(path == name or path.startswith(f"{name}/") for name in _DECIDES)
    return PurePosixPath(path).name == "conftest.py" or (decides and not path.startswith(_DECIDES_NOTHING))


def changed_since(root: Path, revision: str = "HEAD") -> list[Path]:
    """Return the files that differ from a revision: edited, added, deleted, with both names of a moved file.

    Raises:
        ValueError: The revision does not exist.
    """
    git = shutil.which("git")
    assert git is not None, "git is not installed"

    def names(*arguments: str) -> set[str]:
        done = subprocess.run([git, *arguments], cwd=root, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise ValueError(f"{revision} is no revision of this repository; give a branch or a commit")
        return set(filter(None, done.stdout.split("\0")))

    differing = names("diff", "--name-only", "--no-renames", "--relative", "-z", revision, "--")
    return sorted(map(Path, differing | names("ls-files", "--others", "--exclude-standard", "-z")))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the selection; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.suite.selection", description=__doc__)
    parser.add_argument("revision", nargs="?", default="HEAD", help="revision to compare with (default: HEAD)")
    parser.add_argument("--verbose", action="store_true", help="print each test file with its reason")
    options = parser.parse_args(arguments)
    try:
        changed = changed_since(ROOT, options.revision)
    except ValueError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    graph = own_dependencies()
    selection = selected(graph, changed)
    sys.stdout.write(summary(selection, graph))
    if options.verbose:
        for file, reason in selection.files.items():
            sys.stdout.write(f"{file}: {' -> '.join(path.as_posix() for path in reason[1:]) or 'changed'}\n")
    return 0


def summary(selection: Selection, graph: Dependencies) -> str:
    """Return the line with the number of test files and test functions."""
    tests = {path: facts.tests for path, facts in graph.facts.items() if graph.is_test(path)}
    if selection.all is not None:
        return f"all {len(tests)} test files with {sum(tests.values())} test functions: {selection.all} has changed\n"
    count = sum(tests[file.as_posix()] for file in selection.files)
    return f"{len(selection.files)} of {len(tests)} test files, with {count} of {sum(tests.values())} test functions\n"


if __name__ == "__main__":
    sys.exit(main())
