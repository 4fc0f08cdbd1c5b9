"""Measured values of a case."""

from __future__ import annotations

from typing import NamedTuple


class Figure(NamedTuple):
    """Measured value with its unit.

    Attributes:
        value: Value.
        unit: Unit; empty for a number of items.
    """

    value: float
    unit: str = ""

    @property
    def text(self) -> str:
        """Value and unit."""
        return f"{self.value:g} {self.unit}".rstrip()
