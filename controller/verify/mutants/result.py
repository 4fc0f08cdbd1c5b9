"""Results of mutants, the mutation score, and the list of survivors that are judged by a person."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Final

from controller.verify.mutants.change import Kind


class Fate(StrEnum):
    """Result of a mutant."""

    PROOF = "killed by proof"
    STORY = "killed by a story"
    TEST = "killed by a test of the program"
    EQUIVALENT = "equivalent"
    DISPLAY = "no effect on outputs"
    BLOCKED = "blocked by a rule"
    DURATION = "duration"
    LIVENESS = "liveness"
    REDUNDANT = "redundant"
    GAP = "gap"
    OPEN = "not classified"


KILLED: Final = (Fate.PROOF, Fate.STORY, Fate.TEST)
JUDGED: Final = (Fate.DISPLAY, Fate.DURATION, Fate.LIVENESS, Fate.REDUNDANT, Fate.GAP, Fate.TEST)
"""Results that the list of survivors may contain; equivalence and blocking rules are proved, never listed."""


@dataclass(frozen=True, slots=True)
class MutantResult:
    """Result of one mutant.

    Attributes:
        name: Block and description of the change.
        kind: Kind of change.
        fate: Result.
        evidence: Violated goal, story with the difference, proof, or reason.
    """

    name: str
    kind: Kind
    fate: Fate
    evidence: str = ""


def listed_survivors(path: Path) -> dict[str, tuple[Fate, str]]:
    """Return the class and the reason of each listed survivor, by name of the mutant.

    Args:
        path: CSV file with the columns mutant, class and reason.

    Raises:
        ValueError: A row has a class that must be proved, or no reason.
    """
    found: dict[str, tuple[Fate, str]] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for number, row in enumerate(csv.DictReader(file), start=2):
            fate = Fate(row["class"])
            if fate not in JUDGED or not row["reason"].strip():
                classes = ", ".join(JUDGED)
                raise ValueError(f"{path.name}, line {number}: use one of the classes {classes}, and give a reason")
            found[row["mutant"]] = fate, row["reason"]
    return found


def with_listed(results: Iterable[MutantResult], listed: Mapping[str, tuple[Fate, str]]) -> list[MutantResult]:
    """Return the results, in which unclassified survivors have the class and the reason of the list."""
    return [
        replace(each, fate=listed[each.name][0], evidence=listed[each.name][1])
        if each.fate is Fate.OPEN and each.name in listed
        else each
        for each in results
    ]


def score(results: Iterable[MutantResult]) -> float:
    """Return the mutation score: the share of killed mutants among those that are not equivalent, 0 to 1."""
    counted = [each.fate in KILLED for each in results if each.fate is not Fate.EQUIVALENT]
    return sum(counted) / len(counted) if counted else 1.0


def as_text(results: list[MutantResult], seconds: float) -> str:
    """Return the counts, the score and every survivor as text."""
    fates = Counter(each.fate for each in results)
    lines = [f"{len(results)} mutants, {seconds:.1f} s"]
    lines += [f"  {fate}: {fates[fate]}" for fate in Fate if fates[fate]]
    lines.append(f"mutation score {100 * score(results):.1f} % of the mutants that are not equivalent")
    survivors = [each for each in results if each.fate not in KILLED]
    lines += [
        f"{each.fate}: {each.name} ({each.kind}){f': {each.evidence}' if each.evidence else ''}" for each in survivors
    ]
    return "\n".join(lines)


def as_csv(results: Iterable[MutantResult]) -> str:
    """Return all results as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["mutant", "kind", "result", "evidence"])
    writer.writerows([each.name, each.kind, each.fate, each.evidence] for each in results)
    return text.getvalue()


def as_markdown(results: list[MutantResult], population: Mapping[Kind, int], command: str) -> str:
    """Return the score by kind of change and the table of survivors as a Markdown page.

    Args:
        results: Results of a sample.
        population: Number of all mutants of each kind.
        command: Command that generates the page.
    """
    fates = [fate for fate in Fate if any(each.fate is fate for each in results)]
    heading = ["change", "all mutants", "sample", *fates, "score"]
    rows = [_row(str(kind), population[kind], [e for e in results if e.kind is kind], fates) for kind in Kind]
    rows.append(_row("all", sum(population.values()), results, fates))
    survivors = [
        [each.name, each.fate, each.evidence]
        for fate in Fate
        for each in results
        if each.fate is fate and fate not in (*KILLED, Fate.EQUIVALENT)
    ]
    equivalent = [[each.name] for each in results if each.fate is Fate.EQUIVALENT]
    return "\n".join(
        [
            "# Mutants of the program",
            "",
            f"Generated by `{command}`; do not edit. The results are explained in [proof](../proof.md#mutation-score);",
            "all mutants of the sample with their killers are listed in [mutants.csv](mutants.csv).",
            "",
            "## Score",
            "",
            _table(heading, rows),
            "## Survivors",
            "",
            _table(["mutant", "class", "evidence or reason"], survivors),
            "## Equivalent mutants",
            "",
            "Every device has the same value after every scan.",
            "",
            _table(["mutant"], equivalent),
        ]
    )


def _row(name: str, population: int, results: list[MutantResult], fates: list[Fate]) -> list[object]:
    counts = [sum(each.fate is fate for each in results) for fate in fates]
    return [name, population, len(results), *counts, f"{100 * score(results):.0f} %"]


def _table(heading: Sequence[object], rows: Iterable[Iterable[object]]) -> str:
    lines: list[Iterable[object]] = [heading, ["---"] * len(heading), *rows]
    return "\n".join(f"| {' | '.join(str(cell).replace('|', chr(92) + '|') for cell in row)} |" for row in lines) + "\n"
