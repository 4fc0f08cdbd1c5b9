"""Reports of the second table: a row per stop and switch as Markdown, its cases as CSV and JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from controller.common.document.parts import Heading, Part, listing
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.fault_matrix.at_rest import RestOutcome
from plant_sim.fault_matrix.rest_expected import complaints, expectation_at_rest
from plant_sim.fault_matrix.situations import Situation
from plant_sim.fault_matrix.stops import STOPS
from plant_sim.fault_matrix.table_files import bullets, counted_names, extent, write_table

HEADING = ("stop", "fault", "runs", "first signal", "harm", "lost", "repairs", "findings")
COLUMNS = (
    "stop",
    "at_ms",
    "fault",
    "switches",
    "memory",
    "first_signal",
    "after_ms",
    "state",
    "repairs",
    "lost",
    "monitors",
    "reason",
    "findings",
)


class RestResult(NamedTuple):
    """Case with its rest situation and its outcome.

    Attributes:
        situation: Rest situation; without switches and memory if the moments were chosen regardless of them.
        outcome: The outcome.
    """

    situation: Situation
    outcome: RestOutcome

    @property
    def fault(self) -> str:
        """Kind and switch, without the side; empty for the stop without a fault."""
        case = self.outcome.case
        return f"{case.kind}:{case.switch}" if case.kind else ""

    @property
    def findings(self) -> list[str]:
        """Deviations from the expectation."""
        return complaints(self.outcome)


def parts(results: Sequence[RestResult]) -> list[Part]:
    """Return the page of the table: the table, the limits of detection and the findings."""
    rows: dict[tuple[int, str], list[RestResult]] = {}
    order = {stop.name: number for number, stop in enumerate(STOPS)}
    for result in results:
        rows.setdefault((order[result.situation.stop], result.fault), []).append(result)
    cells = (_cells(STOPS[number].name, fault, rows[number, fault]) for number, fault in sorted(rows))
    notes = {
        f"`{result.fault or result.situation.stop}`: {note}"
        for result in results
        if (note := expectation_at_rest(result.outcome.case).note)
    }
    limits: list[Part] = [Heading("Limits of detection at rest", 3), bullets(sorted(notes))] if notes else []
    return [
        listing(HEADING, cells),
        *limits,
        Heading("Findings at rest", 3),
        bullets(all_findings(results)),
    ]


def all_findings(results: Iterable[RestResult]) -> list[str]:
    """Return all findings, one line each, beginning with the stop, its moment and the fault."""
    return [
        f"{result.situation.stop} at {result.outcome.case.at_ms} ms, {result.outcome.case.name}: {finding}"
        for result in results
        for finding in result.findings
    ]


def records(results: Iterable[RestResult]) -> list[dict[str, object]]:
    """Return every case as one flat record."""
    return [_record(result) for result in results]


def write_report(results: Sequence[RestResult], folder: Path, provenance: Provenance | None = None) -> list[Path]:
    """Write the table to a folder; return the files.

    Raises:
        InputError: The folder is not writable.
    """
    title = "Fault matrix at rest"
    return write_table(
        folder / "fault-matrix-at-rest", title, parts(results), records(results), COLUMNS, provenance=provenance
    )


def summary(results: Sequence[RestResult], wall_s: float) -> str:
    """Return a summary of the table as text."""
    faulty = [result for result in results if result.fault]
    situations = len({result.situation for result in results})
    told = sum(bool(result.outcome.signal) for result in faulty)
    findings = all_findings(results)
    by_kind = Counter(
        (result.fault, result.situation.stop, _kind(finding)) for result in results for finding in result.findings
    )
    return "\n".join(
        [
            f"{situations} rest situations, {len(faulty)} cases in {wall_s:.0f} s: {told} with a signal, "
            f"{sum(result.outcome.is_harmed for result in faulty)} with harm",
            f"findings: {len(findings) or 'none'}",
            *(f"{count:5d}  {fault}, {stop}: {kind}" for (fault, stop, kind), count in sorted(by_kind.items())),
        ]
    )


def _kind(finding: str) -> str:
    """Return the beginning of a finding, up to the first detail."""
    return finding.partition(":")[0].partition(";")[0]


def _record(result: RestResult) -> dict[str, object]:
    outcome = result.outcome
    return {
        "stop": result.situation.stop,
        "at_ms": outcome.case.at_ms,
        "fault": outcome.case.name,
        "switches": [*result.situation.switches],
        "memory": [*result.situation.memory],
        "first_signal": outcome.signal,
        "after_ms": outcome.signal_after_ms if outcome.signal else None,
        "state": outcome.state,
        "repairs": outcome.rounds,
        "lost": outcome.lost,
        "monitors": [f"{kind}: {text}" for kind, text in outcome.trips.items()],
        "reason": outcome.reason,
        "findings": result.findings,
    }


def _cells(stop: str, fault: str, results: Sequence[RestResult]) -> tuple[str, ...]:
    outcomes = [result.outcome for result in results]
    findings = sum(len(result.findings) for result in results)
    return (
        stop,
        f"`{fault}`" if fault else "none",
        str(len(outcomes)),
        counted_names(outcome.signal for outcome in outcomes if outcome.signal) or "-",
        counted_names(kind for outcome in outcomes for kind in outcome.trips) or "-",
        extent([outcome.lost for outcome in outcomes]),
        extent([outcome.rounds for outcome in outcomes]),
        str(findings) if findings else "-",
    )
