"""Gestures of a touch screen: none zooms the page, leaves it or opens a menu over it."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from typing import Final

import pytest
from playwright.sync_api import Browser, CDPSession, expect

from tests.controller.hmi.panel.page.screen import CHROMIUM_OF_THE_KIOSK, FLAGS, PAGES, Screen, Station
from tests.paths import DOCS
from tests.sampling import one_in

pytestmark = pytest.mark.nightly

UNIT: Final = DOCS / "examples" / "systemd" / "transplanter-kiosk.service"
OF_A_SCREEN: Final = ("--kiosk", "--ozone-platform=wayland", "--user-data-dir")
"""Beginnings of flags that a browser without a screen, or with the profile of a test, does not take."""


@pytest.fixture(scope="module")
def touch(stopped: Station, browser: Browser) -> Iterator[Screen]:
    with Screen(browser, stopped.panel.url, touch=True) as screen:
        yield screen


@pytest.fixture
def gestures(touch: Screen) -> CDPSession:
    """Return the connection that touches the screen of a page that keeps a mark until it is loaded again."""
    touch.open(PAGES[0])
    touch.page.evaluate("window.loaded = true; window.scrollTo(0, 0)")
    return touch.page.context.new_cdp_session(touch.page)


def pinch(session: CDPSession) -> None:
    """Move two fingers apart."""
    for apart_px in range(10, 160, 10):
        fingers = [{"x": 400 + side * apart_px, "y": 300, "id": max(0, side)} for side in (-1, 1)]
        kind = "touchStart" if apart_px == 10 else "touchMove"
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def scale_of(screen: Screen) -> float:
    """Return the scale of the page after some pictures have been drawn."""
    scale: float = screen.page.evaluate(
        """async () => {
          for (let n = 0; n < 10; n += 1) await new Promise(requestAnimationFrame);
          return window.visualViewport.scale;
        }"""
    )
    return scale


def swipe(session: CDPSession, across_px: int, down_px: int) -> None:
    session.send(
        "Input.synthesizeScrollGesture",
        {
            "x": 400 - across_px // 2,
            "y": 280 - down_px // 2,
            "xDistance": across_px,
            "yDistance": down_px,
            "speed": 3000,
            "gestureSourceType": "touch",
        },
    )


@pytest.mark.parametrize("page", one_in(4, PAGES))
def test_a_pinch_zooms_no_page(touch: Screen, gestures: CDPSession, page: str) -> None:
    touch.open(page)
    pinch(gestures)
    assert scale_of(touch) == 1


def test_the_pinch_zooms_a_page_that_permits_it(stopped: Station, browser: Browser) -> None:
    with Screen(browser, stopped.panel.url, touch=True) as screen:
        screen.page.evaluate("document.documentElement.style.touchAction = 'auto'")
        pinch(screen.page.context.new_cdp_session(screen.page))
        assert scale_of(screen) > 1


def test_a_swipe_leaves_no_page_and_loads_none_again(touch: Screen, gestures: CDPSession) -> None:
    """From side to side, and down at the beginning of the page; the page before the panel is another one."""
    address = touch.page.url
    assert touch.page.evaluate("history.length") == 2
    for across_px, down_px in ((600, 0), (-600, 0), (0, 300), (0, -300)):
        swipe(gestures, across_px, down_px)
        assert touch.page.url == address
        assert touch.page.evaluate("window.loaded") is True
    style = "getComputedStyle(document.documentElement)"
    assert touch.page.evaluate(f"[{style}.overscrollBehaviorX, {style}.overscrollBehaviorY]") == ["none", "none"]


def test_a_long_touch_opens_no_menu_and_selects_nothing(touch: Screen, gestures: CDPSession) -> None:
    """A browser without a screen asks for no menu by itself after a long touch; the mouse keeps its menu."""
    tab = touch.find(".keys [data-command=stop]").bounding_box()
    assert tab is not None
    point = {"x": tab["x"] + tab["width"] / 2, "y": tab["y"] + tab["height"] / 2}
    gestures.send("Input.synthesizeTapGesture", {**point, "duration": 1500, "gestureSourceType": "touch"})
    assert touch.page.evaluate("window.getSelection().toString()") == ""
    for selector in (".keys button", "main button"):
        assert touch.find(selector).first.evaluate("node => getComputedStyle(node).userSelect") == "none"
    opened = touch.find("main").evaluate(
        """node => ["touch", "pen", "mouse"].filter((pointerType) => node.dispatchEvent(
          new PointerEvent("contextmenu", { pointerType, bubbles: true, cancelable: true })))"""
    )
    assert opened == ["mouse"]


def test_a_page_that_is_loaded_again_is_the_same(touch: Screen, gestures: CDPSession) -> None:
    """Pages are no entries of the history, so that a key for *back* has nothing in the panel to go back to."""
    for page in PAGES:
        touch.open(page)
    assert touch.page.evaluate("history.length") == 2
    touch.page.keyboard.press("Backspace")
    touch.page.reload()
    expect(touch.find("main")).to_have_attribute("data-page", PAGES[-1])


def kiosk_flags() -> list[str]:
    """Return the flags of the browser in the delivered unit that do not need a screen."""
    text = UNIT.read_text(encoding="utf-8").replace("\\\n", " ")
    (command,) = (line for line in text.splitlines() if line.startswith("ExecStart="))
    flags = [word for word in shlex.split(command) if word.startswith("--") and word != "--"]
    return [flag for flag in flags if not flag.startswith(OF_A_SCREEN)]


@pytest.fixture
def kiosk(browser: Browser) -> Iterator[Browser]:
    """Run another browser, with the flags of the kiosk."""
    other = browser.browser_type.launch(executable_path=CHROMIUM_OF_THE_KIOSK, args=[*FLAGS, *kiosk_flags()])
    yield other
    other.close()


def test_the_browser_of_the_kiosk_shows_the_panel(stopped: Station, kiosk: Browser) -> None:
    wanted = {"--disable-pinch", "--overscroll-history-navigation=0", "--password-store=basic"}
    assert wanted <= {*kiosk_flags()}
    with Screen(kiosk, stopped.panel.url, touch=True) as screen:
        expect(screen.find("body")).to_have_attribute("data-link", "live")
        session = screen.page.context.new_cdp_session(screen.page)
        address = screen.page.url
        pinch(session)
        swipe(session, 600, 0)
        assert scale_of(screen) == 1
        assert screen.page.url == address
