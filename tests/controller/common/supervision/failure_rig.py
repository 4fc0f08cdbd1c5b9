"""Exceptions that no thread or task expects, raised at moments that are drawn."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest

from controller.common.supervision import failures


class DefectError(Exception):
    """Exception that no thread and no task expects."""


class FailsOnce:
    """Wrapper of a function that raises an exception instead of one of its calls.

    Attributes:
        calls: Number of calls.
    """

    def __init__(self, function: Callable[..., Any], call: int, error: type[Exception] = DefectError) -> None:
        self.calls = 0
        self._function, self._call, self._error = function, call, error

    def __call__(self, *args: Any, **named: Any) -> Any:
        self.calls += 1
        if self.calls == self._call + 1:
            raise self._error
        return self._function(*args, **named)


def patch(monkeypatch: pytest.MonkeyPatch, owner: type, name: str, call: int) -> FailsOnce:
    """Let one call of a method fail, counted over all objects of the class; return the wrapper."""
    failing = FailsOnce(getattr(owner, name), call)

    def method(*args: Any, **named: Any) -> Any:  # a function, which is bound to its object
        return failing(*args, **named)

    monkeypatch.setattr(owner, name, method)
    return failing


def drawn(name: str, below: int, count: int = 2) -> list[int]:
    """Return different numbers of calls before the one that fails, the same in every run."""
    return random.Random(name).sample(range(below), count)


def fresh_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the counts of this process begin at 0."""
    monkeypatch.setattr(failures, "_failures", Counter())
    monkeypatch.setattr(failures, "_dropped", Counter())
