"""State of the objects that can be reached from one object: attributes, containers, variables of inner functions.

The state is found by following the references, so that a function need not list the variables in which it stores
something between two calls. Frozen data classes and what they refer to have no state.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable
from dataclasses import is_dataclass
from enum import Enum
from types import CellType, FunctionType, MethodType
from typing import Any, Final

_EMPTY: Final = object()


class ObjectState:
    """State of all objects that can be reached from one object, at one time."""

    __slots__ = ("_contents",)

    def __init__(self, root: object, modules: tuple[str, ...], stateless: Collection[str] = ()) -> None:
        """Save the state.

        Args:
            root: The object.
            modules: Beginnings of the names of the modules whose objects can have state.
            stateless: Names of their classes whose objects have none, or one that is saved in another way.
        """
        self._contents: list[tuple[Any, Any]] = []
        seen: set[int] = set()
        waiting: list[Any] = [root]
        while waiting:
            each = waiting.pop()
            if id(each) in seen or isinstance(each, str | bytes | int | float | type(None) | type | Enum):
                continue
            seen.add(id(each))
            contents = _contents_of(each, modules, stateless)
            if contents is not _EMPTY:
                self._contents.append((each, contents))
            waiting.extend(_references(each, contents))

    def restore(self) -> None:
        """Restore the state of the objects; their identities do not change."""
        for each, contents in self._contents:
            match each:
                case list():
                    each[:] = contents
                case dict() | set():
                    each.clear()
                    each.update(contents)
                case deque():
                    each.clear()
                    each.extend(contents)
                case CellType():
                    each.cell_contents = contents
                case _:
                    for name, value in contents.items():
                        setattr(each, name, value)


def _contents_of(each: Any, modules: tuple[str, ...], stateless: Collection[str]) -> Any:
    """Return a copy of what can change in an object; `_EMPTY` = nothing."""
    match each:
        case list() | dict() | set() | deque():
            return each.copy()
        case CellType():
            try:
                return each.cell_contents
            except ValueError:  # a variable without a value
                return _EMPTY
    kind = type(each)
    if not kind.__module__.startswith(modules) or kind.__name__ in stateless:
        return _EMPTY
    if is_dataclass(kind) and kind.__dataclass_params__.frozen:  # type: ignore[attr-defined] # of every data class
        return _EMPTY
    if hasattr(each, "__dict__"):
        return each.__dict__.copy()
    return {name: getattr(each, name) for name in getattr(kind, "__slots__", ())}


def _references(each: Any, contents: Any) -> Iterable[Any]:
    """Return what an object refers to and may have state."""
    match each:
        case FunctionType():
            return each.__closure__ or ()
        case MethodType():
            return (each.__self__, each.__func__)
        case tuple() | list() | set() | deque():
            return () if not each or isinstance(next(iter(each)), bool | int) else each
        case dict():
            return each.values()
        case CellType():
            return () if contents is _EMPTY else (contents,)
    if type(each).__name__ == "builtin_function_or_method":
        return (each.__self__,)
    return () if contents is _EMPTY else contents.values()
