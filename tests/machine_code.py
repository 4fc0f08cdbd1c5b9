"""Machine code that need not be compiled again: of a copy of the plant, and of the fixed programs of tests."""

from __future__ import annotations

import shutil
from functools import cache
from hashlib import sha1, sha256
from pathlib import Path

from controller.core import object_code
from plant_sim.common.compiled import cache_folder, cache_sources
from tests.paths import ROOT


@cache
def folder_of_fixed_programs() -> Path | None:
    """Return the folder in which the object files of the fixed programs of tests are kept between runs.

    None if this user has no cache for his programs either. Another processor, another version of LLVM or of the
    compilation has a folder of its own.
    """
    of_user = object_code._folder()
    if of_user is None:
        return None
    source = sha256(Path(object_code.__file__).read_bytes()).hexdigest()[:16]
    folder = ROOT / ".pytest_cache" / f"{of_user.name}-{source}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


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
