"""Scan time of an FX2N in a trial: period, jitter and isolated long scans, and what the program does meanwhile."""

from __future__ import annotations

from dataclasses import dataclass, field
from random import Random
from statistics import median
from typing import Final

from controller.fx.engine.plc import FxPlc
from controller.fx.timing.scan_time import executed_ms
from plant_sim.links.io_module import IoModule
from plant_sim.twin.ladder.annunciators import annunciators_on

SCAN_MS: Final = 10
"""Time between two scans unless a scan timing is given, ms."""
SAMPLE_MS: Final = 5
"""Period at which the input filter samples the terminals between the scans of a scan timing, ms (assumed; the FX2N
samples continuously)."""
FAST_MS: Final = 1
"""Period at which the terminals are sampled for a program with fast inputs or interrupts, ms."""
NO_WATCHDOG_MS: Final = 1_000_000_000
"""Output watchdog of the terminals of a PLC, ms: they have none."""
SCANS_PER_ESTIMATE: Final = 50
"""Number of scans for each one whose duration is estimated."""


@dataclass(frozen=True, slots=True)
class ScanTiming:
    """Scan time of the PLC in a trial.

    Attributes:
        period_ms: Mean time between two scans, ms.
        jitter_ms: Largest deviation from it, ms; every deviation in whole milliseconds is equally frequent.
        long_ms: Duration of an isolated long scan, ms; 0 = none.
        long_every: Mean number of scans for each long one.
    """

    period_ms: int
    jitter_ms: int = 0
    long_ms: int = 0
    long_every: int = 1_000

    def next_ms(self, chance: Random) -> int:
        """Return the duration of the next scan, ms."""
        if self.long_ms and chance.random() < 1 / self.long_every:
            return self.long_ms
        return self.period_ms + chance.randint(-self.jitter_ms, self.jitter_ms)


@dataclass(frozen=True, slots=True)
class ScanEstimate:
    """Estimated duration of the scans of a trial on a real FX2N, from the instructions that were executed.

    Attributes:
        median_ms: Median, ms.
        longest_ms: Longest estimate, ms.
        scans: Number of scans that were estimated, one in `SCANS_PER_ESTIMATE`.
    """

    median_ms: float
    longest_ms: float
    scans: int

    def __str__(self) -> str:
        return (
            f"estimated scan time of an FX2N: median {self.median_ms:.1f} ms, longest {self.longest_ms:.1f} ms of "
            f"{self.scans} scans (instruction times are general knowledge)"
        )


class TrialClock:
    """Clock of the scans; between them, input filter and fast inputs sample the terminals."""

    def __init__(self, timing: ScanTiming | None, seed: int) -> None:
        """Create a clock.

        Args:
            timing: Scan time; None = a scan every `SCAN_MS`, which also samples the terminals.
            seed: Seed of the jitter.
        """
        self._timing = timing
        self._chance = Random(seed)

    def next_ms(self, plc: FxPlc) -> int:
        """Return the time until the next scan, ms; a longer constant scan of the program takes precedence."""
        scan_ms = SCAN_MS if self._timing is None else self._timing.next_ms(self._chance)
        return max(scan_ms, plc.constant_scan_ms)

    def advance(self, module: IoModule, plc: FxPlc, now_ms: int, scan_ms: int) -> None:
        """Advance the plant by one scan.

        Without a scan timing, only the fast inputs and interrupts of a program sample the terminals between scans.
        """
        if self._timing is None and not plc.is_sampled:
            module.advance(scan_ms)
            return
        end_ms, tick_ms = now_ms + scan_ms, FAST_MS if plc.is_sampled else SAMPLE_MS
        while now_ms < end_ms:
            step_ms = min(tick_ms, end_ms - now_ms)
            module.advance(step_ms)
            now_ms += step_ms
            before = plc.cpu.latches.copy()
            image = plc.sample(now_ms, module.inputs())
            if image != before:
                module.write_outputs(0, image[: module.io_map.output_count])


@dataclass(slots=True)
class ScanMonitor:
    """Alarms of a program, and estimates of its scan time.

    Attributes:
        estimates: Whether scans are estimated.
        estimated_ms: Estimated durations, ms.
        scans: Number of scans.
        alarms: Annunciators that were on, in the order of their first activation.
    """

    estimates: bool = False
    estimated_ms: list[float] = field(default_factory=list)
    scans: int = 0
    alarms: list[int] = field(default_factory=list)

    def note(self, plc: FxPlc) -> None:
        """Record the state after a scan."""
        self.scans += 1
        self.alarms += [number for number in annunciators_on(plc) if number not in self.alarms]
        if self.estimates and self.scans % SCANS_PER_ESTIMATE == 0:
            self.estimated_ms.append(executed_ms(plc.ladder, plc.memory))

    @property
    def estimate(self) -> ScanEstimate | None:
        """Summary of the estimates; None if there are none."""
        times_ms = self.estimated_ms
        return ScanEstimate(median(times_ms), max(times_ms), len(times_ms)) if times_ms else None
