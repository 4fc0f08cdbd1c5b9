"""Cache of compiled functions: its key covers all sources, and its folder belongs to the user."""

import ast
import importlib
import os
import pkgutil
import subprocess
import sys
from collections.abc import Iterable, Set
from functools import cache
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

import plant_sim
from plant_sim.common import compiled
from plant_sim.common.compiled import CACHE_SOURCES, cache_folder, cache_sources
from tests.controller.common.files.trust_rig import private_folders

PACKAGE = Path(plant_sim.__file__).parent
WITHOUT_HOME = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "LOCALAPPDATA")


@cache
def compiled_files() -> frozenset[Path]:
    """Return the source files of all compiled functions of the package."""
    for module in pkgutil.walk_packages(plant_sim.__path__, "plant_sim."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    modules = [module for name, module in sys.modules.items() if name.startswith("plant_sim.")]
    functions = [each for module in modules for each in vars(module).values() if isinstance(each, Dispatcher)]
    files = {Path(function.py_func.__code__.co_filename) for function in functions}
    return frozenset(file for file in files if file.is_relative_to(PACKAGE))


@cache
def imported_files(file: Path) -> frozenset[Path]:
    """Return the package files that a file imports from; their constants are compiled into its machine code."""
    imports = [node.module for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.ImportFrom)]
    paths = [PACKAGE.parent.joinpath(*name.split(".")).with_suffix(".py") for name in imports if name]
    return frozenset(path for path in paths if path.is_relative_to(PACKAGE) and path.exists())


def missing_sources(patterns: Iterable[str]) -> set[Path]:
    """Return the source files of machine code that match none of the patterns."""
    needed: set[Path] = set()
    pending: Set[Path] = compiled_files()
    while pending:
        needed |= pending
        pending = {path for file in pending for path in imported_files(file)} - needed
    return needed - set(cache_sources(patterns))


def test_the_cache_key_covers_every_source_of_machine_code() -> None:
    assert PACKAGE / "machine" / "kernel.py" in compiled_files()
    assert missing_sources(CACHE_SOURCES) == set()


@pytest.mark.parametrize("dropped", CACHE_SOURCES)
def test_a_dropped_pattern_is_detected(dropped: str) -> None:
    assert missing_sources([pattern for pattern in CACHE_SOURCES if pattern != dropped])


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({}, "~/.cache/seedling-transplanter"),
        ({"XDG_CACHE_HOME": "/x/cache"}, "/x/cache/seedling-transplanter"),
        ({"XDG_CACHE_HOME": "/x/cache", "NUMBA_CACHE_DIR": "/x/numba"}, "/x/numba"),
    ],
)
def test_the_cache_folder_is_that_of_the_user(
    monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], expected: str
) -> None:
    for name in WITHOUT_HOME:
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert cache_folder() == Path(expected).expanduser()


def test_a_cache_folder_that_others_can_write_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    folder = compiled._version_folder.__wrapped__()
    assert folder is not None
    assert folder.parent == tmp_path
    for exposed in (folder, tmp_path):
        exposed.chmod(0o777)
        with private_folders(monkeypatch):
            private = compiled._version_folder.__wrapped__()
            assert private is not None
            assert private.name == folder.name
            assert not private.is_relative_to(tmp_path)
        exposed.chmod(0o700)
    assert compiled._version_folder.__wrapped__() == folder


CHARGE = """
import numpy as np
from plant_sim.pneumatics.chamber import CHAMBER, set_ambient
set_ambient(np.zeros(1, CHAMBER)[0])
"""


def run_compiled(cache: Path) -> None:
    """Call a compiled function in a new process."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache), "LOCALAPPDATA": str(cache)}
    environment.pop("NUMBA_CACHE_DIR", None)
    environment["PYTHONPATH"] = str(PACKAGE.parent)
    subprocess.run([sys.executable, "-c", CHARGE], check=True, env=environment)


@pytest.mark.nightly
def test_machine_code_is_cached_in_the_cache_folder_and_not_beside_the_source(tmp_path: Path) -> None:
    beside_source = set(PACKAGE.rglob("*.nbc"))
    run_compiled(tmp_path)
    (version,) = (tmp_path / "seedling-transplanter").iterdir()
    cached = {path: path.stat().st_mtime_ns for path in version.rglob("*.nbc")}
    assert cached
    run_compiled(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in version.rglob("*.nbc")} == cached
    assert set(PACKAGE.rglob("*.nbc")) == beside_source


def test_a_cache_folder_that_cannot_be_created_is_not_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    run_compiled(tmp_path / "file")


@pytest.mark.nightly
def test_versions_unused_for_a_day_are_deleted_except_for_the_newest(tmp_path: Path) -> None:
    run_compiled(tmp_path)
    folder = tmp_path / "seedling-transplanter"
    (current,) = folder.iterdir()
    now_s = current.stat().st_mtime
    for number, age_s in enumerate([10, 20, 30, 40, 90_000, 90_001]):
        (folder / f"kernel-{number}").mkdir()
        os.utime(folder / f"kernel-{number}", (now_s - age_s, now_s - age_s))
    run_compiled(tmp_path)
    assert {path.name for path in folder.iterdir()} == {current.name, *(f"kernel-{number}" for number in range(4))}
