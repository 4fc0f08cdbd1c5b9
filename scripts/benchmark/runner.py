"""Run of the benchmark: every part on its own, several times, with the load of the computer."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from controller.common.extras import install_hint
from scripts.benchmark.host import ProcessorTimes, processor_times
from scripts.benchmark.part import BenchmarkPart
from scripts.benchmark.results.record import DISTURBED_PCT, FigureRecord, PartRecord

MOST_REPETITIONS: Final = 20
Clock = Callable[[], ProcessorTimes]


def run_parts(
    parts: Iterable[BenchmarkPart],
    *,
    seed: int,
    repetitions: int | None,
    report: Callable[[str, PartRecord], object],
    clock: Clock = processor_times,
) -> dict[str, PartRecord]:
    """Measure parts in sequence; a failed part costs its own figures only.

    Args:
        parts: Parts to measure.
        seed: Seed of all random numbers.
        repetitions: Number of measurements of each part; None = the number of the part.
        report: Function that is called with the name and the result of each part when it has ended.
        clock: Function that returns the processor times.

    Returns:
        The results by name.
    """
    records = {}
    for part in parts:
        records[part.name] = _run(part, seed, part.repetitions if repetitions is None else repetitions, clock)
        report(part.name, records[part.name])
    return records


def _run(part: BenchmarkPart, seed: int, repetitions: int, clock: Clock) -> PartRecord:
    load_average, began_s = os.getloadavg()[0], time.perf_counter()
    measured: list[Mapping[str, float]] = []
    stolen_pct = other_pct = 0.0
    failed: str | None = None
    figures: dict[str, FigureRecord] = {}
    before = clock()
    try:
        for _ in range(repetitions):
            try:
                measured.append(part.measure(seed))
            finally:  # other processes may be the cause of a failure
                after = clock()
                stolen_pct = max(stolen_pct, after.stolen_pct(before))
                other_pct = max(other_pct, after.other_pct(before))
                before = after
        figures = _figures(part, measured, other_pct)
    except Exception as error:  # noqa: BLE001 - the other parts must keep their figures, whatever fails here
        failed = _reason(error)
    return PartRecord(
        title=part.title,
        repetitions=repetitions,
        duration_s=round(time.perf_counter() - began_s, 1),
        load_average=round(load_average, 2),
        stolen_pct=round(stolen_pct, 1),
        other_pct=round(other_pct, 1),
        failed=failed,
        figures=figures,
    )


def _figures(part: BenchmarkPart, measured: list[Mapping[str, float]], other_pct: float) -> dict[str, FigureRecord]:
    unknown = {key for figures in measured for key in figures} - set(part.figures)
    if unknown:
        raise ValueError(f"unknown figures: {', '.join(sorted(unknown))}")
    disturbed = other_pct > DISTURBED_PCT
    return {
        key: FigureRecord.of(
            figure, [float(figures[key]) for figures in measured if key in figures], disturbed=disturbed
        )
        for key, figure in part.figures.items()
    }


def _reason(error: Exception) -> str:
    """Return the reason of a failure in one line."""
    if isinstance(error, ModuleNotFoundError) and (hint := install_hint(error)):
        return hint
    text, kind = " ".join(str(error).split()), type(error)
    if not text:
        return kind.__name__
    return f"{kind.__name__}: {text}" if kind.__module__ == "builtins" else text
