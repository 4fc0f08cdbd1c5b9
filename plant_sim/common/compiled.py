"""Compilation of the plant equations to machine code, cached on disk."""

import hashlib
import os
import shutil
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

from controller.common.files.cache_folder import user_cache_folder
from controller.common.files.trust import trusted_folder

_Params = ParamSpec("_Params")
_Result = TypeVar("_Result")

_PACKAGE = Path(__file__).parents[1]
_PREFIX = "kernel-"
_RETAINED_VERSIONS = 4
_UNUSED_S = 86_400.0

CACHE_SOURCES = (
    "common/*.py",
    "pneumatics/*.py",
    "devices/*.py",
    "machine/kernel.py",
    "crop/quiet.py",
    "twin/kernel.py",
)
"""Patterns, relative to the package, of the source files whose content identifies the cached machine code."""


def compiled(function: Callable[_Params, _Result]) -> Callable[_Params, _Result]:
    """Compile a function that is called only by compiled functions, not from Python.

    As in Python, floating-point operations are neither reordered nor fused. Unlike in Python, a division by zero gives
    infinity. `function.py_func` is the original Python function.
    """
    return _compiled(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def inlined(function: Callable[_Params, _Result]) -> Callable[_Params, _Result]:
    """Compile a function as a part of each compiled function that calls it.

    Its results are passed in registers instead of memory. A large function called from several places should be
    `compiled`, because each copy costs compilation time.
    """
    return _compiled(function, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def _compiled(function: Callable[_Params, _Result], **options: bool) -> Callable[_Params, _Result]:
    njit: Any = numba.njit  # its type for type checkers lacks some options
    return cast("Callable[_Params, _Result]", njit(error_model="numpy", **options)(function))


def compiled_and_cached(function: Callable[_Params, _Result]) -> Callable[_Params, _Result]:
    """Compile a function that is called from Python, and cache the machine code for later processes.

    To detect outdated machine code, numba checks only the file that contains the function. The name of the cache folder
    is therefore derived from the content of all files matched by `CACHE_SOURCES`. The folder is in
    ``NUMBA_CACHE_DIR`` if that is set, else in the user's cache folder. If it is not writable, every process compiles
    the function again. If another user could write it, a private folder of this process takes its place.
    """
    folder = _version_folder()
    if folder is None:
        return _compiled(function)
    config: Any = numba.config  # a module whose attributes come from the environment and are unknown to type checkers
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder)
    try:
        return _compiled(function, cache=True)
    finally:
        config.CACHE_DIR = before


def cache_sources(patterns: Iterable[str] = CACHE_SOURCES) -> list[Path]:
    """Return the source files that identify the cached machine code, in a fixed order."""
    return [path for pattern in patterns for path in sorted(_PACKAGE.glob(pattern))]


def cache_folder() -> Path:
    """Return the folder that contains all versions of the cached machine code.

    ``NUMBA_CACHE_DIR`` takes precedence over `user_cache_folder`.

    Raises:
        RuntimeError: The user has no home folder.
    """
    if custom := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(custom)
    return user_cache_folder()


@cache
def _version_folder() -> Path | None:
    """Return the writable cache folder of the current sources, or None."""
    digest = hashlib.sha256()
    for path in cache_sources():
        digest.update(path.read_bytes())
    try:
        folder = trusted_folder(cache_folder(), f"{_PREFIX}{digest.hexdigest()[:16]}")
        os.utime(folder)  # the modification time records the last use
    except (OSError, RuntimeError):
        return None
    if not os.access(folder, os.W_OK):
        return None
    _delete_old_versions(folder)
    return folder


def _delete_old_versions(current: Path) -> None:
    """Delete machine code that has not been used for a day, except for the newest versions."""
    times_s = {folder: folder.stat().st_mtime for folder in current.parent.glob(f"{_PREFIX}*")}
    newest_first = sorted(times_s, key=lambda folder: times_s[folder], reverse=True)
    for folder in newest_first[_RETAINED_VERSIONS:]:
        if times_s[current] - times_s[folder] > _UNUSED_S:
            shutil.rmtree(folder, ignore_errors=True)
