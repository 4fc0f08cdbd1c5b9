"""A whole trial by touch alone at 800 x 480: login, homing, a jam, questions, an emergency stop, and the end."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from controller.core.expr import Bit
from controller.program.states import State
from controller.program.tags import SIDES
from plant_sim.faults.fault import parse_fault
from tests.controller.hmi.panel.page.panel_page_rig import PASSWORDS, LiveMachine, PanelProcess
from tests.controller.hmi.panel.page.screen import AGAIN_MS
from tests.controller.hmi.panel.page.touch.touch_page import TouchPage

JAM = "jammed:left.lift"
PRESSES = 20
"""Limit of presses from one stop to the next run."""


class Driver:
    """Driver with one finger, who does what the page says."""

    def __init__(self, live: LiveMachine, page: TouchPage) -> None:
        self.live, self.page = live, page

    def tap(self, selector: str) -> None:
        button = self.page.find(selector)
        expect(button).not_to_have_attribute("aria-disabled", "true")
        button.tap()

    def open(self, name: str) -> None:
        self.tap(".keys [data-page=menu]")
        self.tap(f".menu [data-page={name}]")
        expect(self.page.find(f"main[data-page={name}]")).to_be_visible()

    def log_in(self, user: str) -> None:
        self.tap(".keys [data-page=menu]")
        self.tap("[data-action=menu-login]")
        self.page.find("dialog input[type=password]").tap()
        self.page.type(PASSWORDS[user])
        self.page.key("enter").tap()
        self.tap("dialog [data-action=submit]")
        expect(self.page.find("[data-action=menu-logout]")).to_be_visible()

    def work_on(self) -> None:
        """Press what the cab page offers, and answer what it asks, until the machine runs."""
        for _ in range(PRESSES):
            self.open("cab")
            state = self.live.state
            if state == State.EXECUTE:
                return
            answer, command = self.page.find("[data-cab=recovery]"), self.page.find(".next-command button")
            offered = answer.or_(command).or_(self.page.find("[data-cab=isolation]"))
            expect(offered.filter(visible=True).first).to_be_visible()
            if answer.is_visible():
                answer.tap()
                self.answer()
                continue
            if self.page.find("[data-cab=isolation]").is_visible():  # then the cab offers no motion
                self.open("recovery")
                self.tap("main [data-command=reset]")
            else:
                self.page.page.wait_for_timeout(
                    AGAIN_MS
                )  # a key that has just come takes no second tap of the one before
                command.tap()
            self.until_at_rest(after=state)
        raise AssertionError(f"not running after {PRESSES} presses")

    def until_at_rest(self, after: State) -> None:
        """Wait until a press has changed the state, and the state does not change by itself any more."""
        self.live.until(lambda: self.live.state != after, "a press that the page offers has an effect")
        passing = (State.RESETTING, State.STARTING, State.CLEARING)
        self.live.until(lambda: self.live.state not in passing, "rest")

    def answer(self) -> None:
        """Answer the open questions as somebody who looks at the machine, each with a touch of 2 s."""
        plc, tags, plant = self.live.runtime.plc, self.live.machine.tags, self.live.plant.server.module.plant
        held = self.live.plant.call(lambda: {side: bool(arm.grip.held) for side, arm in plant.arms.items()})
        for side in SIDES:
            if plc.read(tags.arms[side].ask):
                self.hold(f"{side}_loaded_{'yes' if held[side] else 'no'}", tags.arms[side].ask)
            if plc.read(tags.arms[side].ask_cups):
                self.hold("cups_empty", tags.arms[side].ask_cups)
        if plc.read(tags.tray.ask):
            self.hold("tray_same", tags.tray.ask)

    def hold(self, command: str, question: Bit) -> None:
        button = self.page.find(f"[data-question] [data-command={command}]")
        expect(button).not_to_have_attribute("aria-disabled", "true")
        button.scroll_into_view_if_needed()
        box = button.bounding_box()
        assert box is not None
        touch = self.page.page.context.new_cdp_session(self.page.page)
        finger = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2}
        touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [finger]})
        self.live.until(lambda: not self.live.runtime.plc.read(question), "answered")
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        touch.detach()


@pytest.mark.nightly
def test_a_whole_trial_with_a_jam_and_an_emergency_stop(tmp_path: Path, browser: Browser) -> None:
    with (
        LiveMachine(tmp_path) as live,
        PanelProcess(live, tmp_path) as panel,
        TouchPage(browser, panel.url, None) as page,
    ):
        plant = live.plant.server.module.plant
        driver = Driver(live, page)
        expect(page.find("main[data-page=cab]")).to_be_visible()
        driver.log_in("operate")
        live.pace.set(1_000)
        driver.work_on()
        live.until(lambda: live.on("left.lift_retract"), "the left arm lifts its first row")
        live.plant.call(lambda: plant.faults.add(parse_fault(JAM)))
        live.until(lambda: live.state in (State.HELD, State.ABORTED), "stopped by the jam")

        banner = page.find("[data-part=banner]")
        expect(banner).to_contain_text("left arm", ignore_case=True)
        expect(page.find("[data-fact=next-press]")).to_contain_text("Isolate first")
        expect(page.find("[data-fact=next-press]")).not_to_contain_text(
            "left arm", ignore_case=True
        )  # the banner has it
        driver.open("cab")
        expect(page.find(".next-command button")).to_have_count(0)  # no motion while a hand may be in the machine
        driver.tap("[data-cab=isolation]")
        expect(page.find("main [data-part=isolation] li").first).to_be_visible()
        driver.open("alarms")
        driver.tap(".alarm-list [data-help] >> nth=0")
        expect(page.find(".causes li").first).to_be_visible()
        driver.tap("[data-section='alarms.active']")
        driver.tap("[data-command=acknowledge_all]")
        live.plant.call(lambda: plant.faults.clear(JAM))
        driver.work_on()

        moved = live.now_ms
        live.until(lambda: live.now_ms > moved + 5_000, "works on")
        driver.open("overview")
        driver.tap("[data-box=emergency_stop]")
        live.until_state(State.ABORTED)
        expect(banner).to_contain_text("Emergency stop")
        page.page.wait_for_timeout(AGAIN_MS)  # a double tap does not release it
        driver.tap("[data-box=emergency_stop]")
        driver.work_on()

        live.fast()
        live.until_state(State.COMPLETE)
        counts = live.counts()
        assert counts.in_cups + counts.P + counts.D + counts.T == counts.total
        assert counts.in_cups > 40
        driver.open("cab")
        expect(page.find("[data-fact=seedlings]")).to_have_text(f"{counts.in_cups} / {counts.total}")
