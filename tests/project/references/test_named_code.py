"""Names of code in back-ticks exist: each identifier occurs in a source file, and each constant in its module."""

from __future__ import annotations

import re
from functools import cache
from itertools import chain
from typing import Final

from tests.paths import ROOT
from tests.project.test_style import PACKAGES, sources

NAME: Final = re.compile(r"(?<!`)`([A-Za-z]\w*[A-Za-z0-9](?:\.[A-Za-z_]\w*)*)(?:\(\))?`(?!`)")
"""Identifier or dotted name in single back-ticks; a prefix that ends with an underscore is no name."""
FOREIGN: Final = re.compile(r".*\.cpp")
"""Source files of other programs."""
DATA: Final = ("**/*.yaml", "**/*.toml", "**/*.js", "**/*.html")


@cache
def texts() -> dict[str, str]:
    """Return the text of every Python file by its path."""
    return {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
        for path in sources(*PACKAGES, "tests", "scripts")
        if "node_modules" not in path.parts
    }


def known_words() -> set[str]:
    """Return all words of the source files and their paths; words in back-ticks do not count."""
    data = (path for package in PACKAGES for pattern in DATA for path in (ROOT / package).glob(pattern))
    others = (path.read_text(encoding="utf-8") for path in chain(data, ROOT.glob("*.yaml"), ROOT.glob("*.toml")))
    return set(re.findall(r"\w+", re.sub(r"`[^`\n]*`", "", "\n".join([*texts(), *texts().values(), *others]))))


def names() -> list[tuple[str, str]]:
    """Return the path and the name of every name in back-ticks."""
    return [
        (path, name) for path, text in texts().items() for name in NAME.findall(text) if not FOREIGN.fullmatch(name)
    ]


def test_every_name_in_back_ticks_exists() -> None:
    known = known_words()
    assert [found for found in names() if not known.issuperset(found[1].split("."))] == []


def test_every_constant_in_back_ticks_is_in_its_module() -> None:
    """A constant with the name of its module, such as `operator.ORDERS`, is defined in a module of that name."""
    assert len(names()) > 100
    for path, name in names():
        module, _, constant = name.rpartition(".")
        if constant.isupper() and module:
            file = f"{module.replace('.', '/')}.py"
            homes = [text for each, text in texts().items() if f"/{each}".endswith(f"/{file}")]
            homes = homes or [text for text in texts().values() if f"class {module}" in text]
            assert any(re.search(rf"^ *{constant}\b", text, re.MULTILINE) for text in homes), (path, name)
