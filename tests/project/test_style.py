"""Style rules that no linter checks: class names, docstrings, size of folders, formatter escapes."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from itertools import chain, pairwise
from pathlib import Path
from typing import Final

from tests.paths import ROOT

PACKAGES: Final = ("controller", "plant_sim")
SOURCES: Final = (*PACKAGES, "scripts", "tests")
MOST_FILES: Final = 18
"""Maximum number of source files in a folder; ``controller/program`` is one program and may contain more."""
MOST_ESCAPES: Final = 20
QUESTION: Final = re.compile(r"(What|How|Who|Where|Whatever|Whether|Whoever)\b")


def sources(*folders: str) -> Iterator[Path]:
    for folder in folders:
        yield from sorted((ROOT / folder).rglob("*.py"))


def trees(*folders: str) -> Iterator[tuple[Path, ast.Module]]:
    for path in sources(*folders):
        yield path, tree(path)


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def blocks(node: ast.AST) -> Iterator[list[ast.stmt]]:
    """Yield each list of consecutive statements within a node; expressions are not searched."""
    for name in ("body", "orelse", "finalbody"):
        block: list[ast.stmt] = getattr(node, name, [])
        yield block
        for statement in block:
            yield from blocks(statement)
    for branch in (*getattr(node, "handlers", ()), *getattr(node, "cases", ())):
        yield from blocks(branch)


def test_no_class_name_is_used_twice() -> None:
    names = Counter(
        node.name
        for _, tree in trees(*PACKAGES, "scripts")
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert [name for name, count in names.items() if count > 1] == []


def test_no_docstring_begins_with_a_question_word() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}"
        for path, tree in trees(*SOURCES)
        for node in chain[ast.AST]([tree], *blocks(tree))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        and QUESTION.match((ast.get_docstring(node, clean=False) or "").lstrip())
    ]
    assert found == []


def test_no_statement_is_repeated_directly() -> None:
    """A statement that is executed several times in a row stands in a loop."""
    found = [
        f"{path.relative_to(ROOT)}:{after.lineno}: {ast.unparse(after)}"
        for path, tree in trees(*SOURCES)
        for block in blocks(tree)
        for before, after in pairwise(block)
        if before.end_col_offset == after.end_col_offset and ast.dump(before) == ast.dump(after)
    ]
    assert found == []


def test_no_folder_has_too_many_source_files() -> None:
    files = Counter(path.parent for path in sources(*SOURCES) if path.name != "__init__.py")
    large = {folder.relative_to(ROOT).as_posix() for folder, count in files.items() if count > MOST_FILES}
    assert large <= {"controller/program"}


def test_formatter_escapes_are_rare() -> None:
    escape = "# fmt: " + "skip"
    lines = sum(path.read_text(encoding="utf-8").count(escape) for path in sources(*SOURCES))
    assert lines <= MOST_ESCAPES
