"""Machine code for a copy of the plant, taken from the checkout so that the copy need not be compiled."""

from __future__ import annotations

import shutil
from hashlib import sha1
from pathlib import Path

from plant_sim.common.compiled import cache_folder, cache_sources
from tests.paths import ROOT


def give_machine_code(package: Path, cache: Path) -> None:
    """Copy the cached machine code of the checkout to a cache folder, for a copy of the plant with the same sources.

    If numba stores the machine code elsewhere or the sources differ, the copy is compiled on first use.

    Args:
        package: Folder of the copied plant.
        cache: Folder that contains all versions of the machine code of the copy.
    """
    for folder in {path.parent.relative_to(ROOT / "plant_sim") for path in cache_sources()}:
        for compiled in cache_folder().glob(f"kernel-*/{_stored_name(ROOT / 'plant_sim' / folder)}"):
            shutil.copytree(compiled, cache / compiled.parent.name / _stored_name(package / folder))


def _stored_name(folder: Path) -> str:
    """Return the name of the folder in which numba stores the machine code for a source folder."""
    return f"{folder.name}_{sha1(str(folder).encode(), usedforsecurity=False).hexdigest()}"
