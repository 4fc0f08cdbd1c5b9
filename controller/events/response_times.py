"""Lines of the field I/O whose answers take longer than a scan period."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

SCANS: Final = 20
"""Number of scans in succession after which a line is reported as slow, or as in time again (assumed): one late answer
is no property of a device."""


@dataclass(slots=True)
class _Connection:
    late: int = 0
    in_time: int = 0
    spent_s: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    slow: tuple[str, str] | None = None


class ResponseTimes:
    """Comparison of the time that each scan waits for a line with the scan period."""

    def __init__(self, scan_ms: int) -> None:
        """Create the comparison.

        Args:
            scan_ms: Scan period, ms.
        """
        self.scan_ms = scan_ms
        self._lines: defaultdict[str, _Connection] = defaultdict(_Connection)
        self._before_s: dict[str, float] = {}

    @property
    def slow(self) -> dict[str, str]:
        """Cause with figures and remedy of each slow line, by the label of the device that takes most of its time."""
        return dict(line.slow for line in self._lines.values() if line.slow is not None)

    def update(self, waits: Iterable[tuple[str, str, float]]) -> None:
        """Take the times after a scan.

        Args:
            waits: Label of each device, address of its line, and total time that scans have waited for it, s.
        """
        spent_s: defaultdict[str, dict[str, float]] = defaultdict(dict)
        for label, address, total_s in waits:
            spent_s[address][label] = total_s - self._before_s.get(label, total_s)
            self._before_s[label] = total_s
        for address, by_device in spent_s.items():
            self._judge(self._lines[address], by_device)

    def _judge(self, line: _Connection, spent_s: dict[str, float]) -> None:
        if sum(spent_s.values()) * 1_000 <= self.scan_ms:
            line.in_time, line.late = line.in_time + 1, 0
            line.spent_s.clear()
            if line.in_time >= SCANS:
                line.slow = None
            return
        line.late, line.in_time = line.late + 1, 0
        for label, time_s in spent_s.items():
            line.spent_s[label] += time_s
        if line.late == SCANS and line.slow is None:
            line.slow = self._cause(line.spent_s)

    def _cause(self, spent_s: Mapping[str, float]) -> tuple[str, str]:
        slowest = max(spent_s, key=lambda label: spent_s[label])
        mean_ms = {label: 1_000 * time_s / SCANS for label, time_s in spent_s.items()}
        others = "" if len(spent_s) == 1 else f", those of all devices of its line {sum(mean_ms.values()):.1f} ms"
        text = f"a scan waits {mean_ms[slowest]:.1f} ms for its answers{others}, and its period is {self.scan_ms} ms"
        return slowest, f"{text}; use a faster device or line, poll it less often, or give a longer --scan-ms"
