"""Objects whose changing attributes can be saved and restored, in memory."""

from __future__ import annotations

from collections import deque
from operator import attrgetter
from typing import Any, ClassVar, Final

_CONTAINERS: Final = frozenset({list, dict, set, deque})


class Saved:
    """Base class of objects whose state can be saved and restored.

    A subclass lists its changing attributes. Their values are immutable, or containers of immutable values; containers
    are copied. A class with parts of its own extends both methods.
    """

    __slots__ = ()

    SAVED: ClassVar[tuple[str, ...]] = ()
    """Names of the changing attributes."""

    _values: ClassVar[Any]

    def __init_subclass__(cls) -> None:
        """Prepare the access to the attributes."""
        read = attrgetter(*cls.SAVED)
        cls._values = staticmethod(read if len(cls.SAVED) > 1 else lambda each: (read(each),))

    def save(self) -> Any:
        """Return the current state; later changes of the object do not affect it."""
        return [value.copy() if value.__class__ in _CONTAINERS else value for value in self._values(self)]

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`; it can be restored several times."""
        for name, value in zip(self.SAVED, saved, strict=True):
            setattr(self, name, value.copy() if value.__class__ in _CONTAINERS else value)
