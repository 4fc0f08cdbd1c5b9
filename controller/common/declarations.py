"""Declarations that depend on each other: tables that report a missing entry, and the line of a faulty declaration."""

from __future__ import annotations

import traceback
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final, TypeVar

from controller.common.errors import InputError

_K = TypeVar("_K")
_V = TypeVar("_V")

_ROOT: Final = Path(__file__).parents[2]
_MEANS_OF_DECLARING: Final = tuple(_ROOT / "controller" / package for package in ("common", "core"))
"""Folders whose functions check declarations and contain none."""


class DeclarationError(InputError):
    """Raised for a declaration of the program that is missing, or that contradicts another one.

    The message is one line that names what is missing and where. `declared_at` returns the line of the declaration.
    """


class Declared(dict[_K, _V]):
    """Table of declarations in which an unknown key is reported with the name and the file of the table."""

    def __init__(self, name: str, module: str, rows: Mapping[_K, _V]) -> None:
        """Create the table.

        Args:
            name: Name of the declaration to which an entry must be added.
            module: Name of its module.
            rows: Entries.
        """
        super().__init__(rows)
        self._place = f"{name} ({module.replace('.', '/')}.py)"

    def __missing__(self, key: _K) -> _V:
        raise DeclarationError(f"{_shown(key)} is missing in {self._place}; add it there")

    def require(self, keys: Iterable[_K]) -> None:
        """Raise DeclarationError unless the table contains all of these keys."""
        for key in keys:
            if key not in self:
                self.__missing__(key)


def declared_at(error: DeclarationError) -> str:
    """Return the file and the line of the declaration that raised an error, or "" if no declaration did.

    The line is the innermost one outside the functions that check declarations: those of `controller.common` and
    `controller.core`, and each function with a local variable ``__tracebackhide__``.
    """
    lines = [
        f"{Path(frame.f_code.co_filename).relative_to(_ROOT).as_posix()}:{line}"
        for frame, line in traceback.walk_tb(error.__traceback__)
        if _declares(Path(frame.f_code.co_filename)) and "__tracebackhide__" not in frame.f_locals
    ]
    return lines[-1] if lines else ""


def _declares(file: Path) -> bool:
    return file.is_relative_to(_ROOT) and not any(file.is_relative_to(folder) for folder in _MEANS_OF_DECLARING)


def _shown(key: object) -> str:
    name = getattr(key, "name", "")
    return f"{key} {name}" if name else repr(key)
