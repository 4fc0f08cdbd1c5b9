"""Steps page: each list of steps follows its active step, unless the user has scrolled or switched it off."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import pytest
from playwright.sync_api import Browser, Locator, expect

from controller.hmi.panel.view.texts import TEXTS
from controller.program.machine import build
from controller.program.texts.operator import LANGUAGES
from tests.controller.common.modbus_rig import IO_MAP
from tests.controller.hmi.panel.page.appearance.still_page import show, stand_still
from tests.controller.hmi.panel.page.screen import Screen, Station

pytestmark = pytest.mark.nightly

SEQUENCES: Final = {sequence.name: [str(bit) for bit, _ in sequence] for sequence in build(IO_MAP).program.sequences()}
"""Steps of every sequence, in the order of the page."""
LEFT, RIGHT, HOMING = (SEQUENCES[name] for name in ("left arm", "right arm", "left homing"))
INSIDE: Final = """step => {
  const [box, frame] = [step, step.closest(".sfc")].map((node) => node.getBoundingClientRect());
  return frame.height > 0 && box.top >= frame.top - 1 && box.bottom <= frame.bottom + 1;
}"""
"""Script that returns whether a step is in view in its list."""
HAND_MS: Final = 5_000
"""Time for which a list stays where it was scrolled by hand, ms."""


class StepsScreen(Screen):
    """Steps page that shows the steps given by the test; it is scrolled at once, without a motion."""

    def __enter__(self) -> StepsScreen:
        super().__enter__()
        self.page.emulate_media(reduced_motion="reduce")
        self.open("steps")
        expect(self.find("body")).to_have_attribute("data-link", "live")
        stand_still(self.page)
        return self

    def activate(self, *steps: str) -> None:
        show(self.page, {"steps": {"": dict.fromkeys(steps, 1)}})

    def in_view(self, step: str) -> bool:
        inside: bool = self.find(f"[data-step={step}]").evaluate(INSIDE)
        return inside

    def list_of(self, name: str) -> Locator:
        return self.find(f"[data-sequence='{name}'] .sfc")

    def scroll_by_hand(self, name: str) -> None:
        """Turn the wheel over a list until it is at its beginning."""
        self.list_of(name).hover()
        self.page.mouse.wheel(0, -20_000)
        self.page.wait_for_function("node => node.scrollTop === 0", arg=self.list_of(name).element_handle())

    def pass_ms(self, ms: int) -> None:
        """Let the clock of the page be ahead."""
        self.page.evaluate(
            "ms => { const now = performance.now.bind(performance); performance.now = () => now() + ms; }", ms
        )


@pytest.fixture
def wide(stopped: Station, browser: Browser) -> Iterator[StepsScreen]:
    with StepsScreen(browser, stopped.panel.url) as screen:
        yield screen


@pytest.fixture
def small(stopped: Station, browser: Browser) -> Iterator[StepsScreen]:
    with StepsScreen(browser, stopped.panel.url, touch=True) as screen:
        yield screen


def test_each_list_follows_its_own_sequence(wide: StepsScreen) -> None:
    """Both arms at once; the page is not scrolled, and the focus stays where it is."""
    wide.find("[data-action=follow]").focus()
    for left, right in zip(LEFT, reversed(RIGHT), strict=True):
        wide.activate(left, right)
        assert wide.in_view(left)
        assert wide.in_view(right)
    assert wide.page.evaluate("window.scrollY") == 0
    expect(wide.find("[data-action=follow]")).to_be_focused()


def test_the_page_tells_that_no_step_is_active(wide: StepsScreen) -> None:
    wide.activate()
    expect(wide.find(".steps-about")).to_have_text(TEXTS["steps.none"].en)
    wide.activate("S22")
    expect(wide.find(".steps-about")).to_have_text(TEXTS["steps.about"].en)


def test_a_list_that_is_scrolled_by_hand_stays_for_some_seconds(wide: StepsScreen) -> None:
    wide.activate(LEFT[-2])
    wide.scroll_by_hand("left arm")
    wide.activate(LEFT[-1], RIGHT[-1])
    assert not wide.in_view(LEFT[-1])
    assert wide.in_view(RIGHT[-1])
    wide.pass_ms(HAND_MS)
    wide.activate(LEFT[-1], RIGHT[-1])
    assert wide.in_view(LEFT[-1])


def test_following_is_switched_off_and_on(wide: StepsScreen) -> None:
    button = wide.find("[data-action=follow]")
    expect(button).to_have_attribute("aria-pressed", "true")
    button.click()
    expect(button).to_have_attribute("aria-pressed", "false")
    wide.activate(LEFT[-1])
    assert not wide.in_view(LEFT[-1])
    button.click()
    assert wide.in_view(LEFT[-1])


def test_a_small_screen_shows_one_sequence_until_it_ends(small: StepsScreen) -> None:
    """It never changes between two arms that run; a sequence that is chosen stays, also before it runs."""

    def shown() -> list[str]:
        names: list[str] = small.find("[data-sequence]").evaluate_all(
            "parts => parts.filter((part) => part.checkVisibility()).map((part) => part.dataset.sequence)"
        )
        return names

    small.activate(HOMING[-1])
    assert shown() == ["left homing"]
    assert small.in_view(HOMING[-1])
    for step in LEFT:
        small.activate(step, HOMING[-1])
    assert shown() == ["left homing"]
    small.activate(LEFT[-1], RIGHT[3])
    assert shown() == ["left arm"]
    assert small.in_view(LEFT[-1])
    expect(small.find("[data-show='right arm']")).to_have_text(f"● Right arm {RIGHT[3]}")
    small.find("[data-show='tray feeder']").tap()
    small.activate(LEFT[0], RIGHT[-1])
    assert shown() == ["tray feeder"]
    small.find("[data-show='right arm']").tap()
    small.activate(LEFT[0], RIGHT[-1])
    assert shown() == ["right arm"]
    assert small.in_view(RIGHT[-1])


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_button_has_the_language_of_the_page(small: StepsScreen, language: str) -> None:
    small.select_language(language)
    small.open("steps")
    label = {"en": "Follow the active step", "zh": "跟随当前步"}[language]
    expect(small.find("[data-action=follow]")).to_have_text(label)


def test_a_list_moves_smoothly_unless_less_motion_is_wanted(wide: StepsScreen) -> None:
    wide.page.evaluate(
        """() => {
          const scroll = Element.prototype.scrollTo;
          window.ways = [];
          Element.prototype.scrollTo = function (to) { window.ways.push(to.behavior); scroll.call(this, to); };
        }"""
    )
    wide.activate(LEFT[3])
    wide.page.emulate_media(reduced_motion="no-preference")
    wide.activate(LEFT[-1])
    assert wide.page.evaluate("window.ways") == ["instant", "smooth"]
    wide.page.wait_for_function(INSIDE, arg=wide.find(f"[data-step={LEFT[-1]}]").element_handle())
