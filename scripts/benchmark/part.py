"""Part of the benchmark: the figures that it measures, and the function that measures them once."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass

Measurement = Callable[[int], Mapping[str, float]]
"""Function that measures all figures of a part once; its argument is the seed of the random numbers."""


@dataclass(frozen=True, slots=True)
class BenchmarkFigure:
    """Figure that a part measures.

    Attributes:
        title: Name in reports.
        unit: Unit; empty for numbers and ratios.
        at_most: Goal as an upper limit, or None.
        at_least: Goal as a lower limit, or None.
        absent: Reason why a measurement may have no value for this figure; empty if it always has one.
    """

    title: str
    unit: str = ""
    at_most: float | None = None
    at_least: float | None = None
    absent: str = ""


@dataclass(frozen=True, slots=True)
class BenchmarkPart:
    """Part of the benchmark, which does not depend on other parts.

    Attributes:
        name: Name on the command line.
        title: Heading in reports.
        explanation: Method of measurement, as a paragraph of the documentation.
        repetitions: Number of measurements, of which median and range are reported.
        measure: Function that measures all figures once.
        figures: Figures by key.
        by_default: True if the part is measured when no part is named.
    """

    name: str
    title: str
    explanation: str
    repetitions: int
    measure: Measurement
    figures: Mapping[str, BenchmarkFigure]
    by_default: bool = True


@dataclass(frozen=True, slots=True)
class LazyMeasurement:
    """Measurement whose module is imported only when it is called.

    A module that is not installed therefore fails only the parts that require it.

    Attributes:
        place: Module and function, as in ``package.module:function``.
        options: Keyword arguments of the function.
    """

    place: str
    options: Mapping[str, object]

    def __call__(self, seed: int) -> Mapping[str, float]:
        """Measure all figures once."""
        figures: Mapping[str, float] = pkgutil.resolve_name(self.place)(seed, **self.options)
        return figures


def lazily(place: str, **options: object) -> LazyMeasurement:
    """Return the measurement by a function that is imported later."""
    return LazyMeasurement(place, options)
