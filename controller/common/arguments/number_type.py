"""Numbers on the command line: one statement of the range for the help text and for the check."""

from __future__ import annotations

import argparse
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class NumberType:
    """Type of an option whose value is a number within a range, including both ends.

    Attributes:
        kind: Type of the value.
        least: Smallest value.
        most: Largest value; None = no limit.
        also: Further permitted value, beyond the range.
    """

    kind: type[int] | type[float]
    least: float
    most: float | None = None
    also: int | None = None

    def __call__(self, text: str) -> float:
        """Return the number.

        Raises:
            ArgumentTypeError: The text is not a number of this kind, or the number is out of range.
        """
        try:
            value = self.kind(text)
        except ValueError:
            noun = "a whole number" if self.kind is int else "a number"
            raise argparse.ArgumentTypeError(f"must be {noun}, {self.range}") from None
        # The limits refuse "nan" as well.
        if not (self.least <= value <= (float("inf") if self.most is None else self.most) or value == self.also):
            raise argparse.ArgumentTypeError(f"must be {self.range}")
        return value

    @property
    def range(self) -> str:
        """Range in words.

        >>> integer(1, 100).range, integer(0).range, integer(0, 5000, also=65535).range
        ('1 to 100', '0 or more', '0 to 5000, or 65535')
        """
        if self.most is None:
            return f"{self.least:.10g} or more"
        further = "" if self.also is None else f", or {self.also}"
        return f"{self.least:.10g} to {self.most:.10g}{further}"


def integer(least: int, most: int | None = None, *, also: int | None = None) -> NumberType:
    """Return the type of an option whose value is a whole number."""
    return NumberType(int, least, most, also)


def number(least: float, most: float | None = None) -> NumberType:
    """Return the type of an option whose value is a number."""
    return NumberType(float, least, most)


PORT = integer(0, 65_535)
"""TCP port to listen on; 0 = any free port."""
REMOTE_PORT = integer(1, 65_535)
"""TCP port to connect to."""
