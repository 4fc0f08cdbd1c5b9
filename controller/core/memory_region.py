"""Device memory in one region, for programs executed as machine code."""

from __future__ import annotations

import ctypes
from dataclasses import fields
from functools import cache
from typing import Any, Self, cast

from controller.core.devices import Memory
from controller.core.memory_layout import MemoryLayout


class _Bits(ctypes.Array):  # type: ignore[type-arg]
    """Row of bits in the memory region; it has the list methods that are called on the lists of a `Memory`."""

    _type_ = ctypes.c_bool
    _length_ = 0

    def __copy__(self) -> Self:
        return type(self).from_buffer_copy(self)

    def copy(self) -> list[bool]:
        return cast("list[bool]", memoryview(self).cast("B").cast("?").tolist())

    def index(self, value: bool, start: int = 0) -> int:
        return start + cast("list[bool]", self[start:]).index(value)


class _Words(ctypes.Array):  # type: ignore[type-arg]
    """Row of words in the memory region."""

    _type_ = ctypes.c_int64
    _length_ = 0

    def __copy__(self) -> Self:
        return type(self).from_buffer_copy(self)

    def copy(self) -> list[int]:
        return memoryview(self).cast("B").cast("q").tolist()


class MemoryRegion:
    """Region with the device memory of one PLC.

    Attributes:
        data: The region.
        rows: Rows of the layout as views of the region, by name.
        memory: Device memory of the rows; all timers are stopped.
        address: Address of the region.
    """

    def __init__(self, layout: MemoryLayout) -> None:
        self.data = (ctypes.c_char * layout.size)()
        self.rows: dict[str, Any] = {}
        for kind, table in ((_Bits, layout.bits), (_Words, layout.words)):
            for name, (offset, length) in table.items():
                self.rows[name] = _row_type(kind, length).from_buffer(self.data, offset)
        self.memory = Memory(**{field.name: self.rows[field.name] for field in fields(Memory)})
        self.memory.TS[:] = [-1] * len(self.memory.TS)
        self.address = ctypes.addressof(self.data)


@cache
def _row_type(kind: type[_Bits | _Words], length: int) -> Any:
    return type(kind.__name__, (kind,), {"_type_": kind._type_, "_length_": length})
