"""Reports of the fault matrix: its rows as a Markdown table, its cases as CSV and JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from controller.common.document.parts import Heading, Part, listing
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.fault_matrix.cases import Subject
from plant_sim.fault_matrix.expected import Expectation
from plant_sim.fault_matrix.judge import complaints, expectation
from plant_sim.fault_matrix.run import Outcome
from plant_sim.fault_matrix.table_files import bullets, counted_names, extent, write_table

HEADING = (
    "fault",
    "runs",
    "detected",
    "first signal",
    "after the fault, s",
    "in its step, ms",
    "state",
    "lost",
    "in doubt",
    "recovered",
    "presses",
    "harm",
    "silent harm",
    "monitors",
    "findings",
)
COLUMNS = (
    "fault",
    "detected_by",
    "side",
    "after_ms",
    "step",
    "in_step_ms",
    "limit_ms",
    "state",
    "rounds",
    "asked",
    "alarms",
    "folded",
    "beside",
    "lost",
    "in_doubt",
    "in_cups",
    "P",
    "D",
    "T",
    "recovered",
    "presses",
    "monitors",
    "findings",
)
SIZES_COLUMNS = COLUMNS[:-1]
LEGEND = """\
After the fault: minimum, median and maximum time. In its step: maximum time for which the timed-out step had
been active, and its timeout. Lost: seedlings lost or left behind in excess of those of the undisturbed trial.
Presses: most presses from a stop to Execute of an operator who follows only the line that says what to do now,
without and with an isolation before the repair; in brackets, the most questions answered on the way.
Harm: trials in which a monitor tripped. Silent harm: those of them without any signal until their end."""


@dataclass(frozen=True)
class MatrixRow:
    """Subject and the outcomes of its cases.

    Attributes:
        subject: Kind, part, size.
        outcomes: One outcome per case.
    """

    subject: Subject
    outcomes: Sequence[Outcome]

    @property
    def expected(self) -> Expectation:
        """Expectation of the subject."""
        return expectation(self.subject)

    @property
    def findings(self) -> list[str]:
        """Deviations from the expectation, one line each, beginning with the case."""
        return [
            f"{outcome.fault}: {complaint}"
            for outcome in self.outcomes
            for complaint in complaints(self.subject, outcome)
        ]

    @property
    def harmful(self) -> int:
        """Number of cases in which a monitor tripped."""
        return sum(outcome.is_harmful for outcome in self.outcomes)

    @property
    def silently_harmful(self) -> int:
        """Number of cases in which a monitor tripped and no signal occurred."""
        return sum(outcome.is_silently_harmful for outcome in self.outcomes)

    @property
    def is_detected(self) -> bool:
        """True if a signal occurred in any case."""
        return any(outcome.signal for outcome in self.outcomes)

    def cells(self) -> tuple[str, ...]:
        """Return the cells of the table row."""
        detected = [(outcome.fault, outcome.signal) for outcome in self.outcomes if outcome.signal is not None]
        signals = [signal for _, signal in detected]
        after_s = [(signal.at_ms - fault.start_ms) / 1000 for fault, signal in detected]
        late = max((signal for signal in signals if signal.step), key=lambda signal: signal.in_step_ms, default=None)
        return (
            f"`{self.subject}`",
            str(len(self.outcomes)),
            str(len(detected)),
            counted_names(signal.name for signal in signals) or "-",
            f"{min(after_s):.1f} / {median(after_s):.1f} / {max(after_s):.1f}" if after_s else "-",
            f"{late.in_step_ms} of {late.limit_ms}" if late else "-",
            counted_names(outcome.state for outcome in self.outcomes),
            extent([outcome.lost for outcome in self.outcomes]),
            extent([outcome.in_doubt for outcome in self.outcomes]),
            f"{sum(outcome.recovered for outcome in self.outcomes)} of {len(self.outcomes)}",
            self._presses(),
            str(self.harmful or "-"),
            str(self.silently_harmful or "-"),
            counted_names(kind for outcome in self.outcomes for kind in outcome.trips) or "-",
            str(len(self.findings)) if self.findings else "-",
        )

    def _presses(self) -> str:
        """Return the most presses without and with an isolation, and the most questions."""
        followed = [each for outcome in self.outcomes for each in outcome.followed]
        if not followed:
            return "-"
        most = " / ".join(
            str(max(each.presses for each in followed if each.isolated is isolated)) for isolated in (False, True)
        )
        questions = max(each.questions for each in followed)
        return f"{most} ({questions})" if questions else most


def headline(rows: Sequence[MatrixRow]) -> str:
    """Return the numbers of faults and trials, of signals, of recovered trials, and of harm."""
    outcomes = [outcome for row in rows for outcome in row.outcomes]
    harmful = [row for row in rows if row.harmful]
    silent = [row for row in rows if row.silently_harmful]
    never = sum(not row.is_detected for row in silent)
    signalled = sum(outcome.signal is not None for outcome in outcomes)
    recovered = sum(outcome.recovered for outcome in outcomes)
    return (
        f"{len(rows)} faults, {len(outcomes):,} trials: {signalled:,} with a signal, {recovered:,} recovered. "
        f"Harm by {len(harmful)} faults in {sum(row.harmful for row in rows)} trials; "
        f"silent harm by {len(silent)} faults in {sum(row.silently_harmful for row in rows)} trials, "
        f"{never} of these faults never signalled."
    )


def alarm_load(rows: Sequence[MatrixRow]) -> str:
    """Return the numbers of alarms within ten minutes, and of trials with alarms folded under or beside the first."""
    outcomes = [outcome for row in rows for outcome in row.outcomes]
    most = max(outcomes, key=lambda outcome: outcome.alarms)
    trials = Counter(outcome.alarms for outcome in outcomes)
    counts = ", ".join(f"{number} in {trials[number]:,} trials" for number in sorted(trials))
    folded, beside = sum(bool(o.folded) for o in outcomes), sum(bool(o.beside) for o in outcomes)
    return (
        f"Alarms within ten minutes: {counts} (most with `{most.fault}`). Before the operator acts: alarms folded "
        f"under the first one in {folded} trials, alarms beside it in {beside} trials."
    )


def sizes_parts(rows: Sequence[MatrixRow]) -> list[Part]:
    """Return the page of other sizes, which have no expectation: the headline and the matrix."""
    return [headline(rows), listing(HEADING[:-1], (row.cells()[:-1] for row in rows)), LEGEND]


def parts(rows: Sequence[MatrixRow]) -> list[Part]:
    """Return the page of the matrix: the headline, the matrix, the limits of detection and the findings."""
    notes = [f"`{row.subject}`: {row.expected.note}" for row in rows if row.expected.note]
    limits: list[Part] = [Heading("Limits of detection"), bullets(notes)] if notes else []
    return [
        headline(rows),
        alarm_load(rows),
        listing(HEADING, (row.cells() for row in rows)),
        LEGEND,
        *limits,
        Heading("Findings"),
        bullets(finding for row in rows for finding in row.findings),
    ]


def records(rows: Iterable[MatrixRow]) -> list[dict[str, object]]:
    """Return every case as one flat record."""
    return [_record(row.subject, outcome) for row in rows for outcome in row.outcomes]


def write_report(rows: Sequence[MatrixRow], folder: Path, provenance: Provenance | None = None) -> list[Path]:
    """Write the matrix to a folder; return the files.

    Raises:
        InputError: The folder is not writable.
    """
    return write_table(
        folder / "fault-matrix", "Fault matrix", parts(rows), records(rows), COLUMNS, provenance=provenance
    )


def write_sizes_report(rows: Sequence[MatrixRow], folder: Path, provenance: Provenance | None = None) -> list[Path]:
    """Write the matrix of other sizes to a folder; return the files.

    Raises:
        InputError: The folder is not writable.
    """
    title = "Fault matrix: other sizes"
    listed = [{name: value for name, value in record.items() if name in SIZES_COLUMNS} for record in records(rows)]
    return write_table(
        folder / "fault-matrix-sizes", title, sizes_parts(rows), listed, SIZES_COLUMNS, provenance=provenance
    )


def summary(rows: Sequence[MatrixRow], wall_s: float) -> str:
    """Return a summary of the matrix as text."""
    findings = [finding for row in rows for finding in row.findings]
    return "\n".join([*_overview(rows, wall_s), f"findings: {len(findings) or 'none'}", *findings])


def sizes_summary(rows: Sequence[MatrixRow], wall_s: float) -> str:
    """Return a summary of the matrix of other sizes as text."""
    return "\n".join(_overview(rows, wall_s))


def _overview(rows: Sequence[MatrixRow], wall_s: float) -> list[str]:
    silent = [row for row in rows if row.silently_harmful]
    return [
        headline(rows),
        f"duration: {wall_s:.0f} s",
        f"without a signal: {', '.join(str(row.subject) for row in rows if not row.is_detected) or 'none'}",
        f"silent harm: {', '.join(str(row.subject) for row in silent) or 'none'}",
        alarm_load(rows),
    ]


def _record(subject: Subject, outcome: Outcome) -> dict[str, object]:
    signal, counts = outcome.signal, outcome.counts
    return {
        "fault": str(outcome.fault),
        "detected_by": signal.name if signal else "",
        "side": signal.side if signal else "",
        "after_ms": signal.at_ms - outcome.fault.start_ms if signal else None,
        "step": signal.step if signal else "",
        "in_step_ms": signal.in_step_ms if signal and signal.step else None,
        "limit_ms": signal.limit_ms if signal and signal.step else None,
        "state": outcome.state,
        "rounds": outcome.rounds,
        "asked": outcome.asked,
        "alarms": outcome.alarms,
        "folded": outcome.folded,
        "beside": outcome.beside,
        "lost": outcome.lost,
        "in_doubt": outcome.in_doubt,
        "in_cups": counts.in_cups,
        "P": counts.P,
        "D": counts.D,
        "T": counts.T,
        "recovered": outcome.recovered,
        "presses": [str(each.presses) for each in outcome.followed],
        "monitors": [f"{kind}: {text}" for kind, text in outcome.trips.items()],
        "findings": complaints(subject, outcome),
    }
