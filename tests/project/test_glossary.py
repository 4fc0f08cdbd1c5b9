"""Words of the glossary: the names of classes, modules, folders and commands use each term in its one meaning."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

import yaml

from controller.cli.main import COMMAND_LINE as CONTROLLER
from plant_sim.cli.main import COMMAND_LINE as PLANT
from tests.paths import DOCS, ROOT
from tests.project.test_style import PACKAGES, sources

GLOSSARY: Final = DOCS / "glossary.md"
OFFENDERS: Final = ROOT / "tests/project/glossary_offenders.yaml"
OFFENDERS_LEFT: Final = 55
"""Entries of the list of offenders. The number only decreases."""
COLUMNS: Final = ["Term", "Meaning", "Names in", "Elsewhere", "Not"]
CLASS: Final = re.compile(r"^ *class (\w+)[:(\[]", re.MULTILINE)
WORD: Final = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")

Words = tuple[str, ...]


class Term(NamedTuple):
    """Row of the glossary."""

    name: str
    meaning: str
    packages: tuple[str, ...]
    elsewhere: str
    synonyms: tuple[str, ...]

    def may_stand_in(self, package: str) -> bool:
        """Return whether names of a package may contain the term; tests use the words of the package they test."""
        places = (f"{package}/", f"{package.removeprefix('tests/')}/")
        return not self.packages or any(place.startswith(f"{each}/") for place in places for each in self.packages)


class Name(NamedTuple):
    """Name of a class, module, folder or command.

    Attributes:
        text: The name.
        place: Path, followed by the name of a class; for a command, the package and the command.
        package: Folder that determines which words are permitted.
    """

    text: str
    place: str
    package: str


def words(text: str) -> Words:
    """Return the words of a name or term in lower case and in the singular."""
    found = (word.lower() for word in WORD.findall(text.replace("I/O", "Io")))
    return tuple(re.sub(r"(?<=\w\w[^s])s$", "", re.sub(r"ies$", "y", word)) for word in found)


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


@cache
def terms() -> tuple[Term, ...]:
    """Return the rows of all tables of the glossary."""
    lines = [cells(line) for line in GLOSSARY.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    return tuple(
        Term(name, meaning, tuple(re.findall(r"`(.+?)`", packages)), elsewhere, tuple(re.findall(r"`(.+?)`", synonyms)))
        for name, meaning, packages, elsewhere, synonyms in lines
        if [name, meaning, packages, elsewhere, synonyms] != COLUMNS
    )


def names() -> Iterator[Name]:
    """Yield the names of classes, modules, folders and commands."""
    folders = set[Path]()
    for path in sources(*PACKAGES, "scripts/benchmark", "tests"):
        relative = path.relative_to(ROOT)
        folders.update(relative.parents)
        yield Name(path.stem, relative.as_posix(), relative.parent.as_posix())
        for name in CLASS.findall(path.read_text(encoding="utf-8")):
            yield Name(name, f"{relative.as_posix()}:{name}", relative.parent.as_posix())
    yield from (Name(each.name, f"{each.as_posix()}/", each.as_posix()) for each in folders if each.name)
    for package, line in zip(PACKAGES, (CONTROLLER, PLANT), strict=True):
        yield from (Name(command, f"{package} {command}", f"{package}/cli") for command in line.commands)


@cache
def entries() -> dict[Words, tuple[Term, str]]:
    """Return each term, and the term for each synonym with the synonym, by their words."""
    synonyms = {words(synonym): (term, synonym) for term in terms() for synonym in term.synonyms}
    return {words(term.name): (term, "") for term in terms()} | synonyms


def offences(name: Name) -> Iterator[tuple[str, str]]:
    """Yield each word of a name that contradicts the glossary, with the remedy; the longest term at a place counts."""
    rest = words(name.text)
    while rest:
        size = next((size for size in range(len(rest), 0, -1) if rest[:size] in entries()), 0)
        term, synonym = entries().get(rest[:size], (None, ""))
        rest = rest[size or 1 :]
        if term is not None and synonym:
            yield synonym, f"{name.place}: say '{term.name}' ({term.meaning}), not '{synonym}'"
        elif term is not None and not term.may_stand_in(name.package):
            yield term.name, f"{name.place}: '{term.name}' means: {term.meaning}; here say {term.elsewhere}"


def test_the_tables_are_complete_and_name_packages_that_exist() -> None:
    known = [words(each.name) for each in terms()]
    synonyms = [words(synonym) for each in terms() for synonym in each.synonyms]
    assert len(known) > 60
    assert len({*known, *synonyms}) == len(known) + len(synonyms), "a word stands in two rows"
    for term in terms():
        assert term.meaning, f"{term.name}: no meaning"
        assert all((ROOT / package).is_dir() for package in term.packages), f"{term.name}: a package does not exist"
        assert not term.packages or term.elsewhere, f"{term.name}: no word for other packages"


def test_names_follow_the_glossary() -> None:
    listed = yaml.safe_load(OFFENDERS.read_text(encoding="utf-8"))
    known = {(word, place) for word, places in listed.items() for place in places}
    assert len(known) == OFFENDERS_LEFT, "lower the number when an entry is deleted, and add none"
    found = {(word, name.place): remedy for name in names() for word, remedy in offences(name)}
    assert not (new := [remedy for key, remedy in found.items() if key not in known]), "\n".join(new)
    gone = [
        f"{OFFENDERS.name}: {word}: {place}: no longer an offence, delete it" for word, place in known - found.keys()
    ]
    assert not gone, "\n".join(sorted(gone))
