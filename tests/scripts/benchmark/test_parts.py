"""Parts of the benchmark: names, and one measurement of each."""

from __future__ import annotations

import inspect
import pkgutil

import pytest

from controller.common.errors import InputError
from scripts.benchmark.catalogue import PARTS, chosen_parts
from scripts.benchmark.part import LazyMeasurement, lazily
from scripts.benchmark.runner import run_parts
from tests.real_time import MARK
from tests.sampling import first_of

REAL_TIME = {"lateness", "modbus", "malformed"}
"""Parts whose plants follow the clock."""


def test_names_are_unique_and_parts_have_figures() -> None:
    assert len({each.name for each in PARTS}) == len(PARTS)
    assert all(each.figures and 1 <= each.repetitions <= 5 for each in PARTS)


def test_parts_are_chosen_by_name() -> None:
    assert [each.name for each in chosen_parts(["rows", "scan", "rows"])] == ["scan", "rows"]
    by_default = chosen_parts([])
    assert {each.name for each in PARTS} - {each.name for each in by_default} == {"busy-host", "growth", "ladder-page"}
    with pytest.raises(InputError, match=r"^row: unknown part; use one of scan, plant, .*, busy-host$"):
        chosen_parts(["scan", "row"])


def test_every_measurement_can_be_imported() -> None:
    """A measurement is a function with the seed as first argument, and accepts the options of its part."""
    for each in PARTS:
        assert isinstance(each.measure, LazyMeasurement)
        parameters = inspect.signature(pkgutil.resolve_name(each.measure.place)).parameters
        assert next(iter(parameters)) in {"seed", "_seed"}
        assert set(each.measure.options) <= set(parameters)


def speed_of(seed: int, *, factor: float) -> dict[str, float]:
    """Measure nothing."""
    return {"speed": seed * factor}


def test_seed_and_options_reach_the_measurement() -> None:
    assert lazily(f"{__name__}:speed_of", factor=0.5)(7) == {"speed": 3.5}


@pytest.mark.parametrize("name", first_of(["scan", "start"]))
def test_a_part_measures_its_figures(name: str) -> None:
    measured(name)


@pytest.mark.nightly
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(each.name, marks=getattr(pytest.mark, MARK) if each.name in REAL_TIME else ())
        for each in chosen_parts([])
    ],
)
def test_every_part_measures_its_figures(name: str) -> None:
    measured(name)


def measured(name: str) -> None:
    """Measure a part once; its figures must be complete."""
    record = run_parts(chosen_parts([name]), seed=1, repetitions=1, report=lambda _name, _part: None)[name]
    assert record.failed is None
    assert all(figure.absent or figure.median is not None for figure in record.figures.values())
