"""Results of the benchmark as text and as tables."""

from __future__ import annotations

import math
from typing import Final

from scripts.benchmark.results.record import DISTURBED_PCT, BenchmarkRecord, FigureRecord, PartRecord

_LIMITS: Final = {"at_most": "at most", "at_least": "at least"}


def shown(value: float) -> str:
    """Return a value with three significant digits, without losing digits before the point.

    >>> shown(1156.3), shown(20.23), shown(0.5301), shown(12.0), shown(0)
    ('1156', '20.2', '0.53', '12', '0')
    """
    if value == 0:
        return "0"
    decimals = max(0, 2 - math.floor(math.log10(abs(value))))
    text = f"{value:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def goal_text(figure: FigureRecord) -> str:
    """Return the goal of a figure, and a remark if it is not met; empty without a goal."""
    text = ", ".join(f"{_LIMITS[name]} {shown(limit)}" for name, limit in figure.goal.items())
    return text if figure.meets_goal else f"{text}, not met"


def median_text(figure: FigureRecord) -> str:
    """Return the median with its unit, or the reason why there is none."""
    return figure.absent if figure.median is None else f"{shown(figure.median)} {figure.unit}".rstrip()


def value_text(figure: FigureRecord) -> str:
    """Return the median with its unit, marked if the measurement was disturbed."""
    return f"{median_text(figure)} (disturbed)" if figure.disturbed else median_text(figure)


def range_text(figure: FigureRecord) -> str:
    """Return the smallest and the largest measurement; empty if there is none."""
    if figure.minimum is None or figure.maximum is None:
        return ""
    return f"{shown(figure.minimum)} to {shown(figure.maximum)}"


def load_text(part: PartRecord) -> str:
    """Return the load during a part."""
    return (
        f"load average {part.load_average:g} before, other processes {part.other_pct:g} %, steal time "
        f"{part.stolen_pct:g} % of a processor"
    )


def repeated(part: PartRecord) -> str:
    """Return the number of measurements of a part.

    >>> from scripts.benchmark.results.record import PartRecord
    >>> repeated(PartRecord.model_construct(repetitions=1))
    '1 measurement'
    """
    return f"{part.repetitions} measurement{'s' * (part.repetitions != 1)}"


def part_text(name: str, part: PartRecord) -> str:
    """Return the result of a part that did not fail, as lines of text."""
    lines = [f"{name}: {part.title}, {repeated(part)} in {part.duration_s:.0f} s; {load_text(part)}"]
    for figure in part.figures.values():
        spread, goal = range_text(figure), goal_text(figure)
        line = f"  {figure.title:47s} {value_text(figure)}"
        line += f" ({spread})" if spread and figure.repetitions > 1 else ""
        lines.append(line + (f"; goal: {goal}" if goal else ""))
    return "\n".join(lines)


def failure_text(name: str, part: PartRecord) -> str:
    """Return the one line that reports a failed part, with the load if there were other processes."""
    return f"{name}: failed: {part.failed}" + (f"; {load_text(part)}" if part.other_pct > DISTURBED_PCT else "")


def run_text(record: BenchmarkRecord) -> str:
    """Return the computer and the circumstances of a run in one line."""
    host = record.host
    commit = f" ({record.commit})" if record.commit else ""
    loads = " ".join(f"{load:.2f}" for load in record.load_average)
    return (
        f"{record.date}, version {record.version}{commit}, {host.processor}, {host.cores} cores, "
        f"{host.memory_gib:g} GiB, {host.kernel}, {host.python}, load average {loads}"
    )
