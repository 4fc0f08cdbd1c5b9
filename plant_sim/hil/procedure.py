"""Procedures of the bench: generators that wait for conditions in plant time.

A procedure yields a `Wait` and is resumed with True once its condition holds, or with False at its deadline. Procedures
run in the observer of the I/O module, so they need no thread and see every advance of plant time, in real time and in
lock step.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass

Condition = Callable[[], bool]


@dataclass(frozen=True, slots=True)
class Wait:
    """Condition with a deadline.

    Attributes:
        condition: Function that returns True to resume the procedure.
        until_ms: Plant time at which the procedure is resumed anyway, ms.
    """

    condition: Condition
    until_ms: int


Procedure = Generator[Wait, bool, None]


class CaseError(Exception):
    """Failure of a case; the message is one line."""


class NotRunError(Exception):
    """A case that cannot be judged on this machine; the message is one line."""
