"""Types of the quantities in line files and ground files: numbers with a unit and a valid range."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import BeforeValidator

from plant_sim.common.units import QuantityError, parse_quantity

_NUMBER = re.compile(r"[-+.\deE\s]+")


def _quantity(unit: str, low: float, high: float, example: str) -> BeforeValidator:
    """Return a validator that converts a string with a unit to a number and checks its range."""

    def read(value: object) -> float:
        if not isinstance(value, str | int) or isinstance(value, bool):
            raise ValueError(f"must be a number with its unit, such as {example}")
        text = str(value)
        number = parse_quantity(text, unit)
        if unit != "-" and number and is_bare(text):
            raise QuantityError(f"{text!r}: the unit is missing; write for example {example}")
        if not low <= number <= high:
            raise ValueError(f"{text} is out of range; must be {low:g} to {high:g} {unit.replace('-', '')}".rstrip())
        return number

    return BeforeValidator(read)


Share = Annotated[float, _quantity("-", 0.0, 1.0, "5 %")]
Slip = Annotated[float, _quantity("-", 0.0, 0.9, "5 %")]
Grade = Annotated[float, _quantity("-", -0.5, 0.5, "8 %")]
Factor = Annotated[float, _quantity("-", 0.0, 10.0, "1.5")]
Cycles = Annotated[float, _quantity("-", -0.5, 0.5, "5 %")]
Spacing = Annotated[float, _quantity("m", 0.1, 2.0, "40 cm")]
Distance = Annotated[float, _quantity("m", 0.0, 1.0, "15 mm")]
Patch = Annotated[float, _quantity("m", 0.05, 100.0, "1 m")]
Speed = Annotated[float, _quantity("m/s", 0.01, 5.0, "1.5 km/h")]
Duration = Annotated[float, _quantity("s", 0.0, 3600.0, "0.2 s")]
Lag = Annotated[float, _quantity("s", 0.01, 60.0, "0.5 s")]
Acceleration = Annotated[float, _quantity("m/s2", 0.01, 5.0, "0.3 m/s2")]
Phase = Annotated[float, _quantity("-", 0.0, 10.0, "26 %")]
Seedlings = Annotated[float, _quantity("-", 1.0, 1e6, "1440")]
Efficiency = Annotated[float, _quantity("-", 0.01, 1.0, "50 %")]
Width = Annotated[float, _quantity("m", 0.1, 5.0, "60 cm")]
FieldLength = Annotated[float, _quantity("m", 1.0, 10_000.0, "100 m")]
Rate = Annotated[float, _quantity("1/min", 1.0, 1000.0, "90/min")]
Force = Annotated[float, _quantity("N", 1.0, 1000.0, "91.83 N")]


def is_bare(text: str) -> bool:
    """Return True for a number without a unit."""
    return _NUMBER.fullmatch(text) is not None
