"""How the equations of the plant are compiled: once, to machine code that is kept on disk."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

_Params = ParamSpec("_Params")
_Result = TypeVar("_Result")

_PACKAGE = Path(__file__).parents[1]
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
    date. So the code is kept in a folder named after the content of every file it may come from.
    """
    config: Any = numba.config  # a module whose settings come from the environment, unknown to type checkers
    before = config.CACHE_DIR
    config.CACHE_DIR = str(_cache_folder())
    try:
        return cast("Callable[_Params, _Result]", numba.njit(error_model="numpy", cache=True)(function))
    finally:
        config.CACHE_DIR = before


def _cache_folder() -> Path:
    digest = hashlib.sha256()
    for pattern in _SOURCES:
        for path in sorted(_PACKAGE.glob(pattern)):
            digest.update(path.read_bytes())
    name = f"kernel-{digest.hexdigest()[:16]}"
    beside = _PACKAGE / "__pycache__"
    if os.access(beside if beside.exists() else _PACKAGE, os.W_OK):
        return beside / name
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "seedling-transplanter" / name
