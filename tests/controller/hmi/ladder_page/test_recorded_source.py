"""Ladder page of a recorded run: each scan as it was executed, movements through the debugger, a branch, the slider."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, expect

from controller.debug.commands import Debugger
from controller.debug.fx_machine import record_run
from controller.fx.language.il import read_il
from controller.fx.observation.cross_reference import CrossReference
from controller.fx.observation.observed_plc import ObservedPlc
from controller.fx.stimulus.stimulus import Stimulus, device_of
from controller.hmi.ladder_page.program import PageProgram
from controller.hmi.ladder_page.recorded_source import RecordedSource
from tests.controller.hmi.ladder_page.page_rig import WebRig
from tests.controller.hmi.panel.page.screen import chromium

TEXT = """\
LD X0
OUT T200 K20
LD T200
OUT Y0
LDP X0
SET M1
LD X1
RST M1
LD M1
OUT Y1
LD M8002
SET S0
STL S0
LD T200
SET S20
STL S20
LD X1
SET S0
RET
END
"""
SCANS = 60
PRESSED = 5
"""Scan from which X0 is on; T200 comes on 200 ms later."""


@pytest.fixture
def web() -> Iterator[WebRig]:
    ladder = read_il(TEXT)
    pressed = (10 * (PRESSED - 1), {device_of("X0"): 1})
    line = record_run(ladder, Stimulus(10, SCANS, {}, (pressed,), ()))
    with WebRig(RecordedSource(PageProgram("program", CrossReference(ladder)), Debugger(line))) as web:
        yield web


def command(web: WebRig, text: str) -> dict[str, Any]:
    answer = web.client.post("/api/command", content=text, headers={"origin": web.origin})
    assert answer.status_code == 200, answer.text
    result: dict[str, Any] = answer.json()
    return result


def test_every_recorded_scan_is_shown_as_it_was_executed(web: WebRig) -> None:
    ladder = read_il(TEXT)
    truth = ObservedPlc(ladder, input_filter_ms=0)
    for scan in range(1, SCANS + 1):
        truth.scan(10 * (scan - 1), [scan >= PRESSED])
        look = web.look("executed", scan=scan)
        seen = truth.observation
        expected = {
            at: seen.state(int(at), ladder.instructions[int(at)]).value
            for at in look["symbols"]
            if ladder.instructions[int(at)].name not in ("RET", "END")
        }
        assert {at: look["symbols"][at] for at in expected} == expected, scan
        assert (look["scan"], look["at_ms"], look["differing"]) == (scan, 10 * (scan - 1), [])


def test_commands_move_the_page(web: WebRig) -> None:
    run = command(web, "last Y0")["run"]
    assert run["scan"] == PRESSED + 20
    assert web.look("end")["scan"] == run["scan"]
    assert web.look("end")["active"] == ["Y0", "Y1", "S20"]
    assert command(web, "back 1 scan")["run"]["scan"] == run["scan"] - 1
    assert web.look("end")["active"] == ["Y1", "S0"]


def test_rungs_are_steps_within_a_scan(web: WebRig) -> None:
    """From END of a scan, each step forward is before a rung that the next scan executes, and back again."""
    ladder = read_il(TEXT)
    reference, truth = CrossReference(ladder), ObservedPlc(ladder, input_filter_ms=0)
    for scan in range(1, 32):
        truth.scan(10 * (scan - 1), [scan >= PRESSED])
    executed = {reference.rung_at(at): at for at, ran in enumerate(truth.observation.executed) if ran}
    assert 2 < len(executed) < len(reference.rungs) - 1, "an inactive step"
    command(web, "goto 30")
    forward = [command(web, "forward 1 rung")["run"] for _ in executed]
    assert [(run["scan"], run["rung"]) for run in forward] == [(30, rung) for rung in executed]
    back = command(web, "back 1 rung")["run"]
    assert (back["scan"], back["rung"]) == (30, [*executed][-2])
    assert command(web, "forward 1 scan")["run"]["rung"] is None


def test_a_branch_is_a_second_track_with_its_first_difference(web: WebRig) -> None:
    run = command(web, f"branch X0=off@{PRESSED + 10}..")["run"]
    assert (run["track"], run["branch"], run["differs"]) == ("recorded", [PRESSED + 10, SCANS], PRESSED + 10)
    assert "Y0" in web.look("end", scan=SCANS)["active"]
    assert command(web, "use branch")["run"]["track"] == "branch"
    assert "Y0" not in web.look("end", scan=SCANS)["active"]


def test_the_reason_for_an_output_leads_to_its_input(web: WebRig) -> None:
    lines = web.get("/api/why", device="Y0", scan=SCANS).json()["lines"]
    words = [line["text"]["en"] for line in lines]
    assert words[0].startswith("Why is Y0 on")
    (cause,) = [line["text"] for line in lines if line["cause"]]
    assert "X0" in cause["en"]
    assert "X0" in cause["zh"]
    assert 0 in [line["rung"] for line in lines], "the rung of the timer"
    command(web, f"goto {PRESSED - 1}")
    assert web.get("/api/why", device="Y0").json()["lines"][0]["text"]["en"].startswith("Why is Y0 off")
    (told,) = web.get("/api/why", device="Y0", scan=SCANS + 1).json()["lines"]
    assert "no scan to look into" in told["text"]["en"]


def test_invalid_commands_and_scans_are_told(web: WebRig) -> None:
    answer = web.client.post("/api/command", content="jump 7", headers={"origin": web.origin})
    assert (answer.status_code, answer.json()["state"]) == (400, "refused")
    assert "jump: no such command" in answer.json()["reason"]
    assert web.get("/api/look", view="end", first=0, count=1, scan=SCANS + 1).status_code == 410
    assert web.client.post("/api/command", content="help").status_code == 403, "a page of another site"
    assert web.client.post("/api/command", content="x" * 501, headers={"origin": web.origin}).status_code == 400


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as process:
        yield process


def test_the_slider_and_the_buttons_move_back_and_forth(web: WebRig, browser: Browser) -> None:
    page = browser.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(web.origin)
    body = page.locator("body")
    expect(body).to_have_attribute("data-link", "recorded")
    expect(body).to_have_attribute("data-shown", f"end {SCANS}")
    page.locator("g.symbol[data-at='3']").click(force=True)
    expect(page.locator("#panel h3")).to_have_text("Y0")
    page.locator("[data-run=last]").click()
    expect(body).to_have_attribute("data-shown", f"end {PRESSED + 20}")
    page.locator("[data-run='back 1 scan']").click()
    expect(body).to_have_attribute("data-shown", f"end {PRESSED + 19}")
    expect(page.locator("g.symbol[data-at='3']")).to_have_class("symbol off")
    page.locator("[data-run='forward 1 rung']").click()
    expect(body).to_have_attribute("data-shown", f"executed {PRESSED + 20}")
    expect(page.locator("section[data-here]")).to_have_attribute("data-rung", "0")
    page.locator("[data-run='forward 1 rung']").click()
    expect(page.locator("section[data-here]")).to_have_attribute("data-rung", "1")
    page.locator("[data-run='back 1 rung']").click()
    expect(page.locator("section[data-here]")).to_have_attribute("data-rung", "0")
    page.locator("[data-run='back 1 rung']").click()
    expect(page.locator("section[data-here]")).to_have_count(0)
    expect(body).to_have_attribute("data-shown", f"executed {PRESSED + 19}")
    page.locator("[data-view=end]").click()
    page.locator("#slider").fill("7")
    expect(body).to_have_attribute("data-shown", "end 7")
    page.locator("[data-tab=run]").click()
    page.locator("[data-field=until]").fill("Y0")
    page.locator("[data-field=until]").press("Enter")
    expect(body).to_have_attribute("data-shown", f"end {PRESSED + 20}")
    page.locator("[data-field=watch]").fill("TN200")
    page.locator("[data-field=watch]").press("Enter")
    expect(page.locator("#watches")).to_have_text("TN200: 20")
    page.locator("[data-field=change]").fill(f"X0=off@{PRESSED + 2}..")
    page.locator("[data-field=change]").press("Enter")
    page.locator("[data-track=branch]").click()
    expect(body).to_have_attribute("data-link", "branch")
    expect(page.locator("g.symbol[data-at='3']")).to_have_class("symbol off")
    expect(page.locator("#freeze")).to_be_hidden()
    page.close()
    assert errors == []
