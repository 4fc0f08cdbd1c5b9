"""C program made from an instruction list, for comparison with the FX2N engine; gcc compiles it if installed."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from controller.core.devices import SIZES
from controller.fx.language.instruction import DeviceOperand, Instruction, Ladder

_STATEMENTS: Final = {
    "LD": "p = {};",
    "LDI": "p = !{};",
    "AND": "p &= {};",
    "ANI": "p &= !{};",
    "OR": "p |= {};",
    "ORI": "p |= !{};",
    "OUT": "{} = p;",
}


class CProgram:
    """Compiled C program.

    Attributes:
        scan: Function that executes the program; its arguments, an address and the time in ms, are not used.
        call: Function with the same arguments that does nothing.
    """

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library
        self.scan: Callable[[int, int], int] = self._function("scan")
        self.call: Callable[[int, int], int] = self._function("call")

    def bits(self, kind: str) -> Any:
        """Return the X, Y or M devices, one byte each."""
        return (ctypes.c_ubyte * SIZES[kind]).in_dll(self._library, kind)

    def _function(self, name: str) -> Any:
        function = getattr(self._library, name)
        function.argtypes, function.restype = (ctypes.c_void_p, ctypes.c_int64), ctypes.c_int64
        return function


def c_text(ladder: Ladder) -> str:
    """Return the C text of a list of contacts and coils without blocks."""
    arrays = "".join(f"unsigned char {kind}[{SIZES[kind]}];\n" for kind in "XYM")
    body = "".join(f"    {_statement(instruction)}\n" for instruction in ladder.instructions[:-1])
    function = "long long {}(void *memory, long long now_ms) {{\n{}    return 0;\n}}\n"
    return arrays + function.format("scan", f"    unsigned char p;\n{body}") + function.format("call", "")


def _statement(instruction: Instruction) -> str:
    (device,) = instruction.operands
    assert isinstance(device, DeviceOperand)  # noqa: S101 - the list contains contacts and coils only
    return _STATEMENTS[instruction.name].format(f"{device.kind}[{device.number}]")


def compiled_c(ladder: Ladder) -> CProgram | None:
    """Return the C program of a list compiled with ``gcc -O2``, or None if gcc is not installed."""
    gcc = shutil.which("gcc")
    if gcc is None:
        return None
    with TemporaryDirectory() as folder:
        source, library = Path(folder, "program.c"), Path(folder, "program.so")
        source.write_text(c_text(ladder), encoding="utf-8")
        subprocess.run([gcc, "-O2", "-shared", "-fPIC", "-o", library, source], check=True)  # noqa: S603 - our text
        return CProgram(ctypes.CDLL(str(library)))
