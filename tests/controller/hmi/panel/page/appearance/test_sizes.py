"""Cab view at 800 x 480: letters and keys in millimetres on the reference display, and pages that need no scrolling.

The sizes and their sources are in docs/hmi-philosophy.md.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from itertools import combinations, product
from typing import Any, Final

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser

from controller.program.machine import build
from controller.program.operator.next_press import NextPress, what_to_do
from controller.program.states import Mode, State
from controller.program.texts.next_press import NEXT_PRESSES
from controller.program.texts.operator import LANGUAGES, REASONS, Text
from tests.controller.common.modbus_rig import IO_MAP
from tests.controller.hmi.panel.page.appearance.still_page import show, stand_still
from tests.controller.hmi.panel.page.screen import PAGES, Screen, started
from tests.sampling import one_in

pytestmark = pytest.mark.nightly

PX_PER_MM: Final = 800 / 152.4
"""Points of the reference display in a millimetre: 7 inches, 800 by 480, square points."""
WITHOUT_SCROLLING: Final = ("cab", "alarms", "recovery", "manual", "trays")
FAR: Final = {"capital": 3.7, "chinese": 4.6, "key": 20.0, "gap": 4.0}
"""Least sizes of the strip and of the cab page, which are read from 800 mm, mm."""
NEAR: Final = {"capital": 2.3, "chinese": 4.6 * 500 / 800, "key": 15.0, "gap": 0.75}
"""Least sizes of the other pages, which are read from 500 mm, mm."""
STATE_MM: Final = 8.0
ROUNDING_PX: Final = 0.25
ENDS: Final = (("left", "right"), ("top", "bottom"))
GLARE: Final = {"side_px": 36, "luminance": 0.3}
"""A square of this side in which every point has at least this relative luminance is a white area."""


Changes = Mapping[str, Mapping[str, Any]]
ROW: Final = {"first_out": True, "follows": None, "chattering": False, "standing": False, "came_ms": 0}
ALARM: Final = {"rows": [ROW | {"number": 900, "state": 1, "shelved_until_ms": None}]}
SITUATIONS: Final[dict[str, Changes]] = {
    "stopped": {},
    "emergency stop": {
        "machine": {"state": int(State.ABORTED), "first_out": 900, "next_press": 6, "next_command": None},
        "alarms": {"rows": ALARM["rows"]},
    },
    "jam": {
        "machine": {"state": int(State.HELD), "first_out": 900, "isolate": True, "next_command": "reset"},
        "alarms": {"rows": ALARM["rows"]},
    },
    "link to the field lost, inputs forced": {
        "link": {"field_lost": True},
        "forced": {"": [f"X{number:o}" for number in range(8)]},
    },
    "question": {
        "machine": {"state": int(State.HELD), "next_press": 9},
        "questions": {"open": ["left_loaded"]},
    },
}
MEASURE: Final = """
() => {
  const scaleOf = (node) => (node instanceof SVGElement ? Math.hypot(node.getScreenCTM().b, node.getScreenCTM().d) : 1);
  const pen = document.createElement("canvas").getContext("2d");
  const shown = (node) => node.checkVisibility({ visibilityProperty: true, opacityProperty: true })
    && node.getClientRects().length > 0;
  const letters = [];
  const walker = document.createTreeWalker(document.getElementById("panel"), NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.data.trim(), node = walker.currentNode.parentElement;
    if (text === "" || !shown(node) || node.tagName === "OPTION") continue;
    const style = getComputedStyle(node), px = parseFloat(style.fontSize) * scaleOf(node);
    pen.font = `${style.fontWeight} 100px ${style.fontFamily}`;
    const high = (sample) => {
      const { actualBoundingBoxAscent: up, actualBoundingBoxDescent: down } = pen.measureText(sample);
      return ((up + (sample === "H" ? 0 : down)) / 100) * px;
    };
    const chinese = /[\\u4E00-\\u9FFF]/.test(text);
    letters.push({ text, chinese, px: chinese ? high("国") : high("H"), state: node.classList.contains("state"),
      far: node.closest(".always, .cab, .notice") !== null });
  }
  const within = (box, frame) => ({ left: Math.max(box.left, frame.left), top: Math.max(box.top, frame.top),
    right: Math.min(box.right, frame.right), bottom: Math.min(box.bottom, frame.bottom) });
  const visible = (node) => { // the part that is not scrolled out of its place
    let box = node.getBoundingClientRect();
    for (const frame of [node.closest(".wide"), node.closest(".sections > .column"), node.closest("main")]) {
      if (frame) box = within(box, frame.getBoundingClientRect());
    }
    return box;
  };
  const keys = [...document.querySelectorAll("button, input, select, summary")]
    .filter((node) => shown(node) && getComputedStyle(node).pointerEvents !== "none").map((node) => {
      const { left, top, right, bottom } = node.getBoundingClientRect();
      const far = node.closest(".always, .cab") !== null;
      return { text: node.textContent || node.outerHTML, far, left, top, right, bottom, visible: visible(node) };
    });
  return { letters, keys };
}
"""
"""Script that returns the height of the letters and the rectangles of the keys that are shown, px."""
OVERFLOW: Final = """
() => {
  const parts = document.querySelectorAll("main, .todo, .sections > .column, .cab, .figures");
  const places = [document.documentElement, ...parts];
  const main = document.querySelector("main").getBoundingClientRect();
  const outside = [...document.querySelectorAll("main *")].filter((node) =>
    node.checkVisibility() && node.getBoundingClientRect().right > main.right + 1);
  return [
    ...places.filter((node) => node.scrollHeight > node.clientHeight + 1 || node.scrollWidth > node.clientWidth + 1)
      .map((node) => `${node.tagName}.${node.className} ${node.scrollWidth} x ${node.scrollHeight} px in`
        + ` ${node.clientWidth} x ${node.clientHeight}`),
    ...outside.map((node) => `${node.tagName}.${node.className}: ${node.textContent.slice(0, 30)}`),
  ];
}
"""
"""Script that returns the parts that are larger than their place."""


CROSSED: Final = """
() => {
  const parts = [...document.querySelectorAll(".state, .clock, .mode, .todo, .banner, .strip, .keys .order, main")]
    .filter((part) => part.checkVisibility());
  const crossed = (one, other) => {
    const [a, b] = [one.getBoundingClientRect(), other.getBoundingClientRect()];
    return a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1;
  };
  return parts.flatMap((one, n) => parts.slice(n + 1).filter((other) => crossed(one, other))
    .map((other) => `${one.className} and ${other.className || other.tagName}`));
}
"""
"""Script that returns the parts of the strip that lie over each other or over the page."""


@pytest.fixture(scope="module")
def screen(tmp_path_factory: pytest.TempPathFactory, browser: Browser) -> Iterator[Screen]:
    """Yield the page of a maintainer at a machine in Stopped, which stands still."""
    with (
        started(tmp_path_factory.mktemp("sizes")) as station,
        Screen(browser, station.panel.url, "maintain", touch=True) as screen,
    ):
        station.live.until_state(State.STOPPED)
        screen.page.wait_for_selector("body[data-link=live]")
        stand_still(screen.page)
        yield screen


def open_page(screen: Screen, page: str, language: str = "en") -> None:
    """Open a page by its address, in a language."""
    screen.page.evaluate(
        """async ([page, language]) => {
          const { chooseLanguage } = await import("/static/texts.js");
          chooseLanguage(language);
          window.location.hash = "";
          window.location.hash = page;
        }""",
        [page, language],
    )
    screen.page.wait_for_selector(f"main[data-page={page}]")


def sections(screen: Screen) -> list[str | None]:
    """Return the sections of the open page; [None] for a page without."""
    keys = screen.find("[data-section]").all()
    return [key.get_attribute("data-section") for key in keys if key.is_visible()] or [None]


def each_section(screen: Screen) -> Iterator[str | None]:
    for section in sections(screen):
        if section is not None:
            screen.find(f"[data-section='{section}']").click()
        yield section


def too_small(screen: Screen) -> list[str]:
    """Return the letters and keys of the open page that are smaller than their least size."""
    measured = screen.page.evaluate(MEASURE)
    found = []
    for letter in measured["letters"]:
        sizes = FAR if letter["far"] else NEAR
        least = STATE_MM if letter["state"] else sizes["chinese" if letter["chinese"] else "capital"]
        if letter["px"] < least * PX_PER_MM - ROUNDING_PX:
            found.append(f"{letter['text'][:40]!r}: {letter['px'] / PX_PER_MM:.2f} mm, not {least}")
    keys = measured["keys"]
    for key in keys:
        least = (FAR if key["far"] else NEAR)["key"]
        width, height = key["right"] - key["left"], key["bottom"] - key["top"]
        if min(width, height) < least * PX_PER_MM - ROUNDING_PX:
            found.append(f"key {key['text'][:40]!r}: {width:.0f} x {height:.0f} px, not {least} mm")
    drawn = [key for key in keys if all(key["visible"][a] < key["visible"][b] for a, b in ENDS)]
    for one, other in combinations(drawn, 2):
        least = (FAR if one["far"] or other["far"] else NEAR)["gap"]
        a, b = one["visible"], other["visible"]
        gap = max(b["left"] - a["right"], a["left"] - b["right"], b["top"] - a["bottom"], a["top"] - b["bottom"])
        if gap < least * PX_PER_MM - ROUNDING_PX:
            found.append(f"gap of {gap:.0f} px between {one['text']!r} and {other['text']!r}")
    return found


@pytest.mark.parametrize(("page", "language"), one_in(7, product([*PAGES, "menu"], LANGUAGES)))
def test_letters_and_keys_have_their_sizes_on_the_display(screen: Screen, page: str, language: str) -> None:
    for situation, changes in SITUATIONS.items():
        open_page(screen, page, language)
        show(screen.page, changes)
        for section in each_section(screen):
            assert too_small(screen) == [], (situation, section)


@pytest.mark.parametrize(("page", "language"), [*product([*WITHOUT_SCROLLING, "menu"], LANGUAGES)])
def test_the_pages_of_the_cab_need_no_scrolling(screen: Screen, page: str, language: str) -> None:
    """In every section and situation, the cab page also with two warnings; longer lists are paged by keys."""
    for situation, changes in SITUATIONS.items():
        if page != "cab" and "forced" in changes:
            continue  # each warning takes a line of the page
        open_page(screen, page, language)
        show(screen.page, changes)
        for section in each_section(screen):
            assert screen.page.evaluate(OVERFLOW) == [], (situation, section)


@pytest.mark.parametrize("language", LANGUAGES)
def test_what_to_do_now_is_never_cut(screen: Screen, language: str) -> None:
    """Every next press in every mode, and every reason with the presses that it goes with."""
    open_page(screen, "cab", language)
    machine = build(IO_MAP)
    none, resume = NEXT_PRESSES[NextPress.NONE], NEXT_PRESSES[NextPress.RESUME]
    lines = [(0, none)]
    for press in NextPress:
        for mode in Mode:
            values = {machine.tags.machine.next_press: press, machine.tags.machine.mode: mode}
            line = what_to_do(machine.tags, (), lambda device, values=values: values.get(device, 0))  # type: ignore[misc]
            lines += [] if line is None else [(0, line)]
    assert len({text.en for _, text in lines}) > len(NextPress)
    lines += [(reason, text) for reason in REASONS for text in (none, resume)]
    cut = []
    for reason, text in lines:
        show(screen.page, {"machine": {"reason": reason, "next": _in_both(text), "next_press": 1}})
        if screen.find(".todo").evaluate("node => node.scrollHeight > node.clientHeight"):
            cut.append((reason, getattr(text, language)))
    assert cut == []


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("state", [State.STOPPED, State.HELD, State.ABORTED, State.EXECUTE])
def test_the_name_of_the_first_alarm_is_never_cut(screen: Screen, state: State, language: str) -> None:
    """In the states in which alarms arise or last; the banner of a small screen has no other words."""
    open_page(screen, "cab", language)
    cut = []
    for alarm in build(IO_MAP).alarms:
        row = ROW | {"number": alarm.bit.number, "state": 1, "shelved_until_ms": None}
        show(screen.page, {"machine": {"state": int(state)}, "alarms": {"rows": [row]}})
        if screen.find(".banner-text").evaluate("node => node.scrollHeight > node.clientHeight + 1"):
            cut.append(getattr(alarm.text.message, language))
    assert cut == []


def _in_both(text: Text) -> dict[str, str]:
    return {"en": text.en, "zh": text.zh}


def test_the_strip_is_at_the_same_place_on_every_page(screen: Screen) -> None:
    """State, mode, clock, first alarm, what to do now, and the keys, to the point; and nothing covers them."""
    parts = ("[data-fact=state]", "[data-fact=mode]", "[data-fact=clock]", "[data-part=banner]", ".todo")
    keys = (".keys [data-page=menu]", ".keys [data-command=stop]", ".keys [data-command=hold]")
    places = set()
    for page in [*PAGES, "menu"]:
        open_page(screen, page)
        show(screen.page, SITUATIONS["emergency stop"])
        boxes = []
        for selector in (*parts, *keys):
            box = screen.find(selector).bounding_box()
            assert box is not None, (page, selector)
            boxes.append((selector, *box.values()))
            assert screen.find(selector).evaluate(
                """node => {
                  const { x, y, width, height } = node.getBoundingClientRect();
                  const shown = document.elementFromPoint(x + width / 2, y + height / 2);
                  return node.contains(shown) || node.matches(".banner");
                }"""
            ), (page, selector)
        places.add(tuple(boxes))
        assert screen.page.evaluate(CROSSED) == []
    assert len(places) == 1


@pytest.mark.parametrize("page", one_in(3, [*PAGES, "menu"]))
def test_no_area_of_a_page_is_white_at_night(screen: Screen, page: str) -> None:
    open_page(screen, page)
    show(screen.page, SITUATIONS["jam"])
    screen.page.evaluate("() => { document.documentElement.dataset.theme = 'night'; }")
    values = np.asarray(Image.open(io.BytesIO(screen.page.screenshot())).convert("RGB"), dtype=float) / 255
    screen.page.evaluate("() => { document.documentElement.dataset.theme = 'grey'; }")
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    bright = linear @ np.array([0.2126, 0.7152, 0.0722]) >= GLARE["luminance"]
    side = int(GLARE["side_px"])
    windows = np.lib.stride_tricks.sliding_window_view(bright, (side, side))
    spots = np.argwhere(windows.all(axis=(2, 3)))
    assert len(spots) == 0, f"{len(spots)} points, first at {spots[0]}"
