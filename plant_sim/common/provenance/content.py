"""Checksums of the code of both packages and of files, independent of line endings, paths and version control."""

from __future__ import annotations

import hashlib
import importlib.metadata
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

import controller
import plant_sim
from controller.common.extras import DISTRIBUTION

_PACKAGES: Final = {module.__name__: Path(module.__path__[0]) for module in (controller, plant_sim)}
_ADDED: Final = (
    "controller/hmi/panel/static/foreign/",
    "controller/iomap/io_map.yaml",
    "controller/hmi/panel/machine.svg",
)
"""Files that building a wheel adds to the packages; the I/O map belongs to the parameters of a result."""
_DIGITS: Final = 32


def package_version() -> str:
    """Return the version of the package; ``unknown`` for a checkout that is not installed."""
    try:
        return importlib.metadata.version(DISTRIBUTION)
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


def content_hash(content: bytes) -> str:
    r"""Return the checksum of a file's content, the same with every kind of line ending.

    >>> content_hash(b"a: 1\r\nb: 2\r\n") == content_hash(b"a: 1\nb: 2\n")
    True
    """
    return hashlib.sha256(content.replace(b"\r\n", b"\n")).hexdigest()[:_DIGITS]


def code_files() -> Iterator[tuple[str, Path]]:
    """Yield all source and data files of both packages by their names in the packages, in the order of the names."""
    found = {
        f"{package}/{path.relative_to(folder).as_posix()}": path
        for package, folder in _PACKAGES.items()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
    yield from ((name, found[name]) for name in sorted(found) if not name.startswith(_ADDED))


@cache
def code_hash() -> str:
    """Return the checksum of the source and data files of both packages as they are installed."""
    lines = (f"{name} {content_hash(path.read_bytes())}\n" for name, path in code_files())
    return content_hash("".join(lines).encode())
