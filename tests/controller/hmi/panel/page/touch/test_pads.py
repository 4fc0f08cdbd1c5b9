"""Pads of the page: values and passwords are entered by touch alone, and a pad sends nothing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import pytest
from playwright.sync_api import Browser, Locator, Route, expect

from controller.hmi.panel.view import texts
from controller.program.texts.operator import LANGUAGES
from tests.controller.hmi.panel.page.appearance.still_page import show, stand_still
from tests.controller.hmi.panel.page.panel_page_rig import PASSWORDS, LiveMachine, PanelProcess
from tests.controller.hmi.panel.page.screen import AGAIN_MS, Station
from tests.controller.hmi.panel.page.touch.touch_page import OVERLAPS, TouchPage
from tests.sampling import first_of

pytestmark = pytest.mark.nightly

TEXTS = texts.TEXTS
KEY_PX: Final = 15 * 5.25
"""Size of a key that a gloved finger meets, 15 mm on the display of the cab, px."""
LETTER_PX: Final = 65
"""Least size of the keys of the password pad beside the strip of state and alarms, px."""
HEAD_PX: Final = 44
"""Least height of the keys Show and Cancel of the password pad, px."""
GAP_PX: Final = 4


@pytest.fixture(scope="module")
def shared(stopped: Station, browser: Browser) -> Iterator[TouchPage]:
    with TouchPage(browser, stopped.panel.url) as page:
        yield page


@pytest.fixture
def touch(shared: TouchPage) -> TouchPage:
    """Return the page of an operator on a touch screen, without an open pad."""
    shared.open("overview")
    shared.page.evaluate("window.set.length = 0")
    shared.find("[data-part=notice]").evaluate("node => { node.textContent = ''; }")
    return shared


def test_a_set_point_is_entered_by_touch_alone(stopped: Station, touch: TouchPage) -> None:
    """An entry out of range is told at once and not taken; a good one is taken, and sent by the button of the row."""
    live = stopped.live
    register = live.machine.tags.sp.no_cups
    before = live.runtime.plc.read(register)
    touch.open_pad("no_cups")
    expect(touch.pad).to_contain_text("Cup timeout until Suspended")
    expect(touch.pad).to_contain_text("Limits: 1000 – 600000 ms")
    expect(touch.pad).to_contain_text(f"Current value: {before * 100} ms")
    touch.type("300")
    expect(touch.entry).to_have_text("300")
    expect(touch.pad.locator(".wrong")).to_have_text("Enter 1000 to 600000")
    touch.key("enter").dispatch_event("click")
    expect(touch.entry).to_have_text("300")
    touch.key("clear").tap()
    expect(touch.pad.locator(".wrong")).to_have_text("")
    touch.type("50000")
    touch.key("backspace").tap()
    touch.key("enter").tap()
    expect(touch.pad).to_have_count(0)
    expect(touch.field_of("no_cups")).to_have_value("5000")
    assert touch.page.evaluate("window.set") == []
    touch.find("[data-set-point=no_cups] button[type=submit]").tap()
    live.until(lambda: live.runtime.plc.read(register) == 50, "set")
    assert touch.page.evaluate("window.set") == [50]
    expect(touch.field_of("no_cups")).to_have_value("")


def test_a_pad_that_is_cancelled_leaves_the_field_as_it_was(touch: TouchPage) -> None:
    touch.open_pad("no_cups")
    touch.type("5000")
    touch.key("cancel").tap()
    expect(touch.pad).to_have_count(0)
    expect(touch.field_of("no_cups")).to_have_value("")


def double_tap(node: Locator) -> None:
    node.scroll_into_view_if_needed()
    box = node.bounding_box()
    assert box is not None
    for _ in range(2):
        node.page.touchscreen.tap(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def test_a_double_tap_types_nothing_and_presses_nothing_under_the_pad(touch: TouchPage) -> None:
    """Neither the one that opens the pad, nor the one that closes it."""
    touch.open("parameters")
    double_tap(touch.field_of("settle"))
    expect(touch.pad).to_be_visible()
    expect(touch.entry).to_have_text("")
    touch.type("200")
    double_tap(touch.key("enter"))
    expect(touch.find("[data-part=notice]")).to_contain_text(TEXTS["touch.again"].en)
    expect(touch.find(".pad-closed")).to_have_count(0)
    expect(touch.field_of("settle")).to_have_value("200")
    assert touch.page.evaluate("window.set") == []


def test_a_keyboard_types_into_the_pad_and_into_the_field(touch: TouchPage) -> None:
    """The mouse opens the pad with the key beside the field only; an entry with a comma has its reason."""
    touch.open("parameters")
    field = touch.field_of("no_cups")
    field.click()
    expect(touch.pad).to_have_count(0)
    expect(field).to_be_focused()
    touch.page.keyboard.type("4100")
    expect(field).to_have_value("4100")
    touch.opener_of("no_cups").click()
    touch.page.keyboard.type("3,5")
    expect(touch.pad.locator(".wrong")).to_have_text(TEXTS["parameters.comma"].en)
    touch.page.keyboard.press("Enter")
    expect(touch.entry).to_have_text("3,5")
    for _ in range(2):
        touch.page.keyboard.press("Backspace")
    touch.page.keyboard.type("0000")
    touch.page.keyboard.press("Enter")
    expect(touch.pad).to_have_count(0)
    expect(field).to_have_value("30000")
    touch.page.wait_for_timeout(AGAIN_MS)
    touch.opener_of("no_cups").press("Enter")
    touch.page.keyboard.type("7")
    touch.page.keyboard.press("Escape")
    expect(touch.pad).to_have_count(0)
    expect(field).to_have_value("30000")
    assert touch.page.evaluate("window.set") == []


def test_the_pad_has_a_sign_and_a_point_only_for_a_set_point_that_has_them(stopped: Station, browser: Browser) -> None:
    def change(route: Route) -> None:
        response = route.fetch()
        description = response.json()
        (point,) = (point for point in description["set_points"] if point["name"] == "no_cups")
        point.update(lowest=-50, highest=50, scale=0.1)
        route.fulfill(response=response, json=description)

    touch = TouchPage(browser, stopped.panel.url)
    touch.page.route("**/api/describe", change)
    with touch:
        touch.open_pad("settle")
        for key in "-.":
            expect(touch.key(key)).to_have_count(0)
        touch.key("cancel").tap()
        expect(touch.find(".pad-closed")).to_have_count(0)
        touch.field_of("no_cups").tap()
        touch.type("-5.1")
        expect(touch.pad.locator(".wrong")).to_have_text("Enter -5.0 to 5.0")
        touch.key("clear").tap()
        touch.type("-4.05")
        expect(touch.pad.locator(".wrong")).to_have_text("Enter a multiple of 0.1")
        touch.key("clear").tap()
        touch.type("-4.5")
        touch.key("enter").tap()
        expect(touch.field_of("no_cups")).to_have_value("-4.5")
        touch.find("[data-set-point=no_cups] button[type=submit]").tap()
        touch.page.wait_for_function("() => window.set.length === 1")
        assert touch.page.evaluate("window.set") == [-45]


GIVEN_WAY: Final = f"""() =>
  document.querySelector(".notice").textContent !== "" && ({OVERLAPS})(".pad").length === 0"""
"""Script that returns whether a notice is shown and the pad leaves it free."""
SCREENS: Final = [(800, 480), (390, 844), (1280, 800)]
"""Widths and heights of a display in the cab, a telephone and a desk, px."""


@pytest.mark.parametrize(("width", "height"), first_of(SCREENS))
def test_pad_and_dialog_lie_beside_the_strip_which_stays_in_reach(
    stopped: Station, browser: Browser, width: int, height: int
) -> None:
    """Also with the notice of a refused order and a warning; a pad closes with its page."""
    with TouchPage(browser, stopped.panel.url) as touch:
        touch.page.set_viewport_size({"width": width, "height": height})
        touch.open_pad("no_cups")
        assert touch.overlaps(".pad") == []
        hold = touch.find(".keys [data-command=hold]").bounding_box()
        assert hold is not None
        touch.page.touchscreen.tap(hold["x"] + hold["width"] / 2, hold["y"] + hold["height"] / 2)
        expect(touch.find("[data-part=notice]")).to_contain_text("Cannot hold")
        touch.page.wait_for_function(GIVEN_WAY)
        if width == 800:
            touch.ask_login()
        else:
            touch.find("[data-action=login]").tap()
        expect(touch.pad).to_have_count(0 if width == 800 else 1)
        if width != 800:
            touch.key("cancel").tap()
        expect(touch.find("dialog")).to_be_visible()
        assert touch.overlaps("dialog") == []
        touch.find("dialog [data-action=close]").tap()
        touch.open("parameters")
        touch.find("[data-part=notice]").evaluate("node => { node.textContent = ''; }")
        stand_still(touch.page)
        touch.field_of("no_cups").tap()
        show(touch.page, {"forced": {"": ["X5", "X6"]}})
        expect(touch.find("[data-part=forced]")).to_be_visible()
        assert touch.overlaps(".pad") == []


def distance(one: dict[str, float], other: dict[str, float]) -> float:
    """Return the gap between two rectangles, px; negative if they overlap."""
    across = max(one["left"] - other["right"], other["left"] - one["right"])
    down = max(one["top"] - other["bottom"], other["top"] - one["bottom"])
    return max(across, down)


@pytest.mark.parametrize("layer", first_of(["lower", "figures", "signs"]))
def test_keys_have_the_size_of_a_glove(touch: TouchPage, layer: str) -> None:
    """The keys of the number pad, and the letters and signs as large as they fit beside the strip."""
    touch.open_pad("no_cups")
    number = touch.boxes(".pad-key")
    touch.key("cancel").tap()
    expect(touch.find(".pad-closed")).to_have_count(0)
    touch.ask_login()
    touch.find("dialog input").tap()
    if layer != "lower":
        touch.key("kind").tap()
    if layer == "signs":
        touch.key("other").tap()
    letters = touch.boxes(".pad-letters .pad-key")
    head = touch.boxes(".pad-head .pad-key")
    touch.key("cancel").tap()
    touch.find("dialog [data-action=close]").tap()
    assert len(number) == 14
    assert len(letters) == {"lower": 32, "figures": 32, "signs": 22}[layer]
    assert len(head) == 2
    for boxes, least in ((number, KEY_PX), (letters, LETTER_PX), (head, HEAD_PX)):
        assert min(min(box["width"], box["height"]) for box in boxes) >= least
        assert min(distance(one, other) for one in boxes for other in boxes if one is not other) >= GAP_PX
        assert all(box["left"] >= 0 and box["right"] <= 800 and box["bottom"] <= 480 for box in boxes)


def test_shelving_minutes_are_entered_by_touch(stopped: Station, browser: Browser) -> None:
    row: dict[str, Any] = {"number": 999, "state": 1, "came_ms": 0, "shelved_until_ms": None, "first_out": False}
    row |= {"follows": None, "chattering": False, "standing": False}
    with TouchPage(browser, stopped.panel.url) as touch:
        touch.open("alarms")
        stand_still(touch.page)
        show(touch.page, {"alarms": {"rows": [row]}})
        touch.find(".shelf input").tap()
        touch.type("481")
        expect(touch.pad.locator(".wrong")).to_have_text("Enter 1 to 480")
        touch.key("backspace").tap()
        touch.key("enter").tap()
        expect(touch.find(".shelf input")).to_have_value("48")
        touch.find(".shelf input").tap()
        show(touch.page, {"alarms": {"rows": []}})
        expect(touch.pad).to_have_count(0)


def test_an_operator_logs_in_by_touch_alone(stopped: Station, browser: Browser) -> None:
    """The password is masked unless a key is pressed, and is nowhere in the page afterwards."""
    password = PASSWORDS["operate"]
    with TouchPage(browser, stopped.panel.url, user=None) as touch:
        touch.ask_login()
        touch.find("dialog input").tap()
        touch.type(password)
        expect(touch.entry).to_have_text("•" * len(password))
        assert password not in touch.texts()
        touch.key("show").dispatch_event("pointerdown")
        expect(touch.entry).to_have_text(password)
        touch.key("show").dispatch_event("pointerup")
        expect(touch.entry).to_have_text("•" * len(password))
        touch.key("cancel").tap()
        assert password not in touch.texts()
        expect(touch.find(".pad-closed")).to_have_count(0)
        touch.find("dialog input").tap()
        touch.type(password)
        touch.key("enter").tap()
        touch.find("dialog [data-action=submit]").tap()
        expect(touch.find("[data-fact=level]")).to_have_text(TEXTS["level.operate"].en)
        assert password not in touch.texts()


def test_a_password_that_is_typed_goes_with_its_dialog(touch: TouchPage) -> None:
    touch.ask_login()
    touch.find("dialog input").fill("not the password")
    assert "not the password" in touch.texts()
    touch.page.keyboard.press("Escape")
    expect(touch.find("dialog input")).to_have_count(0)
    assert "not the password" not in touch.texts()


def test_every_character_of_a_keyboard_is_on_the_password_pad(touch: TouchPage) -> None:
    touch.ask_login()
    touch.find("dialog input").tap()
    found = {" "}
    for key in (None, "other", "kind", "other"):
        if key is not None:
            touch.key(key).tap()
        found.update(touch.pad.locator(".pad-letters .pad-key:not([disabled])").all_inner_texts())
    touch.key("cancel").tap()
    touch.find("dialog [data-action=close]").tap()
    assert {chr(code) for code in range(32, 127)} - found == set()


def test_the_first_passwords_are_set_by_touch(live: LiveMachine, browser: Browser, tmp_path: Path) -> None:
    """A password that is too short is not taken."""
    with ExitStack() as stack:
        panel = stack.enter_context(PanelProcess(live, tmp_path, first_run=True))
        touch = stack.enter_context(TouchPage(browser, panel.url, user=None))
        for number, password in enumerate(("seed-Tray", "{Claw} 42")):
            expect(touch.find(".pad-closed")).to_have_count(0)
            touch.find("dialog input").nth(number).tap()
            for character in password:
                enter_character(touch, character)
                if len(touch.entry.inner_text()) == 7:
                    expect(touch.pad.locator(".wrong")).to_have_text("At least 8 characters")
                    expect(touch.key("enter")).to_have_attribute("aria-disabled", "true")
            touch.key("enter").tap()
            expect(touch.find("dialog input").nth(number)).to_have_value(password)
        touch.find("dialog [data-action=submit]").tap()
        expect(touch.find("dialog[open]")).to_have_count(0)
        answer = touch.page.request.post(
            f"{panel.url}/api/login",
            data={"user": "maintain", "password": "{Claw} 42"},
            headers={"origin": panel.url},
        )
        assert answer.ok, answer.text()


def enter_character(touch: TouchPage, character: str) -> None:
    """Tap a character, on whatever layer of the pad it is."""
    for layer_key in ("other", "kind", "other", "kind", "other"):
        if character == " " or touch.key(character).count():
            break
        touch.key(layer_key).tap()
    touch.type(character)


@pytest.mark.parametrize("kind", first_of(["password", "number"]))
def test_a_lost_link_closes_the_pad_and_discards_its_entry(
    live: LiveMachine, panel: PanelProcess, browser: Browser, kind: str
) -> None:
    with TouchPage(browser, panel.url) as touch:
        if kind == "number":
            touch.open_pad("no_cups")
            touch.type("5000")
        else:
            touch.ask_login()
            touch.find("dialog input").tap()
            touch.type("secretly")
        with panel.restarted():
            expect(touch.pad).to_have_count(0)
            assert "5000" not in touch.field_of("no_cups").evaluate_all("fields => fields.map((one) => one.value)")
            assert "secretly" not in touch.texts()
        expect(touch.find("body")).to_have_attribute("data-link", "live")
        touch.unexpected.clear()  # refused connections


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_pads_are_in_the_language_of_the_page(touch: TouchPage, language: str) -> None:
    touch.select_language(language)
    touch.open_pad("no_cups")
    number = touch.pad.inner_text()
    touch.key("cancel").tap()
    touch.ask_login()
    touch.find("dialog input").tap()
    password = touch.pad.inner_text()
    touch.key("cancel").tap()
    touch.find("dialog [data-action=close]").tap()
    touch.select_language("en")
    shown = {
        "clear": number + password,
        "enter": number + password,
        "cancel": number,
        "space": password,
        "show": password,
    }
    for key, text in shown.items():
        assert getattr(TEXTS[f"pad.{key}"], language) in text
    assert getattr(TEXTS["parameters.limits"], language) in number
    assert getattr(TEXTS["login.password"], language) in password
