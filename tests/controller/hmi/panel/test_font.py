"""Files of others on the page: the Chinese font has the glyphs of the texts; sizes, licences, and the build."""

from __future__ import annotations

import dataclasses
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

import pytest
from fontTools.ttLib import TTFont

from controller.hmi.panel.web.app import STATIC
from scripts import foreign_files
from scripts.foreign_files import (
    CHARTS,
    CHINESE,
    FOLDER,
    LATIN,
    MARK,
    NOTO_SANS_SC,
    UPLOT,
    WEIGHTS,
    ForeignFileError,
    Package,
    characters,
    get_build_hook,
    make,
)
from tests.controller.hmi.panel.text_tables import declared_values
from tests.paths import ROOT
from tests.sampling import first_of

MOST_BYTES: Final = 400_000
"""Limit of all files of the font together."""
REMEDY: Final = "to make the files again, run: scripts/setup dev"
OTHER_SYMBOLS: Final = set("λ≤≥≠–“”°")
"""Characters of Chinese texts that are neither ASCII nor Chinese; every computer with a Latin font has them."""
FONTS: Final = {weight: ROOT / FOLDER / f"noto-sans-sc-{weight}.woff2" for weight in WEIGHTS}


def strings(value: Any) -> Iterator[str]:
    """Yield the strings in a value, down into tables and records."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, entry in value.items():
            yield from strings(key)
            yield from strings(entry)
    elif isinstance(value, tuple | list | set | frozenset):
        for entry in value:
            yield from strings(entry)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            yield from strings(getattr(value, field.name, None))


def is_chinese(character: str) -> bool:
    return any(first <= ord(character) <= last for first, last in CHINESE)


@cache
def texts() -> frozenset[str]:
    """Return the strings with Chinese characters in the tables of all modules of the controller."""
    found = {text for _, value in declared_values() for text in strings(value)}
    found.update(re.findall(r'"([^"\n]*)"', (STATIC / "texts.js").read_text(encoding="utf-8")))
    return frozenset(text for text in found if any(map(is_chinese, text)))


@pytest.mark.parametrize("weight", WEIGHTS)
def test_the_font_has_the_glyphs_of_the_texts_and_no_others(weight: int) -> None:
    assert len(texts()) > 700
    assert FONTS[weight].is_file(), REMEDY
    glyphs = {chr(code) for code in TTFont(FONTS[weight]).getBestCmap()}
    lacking = {text: set(text) - glyphs for text in texts()}
    assert {text: lack for text, found in lacking.items() if (lack := set(filter(is_chinese, found)))} == {}, REMEDY
    assert glyphs - set("".join(texts())) == set(), REMEDY


def test_other_characters_of_chinese_texts_are_in_every_latin_font() -> None:
    others = {one for one in "".join(texts()) if not one.isascii() and not is_chinese(one)}
    assert others - OTHER_SYMBOLS == set()


def test_the_font_is_small_and_has_its_licence_beside_it() -> None:
    files = [*FONTS.values(), ROOT / FOLDER / "noto-sans-sc.LICENSE.txt"]
    assert sum(path.stat().st_size for path in files) <= MOST_BYTES
    assert "SIL OPEN FONT LICENSE Version 1.1" in files[-1].read_text()
    for weight, path in FONTS.items():
        font = TTFont(path)
        assert (font.flavor, font["OS/2"].usWeightClass) == ("woff2", weight)
        assert "Adobe" in font["name"].getDebugName(0), "the copyright notice stays in the font"


def test_the_charts_are_those_of_the_pinned_version_with_their_licence() -> None:
    script, licence = (
        (ROOT / FOLDER / name).read_text(encoding="utf-8") for name in ("uPlot.esm.js", "uPlot.LICENSE.txt")
    )
    assert f"(v{UPLOT.version})" in script[:400]
    assert script.rstrip().endswith("export { uPlot as default };")
    assert licence.startswith("The MIT License (MIT)")


def test_the_folder_has_the_files_of_the_packages_and_their_mark_only() -> None:
    wanted = {*(path.name for path in FONTS.values()), "noto-sans-sc.LICENSE.txt", *LATIN, *CHARTS, MARK}
    assert {path.name for path in (ROOT / FOLDER).iterdir()} == wanted


def test_the_style_sheet_takes_the_chinese_characters_from_the_font() -> None:
    sheet = (ROOT / "controller/hmi/web/static/fonts.css").read_text(encoding="utf-8")
    blocks = ", ".join(f"U+{first:04X}-{last:04X}" for first, last in CHINESE)
    chinese = sheet[sheet.index('"Panel Chinese"') :]
    assert re.findall(r"unicode-range: (.*);", chinese) == [blocks] * len(FONTS)
    assert re.findall(r'url\("/static/(.*?)"\)', chinese) == [f"foreign/{path.name}" for path in FONTS.values()]


# --- build ----------------------------------------------------------------------------------------


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Return a copy of the files that the build step reads and writes."""
    for folder in (FOLDER, Path("scripts")):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "controller/texts.py").write_text(characters(ROOT), encoding="utf-8")
    return tmp_path


