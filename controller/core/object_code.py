"""Machine code of LLVM modules: compilation, a cache of the object files, and loading.

The object file of a module is reused as long as its text does not change and no other user can have written it. The
package `llvmlite` is the only compiler required.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final, cast

import llvmlite
from llvmlite import binding as llvm

from controller.common.files.cache_folder import user_cache_folder
from controller.common.files.trust import trusted_folder

OPTIMISATION_LEVEL: Final = 2
_UNUSED_S: Final = 30 * 86_400.0


class LoadedModules:
    """Machine code of several modules in this process."""

    def __init__(self, texts: Iterable[str]) -> None:
        """Load the machine code of the modules, compiling those that are not in the cache."""
        # An engine requires an initial module and owns its target machine. The functions are loaded from object files.
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target_machine())
        for text in texts:
            self._engine.add_object_file(llvm.ObjectFileRef.from_data(_object_code(text)))
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Return the address of a function, which is valid as long as this object exists."""
        return int(self._engine.get_function_address(name))

    def function(self, name: str, result: Any, *arguments: Any) -> Any:
        """Return a function, given its result type and argument types; it is valid as long as this object exists."""
        return ctypes.CFUNCTYPE(result, *arguments)(self.address(name))


def _target_machine() -> llvm.TargetMachine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=_features(), opt=OPTIMISATION_LEVEL, codemodel="jitdefault", jit=True
    )


def _features() -> str:
    with suppress(RuntimeError):
        return str(llvm.get_host_cpu_features().flatten())
    return ""


def _object_code(text: str) -> bytes:
    """Return the object file of a module, from the cache if possible."""
    path = _cached(text)
    if path is not None:
        with suppress(OSError):
            checksum, code = _split(path.read_bytes())
            if checksum == _checksum(code):
                os.utime(path)  # the modification time records the last use
                return code
    code = _compile(text)
    if path is not None:
        with suppress(OSError):
            _store(path, code)
    return code


def _checksum(code: bytes) -> bytes:
    return hashlib.sha256(code).digest()


def _split(content: bytes) -> tuple[bytes, bytes]:
    """Return the checksum and the object code in a cached file; running damaged object code would crash the process."""
    size = hashlib.sha256().digest_size
    return content[:size], content[size:]


def _compile(text: str) -> bytes:
    target = _target_machine()
    module = llvm.parse_assembly(text)
    module.triple = target.triple
    options = llvm.create_pipeline_tuning_options(speed_level=OPTIMISATION_LEVEL)
    builder = llvm.create_pass_builder(target, options)
    builder.getModulePassManager().run(module, builder)
    return cast("bytes", target.emit_object(module))


def _cached(text: str) -> Path | None:
    """Return the path of the cached object file of a module; None if there is no cache folder."""
    folder = _folder()
    return None if folder is None else folder / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.o"


@cache
def _folder() -> Path | None:
    """Return the writable cache folder for this processor and this LLVM version, or None."""
    version = f"{llvmlite.__version__} {llvm.llvm_version_info} {llvm.get_host_cpu_name()} {_features()}"
    version += f" {OPTIMISATION_LEVEL}"
    try:
        folder = trusted_folder(user_cache_folder(), f"program-{hashlib.sha256(version.encode()).hexdigest()[:16]}")
        _delete_unused(folder)
    except (OSError, RuntimeError):
        return None
    return folder if os.access(folder, os.W_OK) else None


def _delete_unused(folder: Path) -> None:
    """Delete the object files that were last used 30 days or more before the most recently used one."""
    used_s = {path: path.stat().st_mtime for path in folder.iterdir()}
    for path, at_s in used_s.items():
        if max(used_s.values()) - at_s >= _UNUSED_S:
            path.unlink(missing_ok=True)


def _store(path: Path, code: bytes) -> None:
    """Write an object file atomically: other processes see either the complete file or none."""
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(_checksum(code) + code)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
