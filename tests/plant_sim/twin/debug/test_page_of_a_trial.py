"""Ladder page of a recorded trial with a stuck switch: from the alarm to the switch with three clicks."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from controller.cli.ladder.page_server import program_of_machine
from controller.debug.commands import Debugger
from controller.hmi.ladder_page.recorded_source import RecordedSource
from plant_sim.faults import parse_fault
from plant_sim.twin.debug.recorder import TwinRecorder
from plant_sim.twin.lock_step import Twin
from tests.controller.hmi.ladder_page.page_rig import WebRig
from tests.controller.hmi.panel.page.screen import chromium
from tests.controller.program.interlock_scene import MACHINE

CLICKS = 3
SWITCH = "stuck_off:left.lift_up@12s.."
TAG = "left.lift_up"


@pytest.mark.nightly
def test_an_alarm_leads_to_the_stuck_switch_with_three_clicks() -> None:
    twin = Twin(trays=1, machine=MACHINE, faults=[parse_fault(SWITCH)])
    recorder = TwinRecorder(twin)
    twin.home()
    twin.start()
    twin.run_for(8_000)
    (alarm,) = twin.alarm_events()
    line = recorder.close()
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