def check(tree: Path) -> int:
    command = [sys.executable, str(tree / "scripts/foreign_files.py"), "--check"]
    return subprocess.run(command, check=False, timeout=60).returncode


def test_the_font_has_to_be_made_again_for_a_text_with_a_new_character(tree: Path) -> None:
    assert check(ROOT) == 0, REMEDY
    assert check(tree) == 0
    text = tree / "controller/more.py"
    text.write_text(characters(ROOT)[::-1] + "abc", encoding="utf-8")
    assert check(tree) == 0, "no new character"
    text.write_text(
        next(one for one in map(chr, range(0x4E00, 0x9FFF)) if one not in characters(ROOT)), encoding="utf-8"
    )
    assert check(tree) == 1


@pytest.mark.parametrize("name", ["uPlot.esm.js", "uPlot.LICENSE.txt", "noto-sans-sc-400.woff2"])
def test_a_missing_file_has_to_be_made_again(tree: Path, name: str) -> None:
    (tree / FOLDER / name).unlink()
    assert check(tree) == 1


def test_the_font_has_to_be_made_again_after_a_change_of_its_build(tree: Path) -> None:
    with (tree / "scripts/foreign_files.py").open("a", encoding="utf-8") as script:
        script.write("# one more line\n")
    assert check(tree) == 1


def test_the_build_needs_npm_only_to_make_the_font(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A source distribution contains the font; a checkout without npm takes it from PyPI."""

    def needed(root: Path) -> list[str]:
        monkeypatch.setattr(foreign_files, "ROOT", root)
        hook = get_build_hook()(str(root), {}, None, None, "", "wheel")  # type: ignore[arg-type]
        return hook.dependencies()

    assert needed(ROOT) == []
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert needed(ROOT) == []
    assert needed(tmp_path) == [foreign_files.NPM]
    with pytest.raises(ForeignFileError, match=r"^npm is needed to download @fontsource/noto-sans-sc@[\d.]+; install "):
        make(tmp_path)


@pytest.mark.parametrize("package", first_of([(NOTO_SANS_SC,), (UPLOT,)]), ids=lambda package: package.name)
@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("echo 404 not found >&2; exit 1", "npm cannot download .*: 404 not found; check the network"),
        ("echo other >other.tgz", ".* is not the pinned archive: its SHA-512 differs; check the registry of npm"),
    ],
)
def test_a_package_that_is_not_the_pinned_one_is_refused(
    monkeypatch: pytest.MonkeyPatch, tree: Path, package: Package, script: str, message: str
) -> None:
    """Of all packages one fails; the files that were made before stay as they are."""
    archive = shutil.which("npm")
    assert archive is not None, "npm has the other package in its cache, or downloads it"
    npm = tree / "npm"
    npm.write_text(f'#!/bin/sh\ncase "$*" in *{package.name}@*) {script};; *) exec {archive} "$@";; esac\n')
    npm.chmod(0o755)
    monkeypatch.setattr(shutil, "which", lambda _: str(npm))
    before = {path.name: path.read_bytes() for path in (tree / FOLDER).iterdir()}
    with pytest.raises(ForeignFileError, match=f"^{message}$"):
        make(tree)
    assert {path.name: path.read_bytes() for path in (tree / FOLDER).iterdir()} == before
