"""Lines of the field I/O whose answers take longer than a scan period."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

SCANS: Final = 20
"""Number of scans in succession after which a device is reported as slow, or as in time again (assumed): one late
answer is no property of a device."""


@dataclass(slots=True)
class _Connection:
    late: int = 0
    spent_s: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    slow: dict[str, str] = field(default_factory=dict)
    in_time: defaultdict[str, int] = field(default_factory=lambda: defaultdict(int))


class ResponseTimes:
    """Comparison of the time that each scan waits for a line with the scan period.

    If the answers on a line take longer than the period in `SCANS` scans in succession, the device that has taken most
    of that time is slow. It is in time again after `SCANS` scans in succession in which it has answered and either the
    line was in time or its own answers took no more than its equal share of the period. A scan without an answer from
    it, because it is lost or not polled, shows nothing about it.
    """

    def __init__(self, scan_ms: int) -> None:
        """Create the comparison.

        Args:
            scan_ms: Scan period, ms.
        """
        self.scan_ms = scan_ms
        self._lines: defaultdict[str, _Connection] = defaultdict(_Connection)
        self._before: dict[str, tuple[int, float]] = {}

    @property
    def slow(self) -> dict[str, str]:
        """Cause with figures and remedy of each slow device, by its label."""
        return {label: cause for line in self._lines.values() for label, cause in line.slow.items()}

    def update(self, waits: Iterable[tuple[str, str, int, float]]) -> None:
        """Take the answers after a scan.

        Args:
            waits: Of each device: label, address of its line, number of answers, and total time that scans have waited
                for them, s.
        """
        spent_s: defaultdict[str, dict[str, float]] = defaultdict(dict)
        devices: Counter[str] = Counter()
        for label, address, answers, total_s in waits:
            answers_before, before_s = self._before.get(label, (answers, total_s))
            self._before[label] = answers, total_s
            devices[address] += 1
            if answers > answers_before:
                spent_s[address][label] = total_s - before_s
        for address, count in devices.items():
            self._judge(self._lines[address], spent_s[address], self.scan_ms / count)

    def _judge(self, line: _Connection, spent_s: dict[str, float], share_ms: float) -> None:
        is_late = sum(spent_s.values()) * 1_000 > self.scan_ms
        for label in line.slow.keys() & spent_s.keys():
            is_prompt = not is_late or spent_s[label] * 1_000 <= share_ms
            line.in_time[label] = line.in_time[label] + 1 if is_prompt else 0
            if line.in_time[label] == SCANS:
                del line.slow[label], line.in_time[label]
        line.late = line.late + 1 if is_late else 0
        if line.late == 0:
            line.spent_s.clear()
            return
        for label, time_s in spent_s.items():
            line.spent_s[label] += time_s
        if line.late == SCANS:
            slowest = max(line.spent_s, key=lambda label: line.spent_s[label])
            line.slow.setdefault(slowest, self._cause(slowest, line.spent_s))
            line.late = 0
            line.spent_s.clear()

    def _cause(self, slowest: str, spent_s: Mapping[str, float]) -> str:
        mean_ms = {label: 1_000 * time_s / SCANS for label, time_s in spent_s.items()}
        others = "" if len(spent_s) == 1 else f", those of all devices of its line {sum(mean_ms.values()):.1f} ms"
        text = f"a scan waits {mean_ms[slowest]:.1f} ms for its answers{others}, and its period is {self.scan_ms} ms"
        return f"{text}; use a faster device or line, poll it less often, or give a longer --scan-ms"
