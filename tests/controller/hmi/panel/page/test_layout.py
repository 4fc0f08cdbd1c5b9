"""Size and place of the controls on every page."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from controller.program.texts.operator import LANGUAGES
from tests.controller.hmi.panel.page.screen import PAGES, Screen
from tests.controller.hmi.panel.page.test_page import SHOW_ALARMS
from tests.sampling import first_of

pytestmark = pytest.mark.nightly

SMALL_CONTROLS = """() => [...document.querySelectorAll("button, input, select")]
  .filter((one) => one.checkVisibility({ visibilityProperty: true }))
  .map((one) => ({ text: one.outerHTML, box: one.getBoundingClientRect() }))
  .filter(({ box }) => box.width > 0 && box.height > 0 && !(box.width >= 44 && box.height >= 44))
  .map(({ text, box }) => `${text} is ${box.width} px wide and ${box.height} px high`)"""
"""Script that returns the visible controls that are less than 44 px wide or high."""

CUT_TEXTS = """() => [...document.querySelectorAll("button")]
  .filter((one) => one.checkVisibility({ visibilityProperty: true }))
  .filter((one) => {
    const frame = one.getBoundingClientRect(), words = document.createRange();
    words.selectNodeContents(one);
    return [...words.getClientRects()].some(({ left, top, right, bottom }) =>
      left < frame.left || top < frame.top || right > frame.right || bottom > frame.bottom);
  }).map((one) => one.outerHTML)"""
"""Script that returns the keys that are smaller than their texts."""
CROSSED_MARKS = """() => {
  const arms = [...document.querySelectorAll(".arm[data-tag$='.slide']")];
  const marks = arms.map((arm) => arm.querySelector(".arm-mark"));
  marks.forEach((mark) => { mark.textContent = "✕"; });
  const frame = document.querySelector(".mimic").getBoundingClientRect();
  const captions = [...document.querySelectorAll(".mimic .caption")].filter((caption) => caption.checkVisibility());
  const flow = document.querySelector(".mimic .flow").getBoundingClientRect();
  const cut = captions.filter((caption) => caption.getBoundingClientRect().top < frame.top);
  return [...marks, ...document.querySelectorAll(".mimic .carriage")].flatMap((mark) => {
    const a = mark.getBoundingClientRect();
    const crossed = captions.filter((caption) => {
      const b = caption.getBoundingClientRect();
      return a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
    }).map((caption) => caption.textContent);
    if (a.top < frame.top) crossed.push("edge of the picture");
    if (marks.includes(mark) && a.top < flow.bottom && flow.top < a.bottom) crossed.push("arrow of the conveyor");
    return crossed;
  }).concat(cut.map((caption) => `${caption.textContent}: cut`));
}"""
"""Script that marks both arms, and returns what marks and carriages lie over: captions of the picture or its edge, and
in another place of the slide the arrow of the conveyor; also the captions that the edge of the picture cuts."""


OFF_LINE = """(selectors) => selectors.flatMap(([row, ...parts]) => [...document.querySelectorAll(row)]
  .filter((one) => one.checkVisibility({ visibilityProperty: true })).flatMap((one) => {
    const lines = parts.map((part) => {
      const probe = document.createElement("span"), place = one.querySelector(part);
      probe.style.cssText = "display: inline-block; width: 0; height: 0;";
      place.prepend(probe);
      const { bottom } = probe.getBoundingClientRect();
      probe.remove();
      return bottom;
    });
    return Math.max(...lines) - Math.min(...lines) > 1 ? [`${one.textContent}: ${lines.join(", ")} px`] : [];
  }))"""
"""Script that returns the rows whose parts have their text on different base lines."""


@pytest.mark.parametrize(("width", "height"), first_of([(390, 844), (800, 1280), (1280, 800)]))
@pytest.mark.parametrize("screen", ["maintain"], indirect=True)
def test_every_page_fits_with_named_controls_of_touch_size(screen: Screen, width: int, height: int) -> None:
    screen.page.set_viewport_size({"width": width, "height": height})
    for page in PAGES:
        screen.open(page)
        excess = screen.page.evaluate("() => document.documentElement.scrollWidth - window.innerWidth")
        assert excess <= 0, f"{page} is {excess} px too wide"
        small = screen.page.evaluate(SMALL_CONTROLS)
        assert small == [], page
        nameless = screen.page.evaluate(
            "() => [...document.querySelectorAll('button, input, select')].filter((one) => !one.textContent.trim()"
            " && !one.labels?.length && !one.getAttribute('aria-label')).map((one) => one.outerHTML)"
        )
        assert nameless == []


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_text_is_larger_than_its_key(screen: Screen, language: str) -> None:
    screen.page.set_viewport_size({"width": 1024, "height": 768})
    screen.select_language(language)
    cut = {}
    for page in PAGES:
        screen.open(page)
        cut[page] = screen.page.evaluate(CUT_TEXTS)
    screen.select_language("en")
    assert {page: keys for page, keys in cut.items() if keys} == {}


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_value_stands_on_the_line_of_its_name(screen: Screen, language: str) -> None:
    """Also a number beside Chinese characters, whose lines are higher; the mode beside the clock."""
    screen.page.set_viewport_size({"width": 1024, "height": 768})
    screen.select_language(language)
    off = {}
    for page in ("overview", "trays", "recovery"):
        screen.open(page)
        off[page] = screen.page.evaluate(OFF_LINE, [[".facts div", "dt", "dd"], [".when", ".clock", ".mode"]])
    screen.select_language("en")
    assert {page: rows for page, rows in off.items() if rows} == {}


def test_sign_name_and_keys_of_an_alarm_are_on_one_line(screen: Screen) -> None:
    """Also the reason that stands in place of the key to shelve it."""
    screen.page.set_viewport_size({"width": 1024, "height": 768})
    screen.open("overview")
    screen.page.evaluate(SHOW_ALARMS, [[{"number": 911, "first_out": True}]])
    parts = screen.find("#shown-alarms .alarm-row").locator(".alarm-sign, .alarm-open, .orders > *")
    boxes = [part.bounding_box() for part in parts.all()]
    middles = [box["y"] + box["height"] / 2 for box in boxes if box is not None]
    assert len(middles) == 4
    assert max(middles) - min(middles) <= 1


@pytest.mark.parametrize(("width", "height"), [(800, 480), (1024, 768), (1366, 768)])
@pytest.mark.parametrize("page", ["cab", "overview"])
def test_marks_and_carriages_lie_over_no_caption_or_arrow(screen: Screen, page: str, width: int, height: int) -> None:
    """At the feed position, where they are nearest to the captions; marks and captions are in the picture."""
    screen.page.set_viewport_size({"width": width, "height": height})
    screen.open(page)
    crossed = screen.page.evaluate(CROSSED_MARKS)
    screen.page.set_viewport_size({"width": 1280, "height": 800})
    assert crossed == []


def test_state_mode_and_alarm_stay_in_view_on_a_small_screen(screen: Screen) -> None:
    """At the end of every page as at its beginning; they take less than a quarter of the height."""
    screen.page.set_viewport_size({"width": 480, "height": 600})
    for page in PAGES:
        screen.open(page)
        screen.page.evaluate("() => window.scrollTo(0, document.documentElement.scrollHeight)")
        for fact in ("[data-fact=state]", "[data-fact=mode]", "[data-fact=next-press]", "[data-part=banner]"):
            expect(screen.find(f".always {fact}")).to_be_in_viewport(ratio=1)
        height = screen.page.evaluate("() => document.querySelector('.always').getBoundingClientRect().height")
        assert height < 150, page


def test_tabs_are_selected_with_the_arrow_keys(screen: Screen) -> None:
    screen.find("[role=tab][data-page=overview]").focus()
    first = PAGES.index("overview") + 1
    for page in (*PAGES[first:], *PAGES[:first]):
        screen.page.keyboard.press("ArrowRight")
        expect(screen.find("[role=tab]:focus")).to_have_attribute("data-page", page)
        expect(screen.find("main")).to_have_attribute("data-page", page)
