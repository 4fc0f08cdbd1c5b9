"""Names of code in back-ticks exist, in source files and on the pages of the documentation.

In source files, each identifier occurs in a source file, and each constant in its module. On a page, identifiers with
an underscore or in camel case and dotted names occur in a source file or in a table generated from the program; paths
exist; and a parser or a script accepts each long option.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from itertools import chain
from typing import Final

from tests.paths import DOCS, ROOT
from tests.project.test_style import PACKAGES, SOURCES, sources

NAME: Final = re.compile(r"(?<!`)`([A-Za-z]\w*[A-Za-z0-9](?:\.[A-Za-z_]\w*)*)(?:\(\))?`(?!`)")
"""Identifier or dotted name in single back-ticks; a prefix that ends with an underscore is no name."""
FOREIGN: Final = re.compile(r".*\.cpp")
"""Source files of other programs."""
DATA: Final = ("**/*.yaml", "**/*.toml", "**/*.js", "**/*.html")
FENCED: Final = re.compile(r"^ *```.*?^ *```", re.MULTILINE | re.DOTALL)
"""Block of commands, code or output; other tests run these blocks."""
SPAN: Final = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
IDENTIFIER: Final = re.compile(r"([A-Za-z]\w*[A-Za-z0-9](?:\.[A-Za-z_]\w*)*)(?:\(.*\))?")
DISTINCT: Final = re.compile(r"\w_\w|[a-z][A-Z]|[A-Z][a-z]+[A-Z]|\w\.\w")
"""Feature of a name that is no English word: underscore, camel case or dot."""
ARGUMENT: Final = re.compile(r"(\w+)=")
WORD_BIT: Final = re.compile(r"D\d+\.[0-9A-F]")
"""Bit of a data register, as an operand of an FX3U."""
FILE_NAME: Final = re.compile(r"\w+\.(?:csv|html|il|json|md|parquet|png|py|service|st|svg|txt|wpg|xml|yaml)")
ROOTS: Final = ("controller", "plant_sim", "tests", "scripts", "docs", ".ci")
PATH: Final = re.compile(rf"(?:{'|'.join(map(re.escape, ROOTS))})/[\w./-]*|[\w/]+\.py")
OPTION: Final = re.compile(r"(?<!\S)--[a-z][\w-]*")
READERS: Final = re.compile(r".*/(?:test_)?my_\w+\.\w+")
"""File that the reader of a guide creates."""
METRIC: Final = re.compile(r"transplanter_(\w+?)(?:_total)?")
"""Metric of the web panel; prefix and suffix are added to its name in the source."""
SYSTEM_NAMES: Final = {
    "PasswordManagerEnabled",
    "SupplementaryGroups",
    "TranslateEnabled",
    "XCURSOR_THEME",
    "sched_rt_runtime_us",
}
"""Names of Linux, systemd and the browser."""
OTHER_PROGRAMS: Final = (".venv/bin/pytest ", "journalctl ", "python -m mkdocs ")
"""Beginnings of commands of other programs, whose options are their own."""


@cache
def texts() -> dict[str, str]:
    """Return the text of every Python file by its path."""
    return {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
        for path in sources(*SOURCES)
        if "node_modules" not in path.parts
    }


@cache
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


def spans() -> Iterator[tuple[str, str]]:
    """Yield the name of a page and every text in back-ticks on it; generated pages are checked by their generators."""
    for page in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md"))):
        text = page.read_text(encoding="utf-8")
        if "do not edit" not in text[:400]:
            yield from ((page.name, span) for span in SPAN.findall(FENCED.sub("", text)))


def page_names() -> list[tuple[str, str]]:
    """Return the page and name of every identifier and argument on a page, except English words."""
    calls = ((page, match[1], span) for page, span in spans() if (match := IDENTIFIER.fullmatch(span)))
    found = ((page, name) for page, called, span in calls for name in (called, *ARGUMENT.findall(span)))
    return [
        (page, metric[1] if (metric := METRIC.fullmatch(name)) else name)
        for page, name in found
        if DISTINCT.search(name) and name not in SYSTEM_NAMES
        if not FILE_NAME.fullmatch(name) and not WORD_BIT.fullmatch(name)
    ]


def generated_words() -> set[str]:
    """Return the words of the tables generated from the program; they contain the names of both sides."""
    tables = (*(DOCS / "reference").glob("*.md"), *(DOCS / "reference").glob("*.csv"), DOCS / "hmi-tags.md")
    return set(re.findall(r"\w+", "\n".join(table.read_text(encoding="utf-8") for table in tables)))


def options() -> set[str]:
    """Return the long options of the parsers and scripts."""
    quoted = (re.findall(r"[\"'](--[a-z][\w-]*)[\"']", text) for text in texts().values())
    scripts = (path for path in (ROOT / "scripts").iterdir() if path.is_file() and not path.suffix)
    shell = (re.findall(r"--[a-z][\w-]*", path.read_text(encoding="utf-8")) for path in scripts)
    return {*chain.from_iterable(quoted), *chain.from_iterable(shell)}


def exists(path: str) -> bool:
    """Return whether a path exists in the repository; a module may be given without its first folders."""
    return (ROOT / path).exists() or any(each.endswith(f"/{path}") for each in texts())


def test_every_name_in_back_ticks_exists() -> None:
    known = known_words()
    assert [found for found in names() if not known.issuperset(found[1].split("."))] == []


def test_every_constant_in_back_ticks_is_in_its_module() -> None:
    """A constant with the name of its module, such as `operator.ORDERS`, is defined in a module of that name."""
    assert len(names()) > 100
    for path, name in (*names(), *page_names()):
        module, _, constant = name.rpartition(".")
        if constant.isupper() and module:
            file = f"{module.replace('.', '/')}.py"
            homes = [text for each, text in texts().items() if f"/{each}".endswith(f"/{file}")]
            homes = homes or [text for text in texts().values() if f"class {module}" in text]
            assert any(re.search(rf"^ *{constant}\b", text, re.MULTILINE) for text in homes), (path, name)


def test_every_name_on_a_page_exists() -> None:
    known = known_words() | generated_words()
    found = page_names()
    assert len(found) > 200
    assert [(page, name) for page, name in found if not known.issuperset(name.split("."))] == []


def test_every_path_on_a_page_exists() -> None:
    words = [(page, word) for page, span in spans() for word in span.split()]
    found = [(page, word) for page, word in words if PATH.fullmatch(word) and not READERS.fullmatch(word)]
    assert len(found) > 100
    assert [(page, path) for page, path in found if not exists(path)] == []


def test_every_long_option_on_a_page_exists() -> None:
    units = (path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("examples/systemd/*.service"))
    known = {*options(), *OPTION.findall("\n".join(units))}
    found = [
        (page, option)
        for page, span in spans()
        if not span.startswith(OTHER_PROGRAMS)
        for option in OPTION.findall(span)
    ]
    assert len(found) > 100
    assert [(page, option) for page, option in found if option not in known] == []
