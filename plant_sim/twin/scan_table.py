"""Table of trials of one FX program at several scan times: what scan time the machine tolerates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

from plant_sim.twin.ladder_trial import LadderReport
from plant_sim.twin.scan_timing import ScanTiming


@dataclass(frozen=True, slots=True)
class ScanRow:
    """Trials with one scan timing.

    Attributes:
        timing: Scan time.
        reports: One report for each seed.
    """

    timing: ScanTiming
    reports: Sequence[LadderReport]

    def record(self) -> dict[str, object]:
        """Return the row as a flat record: sums over the trials."""
        counts = [report.counts for report in self.reports]
        alarms = Counter(alarm.split()[0] for report in self.reports for alarm in report.alarms)
        return {
            **asdict(self.timing),
            "trials": len(self.reports),
            "completed": sum(report.completed for report in self.reports),
            "total": sum(each.total for each in counts),
            "in_cups": sum(each.in_cups for each in counts),
            "P": sum(each.P for each in counts),
            "D": sum(each.D for each in counts),
            "T": sum(each.T for each in counts),
            "left": sum(each.in_tray + each.in_claw for each in counts),
            "incidents": sum(len(report.incidents) for report in self.reports),
            "alarms": dict(sorted(alarms.items())),
            "errors": sum(bool(report.error) for report in self.reports),
        }


def table(rows: Sequence[ScanRow]) -> Iterator[str]:
    """Yield the lines of a Markdown table."""
    yield "| scan, ms | completed | in cups | P | D | T | left | incidents | alarms (trials) |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for row in rows:
        cells = row.record()
        alarms = cells["alarms"]
        assert isinstance(alarms, dict)  # noqa: S101 - narrows the union
        listed = ", ".join(f"{name} ({count})" for name, count in alarms.items()) or "–"
        numbers = (f"{cells[key]}" for key in ("in_cups", "P", "D", "T", "left", "incidents"))
        completed = f"{cells['completed']} of {cells['trials']}"
        yield f"| {' | '.join((_scan(row.timing), completed, *numbers, listed))} |"


def _scan(timing: ScanTiming) -> str:
    """Return a scan timing in a few characters.

    Examples:
        >>> _scan(ScanTiming(12, 2, 80)), _scan(ScanTiming(10))
        ('12 ± 2, one in 1000: 80', '10')
    """
    mean = f"{timing.period_ms} ± {timing.jitter_ms}" if timing.jitter_ms else f"{timing.period_ms}"
    return f"{mean}, one in {timing.long_every}: {timing.long_ms}" if timing.long_ms else mean
