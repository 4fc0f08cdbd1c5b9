"""Parsing of quantities with units, such as "5 mm", "0.35 MPa", "2 s" and "30 %", and of bounds."""

import math
import re
from collections.abc import Callable
from typing import NamedTuple

_SPELLINGS: dict[str, dict[str, float]] = {
    "-": {"-": 1.0, "%": 0.01},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0, "d": 86400.0},
    "Pa": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "mbar": 1e2, "bar": 1e5},
    "N": {"N": 1.0, "kN": 1e3},
    "kg": {"kg": 1.0, "g": 1e-3},
    "V": {"V": 1.0},
    "ohm": {"ohm": 1.0},
    "deg": {"deg": 1.0, "rad": 180.0 / math.pi},
    "m3": {"m3": 1.0, "L": 1e-3, "dm3": 1e-3, "mL": 1e-6, "cm3": 1e-6},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "km/h": 1 / 3.6},
    "m/s2": {"m/s2": 1.0, "mm/s2": 1e-3},
    "m3/s": {"m3/s": 1.0, "L/s": 1e-3, "L/min": 1e-3 / 60.0},
    "m3/(s Pa)": {"m3/(s Pa)": 1.0, "dm3/(s bar)": 1e-8, "L/(s bar)": 1e-8},
    "1/s": {"1/s": 1.0, "/s": 1.0, "1/min": 1.0 / 60.0, "/min": 1.0 / 60.0},
    "N m": {"N m": 1.0},
    "N/m": {"N/m": 1.0, "N/mm": 1e3},
    "N s/m": {"N s/m": 1.0},
    "V s/m": {"V s/m": 1.0},
    "N m/Pa": {"N m/Pa": 1.0},
    "kg m2": {"kg m2": 1.0},
    "W/(m2 K)": {"W/(m2 K)": 1.0},
    "mm/d": {"mm/d": 1.0, "cm/d": 10.0},
    "cells": {"cells": 1.0, "cell": 1.0, "%": 0.72},  # percentage of a tray with 72 cells
}
"""Accepted unit spellings and their factors to the SI unit, by SI unit."""

_ENDINGS = {
    "_m3_s_pa": "m3/(s Pa)",
    "_w_m2_k": "W/(m2 K)",
    "_per_min": "1/min",
    "_nm_pa": "N m/Pa",
    "_n_s_m": "N s/m",
    "_v_s_m": "V s/m",
    "_kg_m2": "kg m2",
    "_mm_d": "mm/d",
    "_m3_s": "m3/s",
    "_m_s2": "m/s2",
    "_ohm": "ohm",
    "_m_s": "m/s",
    "_n_m": "N/m",
    "_deg": "deg",
    "_mpa": "MPa",
    "_nm": "N m",
    "_m3": "m3",
    "_kg": "kg",
    "_pa": "Pa",
    "_ms": "ms",
    "_mm": "mm",
    "_m": "m",
    "_n": "N",
    "_s": "s",
    "_v": "V",
    "_d": "d",
}
"""Unit of a parameter by name suffix, longest suffix first."""

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")


class QuantityError(ValueError):
    """Quantity that cannot be parsed; the one-line message states the input, the problem and the remedy."""


class Bounds(NamedTuple):
    """Closed interval.

    Attributes:
        low: Lower end; minus infinity if unbounded.
        high: Upper end; infinity if unbounded.
        text: Text from which the bounds were parsed.
    """

    low: float
    high: float
    text: str

    def hold(self, value: float) -> bool:
        """Return True if a value is within the bounds."""
        return self.low <= value <= self.high


def unit_of(name: str) -> str:
    """Return the unit given by the suffix of a parameter name; ``-`` if it has none.

    >>> unit_of("throttle_conductance_m3_s_pa"), unit_of("critical_ratio")
    ('m3/(s Pa)', '-')
    """
    return next((unit for ending, unit in _ENDINGS.items() if name.endswith(ending)), "-")


