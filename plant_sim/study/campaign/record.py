"""Record of a run: one row of a table, with the same columns for every run of a campaign."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from plant_sim.twin.report import TrialReport

Record = dict[str, Any]
"""Values of a row by column name."""

COLUMNS: Final[Mapping[str, tuple[str, str]]] = {
    "seedlings": ("int32", "-"),
    "in_cups": ("int32", "-"),
    "P": ("int32", "-"),
    "D": ("int32", "-"),
    "T": ("int32", "-"),
    "S": ("double", "%"),
    "S_low": ("double", "%"),
    "S_high": ("double", "%"),
    "F_p": ("double", "%"),
    "F_p_low": ("double", "%"),
    "F_p_high": ("double", "%"),
    "F_d": ("double", "%"),
    "F_d_low": ("double", "%"),
    "F_d_high": ("double", "%"),
    "F_t": ("double", "%"),
    "F_t_low": ("double", "%"),
    "F_t_high": ("double", "%"),
    "cycles": ("int32", "-"),
    "cycle_time_s": ("double", "s"),
    "cycle_times": ("cycle_times", "s"),
    "missed_cups": ("int32", "-"),
    "missed_cups_left": ("int32", "-"),
    "missed_cups_right": ("int32", "-"),
    "missed_cups_by_cause": ("counts", "-"),
    "air_l_min": ("double", "L/min"),
    "alarms": ("texts", "-"),
    "completed": ("bool", "-"),
    "accounted": ("bool", "-"),
    "reason": ("string", "-"),
    "extrapolates": ("bool", "-"),
    "simulated_s": ("double", "s"),
    "in_claws": ("int32", "-"),
    "in_trays_untouched": ("int32", "-"),
    "in_trays_ploughed": ("int32", "-"),
}
"""Type and unit of each column of a trial report; the types are those of `shards`."""
_RATES = ("S", "F_p", "F_d", "F_t")


def report_record(report: TrialReport) -> Record:
    """Return the `COLUMNS` of a report; the rates of an incomplete trial are None.

    The wall-clock time is omitted, so that equal runs have equal records.
    """
    record: Record = {name: getattr(report, name) for name in COLUMNS if hasattr(report, name)}
    for name in _RATES:
        low, high = report.intervals[name]
        record |= {f"{name}_low": low, f"{name}_high": high}
    if not report.completed:
        record |= {column: None for name in _RATES for column in (name, f"{name}_low", f"{name}_high")}
    record |= {f"missed_cups_{row}": count for row, count in report.missed_cups_by_row.items()}
    record["missed_cups_by_cause"] = list(report.missed_cups_by_cause.items())
    record["cycle_times"] = [
        {"row": row, "cycles": times.cycles, "mean_s": times.mean_s, "waiting_s": times.waiting_s}
        for row, times in report.cycle_times.items()
    ]
    return record
