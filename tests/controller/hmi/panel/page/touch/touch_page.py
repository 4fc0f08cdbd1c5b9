"""Page on a touch screen without a keyboard, with the pads of its fields."""

from __future__ import annotations

import json
from typing import Final, Self

from playwright.sync_api import Browser, Locator, expect

from tests.controller.hmi.panel.page.screen import AGAIN_MS, Screen

BOXES: Final = """keys => keys.filter((key) => key.checkVisibility({ visibilityProperty: true }))
  .map((key) => key.getBoundingClientRect().toJSON())"""
"""Script that returns the rectangles of the visible keys."""
OVERLAPS: Final = """selector => {
  const box = document.querySelector(selector).getBoundingClientRect();
  const parts = document.querySelectorAll(".state, .clock, .mode, .todo, .banner, .strip, .keys .order, .notice");
  return [...parts].filter((part) => part.checkVisibility()).filter((part) => {
    const { top, right, bottom, left } = part.getBoundingClientRect();
    const across = left < box.right - 1 && right > box.left + 1, down = top < box.bottom - 1 && bottom > box.top + 1;
    return right > left && bottom > top && across && down;
  }).map((part) => part.className);
}"""
"""Script that returns the classes of the parts of the strip, and of the notice, that an element overlaps."""
KEEP_SET: Final = """
window.set = [];
const send = WebSocket.prototype.send;
WebSocket.prototype.send = function (message) {
  if (JSON.parse(message).type === "set") window.set.push(JSON.parse(message).value);
  send.call(this, message);
};
"""
"""Script that keeps the set-points sent to the panel."""


class TouchPage(Screen):
    """Page on a touch screen without a keyboard; it waits longer before it regards values as outdated."""

    def __init__(self, browser: Browser, url: str, user: str | None = "operate") -> None:
        super().__init__(browser, url, user, touch=True, patient=True)
        self.page.add_init_script(KEEP_SET)

    def __enter__(self) -> Self:
        super().__enter__()
        expect(self.find("body")).to_have_attribute("data-link", "live")
        return self

    @property
    def pad(self) -> Locator:
        return self.find(".pad")

    @property
    def entry(self) -> Locator:
        return self.pad.locator(".pad-entry")

    def key(self, name: str) -> Locator:
        return self.pad.locator(f"[data-key={json.dumps(name)}]")

    def type(self, text: str) -> None:
        """Type into the pad; the second tap of a double tap that has opened it would type nothing."""
        self.page.wait_for_timeout(AGAIN_MS)
        for character in text:
            self.key("space" if character == " " else character).tap()

    def field_of(self, set_point: str) -> Locator:
        return self.find(f"[data-set-point={set_point}] input")

    def opener_of(self, set_point: str) -> Locator:
        return self.find(f"[data-set-point={set_point}] .pad-opener")

    def open_pad(self, set_point: str) -> None:
        self.open("parameters")
        self.field_of(set_point).tap()
        expect(self.pad).to_be_visible()

    def ask_login(self) -> None:
        """Open the login dialog from the menu."""
        self.find(".keys [data-page=menu]").tap()
        self.find("[data-action=menu-login]").tap()

    def overlaps(self, selector: str) -> list[str]:
        """Return the parts of the strip, and the notice, that an element overlaps."""
        found: list[str] = self.page.evaluate(OVERLAPS, selector)
        return found

    def boxes(self, keys: str) -> list[dict[str, float]]:
        """Return the rectangles of the visible keys, px."""
        boxes: list[dict[str, float]] = self.pad.locator(keys).evaluate_all(BOXES)
        return boxes

    def texts(self) -> str:
        """Return everything that is in the document, with the values of its fields."""
        values = "[...document.querySelectorAll('input')].map((one) => one.value).join()"
        document: str = self.page.evaluate(f"document.documentElement.outerHTML + {values}")
        return document
