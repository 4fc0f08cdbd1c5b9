"""Facts of one source file that decide which other files it depends on, taken from its syntax tree."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Final

ROOTS: Final = ("controller", "plant_sim", "scripts", "tests")
WHOLE_TREE: Final = ""
"""Folder of a file that reads files anywhere in the repository."""
_MODULE: Final = re.compile(rf"(?<![\w./])(?:{'|'.join(ROOTS)})(?:\.\w+)*(?![\w/-])")
_FROM: Final = re.compile(rf"\bfrom ((?:{'|'.join(ROOTS)})[\w.]*) import \(?([\w, ]+)")
_FILE: Final = re.compile(r"[\w/-][\w./-]*\.[a-z]\w*")
_AFTER_PACKAGE: Final = re.compile(rf"(?<![\w./-])({'|'.join(ROOTS)}) ([a-z][\w-]*)")
_FIRST_WORD: Final = re.compile(r"\s*([\w-]+)(?!\S)")
_FOLDERS: Final = {"ROOT": WHOLE_TREE, "DOCS": "docs"}
"""Folder of each constant of ``tests/paths.py``."""
_WALKERS: Final = {"walk_packages", "iter_modules"}


@dataclass(frozen=True)
class Facts:
    """Facts of one source file.

    Attributes:
        modules: Paths at which the modules that the file names may be, in import statements or in text.
        files: Paths, or ends of paths, of the files that its texts name.
        folders: Folders whose files it may read, each as a path; see `WHOLE_TREE`.
        words: Words that may be the name of a command, each with the word before it: the first word of a text, with the
            preceding text of the same call or sequence, or an empty one; and the word after a package in a text.
        lines: Packages of which it uses the complete command line.
        mains: Packages of which it calls the main function of the command line.
        packages: Packages of which a text is the name.
        starts_processes: True if it names the interpreter, which a process is started with.
        option_first: True if a sequence of arguments begins with an option, which starts the default command.
        fixtures: True if it declares fixtures.
        tests: Number of test functions and examples that pytest collects from it.
    """

    modules: frozenset[str]
    files: frozenset[str]
    folders: frozenset[str]
    words: frozenset[tuple[str, str]]
    lines: frozenset[str]
    mains: frozenset[str]
    packages: frozenset[str]
    starts_processes: bool
    option_first: bool
    fixtures: bool
    tests: int


def facts_of(path: PurePosixPath, text: str) -> Facts:
    """Return the facts of a source file.

    Args:
        path: Path relative to the root of the repository.
        text: Content of the file.

    Raises:
        SyntaxError: The text is not valid Python.
    """
    tree = ast.parse(text)
    nodes = list(ast.walk(tree))
    prose = {id(node.value) for node in nodes if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)}
    texts = [value for node in nodes if id(node) not in prose and (value := _text(node))]
    table = _commands_call(nodes)
    named = {name for each in texts for name in _named(each)} if table is None else set()
    files = {name for each in texts for name in _FILE.findall(each) if name.lstrip("/") != "__init__.py"}
    imported = set(_imported(nodes, path))
    return Facts(
        modules=frozenset(place for name in imported | named for place in places_of(name)),
        files=frozenset(files),
        folders=frozenset(_folders(nodes)),
        words=frozenset(_words(nodes)),
        lines=frozenset(name.partition(".")[0] for name in imported | named if name.endswith(".cli.main.COMMAND_LINE")),
        mains=frozenset(name.partition(".")[0] for name in imported | named if ".cli.main" in name),
        packages=frozenset(texts) & frozenset(ROOTS),
        starts_processes=any(_name(node) == "executable" for node in nodes),
        option_first=any(_begins_with_option(node) for node in nodes),
        fixtures=any(_name(node) == "fixture" for node in nodes),
        tests=_tests_of(path, text, nodes),
    )


def _tests_of(path: PurePosixPath, text: str, nodes: list[ast.AST]) -> int:
    """Return the number of test functions of a test file, and of examples in the docstrings of any file."""
    functions = [node.name for node in nodes if isinstance(node, ast.FunctionDef)] if path.match("test_*.py") else []
    return sum(name.startswith("test_") for name in functions) + len(re.findall(r"^\s*>>> ", text, re.MULTILINE))


def _words(nodes: list[ast.AST]) -> Iterator[tuple[str, str]]:
    """Yield the words that may be the name of a command, each with the word before it."""
    preceding = dict[int, str]()
    for node in nodes:
        items = node.args if isinstance(node, ast.Call) else node.elts if isinstance(node, ast.List | ast.Tuple) else []
        preceding |= {id(item): _text(before) for before, item in pairwise(items)}
    for node in nodes:
        yield from _AFTER_PACKAGE.findall(_text(node))
        if first := _FIRST_WORD.match(_text(node)):
            yield preceding.get(id(node), ""), first[1]


def _text(node: ast.AST) -> str:
    """Return the value of a text constant, otherwise an empty text."""
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def places_of(name: str) -> Iterator[str]:
    """Yield the paths at which a module, the packages that contain it, or its last name as a module may be.

    >>> sorted(places_of("controller.core"))
    ['controller.py', 'controller/__init__.py', 'controller/core.py', 'controller/core/__init__.py']
    """
    parts = name.split(".")
    for count in range(1, len(parts) + 1):
        folder = "/".join(parts[:count])
        yield f"{folder}.py"
        yield f"{folder}/__init__.py"


def command_table(text: str) -> tuple[str, dict[str, list[str]], str] | None:
    """Return package, modules of each command, and default command of a source text that declares a command line."""
    call = _commands_call(list(ast.walk(ast.parse(text))))
    if call is None:
        return None
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    commands = given["commands"]
    modules = {}
    if isinstance(commands, ast.Dict):
        for key, entry in zip(commands.keys, commands.values, strict=True):
            words = [str(node.value) for node in ast.walk(entry) if isinstance(node, ast.Constant)]
            modules[ast.unparse(key or entry).strip("'\"")] = [word for word in words if _MODULE.fullmatch(word)]
    return str(ast.literal_eval(given["package"])), modules, str(ast.literal_eval(given["default"]))


def _commands_call(nodes: list[ast.AST]) -> ast.Call | None:
    """Return the call that declares the command line of a package."""
    for node in nodes:
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "CommandLine":
            return node
    return None


def _named(text: str) -> Iterator[str]:
    """Yield the dotted names of own modules in a text, which may be a program."""
    yield from _MODULE.findall(text)
    for module, names in _FROM.findall(text):
        yield from (f"{module}.{name.split()[0]}" for name in names.split(",") if name.strip())


def _imported(nodes: list[ast.AST], path: PurePosixPath) -> Iterator[str]:
    """Yield the dotted name of every own module, and of every name taken from one, that the file imports."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.partition(".")[0] in ROOTS)
        elif isinstance(node, ast.ImportFrom):
            above = list(path.parts[: -node.level]) if node.level else []
            module = ".".join([*above, *([node.module] if node.module else [])])
            if module.partition(".")[0] in ROOTS:
                yield from (f"{module}.{alias.name}" for alias in node.names)


