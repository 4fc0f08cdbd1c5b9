"""Programs as machine code: compilation by LLVM, a cache of the object files, and execution of a scan.

The object file of a block is reused until a rung of the block changes. The package `llvmlite` is the only compiler
required.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Final, cast

import llvmlite
from llvmlite import binding as llvm

from controller.common.cache_folder import user_cache_folder
from controller.core.devices import Memory
from controller.core.expr import Expr
from controller.core.llvm_ir import LlvmProgram, translate, translate_condition
from controller.core.memory_layout import MemoryLayout
from controller.core.program import Program
from controller.core.rungs import Pulse, PulseFalling

OPTIMISATION_LEVEL: Final = 2
_UNUSED_S: Final = 30 * 86_400.0


class _Bits(ctypes.Array):  # type: ignore[type-arg]
    """Row of bits in the memory region; it has the list methods that are called on the lists of a `Memory`."""

    _type_ = ctypes.c_bool
    _length_ = 0

    def copy(self) -> list[bool]:
        return cast("list[bool]", memoryview(self).cast("B").cast("?").tolist())

    def index(self, value: bool, start: int = 0) -> int:
        return start + cast("list[bool]", self[start:]).index(value)


class _Words(ctypes.Array):  # type: ignore[type-arg]
    """Row of words in the memory region."""

    _type_ = ctypes.c_int64
    _length_ = 0

    def copy(self) -> list[int]:
        return memoryview(self).cast("B").cast("q").tolist()


class MachineCode:
    """Machine code of a program.

    Attributes:
        program: Program that was compiled.
        layout: Arrangement of its device memory.
        address: Address of the scan function.
        scan: The scan function.
    """

    def __init__(self, program: Program) -> None:
        """Load the machine code of a program, compiling the blocks that are not in the cache."""
        self.program = program
        self.layout = MemoryLayout(sum(isinstance(rung, Pulse | PulseFalling) for rung in program.rungs()))
        self._function = _Function(translate(program, self.layout))
        self.address = self._function.address
        self.scan = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)(self.address)


class MachineCondition:
    """Machine code of a condition over the devices of a program.

    Attributes:
        address: Address of the function; see `translate_condition`.
        holds: The function.
    """

    def __init__(self, expr: Expr, layout: MemoryLayout) -> None:
        """Load the machine code of a condition, compiling it if it is not in the cache."""
        self._function = _Function(translate_condition(expr, layout))
        self.address = self._function.address
        self.holds = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 3)(self.address)


class _Function:
    """Loaded machine code of translated modules; it is unloaded with this object.

    Attributes:
        address: Address of the entry function.
    """

    def __init__(self, translation: LlvmProgram) -> None:
        # An engine requires an initial module and owns its target machine. The functions are loaded from object files.
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target_machine())
        for text in translation.modules:
            self._engine.add_object_file(llvm.ObjectFileRef.from_data(_object_code(text)))
        self._engine.finalize_object()
        self.address: int = self._engine.get_function_address(translation.entry)


@lru_cache(maxsize=16)
def machine_code_of(program: Program) -> MachineCode:
    """Return the machine code of a program; all PLCs with the same program share it."""
    return MachineCode(program)


@lru_cache(maxsize=256)
def machine_condition_of(condition: Expr, layout: MemoryLayout) -> MachineCondition:
    """Return the machine code of a condition; all PLCs with the same arrangement of their memory share it."""
    return MachineCondition(condition, layout)


class MachineExecution:
    """Execution of a program as machine code on its own device memory.

    Attributes:
        memory: Device memory; its rows are views of one region.
        code: Machine code of the program.
        layout: Arrangement of the region.
        region_address: Address of the region.
        scan_address: Address of the scan function.
    """

    def __init__(self, program: Program) -> None:
        """Create the memory of a PLC and load the machine code of its program."""
        self.code = machine_code_of(program)
        self.layout = layout = self.code.layout
        self._region = (ctypes.c_char * layout.size)()
        rows: dict[str, Any] = {}
        for kind, table in ((_Bits, layout.bits), (_Words, layout.words)):
            for name, (offset, length) in table.items():
                rows[name] = _row_type(kind, length).from_buffer(self._region, offset)
        del rows["L"]
        self.memory = Memory(**rows)
        self.memory.TS[:] = [-1] * len(self.memory.TS)
        self.region_address = ctypes.addressof(self._region)
        self.scan_address = self.code.address

    @property
    def region(self) -> memoryview:
        """Device memory as bytes, arranged as in `layout`; writable."""
        return memoryview(self._region).cast("B")

    def run(self, now_ms: int, *, first: bool) -> None:
        """Execute all blocks and the END processing with the latched inputs."""
        self.code.scan(self.region_address, now_ms, first)

    def save(self) -> bytes:
        """Return a copy of all devices."""
        return bytes(self._region)

    def restore(self, saved: bytes) -> None:
        """Restore a copy returned by `save`."""
        ctypes.memmove(self._region, saved, len(saved))

    def image_of(self, spans: Iterable[tuple[str, slice]]) -> Callable[[], object]:
        """Return a function that copies spans of the memory for comparison."""
        views: list[memoryview] = []
        for row, span in spans:
            bytes_each = ctypes.sizeof(getattr(self.memory, row)) // len(getattr(self.memory, row))
            view = memoryview(getattr(self.memory, row)).cast("B")
            views.append(view[span.start * bytes_each : span.stop * bytes_each])
        return lambda: b"".join(views)


@cache
def _row_type(kind: type[_Bits | _Words], length: int) -> Any:
    return type(kind.__name__, (kind,), {"_type_": kind._type_, "_length_": length})


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
        folder = user_cache_folder() / f"program-{hashlib.sha256(version.encode()).hexdigest()[:16]}"
        folder.mkdir(parents=True, exist_ok=True)
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
