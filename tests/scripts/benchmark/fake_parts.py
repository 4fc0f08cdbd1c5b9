"""Small parts of the benchmark, and processor times at will."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from scripts.benchmark.host import ProcessorTimes
from scripts.benchmark.part import BenchmarkFigure, BenchmarkPart, Measurement

SPEED = BenchmarkFigure("speed", "m/s", at_least=2)
GAP = BenchmarkFigure("gap", "mm", absent="there was no gap")


def part(name: str, measure: Measurement, *, repetitions: int = 3, by_default: bool = True) -> BenchmarkPart:
    """Return a part with the figures speed and gap."""
    figures = {"speed": SPEED, "gap": GAP}
    return BenchmarkPart(name, f"Part {name}", "Explained.", repetitions, measure, figures, by_default)


def in_turn(results: Iterable[Mapping[str, float] | BaseException]) -> Measurement:
    """Return a measurement that yields the given figures in turn, or raises the given error."""
    left = iter(results)

    def measure(_seed: int) -> Mapping[str, float]:
        result = next(left)
        if isinstance(result, BaseException):
            raise result
        return result

    return measure


def steady(speed: float = 3.0) -> Measurement:
    """Return a measurement with a constant speed."""
    return lambda _seed: {"speed": speed}


def idle_clock(busy_s: Iterable[float] = (), stolen_s: float = 0.0) -> Callable[[], ProcessorTimes]:
    """Return a clock that advances by 1 s per call while other processes use `busy_s`, s, and the host takes its part.

    After the last value of `busy_s`, the computer is idle.
    """
    times = ProcessorTimes(0.0, 0.0, 0.0, 0.0)
    left = iter((0.0, *busy_s))

    def clock() -> ProcessorTimes:
        nonlocal times
        times = ProcessorTimes(
            times.at_s + 1, times.busy_s + next(left, 0.0) + 0.5, times.own_s + 0.5, times.stolen_s + stolen_s
        )
        return times

    return clock
