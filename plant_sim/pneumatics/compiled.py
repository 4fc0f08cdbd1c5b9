"""How the equations of the plant are compiled: once, to machine code that is kept on disk."""

import hashlib
import os
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

_Params = ParamSpec("_Params")
_Result = TypeVar("_Result")

_PACKAGE = Path(__file__).parents[1]
_PREFIX = "kernel-"
_VERSIONS_KEPT = 4
_SOURCES = ("pneumatics/*.py", "devices/*.py", "kernel.py")


def compiled(function: Callable[_Params, _Result]) -> Callable[_Params, _Result]:
    """Compile a function that only compiled ones call.

    Floating point as Python has it: no reordering, no fused operations; a division by zero gives
    infinity. The plain function is `function.py_func`.
    """
    return cast("Callable[_Params, _Result]", numba.njit(error_model="numpy")(function))


def compiled_and_kept(function: Callable[_Params, _Result]) -> Callable[_Params, _Result]:
    """Compile a function that Python calls, and keep the machine code for the next process.

    numba looks only at the file of the function itself to tell whether the kept code is out of
    date. So the code is kept in a folder named after the content of every file it may come from: in
    ``NUMBA_CACHE_DIR`` if that is set, else beside the source, else in the user's cache. Where
    nothing can be written it is compiled anew by every process.
    """
    folder = _cache_folder()
    if folder is None:
        return compiled(function)
    config: Any = numba.config  # a module whose settings come from the environment, unknown to type checkers
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder)
    try:
        return cast("Callable[_Params, _Result]", numba.njit(error_model="numpy", cache=True)(function))
    finally:
        config.CACHE_DIR = before


@cache
def _cache_folder() -> Path | None:
    digest = hashlib.sha256()
    for pattern in _SOURCES:
        for path in sorted(_PACKAGE.glob(pattern)):
            digest.update(path.read_bytes())
    name = f"{_PREFIX}{digest.hexdigest()[:16]}"
    given = os.environ.get("NUMBA_CACHE_DIR")
    own = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "seedling-transplanter"
    for parent in [Path(given)] if given else [_PACKAGE / "__pycache__", own]:
        folder = parent / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, RuntimeError):  # RuntimeError: the user has no home
            continue
        if os.access(folder, os.W_OK):
            _tidy(parent, folder)
            return folder
    return None


def _tidy(parent: Path, folder: Path) -> None:
    """Delete the machine code of sources that are long gone."""
    folders = sorted(parent.glob(f"{_PREFIX}*"), key=lambda each: each.stat().st_mtime, reverse=True)
    for old in folders[_VERSIONS_KEPT:]:
        if old != folder:
            shutil.rmtree(old, ignore_errors=True)
