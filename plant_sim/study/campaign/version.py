"""Version of a result: the sources and the libraries that determine it."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Final

import controller
import plant_sim
from plant_sim.common.provenance.content import package_version

_SOURCES: Final[Mapping[Path, tuple[str, ...]]] = {
    Path(controller.__file__).parent: (
        "common/**/*.py",
        "core/*.py",
        "events/*.py",
        "io/*.py",
        "iomap/*.py",
        "program/**/*.py",
    ),
    Path(plant_sim.__file__).parent: (
        "common/**/*.py",
        "crop/*.py",
        "devices/*.py",
        "faults/*.py",
        "links/*.py",
        "machine/*.py",
        "pneumatics/*.py",
        "study/campaign/record.py",
        "twin/*.py",
        "twin/debug/run_recorder.py",
        "twin/ending/*.py",
    ),
}
"""Patterns of the sources that determine the results, by package."""

_LIBRARIES: Final = ("llvmlite", "numba", "numpy", "scipy")
"""Libraries that compile the plant and the program or generate the numbers."""


def version_sources() -> list[Path]:
    """Return the source files that determine the results, in a fixed order."""
    return [
        path for package, patterns in _SOURCES.items() for pattern in patterns for path in sorted(package.glob(pattern))
    ]


@cache
def code_version() -> str:
    """Return the version of this program: the number of its release, and a checksum.

    The checksum covers `version_sources` and the versions of Python and of the libraries. Parameters, set-points and
    the I/O map are not included; they belong to each run.
    """
    digest = hashlib.sha256()
    python = ".".join(platform.python_version_tuple()[:2])
    for each in (f"python {python}", *(f"{name} {version(name)}" for name in _LIBRARIES)):
        digest.update(f"{each}\n".encode())
    for path in version_sources():
        content = path.read_bytes()
        digest.update(f"{path.name} {len(content)}\n".encode() + content)
    return f"{package_version()}-{digest.hexdigest()[:16]}"