def _begins_with_option(node: ast.AST) -> bool:
    """Return whether a call or sequence is empty, begins with an option, or names a package without a command."""
    if isinstance(node, ast.Call):
        if not node.args and not node.keywords:
            return _name(node.func).endswith("main")
        items = node.args
    elif isinstance(node, ast.List | ast.Tuple):
        items = node.elts
    else:
        return False
    texts = [_text(item) for item in items]
    if isinstance(node, ast.Call) and any(isinstance(item, ast.List) and not item.elts for item in items[:1]):
        return True
    after_package = [texts[place] for place in range(1, len(texts)) if texts[place - 1] in ROOTS]
    return any(text.startswith("-") and text != "-m" for text in [*texts[:1], *after_package]) or (
        "-m" in texts and texts[-1] in ROOTS
    )


def _folders(nodes: list[ast.AST]) -> Iterator[str]:
    """Yield the folders that the file may read: those of `_FOLDERS` and what is appended to them, as far as known.

    Args:
        nodes: Nodes of the file, outermost first.
    """
    seen: set[int] = set()
    for node in nodes:
        if isinstance(node, ast.Call) and _name(node.func) in _WALKERS:
            packages = {_name(each.value) for each in node.args if isinstance(each, ast.Attribute)}
            yield from packages if packages and packages <= set(ROOTS) else {WHOLE_TREE}
        seen |= {id(part) for ignored in _not_read(node) for part in ast.walk(ignored)}
        if id(node) not in seen and isinstance(node, ast.BinOp | ast.Name):
            seen |= {id(part) for part in ast.walk(node)}
            yield from _folder_of(node)


def _folder_of(path: ast.expr) -> Iterator[str]:
    """Yield the folder of a path expression; none if it is the path of a file, which is found by its name."""
    parts, known = list[str](), True
    while isinstance(path, ast.BinOp):
        if part := _text(path.right):
            parts.insert(0, part)
        else:
            parts, known = [], False
        path = path.left
    of_file = known and parts and "." in parts[-1].rpartition("/")[2]
    if isinstance(path, ast.Name) and isinstance(path.ctx, ast.Load) and path.id in _FOLDERS and not of_file:
        yield "/".join(filter(None, [_FOLDERS[path.id], *parts]))


def _not_read(node: ast.AST) -> Iterator[ast.expr]:
    """Yield the parts of a node in which a path is text or the folder of a process, not the folder of a read file."""
    if isinstance(node, ast.keyword) and node.arg == "cwd":
        yield node.value  # the files that the process reads are known from its arguments
    elif isinstance(node, ast.Call) and _name(node.func) in {"str", "relative_to", "is_relative_to"}:
        yield from node.args


def _name(node: ast.AST) -> str:
    """Return the name of a variable or an attribute, otherwise an empty text."""
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
