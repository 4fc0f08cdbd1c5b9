"""Jog by touch: however the touch ends, the output is off within its lease, in the time of the machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Final

import psutil
import pytest
from playwright.sync_api import Browser, CDPSession, Error, expect

from controller.hmi.panel.view.texts import TEXTS
from controller.program.operator.commands import JOG_LEASE_MS
from tests.controller.hmi.panel.page.panel_page_rig import SCAN_MS
from tests.controller.hmi.panel.page.screen import OUTPUT, Station, chromium, ready_to_jog, started, until_renewed
from tests.controller.hmi.panel.page.touch.touch_page import TouchPage

pytestmark = pytest.mark.nightly

ELSEWHERE: Final = {"x": 5.0, "y": 5.0, "id": 1}
"""Second finger, in a corner of the page."""


@pytest.fixture(scope="module")
def manual(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Yield a machine for jogging; each test must leave it in manual mode with its outputs off."""
    with started(tmp_path_factory.mktemp("manual"), slow=True) as station:
        yield station


class Finger:
    """Finger that holds the jog button of an output, which is on."""

    def __init__(self, station: Station, page: TouchPage) -> None:
        self.page = page
        page.page.set_viewport_size({"width": 1280, "height": 800})  # a touch screen that shows all buttons at once
        button = ready_to_jog(page, station.live)
        button.scroll_into_view_if_needed()
        box = button.bounding_box()
        assert box is not None
        self.at = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2, "id": 0}
        self.session: CDPSession = page.page.context.new_cdp_session(page.page)
        self.touch("touchStart", self.at)
        live = station.live
        live.until(lambda: live.on(OUTPUT), f"{OUTPUT} on")
        until_renewed(live)

    def touch(self, kind: str, *fingers: dict[str, float]) -> None:
        self.session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [*fingers]})


def lift(finger: Finger) -> None:
    finger.touch("touchEnd")


def cancel(finger: Finger) -> None:
    """The browser takes the touch for something else, for example a gesture of the system."""
    finger.touch("touchCancel")


def slide_off(finger: Finger) -> None:
    finger.touch("touchMove", {**ELSEWHERE, "id": 0})


def add_a_finger(finger: Finger) -> None:
    finger.touch("touchStart", finger.at, ELSEWHERE)
    expect(finger.page.find("body")).to_contain_text(TEXTS["touch.two"].en)


def hide(finger: Finger) -> None:
    """Show another tab, with the finger still on the screen."""
    finger.page.page.evaluate(
        """() => {
          Object.defineProperty(document, "hidden", { get: () => true });
          document.dispatchEvent(new Event("visibilitychange"));
        }"""
    )


@pytest.mark.parametrize("end", [lift, cancel, slide_off, add_a_finger, hide])
def test_the_output_is_off_within_its_lease_after_the_end_of_a_touch(
    manual: Station, browser: Browser, end: Callable[[Finger], None]
) -> None:
    live = manual.live
    with TouchPage(browser, manual.panel.url, "maintain") as page:
        finger = Finger(manual, page)
        ended_ms = live.now_ms
        end(finger)
        live.until(lambda: not live.on(OUTPUT), f"{OUTPUT} off")
        assert live.last_on_ms(OUTPUT) - ended_ms <= JOG_LEASE_MS + 2 * SCAN_MS
        held_ms = live.now_ms
        live.until(lambda: live.now_ms > held_ms + 2 * JOG_LEASE_MS, "rest")
        assert live.last_on_ms(OUTPUT) < held_ms, "the output is on again without a press"


def test_the_output_is_off_within_its_lease_after_the_browser_is_killed(manual: Station) -> None:
    live = manual.live
    before = {process.pid for process in psutil.Process().children(recursive=True)}
    with suppress(Error), chromium() as own, TouchPage(own, manual.panel.url, "maintain") as page:
        Finger(manual, page)
        ended_ms = live.now_ms
        for process in psutil.Process().children(recursive=True):
            if process.pid not in before and process.name().startswith("chrom"):
                process.kill()
        live.until(lambda: not live.on(OUTPUT), f"{OUTPUT} off")
        assert live.last_on_ms(OUTPUT) - ended_ms <= JOG_LEASE_MS + 2 * SCAN_MS
        raise Error("the browser is gone")  # its page cannot be closed
