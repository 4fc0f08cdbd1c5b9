"""Pages of a recorded trial with a stuck switch: from the alarm to the switch with three clicks, and the machine."""

from __future__ import annotations

import asyncio
import re

import pytest
from playwright.sync_api import expect

from controller.cli.ladder.page_server import program_of_machine
from controller.debug.commands import Debugger
from controller.debug.timeline import RunTimeline
from controller.events.kinds import as_sentence
from controller.hmi.ladder_page.recorded_source import RecordedSource
from controller.program.states import State
from controller.program.tags import SIDES
from controller.program.texts.operator import STATES
from plant_sim.faults import parse_fault
from plant_sim.twin.debug.picture import picture_of
from plant_sim.twin.debug.recorder import TwinRecorder
from plant_sim.twin.lock_step import Twin
from tests.controller.hmi.ladder_page.page_rig import WebRig
from tests.controller.hmi.panel.page.screen import chromium
from tests.controller.program.interlock_scene import MACHINE

CLICKS = 3
HALF_MM = 300.0
"""Distance of an arm at feed from the middle of the picture, mm."""
SWITCH = "stuck_off:left.lift_up@12s.."
TAG = "left.lift_up"
MOVING = (1_690, 1_760, 1_905, 1_330)
"""Scans in which parts of the arms move, in the order in which they are returned to."""


def values_after(line: RunTimeline, scan: int) -> dict[str, float]:
    """Return the values of the plant and of all devices after a scan, by name."""
    line.seek(scan)
    return {name: float(value) for name, value in {**line.machine.values(), **line.machine.devices()}.items()}


def stuck() -> tuple[Twin, RunTimeline]:
    """Return a twin that has stopped because of the switch, and its recorded run."""
    twin = Twin(trays=1, machine=MACHINE, faults=[parse_fault(SWITCH)])
    recorder = TwinRecorder(twin)
    twin.home()
    twin.start()
    twin.run_for(8_000)
    return twin, recorder.close()


@pytest.mark.nightly
def test_an_alarm_leads_to_the_stuck_switch_with_three_clicks() -> None:
    twin, line = stuck()
    (alarm,) = twin.alarm_events()
    program, _ = program_of_machine(MACHINE)
    with WebRig(RecordedSource(program, Debugger(line))) as web, chromium() as browser:
        page = browser.new_page()
        page.goto(web.origin)
        expect(page.locator("body")).to_have_attribute("data-link", "recorded")
        clicks = (
            page.locator("[data-tab=alarms]"),
            page.locator(f"[data-part=alarms] li[data-device=S{alarm.number}] button"),
            page.locator("[data-action=why]"),
        )
        for click in clicks:
            click.click()
        assert len(clicks) <= CLICKS
        cause = page.locator("[data-part=why] li.cause")
        expect(cause).to_contain_text(TAG)
        expect(cause).to_contain_text("stuck_off")
        expect(page.locator("[data-part=why]")).to_contain_text("Proved by replay")
        mark = page.locator(".mark.alarm")
        expect(mark).to_have_attribute("title", re.compile(re.escape(alarm.text.en)))
        page.locator("#language").click()
        expect(mark).to_have_attribute("title", re.compile(re.escape(alarm.text.zh)))


def test_the_marks_tell_every_event_in_both_languages() -> None:
    twin, line = stuck()
    program, _ = program_of_machine(MACHINE)
    marks = asyncio.run(RecordedSource(program, Debugger(line)).state())["marks"]
    told = [mark["text"] for mark in marks if mark["kind"] != "entry"]
    assert told == [as_sentence(event)._asdict() for event in twin.events]
    (alarm,) = twin.alarm_events()
    assert {
        "en": f"alarm S{alarm.number} on: {alarm.text.en}",
        "zh": f"报警 S{alarm.number} 出现：{alarm.text.zh}",
    } in told
    for text in told:
        assert not re.search("[\u4e00-\u9fff]", text["en"])
        assert not re.search("[a-z]{2}", text["zh"]), text["zh"]


@pytest.mark.nightly
def test_the_slider_moves_the_machine_and_the_ladder_to_the_same_scan() -> None:
    twin, line = stuck()
    lamps = [point for point in twin.io_map.outputs if "lamp" in point.tag]
    values = {scan: values_after(line, scan) for scan in MOVING}
    program, _ = program_of_machine(MACHINE)
    with WebRig(RecordedSource(program, Debugger(line), picture_of(line.machine))) as web, chromium() as browser:
        page = browser.new_page(viewport={"width": 800, "height": 480})
        page.goto(web.origin)
        expect(page.locator("body")).to_have_attribute("data-link", "recorded")
        page.locator("[data-mode=machine]").click()
        for scan in MOVING:
            page.locator("#slider").fill(str(scan))
            expect(page.locator("#scan")).to_have_text(str(scan))
            expect(page.locator("body")).to_have_attribute("data-shown", f"end {scan}")
            recorded = values[scan]
            for side in SIDES:
                slide_mm, lift_mm = (1_000 * recorded[f"{side}.{part}.position_m"] for part in ("slide", "lift"))
                expect(page.locator(f"[data-place='{side}.slide']")).to_contain_text(f"{slide_mm:.1f} mm")
                expect(page.locator(f"[data-place='{side}.lift']")).to_contain_text(f"{lift_mm:.1f} mm")
                x = (slide_mm - HALF_MM) * (1 if side == "left" else -1)
                arm = page.locator(f".arm[data-tag='{side}.slide']")
                assert arm.evaluate("node => new DOMMatrix(node.style.transform).e") == pytest.approx(x, abs=0.06)
            for lamp in lamps:
                on = lamp.active(bool(recorded[lamp.address]))
                expect(page.locator(f"[data-lamp='{lamp.tag}']")).to_have_attribute("data-on", str(int(on)))
        page.locator("#language").click()
        expect(page.locator("[data-lamp=lamp_amber]")).to_contain_text("塔灯黄")
        expect(page.locator("[data-fact=state]")).to_have_text(STATES[State.EXECUTE].zh)
        assert page.evaluate("document.documentElement.scrollWidth") <= 800
        bottom = "node => node.getBoundingClientRect().bottom"
        assert page.locator("[data-place='right.step']").evaluate(bottom) <= page.locator("main").evaluate(bottom)
        page.locator("[data-mode=ladder]").click()
        expect(page.locator("#ladder")).to_be_visible()
        expect(page.locator("#scan")).to_have_text(str(MOVING[-1]))
