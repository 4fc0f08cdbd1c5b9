"""Language of the page at the first visit and after a choice, and its Chinese in a browser without a Chinese font."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import matplotlib as mpl
import pytest
from playwright.sync_api import Browser, CDPSession, expect

from controller.hmi.panel.view.describe import public
from controller.hmi.panel.view.texts import TEXTS
from controller.program.states import State
from controller.program.texts.operator import STATES
from scripts.foreign_files import WEIGHTS, characters
from tests.controller.hmi.panel.page.panel_page_rig import PanelProcess
from tests.controller.hmi.panel.page.screen import Screen, Station, chromium
from tests.paths import ROOT

FONTS: Final = """<?xml version="1.0"?>
<fontconfig><dir>{fonts}</dir><cachedir>{cache}</cachedir></fontconfig>
"""
"""Configuration of a computer whose fonts are those of one folder."""
LATIN: Final = Path(mpl.get_data_path()) / "fonts/ttf"
"""Folder with DejaVu fonts, which have no Chinese characters."""
DRAWN: Final = """async ([characters, family, weight]) => {
  const font = `${weight} 24px ${family ?? getComputedStyle(document.body).fontFamily}`;
  await document.fonts.load(font, characters);
  const canvas = new OffscreenCanvas(32, 32);
  const pen = canvas.getContext("2d", { willReadFrequently: true });
  pen.font = font;
  return [...characters].map((character) => {
    pen.clearRect(0, 0, 32, 32);
    pen.fillText(character, 4, 26);
    return pen.getImageData(0, 0, 32, 32).data.filter((_, index) => index % 4 === 3).join();
  });
}"""
"""Script that returns the picture of each character in the fonts of the page, or of a family."""

CHARTS_DRAWN: Final = """() => {
  const charts = [...document.querySelectorAll(".chart:not([hidden]) canvas")];
  return charts.length > 0 && charts.every((one) => one.getContext("2d").font.includes("Panel Chinese"));
}"""
"""Script that returns whether charts are shown, with their scales in the font of the page."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """Yield a browser with no Chinese font but that of the page."""
    folder = tmp_path_factory.mktemp("fonts")
    configuration = folder / "fonts.conf"
    configuration.write_text(FONTS.format(fonts=LATIN, cache=folder / "cache"), encoding="utf-8")
    environment: dict[str, str | float | bool] = {**os.environ, "FONTCONFIG_FILE": str(configuration)}
    with chromium(environment) as process:
        yield process


@pytest.fixture(scope="module")
def chinese(stopped: Station, browser: Browser) -> Iterator[Screen]:
    """Yield the first page in a Chinese browser."""
    with Screen(browser, stopped.panel.url, locale="zh-CN") as screen:
        expect_language(screen, "zh")
        yield screen


def expect_language(screen: Screen, language: str) -> None:
    expect(screen.find("header [data-fact=state]")).to_contain_text(getattr(STATES[State.STOPPED], language))
    expect(screen.find("h1")).to_have_text(getattr(TEXTS["title"], language))
    expect(screen.find("html")).to_have_attribute("lang", {"en": "en", "zh": "zh-CN"}[language])


@contextmanager
def visited(browser: Browser, panel: PanelProcess, locale: str) -> Iterator[Screen]:
    with Screen(browser, panel.url, locale=locale) as screen:
        yield screen


@pytest.mark.nightly
@pytest.mark.parametrize(("locale", "language"), [("zh-CN", "zh"), ("zh-Hant-TW", "zh"), ("en-GB", "en"), ("de", "en")])
def test_the_language_of_the_browser_is_that_of_the_first_visit(
    stopped: Station, browser: Browser, locale: str, language: str
) -> None:
    with visited(browser, stopped.panel, locale) as screen:
        expect_language(screen, language)
        assert screen.page.evaluate("() => window.localStorage.length") == 0, "nothing has been selected"


@pytest.mark.nightly
def test_a_selected_language_outlives_the_language_of_the_browser(stopped: Station, browser: Browser) -> None:
    with visited(browser, stopped.panel, "zh-CN") as screen:
        screen.find("[data-action=language]").select_option("en")
        expect_language(screen, "en")
        screen.page.reload()
        expect_language(screen, "en")


@pytest.mark.nightly
def test_the_option_sets_the_language_until_one_is_selected(stopped: Station, browser: Browser, tmp_path: Path) -> None:
    with (
        PanelProcess(stopped.live, tmp_path, "--language", "zh") as panel,
        visited(browser, panel, "en-GB") as screen,
    ):
        expect_language(screen, "zh")
        screen.find("[data-action=language]").select_option("en")
        screen.page.reload()
        expect_language(screen, "en")


def test_the_login_dialog_has_the_language_of_the_option() -> None:
    assert public("zh")["language"] == "zh"
    assert public()["language"] is None


@pytest.mark.nightly
@pytest.mark.parametrize("weight", WEIGHTS)
def test_every_chinese_character_has_a_picture_of_its_own(chinese: Screen, weight: int) -> None:
    wanted = characters(ROOT)
    boxes = chinese.page.evaluate(DRAWN, [wanted, "sans-serif", weight])
    assert len(set(boxes)) == 1, "the browser has another Chinese font, and the test proves nothing"
    pictures = chinese.page.evaluate(DRAWN, [wanted, None, weight])
    assert len(set(pictures)) == len(wanted)
    assert not set(pictures) & set(boxes)


def fonts_of(session: CDPSession, selector: str) -> set[tuple[str, bool]]:
    """Return the families that draw the text of an element, without the weight, and whether the page brings them."""
    root = session.send("DOM.getDocument")["root"]["nodeId"]
    node = session.send("DOM.querySelector", {"nodeId": root, "selector": selector})["nodeId"]
    fonts = session.send("CSS.getPlatformFontsForNode", {"nodeId": node})["fonts"]
    return {(font["familyName"].removesuffix(" Thin"), font["isCustomFont"]) for font in fonts}


@pytest.mark.nightly
def test_every_letter_is_drawn_with_a_font_of_the_page(chinese: Screen) -> None:
    session = chinese.page.context.new_cdp_session(chinese.page)
    for domain in ("DOM", "CSS"):
        session.send(f"{domain}.enable")
    for selector in ("h1", "[data-command=start]", "[data-fact=mode]", "[data-fact=next-press]"):
        assert ("Noto Sans SC", True) in fonts_of(session, selector), selector
    for selector in ("[data-fact=next-press]", "[data-box=start]"):
        assert ("Roboto Condensed", True) in fonts_of(session, selector), f"{selector} contains digits and letters"
    chinese.open("trends")
    chinese.page.wait_for_function(
        "() => document.fonts.size === 4 && [...document.fonts].every((one) => one.status === 'loaded')"
    )
    chinese.page.wait_for_function(CHARTS_DRAWN)
    chinese.open("overview")


@pytest.mark.nightly
def test_the_clamp_force_is_read_with_the_clock_and_is_not_negative(stopped: Station, chinese: Screen) -> None:
    forces = stopped.live.plant.call(
        lambda: [arm.claws.clamp_n for arm in stopped.live.plant.server.module.plant.arms.values()]
    )
    assert max(forces) < -1.0, "the claws are held open"
    chinese.open("trends")
    chart = chinese.find(".chart").filter(has_text=TEXTS["trends.clamp"].zh)
    expect(chart.locator("canvas")).to_be_visible()  # once the first values have arrived
    area = chart.locator(".u-over")
    box = area.bounding_box()
    assert box is not None
    area.hover(position={"x": box["width"] - 1, "y": box["height"] / 2})
    expect(chart.locator(".chart-reading")).to_have_text(re.compile(r"^\d\d:\d\d:\d\d：左 0\.0，右 0\.0 N$"))
    chinese.open("overview")
