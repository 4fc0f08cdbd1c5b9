"""Parsing of quantities with units: accepted spellings and rejected inputs."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant_sim.common.units import QuantityError, parse_bounds, parse_ms, parse_quantity, unit_of
from plant_sim.machine.parameters import load_machine


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("5 mm", "m", 0.005),
        ("-8mm", "m", -0.008),
        (" 0.35  MPa ", "Pa", 350_000.0),
        ("5 bar", "Pa", 500_000.0),
        ("3.5 bar", "MPa", 0.35),
        ("350 kPa", "MPa", 0.35),
        ("2 min", "s", 120.0),
        ("50 d", "d", 50.0),
        ("30 %", "-", 0.3),
        (".5", "-", 0.5),
        ("2e-9", "m3/(s Pa)", 2e-9),
        ("0.2 dm3/(s bar)", "m3/(s Pa)", 2e-9),
        ("2E-9m3/(sPa)", "m3/(s Pa)", 2e-9),
        ("6 L", "m3", 0.006),
        ("240 L/min", "m3/s", 0.004),
        ("45/min", "1/min", 45.0),
        ("0.75 1/s", "1/min", 45.0),
        ("200 mm/s", "m/s", 0.2),
        ("10 %", "cells", 7.2),
        ("6 cells", "cells", 6.0),
    ],
)
def test_a_quantity_is_a_number_in_the_wanted_unit(text: str, unit: str, value: float) -> None:
    assert parse_quantity(text, unit) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "unit", "complaint"),
    [
        ("5 furlong", "m", "'5 furlong': unknown unit furlong; use m or cm or mm or um"),
        ("5 mm", "N", "'5 mm': mm is a unit of another quantity; use N or kN"),
        ("5 M", "N", "'5 M': unknown unit M; use N or kN"),  # units are case-sensitive
        ("mm", "m", "'mm': not a number; write a number with its unit, for example 5 mm"),
        ("", "m", "'': not a number; write a number with its unit, for example 5 mm"),
        ("1e999 m", "m", "'1e999 m': not a number; write a number with its unit, for example 5 mm"),
        ("nan", "m", "'nan': not a number; write a number with its unit, for example 5 mm"),
        ("1,5 m", "m", "'1,5 m': unknown unit ,5 m; use m or cm or mm or um"),
    ],
)
def test_an_invalid_quantity_is_rejected_with_a_remedy(text: str, unit: str, complaint: str) -> None:
    with pytest.raises(QuantityError) as error:
        parse_quantity(text, unit)
    assert str(error.value) == complaint


@given(st.floats(min_value=-1e6, max_value=1e6), st.sampled_from(["m", "Pa", "s", "-", "m3/(s Pa)", "1/min"]))
def test_a_number_without_unit_is_in_the_wanted_unit_exactly(value: float, unit: str) -> None:
    assert parse_quantity(repr(value), unit) == value


@pytest.mark.parametrize(("text", "ms"), [("0", 0), ("0 s", 0), ("1500 ms", 1500), ("0.3 s", 300), ("2min", 120_000)])
def test_a_time_is_an_integer_number_of_milliseconds(text: str, ms: int) -> None:
    assert parse_ms(text) == ms


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("12", "'12': a time requires a unit; write 12 s or 12 ms"),
        ("1.5 us", "'1.5 us': must be a whole number of milliseconds, 0 or more"),
        ("-1 s", "'-1 s': must be a whole number of milliseconds, 0 or more"),
        ("5 mm", "'5 mm': mm is a unit of another quantity; use s or ms or us or min or h or d"),
    ],
)
def test_an_invalid_time_is_rejected(text: str, complaint: str) -> None:
    with pytest.raises(QuantityError) as error:
        parse_ms(text)
    assert str(error.value) == complaint


@pytest.mark.parametrize(
    ("text", "unit", "low", "high"),
    [
        (">= 60", "-", 60.0, math.inf),
        ("<=3 mm", "m", -math.inf, 0.003),
        ("0.1 MPa..0.35 MPa", "Pa", 1e5, 3.5e5),
        ("8 s..9500 ms", "ms", 8_000, 9_500),
        ("-5 deg", "deg", -5.0, -5.0),
    ],
)
def test_bounds_include_their_ends(text: str, unit: str, low: float, high: float) -> None:
    bounds = parse_bounds(text, unit)
    assert (bounds.low, bounds.high) == pytest.approx((low, high))
    assert bounds.hold(max(bounds.low, -1e9))
    assert bounds.hold(min(bounds.high, 1e9))
    assert not bounds.hold(bounds.low - 0.001) or low == -math.inf
    assert not bounds.hold(bounds.high + 0.001) or high == math.inf


@pytest.mark.parametrize("text", ["20..40 mm", "9 s..", "..3", "> 3"])
def test_invalid_bounds_are_rejected(text: str) -> None:
    with pytest.raises(QuantityError):
        parse_bounds(text, "m")


def test_the_unit_of_every_machine_parameter_can_be_parsed() -> None:
    machine = load_machine()
    names = [
        f"{section}.{key}"
        for section in machine.__dataclass_fields__
        for key in getattr(machine, section).__dataclass_fields__
    ]
    assert len(names) > 100
    for name in names:
        assert parse_quantity(f"2 {unit_of(name)}", unit_of(name)) == 2.0, name
