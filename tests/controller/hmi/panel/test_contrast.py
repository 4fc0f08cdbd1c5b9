"""Contrast of every text of the page, from the colours that the browser computes, in every state of the controls."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import pytest
from playwright.sync_api import Browser, CDPSession, Page, expect, sync_playwright

from controller.program.states import State
from tests.controller.hmi.panel.panel_page_rig import LiveMachine, PanelProcess
from tests.controller.hmi.panel.test_page import FLAGS, PAGES, Screen, clear

TEXT_RATIO: Final = 4.5
"""Least contrast of a text (WCAG 2.2, 1.4.3)."""
DISABLED_RATIO: Final = 3.0
"""Least contrast of the text of a control that is not available."""
STATES_OF_CONTROLS: Final = {
    "rest": (),
    "hover": ("hover",),
    "focus": ("focus", "focus-visible"),
    "touched": ("hover", "active"),
}
"""Pseudo-classes that are forced on every control; after a touch, a browser keeps `hover`."""
MEASURE: Final = """
([pressed, least, leastDisabled]) => {
  const parse = (text) => {
    const [r, g, b, a = 1] = text.match(/[\\d.]+/g).map(Number);
    return { r, g, b, a };
  };
  const over = (top, under) => ({ r: top.r * top.a + under.r * (1 - top.a), g: top.g * top.a + under.g * (1 - top.a),
    b: top.b * top.a + under.b * (1 - top.a), a: 1 });
  const linear = (value) => (value / 255 <= 0.04045 ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4);
  const light = (colour) => 0.2126 * linear(colour.r) + 0.7152 * linear(colour.g) + 0.0722 * linear(colour.b);
  const ground = (node) => {
    const layers = [];
    for (let each = node; each !== null; each = each.parentElement) {
      const colour = parse(getComputedStyle(each).backgroundColor);
      layers.push(colour);
      if (colour.a === 1) break;
    }
    return layers.reverse().reduce((under, top) => over(top, under), { r: 255, g: 255, b: 255, a: 1 });
  };
  const opacity = (node) => {
    let product = 1;
    for (let each = node; each !== null; each = each.parentElement) product *= Number(getComputedStyle(each).opacity);
    return product;
  };
  const switches = pressed ? [...document.querySelectorAll("[aria-pressed]")] : [];
  const before = switches.map((node) => node.getAttribute("aria-pressed"));
  switches.forEach((node) => node.setAttribute("aria-pressed", "true"));
  const texts = [...document.querySelectorAll("body *")].filter((node) => !(node instanceof SVGElement)
    && node.checkVisibility({ opacityProperty: true, visibilityProperty: true }) && node.getClientRects().length
    && (["INPUT", "SELECT"].includes(node.tagName)
      || [...node.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim())));
  const found = texts.map((node) => {
    const under = ground(node), style = getComputedStyle(node), colour = parse(style.color);
    const ink = over({ ...colour, a: colour.a * opacity(node) }, under);
    const [high, low] = [light(ink), light(under)].sort((a, b) => b - a);
    return { ratio: (high + 0.05) / (low + 0.05), disabled: node.closest("[aria-disabled=true]") !== null,
      text: `${node.tagName}.${node.className}: ${(node.textContent || node.value).trim().slice(0, 30)}` };
  });
  switches.forEach((node, index) => node.setAttribute("aria-pressed", before[index]));
  return { count: found.length, least: Math.min(...found.map((each) => each.ratio)),
    low: found.filter((each) => each.ratio < (each.disabled ? leastDisabled : least))
      .map((each) => `${each.ratio.toFixed(2)} ${each.text}`) };
}
"""
"""Texts whose contrast with the colour under them is too low; SVG drawings are left out."""


class Station(NamedTuple):
    """Machine in Stopped, and the page of a maintainer."""

    live: LiveMachine
    screen: Screen


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Yield a machine in Stopped with its page; each test must leave it so."""
    folder = tmp_path_factory.mktemp("contrast")
    with LiveMachine(folder) as live, PanelProcess(live, folder) as panel, sync_playwright() as playwright:
        chromium: Browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=FLAGS)
        with Screen(chromium, panel.url, "maintain") as screen:
            live.until_state(State.STOPPED)
            yield Station(live, screen)
        chromium.close()


def force(session: CDPSession, pseudo_classes: tuple[str, ...]) -> None:
    """Force pseudo-classes on every control of the page."""
    root = session.send("DOM.getDocument", {"depth": -1})["root"]["nodeId"]
    controls = session.send("DOM.querySelectorAll", {"nodeId": root, "selector": "button, input, select"})["nodeIds"]
    assert controls
    for node in controls:
        session.send("CSS.forcePseudoState", {"nodeId": node, "forcedPseudoClasses": list(pseudo_classes)})


def low_contrasts(page: Page, state: str, *, pressed: bool) -> list[str]:
    """Return the texts whose contrast is too low in one state of all controls."""
    session = page.context.new_cdp_session(page)
    session.send("DOM.enable")
    session.send("CSS.enable")
    force(session, STATES_OF_CONTROLS[state])
    found = page.evaluate(MEASURE, [pressed, TEXT_RATIO, DISABLED_RATIO])
    session.detach()
    assert found["count"] > 10
    low: list[str] = found["low"]
    return low


def low_in_any_state(page: Page) -> dict[str, list[str]]:
    """Return the texts whose contrast is too low, by state of the controls."""
    return {
        f"{state}{', pressed' if pressed else ''}": found
        for state in STATES_OF_CONTROLS
        for pressed in (False, True)
        if (found := low_contrasts(page, state, pressed=pressed))
    }


@pytest.mark.parametrize("name", PAGES)
def test_every_text_is_readable_in_every_state_of_the_controls(station: Station, name: str) -> None:
    """Also a control that is pressed while the pointer is over it, or after a touch."""
    station.screen.open(name)
    assert low_in_any_state(station.screen.page) == {}


@pytest.mark.parametrize("name", PAGES)
def test_a_control_that_is_not_available_differs_by_its_form(station: Station, name: str) -> None:
    """Its border is dashed, and that of every other control is not."""
    station.screen.open(name)
    borders = station.screen.page.evaluate(
        """() => [...document.querySelectorAll("button.order, button.hold")].map((node) =>
             [node.getAttribute("aria-disabled") === "true", getComputedStyle(node).borderTopStyle])"""
    )
    assert {style for disabled, style in borders if disabled} <= {"dashed"}
    assert "dashed" not in {style for disabled, style in borders if not disabled}


@pytest.mark.parametrize("name", ["overview", "alarms", "recovery"])
def test_every_text_is_readable_in_an_emergency_stop(station: Station, name: str) -> None:
    """With an alarm that is not acknowledged, and with the refusal of a press."""
    live, screen = station
    screen.open("overview")
    screen.press("[data-box=emergency_stop]")
    live.until_state(State.ABORTED)
    screen.open(name)
    expect(screen.find(".banner")).to_have_attribute("data-priority", "safety")
    low = low_in_any_state(screen.page)
    screen.open("overview")
    screen.press("[data-box=emergency_stop]")
    clear(screen, live)
    screen.open("alarms")
    screen.press("[data-command=acknowledge_all]")
    assert low == {}
