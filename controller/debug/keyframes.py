"""Complete states at intervals, each stored as its difference from the first one of its group."""

from __future__ import annotations

import marshal
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

GROUP: Final = 64
"""Number of states that share a complete one; a longer group has larger differences."""
_BLOCK: Final = 4_096
_PAGE: Final = 64
_SEQUENCES: Final = frozenset({tuple, list})
_PLAIN: Final = frozenset({int, bool, str})
_LONGEST: Final = 64
"""Longest sequence whose items are packed one by one; a longer one consists of many small values."""
_BUILT_IN: Final = 2  # version of the marshal format, in which equal values have equal bytes


@dataclass(frozen=True, slots=True)
class _Pages:
    """Bytes that differ from others in some pages.

    Attributes:
        base: The other bytes.
        pages: Differing pages by position.
    """

    base: bytes
    pages: dict[int, bytes]


@dataclass(frozen=True, slots=True)
class _Items:
    """Sequence of which some items are packed."""

    kind: type
    items: tuple[Any, ...]


class Packer:
    """Packing of the states of one machine; what has not changed is stored once."""

    def __init__(self) -> None:
        self._base: Any = None
        self._count = 0

    def pack(self, state: Any) -> Any:
        """Return a state in its packed form, which shares all that is equal in the first state of the group."""
        if self._count % GROUP == 0:
            self._base = state
        self._count += 1
        return _packed(state, self._base)


def unpack(packed: Any) -> Any:
    """Return the state in a packed form."""
    if type(packed) is _Pages:
        data = bytearray(packed.base)
        for at, page in packed.pages.items():
            data[at : at + len(page)] = page
        return bytes(data)
    if type(packed) is _Items:
        return packed.kind(map(unpack, packed.items))
    return packed


def _packed(value: Any, base: Any) -> Any:
    if value is base or type(value) is not type(base):
        return value
    if type(value) is bytes and len(value) == len(base):
        return base if value == base else _Pages(base, dict(_pages(value, base)))
    if type(value) in _PLAIN:
        return base if value == base else value
    if type(value) in _SEQUENCES and len(value) == len(base) <= _LONGEST:
        items = tuple(map(_packed, value, base))
        if all(map(_is, items, base)):
            return base
        is_plain = all(map(_is, items, value))
        return value if is_plain else _Items(type(value), items)
    return base if _are_equal(value, base) else value


def _is(one: object, other: object) -> bool:
    return one is other


def _pages(value: bytes, base: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the position and the contents of each page that differs."""
    for block in range(0, len(value), _BLOCK):
        if value[block : block + _BLOCK] != base[block : block + _BLOCK]:
            for at in range(block, min(block + _BLOCK, len(value)), _PAGE):
                page = value[at : at + _PAGE]
                if page != base[at : at + _PAGE]:
                    yield at, page


def _are_equal(value: Any, base: Any) -> bool:
    """Return True if two values are the same in type and bit for bit."""
    try:
        return marshal.dumps(value, _BUILT_IN) == marshal.dumps(base, _BUILT_IN)
    except ValueError:  # an object that is not built in
        return False
