"""Keys of the cab page: the command that *what to do now* names, at its own place."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, expect

from controller.hmi.panel.view.texts import TEXTS
from controller.program.machine import build
from tests.controller.common.modbus_rig import IO_MAP
from tests.controller.hmi.panel.page.appearance.still_page import show, stand_still
from tests.controller.hmi.panel.page.screen import AGAIN_MS, Station
from tests.controller.hmi.panel.page.touch.touch_page import TouchPage

pytestmark = pytest.mark.nightly

KEEP_ORDERS = """async () => {
  const { app } = await import("/static/app.js");
  window.orders = [];
  app.link.order = (message) => {
    window.orders.push(message.command);
    return Promise.resolve({ ok: true, text: { en: "", zh: "" } });
  };
}"""
"""Script that keeps the commands of the page and sends none."""


@pytest.fixture
def cab(stopped: Station, browser: Browser) -> Iterator[TouchPage]:
    with TouchPage(browser, stopped.panel.url) as page:
        page.open("cab")
        stand_still(page.page)
        page.page.evaluate(KEEP_ORDERS)
        yield page


def offer(page: TouchPage, command: str | None, *, isolate: bool = False) -> None:
    free = {} if command is None else {f"{command}/free": True}
    show(page.page, {"machine": {"next_command": command, "isolate": isolate}, "commands": free})


def tap_next(page: TouchPage) -> None:
    box = page.find(".next-command").bounding_box()
    assert box is not None
    page.page.touchscreen.tap(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def test_a_key_that_has_just_changed_takes_no_press(cab: TouchPage) -> None:
    """The second tap of a double tap on the key before would otherwise start a motion."""
    offer(cab, "clear")
    cab.page.wait_for_timeout(AGAIN_MS)
    tap_next(cab)
    offer(cab, "reset")
    tap_next(cab)
    assert cab.page.evaluate("window.orders") == ["clear"]
    expect(cab.find("[data-part=notice]")).to_contain_text(TEXTS["touch.again"].en)
    cab.page.wait_for_timeout(AGAIN_MS)
    tap_next(cab)
    assert cab.page.evaluate("window.orders") == ["clear", "reset"]


@pytest.mark.parametrize("command", [None, "stop", "hold"])
def test_its_place_stays_empty_without_a_command_of_its_own(cab: TouchPage, command: str | None) -> None:
    """It has no border: that of a key without a text would be taken for a fault."""
    offer(cab, command)
    expect(cab.find(".next-command button")).to_have_count(0)
    expect(cab.find(".next-command")).to_have_css("border-top-style", "none")


def test_it_offers_nothing_while_a_hand_may_be_in_the_machine(cab: TouchPage) -> None:
    offer(cab, "reset")
    place = cab.find(".next-command").bounding_box()
    expect(cab.find(".next-command button")).to_have_count(1)
    offer(cab, "reset", isolate=True)
    expect(cab.find(".next-command button")).to_have_count(0)
    expect(cab.find("[data-cab=isolation]")).to_be_visible()
    assert cab.find(".next-command").bounding_box() == place


def test_an_open_question_has_a_key_that_leads_to_its_answers(cab: TouchPage) -> None:
    answer = cab.find("[data-cab=recovery]")
    expect(answer).to_be_hidden()
    question = {"questions": {"open": ["left_loaded"]}}
    show(cab.page, question)
    answer.tap()
    show(cab.page, question)
    expect(cab.find("[data-question=left_loaded] [data-command=left_loaded_yes]")).to_be_visible()


def test_every_page_has_a_key_in_the_menu(cab: TouchPage) -> None:
    tabs = cab.find("[role=tab]").evaluate_all("tabs => tabs.map((tab) => tab.dataset.page)")
    cab.find(".keys [data-page=menu]").tap()
    keys = cab.find(".menu [data-page]").evaluate_all("keys => keys.map((key) => key.dataset.page)")
    assert sorted(keys) == sorted(tabs)


def test_the_levels_of_the_keys_are_those_of_the_panel(cab: TouchPage) -> None:
    """Stop and Hold for everyone, every other command for an operator."""
    levels = cab.page.evaluate(
        """async () => {
          const { app } = await import("/static/app.js");
          return Object.fromEntries(app.describe.commands.map((command) => [command.name, command.level]));
        }"""
    )
    names = {command.name for command in build(IO_MAP).tags.commands}
    assert levels == {name: "view" if name in {"stop", "hold"} else "operate" for name in names}
