"""Reports of the third table: a row per remedy, condition, arm and device as Markdown, its cases as CSV and JSON."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from controller.common.document.parts import Heading, Part, listing
from controller.common.document.rendering import aligned
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.fault_matrix.stored_air import CONDITIONS, AirOutcome
from plant_sim.fault_matrix.table_files import bullets, write_table

HEADING = ("remedy", "condition", "arm", "device", "runs", "slide m/s", "lift m/s", "jump mm", "lost", "not as wanted")
COLUMNS = (
    "remedy",
    "condition",
    "arm",
    "device",
    "at_ms",
    "slide_m_s",
    "lift_m_s",
    "jump_mm",
    "lost",
    "too_fast",
    "monitors",
    "reason",
)


class AirResult(NamedTuple):
    """Case with its remedy and its outcome.

    Attributes:
        remedy: Name in `REMEDIES`.
        outcome: The outcome.
    """

    remedy: str
    outcome: AirOutcome

    @property
    def finding(self) -> str:
        """Deviation from the wanted outcome as one line; empty if there is none, or if no remedy helps."""
        case, outcome = self.outcome.case, self.outcome
        if outcome.is_good or self.remedy == "none" or not CONDITIONS[case.condition].is_remedied:
            return ""
        device = f", {case.drive} jammed" if case.drive else ""
        problems = [f"{drive} too fast" for drive in outcome.too_fast] + [*outcome.trips]
        problems += [f"{outcome.lost} lost"] if outcome.lost else []
        problems += [outcome.reason] if outcome.reason else []
        return f"{self.remedy}: {case.condition}, {case.side} arm at {case.at_ms} ms{device}: {'; '.join(problems)}"


def parts(results: Sequence[AirResult]) -> list[Part]:
    """Return the page of the table: the table and the findings."""
    rows: dict[tuple[str, str, str, str], list[AirOutcome]] = {}
    for result in results:
        case = result.outcome.case
        rows.setdefault((result.remedy, case.condition, case.side, case.drive), []).append(result.outcome)
    cells = ((*key[:3], key[3] or "-", *_cells(outcomes)) for key, outcomes in rows.items())
    return [listing(HEADING, cells), Heading("Findings with stored air", 3), bullets(all_findings(results))]


def all_findings(results: Iterable[AirResult]) -> list[str]:
    """Return all findings, one line each."""
    return [result.finding for result in results if result.finding]


def records(results: Iterable[AirResult]) -> list[dict[str, object]]:
    """Return every case as one flat record."""
    return [_record(result) for result in results]


def write_report(results: Sequence[AirResult], folder: Path, provenance: Provenance | None = None) -> list[Path]:
    """Write the table to a folder; return the files.

    Raises:
        InputError: The folder is not writable.
    """
    return write_table(
        folder / "stored-air", "Stored air", parts(results), records(results), COLUMNS, provenance=provenance
    )


def summary(results: Sequence[AirResult], wall_s: float) -> str:
    """Return a summary of the table as text, with a line per remedy and condition."""
    groups: dict[tuple[str, str], list[AirOutcome]] = {}
    for result in results:
        groups.setdefault((result.remedy, result.outcome.case.condition), []).append(result.outcome)
    findings = all_findings(results)
    rows = [
        (
            f"{remedy}: {condition}",
            f"slide {_fastest(outcomes, 'slide')} m/s, lift {_fastest(outcomes, 'lift')} m/s, "
            f"{sum(not each.is_good for each in outcomes)} of {len(outcomes)} not as wanted",
        )
        for (remedy, condition), outcomes in groups.items()
    ]
    heading = f"{len(results)} cases in {wall_s:.0f} s"
    return "\n".join([heading, *aligned(rows), f"findings: {len(findings) or 'none'}", *findings])


def _record(result: AirResult) -> dict[str, object]:
    case, outcome = result.outcome.case, result.outcome
    return {
        "remedy": result.remedy,
        "condition": case.condition,
        "arm": case.side,
        "device": case.drive,
        "at_ms": case.at_ms,
        "slide_m_s": round(outcome.slide_m_s, 3),
        "lift_m_s": round(outcome.lift_m_s, 3),
        "jump_mm": round(1e3 * outcome.jump_m, 1),
        "lost": outcome.lost,
        "too_fast": [*outcome.too_fast],
        "monitors": [f"{kind}: {text}" for kind, text in outcome.trips.items()],
        "reason": outcome.reason,
    }


def _cells(outcomes: Sequence[AirOutcome]) -> tuple[str, ...]:
    unwanted = sum(not outcome.is_good for outcome in outcomes)
    return (
        str(len(outcomes)),
        _fastest(outcomes, "slide"),
        _fastest(outcomes, "lift"),
        f"{1e3 * max(outcome.jump_m for outcome in outcomes):.0f}",
        str(sum(outcome.lost for outcome in outcomes)),
        str(unwanted) if unwanted else "-",
    )


def _fastest(outcomes: Iterable[AirOutcome], drive: str) -> str:
    return f"{max(getattr(outcome, f'{drive}_m_s') for outcome in outcomes):.2f}"
