"""Report of the matrix without and with the yield inputs: silent harm, the inputs that tell it, and their faults."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from controller.common.document.parts import Heading, Part, listing
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.fault_matrix.report import COLUMNS, HEADING, LEGEND, MatrixRow, headline, records
from plant_sim.fault_matrix.table_files import bullets, counted_names, extent, write_table
from plant_sim.fault_matrix.yield_inputs.fitted import YIELD_INPUTS, YieldResult, is_silent, silent_rows

TELLS_HEADING: Final = (
    "fault",
    "runs",
    "silent harm, without",
    "with",
    "detected, without",
    *(f"{name} alone" for name in YIELD_INPUTS.values()),
    "with all",
    "first signal with all",
    "lost silently, without",
    "with all",
)
"""Column titles of the table of rows that harm or lose seedlings without a signal."""
TELLS_LEGEND: Final = """\
Silent harm: trials in which a monitor tripped without any signal. Detected: trials with a signal, with no yield input,
with one kind of them on both arms, and with all. Lost silently: seedlings lost in trials without a signal."""
OWN_HEADING: Final = ("fault", "runs", "detected", "first signal", "lost", "harm", "findings")


def silent_harm(rows: Sequence[MatrixRow]) -> str:
    """Return the number of faults and trials with silent harm, and the faults by name."""
    silent = [row for row in rows if row.silently_harmful]
    trials = sum(row.silently_harmful for row in silent)
    lost = sum(outcome.lost for row in silent for outcome in row.outcomes if outcome.is_silently_harmful)
    names = ", ".join(f"`{row.subject}`" for row in silent) or "none"
    return f"{len(silent)} faults in {trials} trials, with {lost} seedlings lost in them ({names})"


def parts(result: YieldResult) -> list[Part]:
    """Return the page: the headlines, the rows that the inputs tell, their own faults and the complete matrix."""
    return [
        f"Without the inputs: {headline(result.without)}",
        f"With all of them: {headline(result.fitted)}",
        f"Silent harm without the inputs: {silent_harm(result.without)}. With all of them: "
        f"{silent_harm(result.fitted)}.",
        listing(TELLS_HEADING, _telling_cells(result)),
        TELLS_LEGEND,
        Heading("Faults of the yield inputs", 3),
        headline(result.own),
        listing(OWN_HEADING, map(_own_cells, result.own)),
        Heading("Complete matrix with the yield inputs", 3),
        listing(HEADING, (row.cells() for row in result.fitted)),
        LEGEND,
        Heading("Findings with the yield inputs", 3),
        bullets(result.findings),
    ]


def summary(result: YieldResult, wall_s: float) -> str:
    """Return a summary as text."""
    return "\n".join(
        [
            f"without the yield inputs: {headline(result.without)}",
            f"with the yield inputs: {headline(result.fitted)}",
            f"silent harm without them: {silent_harm(result.without)}",
            f"silent harm with them: {silent_harm(result.fitted)}",
            f"faults of the inputs: {headline(result.own)}",
            f"duration: {wall_s:.0f} s",
            f"findings: {len(result.findings) or 'none'}",
            *result.findings,
        ]
    )


def write_report(result: YieldResult, folder: Path, provenance: Provenance | None = None) -> list[Path]:
    """Write the page, and the cases with all yield inputs, to a folder; return the files.

    Raises:
        InputError: The folder is not writable.
    """
    cases = records([*result.fitted, *result.own])
    title = "Fault matrix: with the yield inputs"
    return write_table(folder / "fault-matrix-yield", title, parts(result), cases, COLUMNS, provenance=provenance)


def _telling_cells(result: YieldResult) -> list[tuple[str, ...]]:
    without = {row.subject: row for row in result.without}
    fitted = {row.subject: row for row in result.fitted}
    single = [{row.subject: row for row in rows} for rows in result.single.values()]
    return [
        (
            f"`{subject}`",
            str(len(without[subject].outcomes)),
            str(without[subject].silently_harmful or "-"),
            str(fitted[subject].silently_harmful or "-"),
            _detected(without[subject]),
            *(_detected(rows[subject]) for rows in single),
            _detected(fitted[subject]),
            _signals(fitted[subject]),
            _lost_silently(without[subject]),
            _lost_silently(fitted[subject]),
        )
        for subject in silent_rows(result.without)
    ]


def _own_cells(row: MatrixRow) -> tuple[str, ...]:
    return (
        f"`{row.subject}`",
        str(len(row.outcomes)),
        _detected(row),
        _signals(row),
        extent([outcome.lost for outcome in row.outcomes]),
        str(row.harmful or "-"),
        str(len(row.findings) or "-"),
    )


def _detected(row: MatrixRow) -> str:
    return str(sum(outcome.signal is not None for outcome in row.outcomes))


def _signals(row: MatrixRow) -> str:
    return counted_names(outcome.signal.name for outcome in row.outcomes if outcome.signal is not None) or "-"


def _lost_silently(row: MatrixRow) -> str:
    return str(sum(outcome.lost for outcome in row.outcomes if is_silent(outcome)) or "-")
