"""File with the results of the benchmark."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Final, Literal, Self

import yaml
from pydantic import Field

from controller.common.errors import InputError
from controller.common.yaml_lines import read_yaml, unfold
from controller.common.yaml_model import StrictModel, validated
from plant_sim.common.whole_file import write_whole
from scripts.benchmark.part import BenchmarkFigure

DISTURBED_PCT: Final = 10.0
"""Processor time of other processes above which a figure is marked as disturbed, % of one processor."""
REMEDY: Final = "measure again with scripts/bench --json"
_DIGITS: Final = 5
_DEPTH: Final = 6
"""Levels of the file from the record down to the goal of a figure."""


Limit = Literal["at_most", "at_least"]


class FigureRecord(StrictModel):
    """Result of one figure.

    Attributes:
        title: Name of the figure.
        unit: Unit; empty for numbers and ratios.
        goal: Limits that the median should meet.
        repetitions: Number of measurements that have a value.
        median: Median of the measurements; None if none has a value.
        minimum: Minimum.
        maximum: Maximum.
        absent: Reason why there is no value; empty if there is one.
        disturbed: True if other processes took more than `DISTURBED_PCT` of a processor during a measurement.
    """

    title: str
    unit: str
    goal: dict[Limit, float]
    repetitions: int
    median: float | None
    minimum: float | None
    maximum: float | None
    absent: str
    disturbed: bool

    @classmethod
    def of(cls, figure: BenchmarkFigure, values: Sequence[float], *, disturbed: bool) -> Self:
        """Return the result of measurements.

        Raises:
            ValueError: A value is not finite, or there is none although the figure always has one.
        """
        if not all(map(math.isfinite, values)):
            raise ValueError(f"{figure.title!r} is not finite")
        if not values and not figure.absent:
            raise ValueError(f"no value of {figure.title!r}")
        limits: dict[Limit, float | None] = {"at_most": figure.at_most, "at_least": figure.at_least}
        return cls(
            title=figure.title,
            unit=figure.unit,
            goal={name: limit for name, limit in limits.items() if limit is not None},
            repetitions=len(values),
            median=_rounded(median(values)) if values else None,
            minimum=_rounded(min(values)) if values else None,
            maximum=_rounded(max(values)) if values else None,
            absent="" if values else figure.absent,
            disturbed=disturbed,
        )

    @property
    def meets_goal(self) -> bool:
        """True if the median meets the goal; a figure without goal or value meets it."""
        if self.median is None:
            return True
        return self.goal.get("at_least", -math.inf) <= self.median <= self.goal.get("at_most", math.inf)


class PartRecord(StrictModel):
    """Result of one part.

    Attributes:
        title: Heading of the part.
        repetitions: Number of measurements requested.
        duration_s: Duration of all measurements, s.
        load_average: Load average over one minute before the part.
        stolen_pct: Largest steal time during a measurement, % of one processor.
        other_pct: Largest processor time of other processes during a measurement, % of one processor.
        failed: Reason why the part has no figures; None if it has.
        figures: Results by key.
    """

    title: str
    repetitions: int
    duration_s: float
    load_average: float
    stolen_pct: float
    other_pct: float
    failed: str | None
    figures: dict[str, FigureRecord]


class HostRecord(StrictModel):
    """Computer, Python and libraries."""

    processor: str
    cores: int
    memory_gib: float
    kernel: str
    python: str
    libraries: dict[str, str]


class BenchmarkRecord(StrictModel):
    """Results of a run.

    Attributes:
        version: Version of the program.
        commit: Commit of the program; None if it does not run from a checkout.
        date: Date and time of the start, with UTC offset.
        seed: Seed of all random numbers.
        load_average: Load averages over 1, 5 and 15 minutes before the run.
        host: Computer.
        test_duration_s: Duration of ``scripts/test``, s, which is measured separately; None if it is not stated.
        parts: Results by part.
    """

    version: str
    commit: str | None
    date: str
    seed: int
    load_average: list[float]
    host: HostRecord
    test_duration_s: int | None = Field(gt=0, description="write the duration of scripts/test in whole seconds")
    parts: dict[str, PartRecord]

    def write(self, path: Path) -> None:
        """Write the file completely or not at all.

        Raises:
            InputError: The file cannot be written.
        """
        text = json.dumps(self.model_dump(), indent=1, ensure_ascii=False, allow_nan=False)
        write_whole(path, lambda part: part.write_text(f"{text}\n", encoding="utf-8"))


def read_record(path: Path) -> BenchmarkRecord:
    """Read a file written by `BenchmarkRecord.write`.

    JSON is read as YAML, of which it is a subset, because that reader states the line of an invalid value.

    Raises:
        InputError: The file cannot be read or is invalid.
    """
    if not path.is_file():
        raise InputError(f"{path}: is not a file; specify a file written by scripts/bench --json")
    located = unfold(read_yaml(path, InputError), _DEPTH, _json_value)
    record = validated(BenchmarkRecord, located)
    if record is None or located.faults:
        raise InputError(f"{path}:{located.faults[0]}; or {REMEDY}")
    return record


def _json_value(node: yaml.Node) -> object:
    """Return the value of a scalar in JSON.

    Raises:
        ValueError: It is none.
    """
    if not isinstance(node, yaml.ScalarNode):
        raise ValueError("is nested too deeply; correct it")
    if node.style == '"':
        return node.value
    try:
        return json.loads(node.value)
    except ValueError:
        raise ValueError("is not a JSON value; correct it") from None


def _rounded(value: float) -> float:
    """Return a value with `_DIGITS` significant digits."""
    return float(f"{value:.{_DIGITS}g}")
