"""Processor time of a frame while 8,000 steps scroll, beside that of an empty page in the same browser."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from playwright.sync_api import Browser, CDPSession, Page, ViewportSize, expect

from controller.fx.language.il import read_il
from tests.controller.hmi.ladder_page.page_rig import LadderRig
from tests.controller.hmi.panel.page.screen import chromium

STEPS = 8_000
FRAMES = 200
SCREEN: ViewportSize = {"width": 1280, "height": 800}
MOST = 12.0
"""Largest processor time of a frame as a multiple of that of an empty page; 8 to 10 were measured, and 15 with all
rungs that have been in sight."""
STEP_PX = 120
"""Way of a frame: 9 screens a second at 60 Hz."""
SCROLL = """async ([step, frames]) => {
  const box = document.getElementById("ladder");
  box.scrollTop = 0;
  for (let n = 0; n < frames; n += 1) {
    box.scrollTop += step;
    await new Promise(requestAnimationFrame);
  }
  return box.scrollTop;
}"""
EMPTY = """<!doctype html><style>html, body, #ladder { height: 100%; margin: 0; } #ladder { overflow: auto; }</style>
<div id="ladder"><div style="height: 1000000px"></div></div>"""


@dataclass(frozen=True, slots=True)
class Scrolled:
    """Page that is scrolled, with the processor time of its thread."""

    page: Page
    session: CDPSession

    @classmethod
    def of(cls, page: Page) -> Scrolled:
        session = page.context.new_cdp_session(page)
        session.send("Performance.enable", {"timeDomain": "threadTicks"})
        return cls(page, session)

    def frame_ms(self) -> float:
        """Scroll, and return the processor time of a frame, ms."""
        self.page.bring_to_front()
        before = self._busy_s()
        assert self.page.evaluate(SCROLL, [STEP_PX, FRAMES]) == STEP_PX * FRAMES
        return 1_000 * (self._busy_s() - before) / FRAMES

    def _busy_s(self) -> float:
        metrics = self.session.send("Performance.getMetrics")["metrics"]
        return float(next(each["value"] for each in metrics if each["name"] == "TaskDuration"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.mark.nightly
def test_a_frame_of_8_000_steps_is_a_bounded_multiple_of_an_empty_one(browser: Browser) -> None:
    network = "LD X{0}\nANI M{1}\nOUT M{1}\nLD M{1}\nOUT Y{0}\n"
    ladder = read_il("".join(network.format(n % 8, n % 500) for n in range(STEPS // 5)) + "END\n")
    assert len(ladder.instructions) > STEPS
    with LadderRig(ladder) as rig:
        page, empty = browser.new_page(viewport=SCREEN), browser.new_page(viewport=SCREEN)
        page.goto(rig.web.origin)
        expect(page.locator("body")).to_have_attribute("data-link", "live")
        empty.set_content(EMPTY)
        own, other = Scrolled.of(page), Scrolled.of(empty)
        own.frame_ms()  # the rungs are fetched
        ratios = sorted(own.frame_ms() / other.frame_ms() for _ in range(3))
        assert ratios[1] <= MOST, ratios