def parse_quantity(text: str, unit: str) -> float:
    """Parse a quantity and return its value.

    Args:
        text: A number with its unit; a number without a unit is in `unit`.
        unit: Unit of the result, for example ``Pa``; the text may use any unit of the same quantity.

    Raises:
        QuantityError: The text is not a number, or its unit is unknown or belongs to another quantity.

    >>> parse_quantity("0.35 MPa", "Pa"), parse_quantity("30%", "-"), parse_quantity("2", "s")
    (350000.0, 0.3, 2.0)
    """
    spellings, per_unit = _kind_of(unit)
    value, written = _split(text)
    if not written:
        return value
    factors = {_tight(spelling): factor for spelling, factor in spellings.items()}
    factor = factors.get(_tight(written))
    if factor is None:
        known = any(_tight(written) in map(_tight, kind) for kind in _SPELLINGS.values())
        wrong = f"{written} is a unit of another quantity" if known else f"unknown unit {written}"
        raise QuantityError(f"{text!r}: {wrong}; use {' or '.join(spellings)}")
    ratio = factor / per_unit
    # a division by an integer rounds once; a product with its inexact inverse rounds twice
    return value * ratio if ratio >= 1.0 else value / (per_unit / factor)


def parse_ms(text: str) -> int:
    """Parse a time and return it as an integer number of milliseconds; the unit is required except for 0.

    Raises:
        QuantityError: The text is not a time, is negative, has no unit or is not an integer number of milliseconds.

    >>> parse_ms("1.5 s"), parse_ms("0")
    (1500, 0)
    """
    value, written = _split(text)
    if value and not written:
        raise QuantityError(f"{text!r}: a time requires a unit; write {text.strip()} s or {text.strip()} ms")
    exact_ms = parse_quantity(text, "ms")
    time_ms = round(exact_ms)
    if abs(exact_ms - time_ms) > 1e-6 or time_ms < 0:
        raise QuantityError(f"{text!r}: must be a whole number of milliseconds, 0 or more")
    return time_ms


def parse_bounds(text: str, unit: str) -> Bounds:
    """Parse bounds written as ``>= a``, ``<= b``, ``a..b`` or a single value.

    Args:
        text: The bounds; each end may have a different unit.
        unit: Unit of the result; ``ms`` requires a unit at each end.

    Raises:
        QuantityError: An end cannot be parsed, or the lower end is above the upper end.

    >>> parse_bounds("20 mm..0.1 m", "m")[:2], parse_bounds("<= 3", "-").hold(4)
    ((0.02, 0.1), False)
    """
    read: Callable[[str], float] = parse_ms if unit == "ms" else lambda end: parse_quantity(end, unit)
    text = text.strip()
    if text.startswith(">="):
        return Bounds(read(text[2:]), math.inf, text)
    if text.startswith("<="):
        return Bounds(-math.inf, read(text[2:]), text)
    first, dots, last = text.partition("..")
    low = read(first)
    high = read(last) if dots else low
    if low > high:
        raise QuantityError(
            f"{text!r}: the lower end is above the upper end; write the lower end first, each end with its unit"
        )
    return Bounds(low, high, text)


def _kind_of(unit: str) -> tuple[dict[str, float], float]:
    """Return all unit spellings of the same quantity, and the factor from the given unit to SI."""
    if unit in _SPELLINGS:
        return _SPELLINGS[unit], 1.0
    return next((spellings, spellings[unit]) for spellings in _SPELLINGS.values() if unit in spellings)


def _split(text: str) -> tuple[float, str]:
    """Split a quantity into its number and its unit as written."""
    match = _NUMBER.fullmatch(text)
    if match is None or not math.isfinite(float(match[1])):
        raise QuantityError(f"{text.strip()!r}: not a number; write a number with its unit, for example 5 mm")
    return float(match[1]), match[2]


def _tight(unit: str) -> str:
    """Return a unit without spaces, as usually typed on a command line."""
    return unit.replace(" ", "")
