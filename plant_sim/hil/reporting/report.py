"""Reports of a run: text, JUnit XML, and HTML with a timing diagram of every case."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree

from controller.common.document.parts import Heading, InlineDrawing, Part, Table
from controller.common.document.rendering import html as document
from plant_sim.common.provenance.provenance import KEY, Provenance
from plant_sim.common.provenance.result_files import ResultFiles
from plant_sim.hil.bench_run import CaseResult, CaseVerdict


def line(result: CaseResult) -> str:
    """Return one line of text on a case."""
    text = f"{result.verdict:<8} {result.group}: {result.name}"
    details = findings(result)
    return f"{text} ({details})" if details else text


def findings(result: CaseResult) -> str:
    """Return the reasons and the measured values of a case as text."""
    figures = ", ".join(f"{name} {figure.text}" for name, figure in result.figures.items())
    return "; ".join(filter(None, (*result.reasons, figures)))


def summary(results: Sequence[CaseResult]) -> str:
    """Return the numbers of cases by verdict."""
    return ", ".join(f"{sum(each.verdict is verdict for each in results)} {verdict}" for verdict in CaseVerdict)


def junit(results: Sequence[CaseResult], *, about: str, provenance: Provenance | None = None) -> bytes:
    """Return the results as JUnit XML with one suite for each group; times are in seconds of plant time.

    The provenance is a property of each suite.
    """
    root = ElementTree.Element("testsuites", {"name": about, **_totals(results)})
    for group in dict.fromkeys(each.group for each in results):
        own = [each for each in results if each.group == group]
        suite = ElementTree.SubElement(root, "testsuite", {"name": group, **_totals(own)})
        if provenance is not None:
            properties = ElementTree.SubElement(suite, "properties")
            ElementTree.SubElement(properties, "property", name=KEY, value=provenance.text)
        for each in own:
            seconds = f"{(each.to_ms - each.from_ms) / 1_000:.3f}"
            case = ElementTree.SubElement(suite, "testcase", classname=group, name=each.name, time=seconds)
            if each.figures:
                properties = ElementTree.SubElement(case, "properties")
                for name, figure in each.figures.items():
                    ElementTree.SubElement(properties, "property", name=name, value=figure.text)
            if each.verdict is CaseVerdict.FAILED:
                ElementTree.SubElement(case, "failure", message=each.reasons[0]).text = "\n".join(each.reasons)
            elif each.verdict is CaseVerdict.NOT_RUN:
                ElementTree.SubElement(case, "skipped", message="; ".join(each.reasons))
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"


def _totals(results: Sequence[CaseResult]) -> dict[str, str]:
    failed = sum(each.verdict is CaseVerdict.FAILED for each in results)
    skipped = sum(each.verdict is CaseVerdict.NOT_RUN for each in results)
    seconds = sum(each.to_ms - each.from_ms for each in results) / 1_000
    return {
        "tests": str(len(results)),
        "failures": str(failed),
        "errors": "0",
        "skipped": str(skipped),
        "time": f"{seconds:.3f}",
    }


def page(
    results: Sequence[CaseResult],
    *,
    about: str,
    facts: Iterable[str],
    picture: Callable[[CaseResult], str],
    provenance: Provenance | None = None,
) -> str:
    """Return the results as one HTML page that contains its pictures.

    Args:
        results: Results.
        about: Title.
        facts: Lines on the controller, the link and the machine.
        picture: Function that returns the SVG text of a case.
        provenance: Provenance of the results.
    """
    headings = [Heading(f"{each.group}: {each.name}") for each in results]
    ran = [each.verdict is not CaseVerdict.NOT_RUN for each in results]
    cases = Table(
        "",
        "",
        ("case", "verdict", "findings"),
        tuple((heading.text, each.verdict, findings(each)) for heading, each in zip(headings, results, strict=True)),
        headings=tuple(heading if has_run else None for heading, has_run in zip(headings, ran, strict=True)),
        strong=(CaseVerdict.FAILED,),
    )
    parts: list[Part] = [*facts, summary(results), cases]
    for heading, each in itertools.compress(zip(headings, results, strict=True), ran):
        seconds = f"{each.from_ms / 1_000:.1f} s to {each.to_ms / 1_000:.1f} s of plant time"
        parts += [heading, InlineDrawing(f"{each.verdict}, {seconds}", picture(each))]
    if provenance is None:
        return document(about, parts)
    return document(about, [*parts, Heading("Provenance"), provenance.table()], meta={KEY: provenance.text})


def write(folder: Path, xml: bytes, html: str, provenance: Provenance, *, interrupted: bool = False) -> list[Path]:
    """Write ``hil.xml`` and ``hil.html`` to a folder with their provenance; return the paths of all files."""
    files = ResultFiles(folder, provenance)
    files.text("hil.xml", xml.decode())
    files.text("hil.html", html)
    return files.finish(interrupted=interrupted)
