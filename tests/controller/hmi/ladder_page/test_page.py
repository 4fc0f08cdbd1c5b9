"""Ladder page in a browser: states beside a frozen scan, search, cross references, scrolling, a lost connection."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from controller.fx.language.il import read_il
from controller.hmi.ladder_page.texts import TEXTS
from tests.controller.hmi.ladder_page.evaluation import end_states
from tests.controller.hmi.ladder_page.page_rig import LadderRig
from tests.controller.hmi.ladder_page.test_live_source import TEXT, foreign
from tests.controller.hmi.panel.page.screen import chromium

LOWEST = "Math.min(...[...document.querySelectorAll('header button')].map((each) => each.offsetHeight || 99))"
READ = """() => Object.fromEntries([...document.querySelectorAll("g.symbol")].map(
    (each) => [Number(each.dataset.at), each.getAttribute("class").replace("symbol ", "")]))"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as process:
        yield process


class LadderScreen:
    """Ladder page in a browser; nothing unexpected may happen in it."""

    def __init__(self, browser: Browser, rig: LadderRig, *, touch: bool = False, locale: str = "en-US") -> None:
        width, height = (800, 480) if touch else (1366, 768)
        self._context = browser.new_context(viewport={"width": width, "height": height}, has_touch=touch, locale=locale)
        self.page: Page = self._context.new_page()
        self.unexpected: list[str] = []
        self.page.on("pageerror", lambda error: self.unexpected.append(str(error)))
        self.page.on("request", lambda request: self._check(request.url, rig))
        self._rig = rig

    def __enter__(self) -> LadderScreen:
        self.page.goto(self._rig.web.origin)
        expect(self.page.locator("body")).to_have_attribute("data-link", "live")
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._context.close()
        if kind is None:
            assert self.unexpected == []

    def show(self, view: str) -> None:
        self.page.locator(f"[data-view={view}]").click()

    def shows(self, view: str, scan: int) -> None:
        """Wait until the page shows a scan."""
        expect(self.page.locator("body")).to_have_attribute("data-shown", f"{view} {scan}")
        expect(self.page.locator("#scan")).to_have_text(str(scan))

    def states(self) -> dict[int, str]:
        read: dict[str, Any] = self.page.evaluate(READ)
        return {int(at): state for at, state in read.items()}

    def _check(self, url: str, rig: LadderRig) -> None:
        if not url.startswith(rig.web.origin):
            self.unexpected.append(url)


@pytest.fixture
def rig() -> Iterator[LadderRig]:
    with LadderRig(TEXT) as rig:
        yield rig


def test_the_page_beside_a_frozen_scan(rig: LadderRig, browser: Browser) -> None:
    """Every state on the page is that of an independent evaluation of what another client reads."""
    rig.scan((0, 2), (0, 2))
    with LadderScreen(browser, rig) as screen:
        expected = end_states(rig.ladder, foreign(rig).__getitem__)
        screen.shows("end", rig.live.plc.scans)
        expect(screen.page.locator("g.symbol[data-at='27']")).to_have_class("symbol off")
        shown = screen.states()
        assert {at: shown[at] for at in expected} == expected
        screen.page.locator("#freeze").click()
        expect(screen.page.locator("body")).to_have_attribute("data-link", "frozen")
        frozen = rig.live.plc.scans
        rig.scan((), (1,), (1, 3))
        screen.show("executed")
        screen.shows("executed", frozen)
        expect(screen.page.locator("#time")).to_have_text(f"{frozen * 10 / 1000:.2f} s")
        expect(screen.page.locator("g.symbol[data-at='17']")).to_have_class("symbol not-executed")
        screen.page.locator("#freeze").click()
        screen.shows("executed", frozen + 3)
        assert screen.states()[13] == "on", "LD X1"


def test_a_contact_leads_to_its_uses_and_they_to_their_rungs(rig: LadderRig, browser: Browser) -> None:
    with LadderScreen(browser, rig, touch=True) as screen:
        page = screen.page
        assert page.evaluate("document.documentElement.scrollWidth") <= 800
        assert page.evaluate(LOWEST) >= 40
        page.locator("g.symbol[data-at='9']").tap(force=True)
        expect(page.locator("#panel h3")).to_have_text("M1")
        expect(page.locator("[data-uses=written] button")).to_have_count(2)
        page.locator("[data-uses=written] button").last.tap()
        expect(page.locator("section[data-here]")).to_have_attribute("data-rung", "3")
        page.locator("#search").fill("y0")
        expect(page.locator("[data-found=Y0]")).to_be_visible()
        page.locator("#search").fill("nothing like it")
        expect(page.locator("[data-part=find] p")).to_have_text(TEXTS["search.none"].en)


