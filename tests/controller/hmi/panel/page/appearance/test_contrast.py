"""Contrast of every text of the page, from the colours that the browser computes, in every state of the controls."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Final

import pytest
from playwright.sync_api import CDPSession, Page, expect

from controller.hmi.panel.view.texts import TEXTS
from controller.program.states import State
from tests.controller.hmi.panel.page.appearance.still_page import show, stand_still
from tests.controller.hmi.panel.page.appearance.test_colour_vision import NUMBERS
from tests.controller.hmi.panel.page.appearance.test_sizes import ROW, SITUATIONS
from tests.controller.hmi.panel.page.screen import PAGES, Maintained, Screen, clear, maintained

pytestmark = pytest.mark.nightly

TEXT_RATIOS: Final = {"grey": 4.5, "day": 7.0, "night": 4.5}
"""Least contrast of a text by theme (WCAG 2.2, 1.4.3 and 1.4.6)."""
DISABLED_RATIO: Final = 3.0
"""Least contrast of the text of a control that is not available."""
LANGUAGES: Final = ("en", "zh")
STATES_OF_CONTROLS: Final = {
    "rest": (),
    "hover": ("hover",),
    "focus": ("focus", "focus-visible"),
    "touched": ("hover", "active"),
}
"""Pseudo-classes that are forced on every control; after a touch, a browser keeps `hover`."""
BACKS: Final = {"grey": "rgb(213, 216, 218)", "day": "rgb(255, 255, 255)", "night": "rgb(20, 24, 27)"}
"""Background of the page by theme."""
SUNLIT: Final = {"theme": "day", "white": 500, "reflected": 95, "least": 3}
"""Panel in sunlight (docs/hmi-philosophy.md): luminance of white and of the reflected light, cd/m², and the least
contrast of a text in the theme for it.
"""
FINGER_PX: Final = 44
PRIORITIES: Final = ("safety", "stops", "warning")
MEASURED: Final = (*PAGES, "menu")
IN_THE_CAB: Final = ("cab", "recovery", "trays", "menu")
"""Pages that are measured in the form for the cab; the others in that for the desk."""
BOTH: Final = [*product(MEASURED, LANGUAGES)]
"""Pages in each language; by default four, in alternating languages."""
MEASURE: Final = """
([ratios, leastDisabled, links, sunlit]) => {
  const parse = (text) => {
    const [r, g, b, a = 1] = text.match(/[\\d.]+/g).map(Number);
    return { r, g, b, a };
  };
  const over = (top, under) => ({ r: top.r * top.a + under.r * (1 - top.a), g: top.g * top.a + under.g * (1 - top.a),
    b: top.b * top.a + under.b * (1 - top.a), a: 1 });
  const linear = (value) => (value / 255 <= 0.04045 ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4);
  const light = (colour) => 0.2126 * linear(colour.r) + 0.7152 * linear(colour.g) + 0.0722 * linear(colour.b);
  const remembered = (compute) => {
    const known = new Map();
    return (node) => known.get(node) ?? known.set(node, compute(node)).get(node);
  };
  const shapeUnder = (text) => {
    const { x, y, width, height } = text.getBoundingClientRect();
    const shapes = [...text.ownerSVGElement.querySelectorAll("rect, circle, path")].filter((shape) =>
      shape.compareDocumentPosition(text) & Node.DOCUMENT_POSITION_FOLLOWING
      && shape.checkVisibility({ visibilityProperty: true }) && getComputedStyle(shape).fill !== "none");
    return shapes.findLast((shape) => shape.isPointInFill(
      new DOMPoint(x + width / 2, y + height / 2).matrixTransform(shape.getScreenCTM().inverse())));
  };
  const measure = (least, situation) => {
    const ground = remembered((node) => {
      if (node === null) return { r: 255, g: 255, b: 255, a: 1 };
      const colour = parse(getComputedStyle(node).backgroundColor);
      return colour.a === 1 ? colour : over(colour, ground(node.parentElement));
    });
    const opacity = remembered((node) => (node === null ? 1
      : Number(getComputedStyle(node).opacity) * opacity(node.parentElement)));
    return texts.map((node) => {
      const drawn = node instanceof SVGElement, style = getComputedStyle(node);
      const shape = drawn ? shapeUnder(node) : undefined;
      const under = shape === undefined ? ground(node) : parse(getComputedStyle(shape).fill);
      const colour = parse(drawn ? style.fill : style.color);
      const ink = over({ ...colour, a: colour.a * opacity(node) }, under);
      const [high, low] = [light(ink), light(under)].sort((a, b) => b - a);
      const words = (node.textContent || node.value).trim().slice(0, 30);
      const seen = (value) => sunlit.white * value + sunlit.reflected;
      return { ratio: (high + 0.05) / (low + 0.05), least: node.closest("[aria-disabled=true]") ? leastDisabled : least,
        faint: root.theme === sunlit.theme && seen(high) / seen(low) < sunlit.least,
        text: `${situation}: ${node.tagName}.${node.getAttribute("class")}: ${words}` };
    }).filter((each) => each.ratio < each.least || each.faint).map((each) => `${each.ratio.toFixed(2)} ${each.text}`);
  };
  const texts = [...document.querySelectorAll("body *")].filter((node) => (["INPUT", "SELECT"].includes(node.tagName)
      || [...node.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim()))
    && node.checkVisibility({ opacityProperty: true, visibilityProperty: true }) && node.getClientRects().length);
  const root = document.documentElement.dataset, body = document.body.dataset;
  const switches = [...document.querySelectorAll("[aria-pressed]")];
  const before = switches.map((node) => node.getAttribute("aria-pressed"));
  const { theme: themeBefore } = root, { link: linkBefore } = body;
  const low = [];
  for (const [theme, least] of Object.entries(ratios)) for (const link of links) for (const pressed of [false, true]) {
    Object.assign(root, { theme });
    Object.assign(body, { link });
    switches.forEach((node, index) => node.setAttribute("aria-pressed", pressed || before[index]));
    low.push(...measure(least, `${theme}, ${link}${pressed ? ", pressed" : ""}`));
  }
  switches.forEach((node, index) => node.setAttribute("aria-pressed", before[index]));
  Object.assign(root, { theme: themeBefore });
  Object.assign(body, { link: linkBefore });
  return { count: texts.length, low };
}
"""
"""Script that returns the texts whose contrast with the colour under them is too low, with the themes, links and
switches in turn; the page draws nothing in between."""


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Maintained]:
    """Yield a machine in Stopped with its page; each test must leave it so."""
    with maintained(tmp_path_factory.mktemp("contrast")) as machine:
        yield machine


def force(session: CDPSession, pseudo_classes: tuple[str, ...]) -> None:
    """Force pseudo-classes on every control of the page."""
    root = session.send("DOM.getDocument", {"depth": -1})["root"]["nodeId"]
    controls = session.send("DOM.querySelectorAll", {"nodeId": root, "selector": "button, input, select"})["nodeIds"]
    assert controls
    for node in controls:
        session.send("CSS.forcePseudoState", {"nodeId": node, "forcedPseudoClasses": list(pseudo_classes)})


def open_page(screen: Screen, name: str) -> None:
    """Open a page by its address; the menu has no tab."""
    screen.page.evaluate("name => { window.location.hash = name; }", name)
    expect(screen.find(f"main[data-page={name}]")).to_be_visible()


def low_in_any_state(page: Page) -> dict[str, list[str]]:
    """Return the texts whose contrast is too low in any theme, by state of the controls."""
    session = page.context.new_cdp_session(page)
    session.send("DOM.enable")
    session.send("CSS.enable")
    low = {}
    for state, pseudo_classes in STATES_OF_CONTROLS.items():
        force(session, pseudo_classes)
        found = page.evaluate(
            MEASURE, [TEXT_RATIOS, DISABLED_RATIO, ["live", "stale"] if state == "rest" else ["live"], SUNLIT]
        )
        assert found["count"] > 10
        if found["low"]:
            low[state] = found["low"]
    session.detach()
    return low


def choose_language(screen: Screen, language: str) -> None:
    screen.find("[data-action=language]").select_option(language)
    expect(screen.find("h1")).to_have_text(getattr(TEXTS["title"], language))


@pytest.mark.parametrize(("name", "language"), BOTH)
def test_every_text_is_readable_in_every_state_of_the_controls(station: Maintained, name: str, language: str) -> None:
    """In every theme; also a control that is pressed under the pointer or after a touch, and outdated values."""
    choose_language(station.screen, language)
    open_page(station.screen, name)
    if name in IN_THE_CAB:
        station.screen.page.set_viewport_size({"width": 800, "height": 480})
    low = low_in_any_state(station.screen.page)
    station.screen.page.set_viewport_size({"width": 1280, "height": 800})
    assert low == {}


@pytest.mark.parametrize(("name", "language"), BOTH)
def test_every_text_is_readable_in_every_situation(station: Maintained, name: str, language: str) -> None:
    """In the situations in which the sizes are measured, with warnings, a question and alarms of every priority."""
    page = station.screen.page
    choose_language(station.screen, language)
    open_page(station.screen, name)
    stand_still(page)
    numbers = page.evaluate(NUMBERS)
    rows = [ROW | {"number": numbers[each], "state": 1, "shelved_until_ms": None} for each in PRIORITIES]
    low = {}
    for situation, changes in (SITUATIONS | {"alarms": {"alarms": {"rows": rows}}}).items():
        show(page, changes)
        found = page.evaluate(MEASURE, [TEXT_RATIOS, DISABLED_RATIO, ["live"], SUNLIT])
        low[situation] = found["low"]
    page.reload()
    expect(station.screen.find("body")).to_have_attribute("data-link", "live")
    assert {situation: texts for situation, texts in low.items() if texts} == {}


@pytest.mark.parametrize("name", PAGES)
def test_a_control_that_is_not_available_differs_by_its_form(station: Maintained, name: str) -> None:
    """Its border is dashed, and that of every other control is not; the themes differ in colours only."""
    station.screen.open(name)
    borders = station.screen.page.evaluate(
        """() => [...document.querySelectorAll("button.order, button.hold")].map((node) =>
             [node.getAttribute("aria-disabled") === "true", getComputedStyle(node).borderTopStyle])"""
    )
    assert {style for disabled, style in borders if disabled} <= {"dashed"}
    assert "dashed" not in {style for disabled, style in borders if not disabled}


@pytest.mark.parametrize(("name", "language"), [("overview", "zh"), ("alarms", "en"), ("recovery", "zh")])
def test_every_text_is_readable_in_an_emergency_stop(station: Maintained, name: str, language: str) -> None:
    """With an alarm that is not acknowledged, and with the refusal of a press."""
    live, screen = station
    choose_language(screen, language)
    screen.open("overview")
    screen.press("[data-box=emergency_stop]")
    live.until_state(State.ABORTED)
    screen.open(name)
    expect(screen.find(".banner")).to_have_attribute("data-priority", "safety")
    stand_still(screen.page)  # a new list of alarms would replace the controls while they are measured
    low = low_in_any_state(screen.page)
    screen.page.reload()
    expect(screen.find("body")).to_have_attribute("data-link", "live")
    screen.open("overview")
    screen.press("[data-box=emergency_stop]")
    clear(screen, live)
    screen.open("alarms")
    screen.press("[data-command=acknowledge_all]")
    assert low == {}


def expect_theme(screen: Screen, theme: str) -> None:
    expect(screen.find("html")).to_have_attribute("data-theme", theme)
    expect(screen.find("[data-action=theme]")).to_have_value(theme)
    assert screen.page.evaluate("getComputedStyle(document.body.parentElement).backgroundColor") == BACKS[theme]


def test_the_theme_follows_the_computer_until_it_is_chosen(station: Maintained) -> None:
    """A choice, here with the keyboard, outlasts the setting of the computer and a reload."""
    _, screen = station
    expect_theme(screen, "grey")
    screen.page.emulate_media(contrast="more")
    expect_theme(screen, "day")
    screen.find("[data-action=theme]").focus()
    screen.page.keyboard.press("ArrowUp")
    expect_theme(screen, "grey")
    expect(screen.find("[data-action=theme]")).to_be_focused()
    screen.page.emulate_media(contrast="no-preference")
    screen.page.keyboard.press("ArrowDown")
    expect_theme(screen, "day")
    screen.page.reload()
    expect_theme(screen, "day")


def test_the_choice_of_the_theme_is_named_and_as_large_as_a_finger(station: Maintained) -> None:
    _, screen = station
    for language in LANGUAGES:
        choose_language(screen, language)
        choice = screen.find("[data-action=theme]")
        expect(choice).to_have_attribute("aria-label", getattr(TEXTS["theme"], language))
        expect(choice.locator("option")).to_have_text(
            [getattr(TEXTS[f"theme.{theme}"], language) for theme in TEXT_RATIOS]
        )
        box = choice.bounding_box()
        assert box is not None
        assert min(box["width"], box["height"]) >= FINGER_PX
