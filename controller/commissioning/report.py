"""Report of a check to sign: Markdown in one language, and a CSV file that does not depend on the language."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from controller.commissioning.judge import UNTESTED, WireFinding, WireResult
from controller.commissioning.texts import NOTES, REPORT, RESULTS, point_name, said
from controller.common.document.parts import listing
from controller.common.document.rendering import csv_text, markdown
from controller.common.errors import InputError
from controller.common.modbus.io_map import IoMap, Point
from controller.core.clock import utc_text
from controller.iomap.digest import map_digest
from controller.program.texts.operator import Language

COLUMNS = ("address", "tag", "result", "others", "note", "at_utc")


@dataclass
class CheckReport:
    """Results of a check.

    Attributes:
        io_map: I/O map.
        points: Points that were to be checked.
        machine: Name of the machine.
        field_io: Address of the field I/O.
        program: Name and version of the program.
        tester: Name of the person; empty = to be filled in.
        begun_ms: Begin, ms since 1970 UTC.
        ended_ms: End, ms since 1970 UTC.
        watchdog_confirmed: True if the person has confirmed the output watchdog and the emergency stop.
        end: Key of the text that states how the check ended.
        findings: Results by tag.
        at_ms: Time of each result, ms since 1970 UTC.
    """

    io_map: IoMap
    points: Sequence[Point]
    machine: str
    field_io: str
    program: str
    tester: str
    begun_ms: int
    ended_ms: int = 0
    watchdog_confirmed: bool = False
    end: str = "stopped"
    findings: dict[str, WireFinding] = field(default_factory=dict)
    at_ms: dict[str, int] = field(default_factory=dict)

    def add(self, tag: str, finding: WireFinding, at_ms: int) -> None:
        """Record the result of a point; a later result replaces an earlier one."""
        self.findings[tag] = finding
        self.at_ms[tag] = at_ms

    @property
    def is_clean(self) -> bool:
        """True if every point was checked and is correct."""
        return all(self.finding(point.tag).result is WireResult.OK for point in self.points)

    def finding(self, tag: str) -> WireFinding:
        """Return the result of a point."""
        return self.findings.get(tag, UNTESTED)

    def csv_text(self) -> str:
        """Return the results as CSV."""
        return csv_text(COLUMNS, map(self._record, self.points))

    def _record(self, point: Point) -> tuple[str, ...]:
        found = self.finding(point.tag)
        others = " ".join(self.io_map[tag].address for tag in found.others)
        return point.address, point.tag, found.result.value, others, found.note, self._at(point)

    def markdown(self, language: Language) -> str:
        """Return the report with lines for signatures."""

        def t(key: str, **values: str) -> str:
            return said(REPORT[key], language, **values)

        results = [self.finding(point.tag).result for point in self.points]
        ok, left = results.count(WireResult.OK), results.count(WireResult.NOT_TESTED)
        counts = {"ok": ok, "all": len(results), "faults": len(results) - ok - left, "left": left}
        head = {
            "machine": self.machine,
            "field": self.field_io,
            "io_map": map_digest(self.io_map),
            "program": self.program,
            "begun": utc_text(self.begun_ms),
            "ended": utc_text(self.ended_ms),
            "watchdog": t("yes" if self.watchdog_confirmed else "no"),
            "end": t(self.end),
        }
        people = [(t("tester"), self.tester), (t("witness"), "")]
        parts = (
            "\n".join(f"- {t(key)}: {value}" for key, value in head.items()),
            f"**{t('summary', **{name: str(count) for name, count in counts.items()})}**",
            listing(
                (t(column) for column in ("address", "name", "result", "note", "at")),
                (self._row(point, language) for point in self.points),
            ),
            listing(
                ("", t("name") if language == "en" else "姓名", t("date"), t("signature")),
                ((role, name or "&nbsp;", "&nbsp;", "&nbsp;") for role, name in people),
            ),
        )
        return markdown(t("title"), parts, is_literal=False)

    def _row(self, point: Point, language: Language) -> tuple[str, ...]:
        found = self.finding(point.tag)
        return (
            point.address,
            point_name(point.tag, language),
            result_text(self.io_map, found, language),
            note_text(found, language),
            self._at(point),
        )

    def _at(self, point: Point) -> str:
        return utc_text(self.at_ms[point.tag]) if point.tag in self.at_ms else ""


def result_text(io_map: IoMap, found: WireFinding, language: Language) -> str:
    """Return a result with the addresses of the other points that reacted."""
    others = ", ".join(io_map[tag].address for tag in found.others) or "?"
    return said(RESULTS[found.result], language, others=others)


def note_text(found: WireFinding, language: Language) -> str:
    """Return the remark on a result; empty if there is none."""
    return said(NOTES[found.note], language) if found.note else ""


def write_report(report: CheckReport, folder: Path, language: Language) -> Path:
    """Write both files, named by the time of the begin, and return the path of the Markdown file.

    The folder need not exist.

    Raises:
        InputError: The files cannot be written.
    """
    stem = "check-io-" + utc_text(report.begun_ms).replace(":", "").replace("-", "")
    texts: Mapping[str, str] = {".md": report.markdown(language), ".csv": report.csv_text()}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for ending, text in texts.items():
            part = folder / f"{stem}{ending}.part"
            part.write_text(text, encoding="utf-8")
            part.replace(folder / f"{stem}{ending}")
    except OSError as error:
        raise InputError(f"--out {folder}: {error.strerror}; choose a writable folder") from error
    return folder / f"{stem}.md"
