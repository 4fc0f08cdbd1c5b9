"""Citations of docs/sources: every cited section exists, and no page outside the repository is cited."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from tests.paths import DOCS, ROOT

FOLDERS = ("controller", "plant_sim", "tests", "scripts", "docs")
SUFFIXES = {".md", ".py", ".toml", ".yaml", ".yml"}
SOURCES = DOCS / "sources"
PAGES = {page.name: page for page in SOURCES.glob("*.md") if page.name != "README.md"}
NUMBER = r"\d+(?:\.\d+)?"
LIST = rf"{NUMBER}(?:(?:,| to| and) {NUMBER})*"
CITATION = re.compile(rf"(?<![\w-])({'|'.join(map(re.escape, PAGES))})(?:\s[\s#:]*({LIST})(?: rules? (\d+))?)?")
OUTSIDE = re.compile(r"\b(?:FX|PLANT|MACHINE|ECOSYSTEM|DESIGN|STYLE|LAYOUT)\.md\b")
OLD_MARKS = re.compile(r"\bG[K]\b|\[V\]")


def sections(page: Path) -> dict[str, str]:
    """Return the text of every numbered section of a page."""
    parts = re.split(rf"^#{{2,3}} ({NUMBER})\.? .*$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


SECTIONS = {name: sections(page) for name, page in PAGES.items()}


def text_files() -> Iterator[tuple[str, str]]:
    """Yield the name and text of every file of the repository that may contain citations."""
    paths = [*ROOT.iterdir(), *(path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*")))]
    for path in paths:
        if path != Path(__file__) and path.suffix in SUFFIXES and path.is_file():
            yield str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")


def test_every_cited_section_exists() -> None:
    wrong, count = [], 0
    for name, text in text_files():
        for page, numbers, rule in CITATION.findall(text):
            for number in re.findall(NUMBER, numbers):
                count += 1
                if number not in SECTIONS[page]:
                    wrong.append(f"{name}: {page} {number}: docs/sources/{page} has no such section")
                elif rule and not re.search(rf"^{rule}\. ", SECTIONS[page][number], re.MULTILINE):
                    wrong.append(f"{name}: {page} {number} rule {rule}: no such rule")
    assert not wrong, "\n".join(wrong)
    assert count > 50


def test_numbers_of_sections_are_unique() -> None:
    for page in PAGES.values():
        numbers = re.findall(rf"^#{{2,3}} ({NUMBER})", page.read_text(encoding="utf-8"), re.MULTILINE)
        assert len(numbers) == len(set(numbers)), page.name


def test_no_page_outside_the_repository_is_cited() -> None:
    wrong = [f"{name}: {hit}" for name, text in text_files() for hit in OUTSIDE.findall(text)]
    assert not wrong, "\n".join(wrong)


def test_marks_of_reliability_are_written_out() -> None:
    wrong = [
        f"{name}: {hit}: write 'from memory' or 'verified'"
        for name, text in text_files()
        for hit in OLD_MARKS.findall(text)
    ]
    assert not wrong, "\n".join(wrong)
