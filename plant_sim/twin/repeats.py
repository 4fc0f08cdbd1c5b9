"""Trials repeated with consecutive seeds, and their pooled result as a table, CSV and JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import Any, Final

from plant_sim.common.provenance.provenance import Provenance
from plant_sim.common.provenance.result_files import csv_with_provenance
from plant_sim.twin.report import TrialReport, success_intervals

SHARES: Final = {"S": "in_cups", "F_p": "P", "F_d": "D", "F_t": "T"}
"""Rates (percentages of the seedlings) and the counts from which they are computed."""
_COLUMNS = ("seed", "seedlings", *SHARES.values())
_REST = ("missed_cups", "cycles", "cycle_time_s", "air_l_min", "simulated_s", "extrapolates")


@dataclass(frozen=True, slots=True)
class Pool:
    """Pooled counts of several trials.

    Attributes:
        trials: Number of trials.
        seedlings: Number of seedlings.
        counts: Seedlings in cups and seedlings lost while picking, carrying and throwing, by name of the rate.
    """

    trials: int
    seedlings: int
    counts: Mapping[str, int]

    @property
    def shares(self) -> dict[str, float]:
        """S, F_p, F_d and F_t, %."""
        return {name: 100 * count / self.seedlings for name, count in self.counts.items()}

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Exact binomial 95 % confidence intervals of the rates, %."""
        return success_intervals(*(self.counts[name] for name in SHARES), seedlings=self.seedlings)


def pool(reports: Sequence[TrialReport]) -> Pool:
    """Pool the counts of trials.

    Args:
        reports: The trials, at least one.
    """
    counts = {name: sum(getattr(report, count) for report in reports) for name, count in SHARES.items()}
    return Pool(len(reports), sum(report.seedlings for report in reports), counts)


@dataclass(frozen=True)
class Repeats:
    """Repeated trials with the same settings.

    Attributes:
        reports: Trial reports in the order of the seeds.
    """

    reports: Sequence[TrialReport]

    @property
    def completed(self) -> bool:
        """True if every trial reached Complete."""
        return all(report.completed for report in self.reports)

    @property
    def accounted(self) -> bool:
        """True if every seedling of every trial is counted exactly once."""
        return all(report.accounted for report in self.reports)

    def pooled(self) -> dict[str, object] | None:
        """Return counts, rates (percent) and 95 % binomial intervals of all seedlings, and mean S.

        Only completed trials are included; None if no trial completed.
        """
        completed = [report for report in self.reports if report.completed]
        if not completed:
            return None
        total = pool(completed)
        successes = [report.S for report in completed]
        return {
            "trials": total.trials,
            "seedlings": total.seedlings,
            **{SHARES[name]: count for name, count in total.counts.items()},
            **total.shares,
            "intervals": total.intervals,
            "S_mean": fmean(successes),
            "S_sd": stdev(successes) if len(successes) > 1 else None,
        }

    def record(self) -> dict[str, object]:
        """Return trials and pooled result as one JSON object."""
        return {"trials": [report.record() for report in self.reports], "pooled": self.pooled()}

    def untimed_record(self) -> dict[str, object]:
        """Return `record` without the durations of the runs: equal trials give equal records."""
        trials = [{name: each for name, each in report.record().items() if name != "wall_s"} for report in self.reports]
        return {**self.record(), "trials": trials}

    def csv(self, provenance: Provenance | None = None) -> str:
        """Return `table` as CSV, with the provenance in the last column."""
        return csv_with_provenance(*self.table(), provenance)

    def table(self) -> tuple[list[str], list[list[object]]]:
        """Return a header and one row per trial; the columns of the intervals are `S_low`, `S_high` and so on.

        The rates of an incomplete trial are left empty.
        """
        rows: list[list[object]] = []
        for report in self.reports:
            shares = [getattr(report, name) for name in SHARES]
            shares += [end for name in SHARES for end in report.intervals[name]]
            cells = shares if report.completed else [None] * len(shares)
            counts, rest = ([getattr(report, name) for name in names] for names in (_COLUMNS, _REST))
            rows.append([*counts, *cells, *rest, report.completed])
        ends = [f"{name}_{end}" for name in SHARES for end in ("low", "high")]
        return [*_COLUMNS, *SHARES, *ends, *_REST, "completed"], rows

    def text(self) -> str:
        """Return the trials as a text table."""
        heading = f"{'seed':>6} {'seedlings':>9} {'in cups':>8} {'P':>4} {'D':>4} {'T':>4} {'S %':>6}  95 % binomial"
        lines = [heading, *map(_line, self.reports)]
        pooled: dict[str, Any] | None = self.pooled()
        if pooled is not None:
            lines.append(self._all(pooled))
        lines += [
            f"seed {report.seed}: the trial did not complete, so it has no S: {report.reason}"
            for report in self.reports
            if not report.completed
        ]
        return "\n".join(lines)

    def _all(self, pooled: Mapping[str, Any]) -> str:
        """Return the line of the pooled trials."""
        intervals = pooled["intervals"]
        shares = "  ".join(
            f"{name} {pooled[name]:.2f} % ({intervals[name][0]:.2f} to {intervals[name][1]:.2f})" for name in SHARES
        )
        trials = "" if self.completed else f" of the trials that completed, {pooled['trials']} of {len(self.reports)}"
        spread = (
            ""
            if pooled["S_sd"] is None
            else f"; S of a trial {pooled['S_mean']:.2f} %, standard deviation {pooled['S_sd']:.2f} %"
        )
        return f"all {pooled['seedlings']} seedlings{trials}: {shares}, 95 % binomial{spread}"


def _line(report: TrialReport) -> str:
    """Return the line of a trial."""
    counts = f"{report.seed:6} {report.seedlings:9} {report.in_cups:8} {report.P:4} {report.D:4} {report.T:4}"
    if not report.completed:
        return f"{counts} {'-':>6}"
    low, high = report.intervals["S"]
    return f"{counts} {report.S:6.1f}  {low:.1f} to {high:.1f}"
