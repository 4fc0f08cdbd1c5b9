"""Text of LLVM functions that operate on a device memory in one region."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import reduce
from typing import Final

from controller.core.memory_layout import MemoryLayout

_PREDICATES: Final = {"==": "eq", "!=": "ne", "<": "slt", "<=": "sle", ">": "sgt", ">=": "sge"}
_BIT_RANGE: Final = "!0 = !{i8 0, i8 2}"
"""Values of the byte of a bit: 0 and 1."""
_MEMSET: Final = "declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)"


def name_of(body: str) -> str:
    """Return the name of a function; it is derived from the body, so that functions with equal bodies are equal."""
    return f"f_{hashlib.sha256(body.encode()).hexdigest()[:24]}"


def function(result: str, name: str, parameters: str, body: str) -> str:
    """Return the definition of a function."""
    return f"define {result} @{name}({parameters}) {{\n{body}\n}}\n"


def module(definitions: Iterable[str], declarations: Iterable[str] = ()) -> str:
    """Return the text of a module with these functions."""
    return "\n".join([_MEMSET, _BIT_RANGE, *declarations, *definitions])


class FunctionBody:
    """Builder of the body of one function. Conditions are values of type i1, and words are values of type i64.

    The parameter `%m` of the function is the address of the memory region.

    Attributes:
        block: Label of the basic block to which operations are added.
    """

    def __init__(self, layout: MemoryLayout) -> None:
        self._layout = layout
        self.block = "entry"
        self._lines = [f"{self.block}:"]
        self._values = 0
        self._labels = 0

    @property
    def size(self) -> int:
        """Number of lines."""
        return len(self._lines)

    def text(self) -> str:
        """Return the text of the body."""
        return "\n".join(self._lines)

    def add(self, line: str) -> None:
        """Add a line."""
        self._lines.append(f"  {line}")

    def value(self, operation: str) -> str:
        """Add an operation and return the name of its result."""
        self._values += 1
        self.add(f"%v{self._values} = {operation}")
        return f"%v{self._values}"

    # memory

    def pointer(self, region: str, position: int) -> str:
        """Add the address of a byte of a memory region, which is a parameter of the function."""
        return self.value(f"getelementptr i8, ptr %{region}, i64 {position}")

    def _pointer(self, position: int) -> str:
        return self.pointer("m", position)

    def bit(self, row: str, number: int) -> str:
        """Return the value of a bit."""
        return self._loaded_bit(self._pointer(self._layout.bit(row, number)))

    def set_bit(self, row: str, number: int, value: str) -> None:
        """Set a bit."""
        self._store_bit(self._pointer(self._layout.bit(row, number)), value)

    def _loaded_bit(self, pointer: str) -> str:
        # with the range of the byte, LLVM combines conditions without masking it
        return self.value(f"trunc i8 {self.value(f'load i8, ptr {pointer}, !range !0')} to i1")

    def _store_bit(self, pointer: str, value: str) -> None:
        self.add(f"store i8 {self.value(f'zext i1 {value} to i8')}, ptr {pointer}")

    def clear_bits(self, row: str, first: int, last: int) -> None:
        """Reset the bits `first` to `last` of a row."""
        start = self._pointer(self._layout.bit(row, first))
        self.add(f"call void @llvm.memset.p0.i64(ptr {start}, i8 0, i64 {last + 1 - first}, i1 false)")

    def word(self, row: str, number: int) -> str:
        """Return the value of a word."""
        return self.value(f"load i64, ptr {self._pointer(self._layout.word(row, number))}")

    def set_word(self, row: str, number: int, value: str | int) -> None:
        """Set a word."""
        self.add(f"store i64 {value}, ptr {self._pointer(self._layout.word(row, number))}")

    # operations

    def inverse(self, value: str) -> str:
        """Return the inverse of a condition."""
        return self.value(f"xor i1 {value}, true")

    def all_of(self, values: Iterable[str]) -> str:
        """Return a condition that is true if all conditions are true."""
        return reduce(lambda a, b: self.value(f"and i1 {a}, {b}"), values)

    def any_of(self, values: Iterable[str]) -> str:
        """Return a condition that is true if at least one condition is true."""
        return reduce(lambda a, b: self.value(f"or i1 {a}, {b}"), values)

    def compare(self, relation: str, left: str | int, right: str | int) -> str:
        """Return the result of a comparison of two words."""
        return self.value(f"icmp {_PREDICATES[relation]} i64 {left}, {right}")

    def choice(self, condition: str, one: str | int, other: str | int) -> str:
        """Return one of two words."""
        return self.value(f"select i1 {condition}, i64 {one}, i64 {other}")

    def sum(self, one: str, other: str | int) -> str:
        """Return the sum of two words."""
        return self.value(f"add i64 {one}, {other}")

    # control flow

    @contextmanager
    def on(self, condition: str) -> Iterator[None]:
        """Execute the operations added in the `with` block only if the condition is true."""
        inside, after = self._label(), self._label()
        self.add(f"br i1 {condition}, label %{inside}, label %{after}")
        self._begin(inside)
        yield
        self.add(f"br label %{after}")
        self._begin(after)

    def _label(self) -> str:
        self._labels += 1
        return f"l{self._labels}"

    def _begin(self, label: str) -> None:
        """Begin a basic block; the lines added next belong to it."""
        self.block = label
        self._lines.append(f"{label}:")
