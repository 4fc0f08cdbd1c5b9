"""Report of a trial: the paper's P, D, T and S, cycle times, missed cups, alarms."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any, Final

from plant_sim.common.proportion import Proportion
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.twin.ending.reported import alarm_name

EXTRAPOLATES: Final = "crop settings outside the trials of the paper: extrapolated"


@dataclass(frozen=True, slots=True)
class RowTimes:
    """Cycle times of one arm at one row, s.

    Attributes:
        cycles: Number of cycles.
        mean_s: Mean time from leaving feed to returning to feed.
        waiting_s: Mean part of that time spent waiting for cups.
    """

    cycles: int
    mean_s: float
    waiting_s: float

    def text(self) -> str:
        """Return the times as text."""
        moving_s = self.mean_s - self.waiting_s
        return (
            f"{self.cycles} cycles, {self.mean_s:5.2f} s ({moving_s:.2f} moving, {self.waiting_s:.2f} waiting for cups)"
        )


@dataclass(frozen=True)
class TrialReport:
    """Report of a trial.

    Attributes:
        seed: Seed of the plant.
        seedlings: Number of seedlings at the start.
        in_cups: Seedlings in cups.
        P: Pick failures (stems missed or cut while picking, plugs not pulled out).
        D: Carry failures (stems cut while carrying).
        T: Throw failures (plugs that fall outside the cups at the release over them).
        S: Success, percent of all seedlings, eq. 1 of the paper. The rates are meaningful only for a completed trial;
            `record` and `text` omit those of an incomplete trial.
        F_p: P as a percentage of all seedlings, eq. 2.
        F_d: D as a percentage, eq. 3.
        F_t: T as a percentage, eq. 4.
        intervals: Exact binomial 95 % confidence intervals of S, F_p, F_d and F_t, percent.
        cycles: Rows transplanted.
        cycle_time_s: Mean time of a cycle, s.
        cycle_times: Times by arm and row.
        missed_cups: Cups that passed empty after the twelfth cup since a release, total of both rows.
        missed_cups_by_row: Missed cups by row.
        missed_cups_by_cause: Missed cups by cause: tray change, other arm in the centre, or the travel time to row 1,
            2 or 3.
        air_l_min: Air consumption of the valves from power-up to the end, both arms, L/min ANR; None if unknown.
        alarms: Names of the alarms raised, number and text, in order.
        reason: Reason for an incomplete trial; empty if it completed.
        simulated_s: Machine time from power-up to the end, s.
        wall_s: Wall-clock time of the run, s.
        extrapolates: True if the crop settings are outside the paper's trials.
        in_claws: Seedlings in claws at the end.
        in_trays_untouched: Seedlings in trays that no arm was driven through.
        in_trays_ploughed: Seedlings in trays that an arm was driven through without tearing them out. With those in
            claws, in trays, in cups and lost (P, D, T), every seedling is counted exactly once.
    """

    seed: int
    seedlings: int
    in_cups: int
    P: int
    D: int
    T: int
    S: float
    F_p: float
    F_d: float
    F_t: float
    intervals: dict[str, tuple[float, float]]
    cycles: int
    cycle_time_s: float
    cycle_times: dict[str, RowTimes]
    missed_cups: int
    missed_cups_by_row: dict[str, int]
    missed_cups_by_cause: dict[str, int]
    air_l_min: float | None
    alarms: list[str]
    reason: str
    simulated_s: float
    wall_s: float
    extrapolates: bool = False
    in_claws: int = 0
    in_trays_untouched: int = 0
    in_trays_ploughed: int = 0

    def __repr__(self) -> str:
        return f"<TrialReport seed {self.seed}: {self._result()}, {self.simulated_s:.1f} s of machine time>"

    def _result(self) -> str:
        """Return the success, or the reason why there is none."""
        if not self.completed:
            return f"{self.in_cups} of {self.seedlings} seedlings in cups, did not complete: {self.reason}"
        low, high = self.intervals["S"]
        return f"{self.in_cups} of {self.seedlings} seedlings in cups, S {self.S:.1f} % ({low:.1f} to {high:.1f})"

    @property
    def completed(self) -> bool:
        """True if the machine reached Complete."""
        return not self.reason

    @property
    def accounted(self) -> bool:
        """True if every seedling is either in a cup or lost."""
        return self.in_cups + self.P + self.D + self.T == self.seedlings

    def record(self) -> dict[str, object]:
        """Return the report as one JSON object; an incomplete trial has no rates."""
        shares = {} if self.completed else dict.fromkeys((*self.intervals, "intervals"))
        return asdict(self) | shares

    @property
    def counts(self) -> SeedlingCounts:
        """Number of seedlings by location."""
        in_tray = self.in_trays_untouched + self.in_trays_ploughed
        lost = (self.P, self.D, self.T)
        return SeedlingCounts(
            in_tray, self.in_claws, self.in_cups, *lost, self.seedlings, ploughed=self.in_trays_ploughed
        )

    def text(self) -> str:
        """Return the report as text."""
        shares = [
            f"{name} {getattr(self, name):.1f} % ({low:.1f} to {high:.1f})"
            for name, (low, high) in self.intervals.items()
        ]
        lines = [
            *([] if self.completed else [f"the trial did not complete, so it has no S: {self.reason}"]),
            account_text(self.counts),
            *(["  ".join(shares) + ", 95 % binomial"] if self.completed else []),
            *([f"({EXTRAPOLATES})"] if self.extrapolates else []),
            f"cycles {self.cycles}, mean cycle {self.cycle_time_s:.2f} s, "
            f"{self.simulated_s:.1f} s of machine time in {self.wall_s:.1f} s",
        ]
        lines += [f"  {name:12} {times.text()}" for name, times in sorted(self.cycle_times.items())]
        gaps = ", ".join(f"{row} {count}" for row, count in self.missed_cups_by_row.items())
        causes = ", ".join(f"{cause} {count}" for cause, count in self.missed_cups_by_cause.items())
        lines += [
            f"missed cups {self.missed_cups} ({gaps}){': ' + causes if causes else ''}",
            *([f"air {self.air_l_min:.1f} L/min"] if self.air_l_min is not None else []),
            f"alarms {'; '.join(counted(self.alarms)) or 'none'}",
        ]
        return "\n".join(lines)


def account_text(counts: SeedlingCounts) -> str:
    """Return where the seedlings are, in one line; its numbers add up to that of the seedlings.

    >>> account_text(SeedlingCounts(24, 1, 40, 4, 0, 3, total=72, ploughed=12))
    'seedlings 72: in cups 40, lost picking P 4, carrying D 0, throwing T 3, in claws 1, in trays untouched 12, \
in trays ploughed through 12'
    """
    rest = {
        "in claws": counts.in_claw,
        "in trays untouched": counts.in_tray - counts.ploughed,
        "in trays ploughed through": counts.ploughed,
    }
    return ", ".join(
        [
            f"seedlings {counts.total}: in cups {counts.in_cups}, lost picking P {counts.P}, carrying D {counts.D}, "
            f"throwing T {counts.T}",
            *(f"{place} {count}" for place, count in rest.items() if count),
        ]
    )


def counted(names: Sequence[str]) -> list[str]:
    """Return each name once, in the order of its first occurrence, with the number of its occurrences.

    >>> counted(["S912 low", "S905 air", "S912 low"])
    ['S912 low (2 times)', 'S905 air']
    """
    return [name if count == 1 else f"{name} ({count} times)" for name, count in Counter(names).items()]


def make_report(
    *,
    seed: int,
    counts: SeedlingCounts,
    events: Iterable[Mapping[str, Any]],
    reason: str,
    simulated_s: float,
    wall_s: float,
    extrapolates: bool = False,
    air_l_min: float | None = None,
) -> TrialReport:
    """Return the report of a trial.

    Args:
        seed: Seed of the plant.
        counts: Final location of the seedlings.
        events: Records of the controller's events (`controller.events.kinds.as_record`).
        reason: Reason for an incomplete trial; empty if it completed.
        simulated_s: Machine time, s.
        wall_s: Wall-clock time, s.
        extrapolates: True if the crop settings are outside the paper's trials.
        air_l_min: Air consumption of the valves, L/min ANR; None if unknown.

    Returns:
        The report.
    """
    events = list(events)
    cycles = [event for event in events if event["event"] == "cycle"]
    alarms = [
        alarm_name(event["number"], str(event["text"]))
        for event in events
        if event["event"] == "alarm" and event["active"]
    ]
    missed = {"left": 0, "right": 0} | {str(event["side"]): int(event["missed_cups"]) for event in cycles}
    return TrialReport(
        seed=seed,
        seedlings=counts.total,
        in_cups=counts.in_cups,
        P=counts.P,
        D=counts.D,
        T=counts.T,
        S=_percent(counts.in_cups, counts.total),
        F_p=_percent(counts.P, counts.total),
        F_d=_percent(counts.D, counts.total),
        F_t=_percent(counts.T, counts.total),
        intervals=success_intervals(counts.in_cups, counts.P, counts.D, counts.T, seedlings=counts.total),
        cycles=len(cycles),
        cycle_time_s=round(fmean(event["cycle_ms"] for event in cycles) / 1000, 3) if cycles else 0.0,
        cycle_times=_row_times(cycles),
        missed_cups=sum(missed.values()),
        missed_cups_by_row=missed,
        missed_cups_by_cause=_gap_causes(cycles),
        air_l_min=air_l_min,
        alarms=alarms,
        reason=reason,
        simulated_s=simulated_s,
        wall_s=wall_s,
        extrapolates=extrapolates,
        in_claws=counts.in_claw,
        in_trays_untouched=counts.in_tray - counts.ploughed,
        in_trays_ploughed=counts.ploughed,
    )


def success_intervals(in_cups: int, P: int, D: int, T: int, *, seedlings: int) -> dict[str, tuple[float, float]]:  # noqa: N803
    """Return the confidence intervals of S, F_p, F_d and F_t, percent; arguments as in `TrialReport`."""
    counts = {"S": in_cups, "F_p": P, "F_d": D, "F_t": T}
    return {name: Proportion(count, seedlings).interval_percent for name, count in counts.items()}


def _percent(count: int, total: int) -> float:
    return 100 * count / total if total else 0.0


def _gap_causes(cycles: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Return the number of missed cups by cause."""
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
