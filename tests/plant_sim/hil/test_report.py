"""Reports of the bench: JUnit XML and HTML."""

from __future__ import annotations

from xml.etree import ElementTree

from plant_sim.hil.bench import Figure
from plant_sim.hil.bench_run import CaseResult, CaseVerdict
from plant_sim.hil.reporting.report import findings, junit, line, page, summary

RESULTS = [
    CaseResult("homing", "a & b", CaseVerdict.PASSED, [], 1_000, 3_500, 2_000, {"homing": Figure(2.5, "s")}),
    CaseResult("fault", "x<y", CaseVerdict.FAILED, ["first", "second"], 4_000, 5_000, 4_500, {"lost": Figure(3)}),
    CaseResult("fault", "z", CaseVerdict.NOT_RUN, ["no lamp"], 5_000, 5_000),
]


def test_junit_has_a_suite_for_each_group() -> None:
    root = ElementTree.fromstring(junit(RESULTS, about="bench"))  # noqa: S314 - our own text
    assert root.tag == "testsuites"
    assert (root.get("tests"), root.get("failures"), root.get("skipped")) == ("3", "1", "1")
    homing, fault = root.findall("testsuite")
    assert (homing.get("name"), homing.get("tests"), homing.get("time")) == ("homing", "1", "2.500")
    case = homing.find("testcase")
    assert case is not None
    assert case.get("name") == "a & b"
    value = case.find("properties/property")
    assert value is not None
    assert (value.get("name"), value.get("value")) == ("homing", "2.5 s")
    failed, skipped = fault.findall("testcase")
    failure = failed.find("failure")
    assert failure is not None
    assert failure.get("message") == "first"
    assert failure.text == "first\nsecond"
    assert skipped.find("skipped") is not None


def test_the_page_escapes_and_links_every_case() -> None:
    html = page(RESULTS, about="<bench>", facts=["a > b"], picture=lambda result: f"<svg>{result.group}</svg>")
    assert "<h1>&lt;bench&gt;</h1>" in html
    assert "x&lt;y" in html
    assert "x<y" not in html
    assert html.count("<svg>") == 2  # not for the case that was not run
    assert '<a href="#fault-x-y">fault: x&lt;y</a>' in html
    assert '<h2 id="fault-x-y">' in html
    assert '<a href="#fault-z">' not in html
    assert "<td><strong>failed</strong></td>" in html
    assert "first; second; lost 3" in html


def test_lines_state_verdict_reasons_and_figures() -> None:
    assert line(RESULTS[0]) == "passed   homing: a & b (homing 2.5 s)"
    assert findings(RESULTS[1]) == "first; second; lost 3"
    assert summary(RESULTS) == "1 passed, 1 failed, 1 not run"
