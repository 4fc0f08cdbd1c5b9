"""The report of a trial: the paper's P, D, T and S, cycles and their times, gaps, alarms."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any

from plant_sim.crop.seedling import SeedlingCounts

EQ_5_NOTE = (
    "until the seedling model comes, pick, carry and throw fail at random with the probabilities of "
    "eq. 5 of the paper, split evenly"
)


@dataclass(frozen=True, slots=True)
class RowTimes:
    """Cycle times of one arm at one row, s.

    Attributes:
        cycles: Number of cycles.
        mean_s: Mean time from leaving feed to standing there again.
        waiting_s: Mean part of it spent waiting for cups.
    """

    cycles: int
    mean_s: float
    waiting_s: float

    def text(self) -> str:
        """Return the times for a person."""
        moving_s = self.mean_s - self.waiting_s
        return (
            f"{self.cycles} cycles, {self.mean_s:5.2f} s ({moving_s:.2f} moving, {self.waiting_s:.2f} waiting for cups)"
        )


@dataclass(frozen=True)
class TrialReport:
    """What a trial gave.

    Attributes:
        seed: Seed of the plant.
        seedlings: Seedlings the trial began with.
        in_cups: Seedlings in cups.
        P: Pick failures (stems missed or cut while picking, plugs not pulled out).
        D: Carry failures (stems cut while carrying).
        T: Throw failures (plugs outside the cups).
        S: Success, percent of all seedlings.
        cycles: Rows transplanted.
        cycle_time_s: Mean time of a cycle, s.
        cycle_times: Times by arm and row.
        missed_cups: Cups that passed empty after the twelfth, both rows.
        missed_cups_by_row: The same for each row.
        missed_cups_by_cause: The same by what kept the arm: tray change, the other arm in the centre, or the
            length of its own way to row 1, 2 or 3.
        alarms: Texts of the alarms that came on, in order.
        reason: Why the trial did not complete; empty if it did.
        simulated_s: Machine time from power-up to the end, s.
        wall_s: Time it took to run, s.
        extrapolates: Whether the crop settings lie outside the paper's trials.
    """

    seed: int
    seedlings: int
    in_cups: int
    P: int
    D: int
    T: int
    S: float
    cycles: int
    cycle_time_s: float
    cycle_times: dict[str, RowTimes]
    missed_cups: int
    missed_cups_by_row: dict[str, int]
    missed_cups_by_cause: dict[str, int]
    alarms: list[str]
    reason: str
    simulated_s: float
    wall_s: float
    extrapolates: bool = False

    @property
    def completed(self) -> bool:
        """Whether the machine reached Complete."""
        return not self.reason

    @property
    def accounted(self) -> bool:
        """Whether every seedling is in a cup or counted as lost, once."""
        return self.in_cups + self.P + self.D + self.T == self.seedlings

    def record(self) -> dict[str, object]:
        """Return the report as one JSON object."""
        return {**asdict(self), "note": EQ_5_NOTE}

    def text(self) -> str:
        """Return the report for a person."""
        lines = [
            f"seedlings {self.seedlings}: in cups {self.in_cups}, lost picking P {self.P}, carrying D {self.D}, "
            f"throwing T {self.T}; S = {self.S:.1f} %",
            f"({EQ_5_NOTE}{'; outside its range: extrapolated' if self.extrapolates else ''})",
            f"cycles {self.cycles}, mean cycle {self.cycle_time_s:.2f} s, "
            f"{self.simulated_s:.1f} s of machine time in {self.wall_s:.1f} s",
        ]
        lines += [f"  {name:12} {times.text()}" for name, times in sorted(self.cycle_times.items())]
        gaps = ", ".join(f"{row} {count}" for row, count in self.missed_cups_by_row.items())
        causes = ", ".join(f"{cause} {count}" for cause, count in self.missed_cups_by_cause.items())
        lines += [
            f"missed cups {self.missed_cups} ({gaps}){': ' + causes if causes else ''}",
            "alarms " + ("none" if not self.alarms else "; ".join(self.alarms)),
        ]
        if not self.completed:
            lines.append(f"the trial did not complete: {self.reason}")
        return "\n".join(lines)


def make_report(
    *,
    seed: int,
    counts: SeedlingCounts,
    events: Iterable[Mapping[str, Any]],
    reason: str,
    simulated_s: float,
    wall_s: float,
    extrapolates: bool = False,
) -> TrialReport:
    """Put a report together.

    Args:
        seed: Seed of the plant.
        counts: Where the seedlings are at the end.
        events: Records of the controller's events (`controller.hmi.production.as_record`).
        reason: Why the trial did not complete; empty if it did.
        simulated_s: Machine time, s.
        wall_s: Time it took, s.
        extrapolates: Whether the crop settings lie outside the paper's trials.

    Returns:
        The report.
    """
    events = list(events)
    cycles = [event for event in events if event["event"] == "cycle"]
    alarms = [str(event["text"]) for event in events if event["event"] == "alarm" and event["active"]]
    missed = {"left": 0, "right": 0} | {str(event["side"]): int(event["missed_cups"]) for event in cycles}
    return TrialReport(
        seed=seed,
        seedlings=counts.total,
        in_cups=counts.in_cups,
        P=counts.P,
        D=counts.D,
        T=counts.T,
        S=100 * counts.in_cups / counts.total if counts.total else 0.0,
        cycles=len(cycles),
        cycle_time_s=round(fmean(event["cycle_ms"] for event in cycles) / 1000, 3) if cycles else 0.0,
        cycle_times=_row_times(cycles),
        missed_cups=sum(missed.values()),
        missed_cups_by_row=missed,
        missed_cups_by_cause=_gap_causes(cycles),
        alarms=alarms,
        reason=reason,
        simulated_s=simulated_s,
        wall_s=wall_s,
        extrapolates=extrapolates,
    )


def _gap_causes(cycles: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Return how many cups were missed for which cause."""
    names = {"tray": "tray change", "centre": "other arm in the centre"}
    before = {"left": 0, "right": 0}
    causes: dict[str, int] = defaultdict(int)
    for event in cycles:
        side = str(event["side"])
        missed = event["missed_cups"] - before[side]
        before[side] = event["missed_cups"]
        if missed > 0:
            causes[names.get(event["gap_cause"], f"way to row {event['row']}")] += missed
    return dict(sorted(causes.items()))


def _row_times(cycles: Sequence[Mapping[str, Any]]) -> dict[str, RowTimes]:
    groups: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    for event in cycles:
        groups[f"{event['side']} row {event['row']}"].append(event)
    return {
        name: RowTimes(
            len(group),
            round(fmean(event["cycle_ms"] for event in group) / 1000, 3),
            round(fmean(event["waiting_ms"] for event in group) / 1000, 3),
        )
        for name, group in sorted(groups.items())
    }