def test_an_output_leads_to_the_rung_behind_it_by_keyboard(rig: LadderRig, browser: Browser) -> None:
    rig.scan((0,))
    with LadderScreen(browser, rig) as screen:
        page = screen.page
        page.locator("[data-tab=outputs]").press("Enter")
        row = page.locator("li[data-device=Y2]")
        expect(row.locator(".level")).to_have_text(TEXTS["on"].en)
        row.locator("button").press("Enter")
        expect(page.locator("section[data-here] g.symbol[data-at='18']")).to_be_visible()
        page.keyboard.press("v")
        screen.shows("executed", rig.live.plc.scans)
        page.keyboard.press("f")
        expect(page.locator("body")).to_have_attribute("data-link", "frozen")


def test_a_lost_connection_is_never_shown_as_current(rig: LadderRig, browser: Browser) -> None:
    with LadderScreen(browser, rig, locale="zh-CN") as screen:
        page = screen.page
        expect(page.locator("[data-view=end]")).to_have_text(TEXTS["view.end"].zh)
        assert "400 loaded" in page.evaluate(FONTS), "the Chinese font of the page"
        rig._server.__exit__(None, None, None)
        expect(page.locator("body")).to_have_attribute("data-link", "lost")
        expect(page.locator("#message")).to_have_text(TEXTS["state.lost"].zh)
        expect(page.locator("#state")).to_have_text(TEXTS["state.lost"].zh)
        rig._server = type(rig._server)([rig.endpoint], rig.live.writes)
        rig._server.__enter__()


def test_step_charts_mark_the_active_steps(rig: LadderRig, browser: Browser) -> None:
    with LadderScreen(browser, rig) as screen:
        screen.page.locator("[data-mode=charts]").click()
        expect(screen.page.locator("g.step[data-state='20']")).to_have_class("step on")
        expect(screen.page.locator("g.step[data-state='21']")).to_have_class("step")


FONTS = """async () => {
  await document.fonts.ready;
  const chinese = [...document.fonts].filter((each) => each.family.includes("Panel Chinese"));
  return chinese.map((each) => `${each.weight.startsWith("100") ? 400 : 700} ${each.status}`).join();
}"""
SCROLL = """async () => {
  const ladder = document.getElementById("ladder");
  const gaps = [];
  let before = performance.now();
  let most = 0;
  for (let n = 0; n < 120; n += 1) {
    ladder.scrollTop += 400;
    await new Promise(requestAnimationFrame);
    const now = performance.now();
    gaps.push(now - before);
    before = now;
    most = Math.max(most, document.querySelectorAll("#rungs section").length);
  }
  gaps.sort((one, other) => one - other);
  const elements = document.querySelectorAll("*").length;
  return { median: gaps[60], p95: gaps[114], longest: gaps[119], most, elements };
}"""


@pytest.mark.parametrize("rungs", [pytest.param(60, id="few"), pytest.param(3_200, marks=pytest.mark.nightly)])
def test_a_long_program_scrolls_with_only_the_rungs_in_sight(browser: Browser, rungs: int) -> None:
    """8,000 steps at night. How long frames take depends on the computer, so the number of elements is limited."""
    network = "LD X{0}\nANI M{1}\nOUT M{1}\nLD M{1}\nOUT Y{0}\n"
    ladder = read_il("".join(network.format(n % 8, n % 500) for n in range(rungs // 2)) + "END\n")
    with LadderRig(ladder) as rig, LadderScreen(browser, rig) as screen:
        found = screen.page.evaluate(SCROLL)
        assert found["most"] < 40
        assert found["elements"] < 3_000
        screen.page.evaluate("document.getElementById('ladder').scrollTop = 1e9")
        last = screen.page.locator(f"g.symbol[data-at='{len(ladder.instructions) - 1}']")
        expect(last).to_have_class("symbol on")
