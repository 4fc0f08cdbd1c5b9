"""Checked access to the arguments of a request."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from controller.common.errors import InputError

_LARGEST: Final = 2**31 - 1
_LONGEST: Final = 10_000


class Arguments:
    """Arguments of a request, or an object within them."""

    def __init__(self, values: Mapping[str, Any], where: str) -> None:
        """Take an object.

        Args:
            values: The object.
            where: Its name for messages.
        """
        self._values, self._where = values, where

    def __contains__(self, key: str) -> bool:
        return self._values.get(key) is not None

    def integer(self, key: str, default: int | None = None) -> int:
        """Return a whole number from 0.

        Raises:
            InputError: It has another type, or is missing and has no default.
        """
        value = self._values.get(key)
        if value is None and default is not None:
            return default
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= _LARGEST:
            raise self._error(key, "a whole number from 0")
        return value

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text; the same errors as `integer`."""
        value = self._values.get(key)
        if value is None and default is not None:
            return default
        if not isinstance(value, str) or len(value) > _LONGEST:
            raise self._error(key, "a text")
        return value

    def flag(self, key: str, *, default: bool) -> bool:
        """Return true or false; the same errors as `integer`."""
        value = self._values.get(key)
        if value is None:
            return default
        if not isinstance(value, bool):
            raise self._error(key, "true or false")
        return value

    def inner(self, key: str) -> Arguments:
        """Return an object; the same errors as `integer`."""
        value = self._values.get(key)
        if not isinstance(value, dict):
            raise self._error(key, "an object")
        return Arguments(value, f"{self._where}.{key}")

    def items(self, key: str) -> list[Arguments]:
        """Return a list of objects, which may be missing; the same errors as `integer`."""
        value = self._values.get(key, [])
        if not isinstance(value, list) or not all(isinstance(each, dict) for each in value):
            raise self._error(key, "a list of objects")
        return [Arguments(each, f"{self._where}.{key}[{n}]") for n, each in enumerate(value)]

    def _error(self, key: str, wanted: str) -> InputError:
        return InputError(f"{self._where}.{key}: write {wanted}")
