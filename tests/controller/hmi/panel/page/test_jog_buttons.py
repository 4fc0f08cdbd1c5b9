"""Buttons that move an output as long as they are held."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Final

import pytest
from playwright.sync_api import Browser, expect

from controller.hmi.panel.view import texts
from controller.program.operator.commands import JOG_LEASE_MS
from controller.program.texts.interlocks import RULES
from tests.controller.hmi.panel.page.panel_page_rig import SCAN_MS, PanelProcess
from tests.controller.hmi.panel.page.screen import (
    OUTPUT,
    Screen,
    Station,
    press_unavailable,
    ready_to_jog,
    started,
    until_renewed,
)
from tests.sampling import first_of


@pytest.fixture(scope="module")
def manual(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Yield a machine for jogging; each test must leave it in manual mode with its outputs off."""
    with started(tmp_path_factory.mktemp("manual"), slow=True) as station:
        yield station


def test_output_follows_pointer_and_key(manual: Station, browser: Browser) -> None:
    live = manual.live
    with Screen(browser, manual.panel.url, patient=True) as screen:
        screen.log_in("maintain")
        button = ready_to_jog(screen, live)
        for end in ("up", "leave", "blur"):
            button.hover()
            screen.page.mouse.down()
            live.until(lambda: live.on(OUTPUT), f"{OUTPUT} on, to end by {end}")
            if end == "up":
                until_renewed(live)
                screen.page.mouse.up()
            elif end == "leave":
                screen.page.mouse.move(5, 5)
            else:
                screen.page.evaluate("() => window.dispatchEvent(new Event('blur'))")
            live.until(lambda: not live.on(OUTPUT), f"{OUTPUT} off by {end}")
            screen.page.mouse.up()
        for key in ("Space", "Enter"):
            button.focus()
            screen.page.keyboard.down(key)
            live.until(lambda: live.on(OUTPUT), f"{OUTPUT} on by {key}")
            screen.page.keyboard.up(key)
            live.until(lambda: not live.on(OUTPUT), f"{OUTPUT} off after {key}")


REFUSE_LATE: Final = """async () => {
  const { app } = await import("/static/app.js");
  const { jogButton } = await import("/static/controls/buttons.js");
  const sent = [];
  app.link.order = (message) => new Promise((reply) => sent.push({ hold: message.hold, reply }));
  const holding = async (number) => {
    while (sent.filter((order) => order.hold).length < number) await new Promise((next) => setTimeout(next, 10));
    return sent.filter((order) => order.hold).at(-1);
  };
  const refused = { ok: false, text: { en: "refused", zh: "refused" } };
  const button = jogButton("jog", "left.lift_retract");
  button.why = null;
  button.start();
  const first = await holding(1);
  button.end();
  button.start();
  const second = await holding(2);
  first.reply(refused);
  await new Promise((next) => setTimeout(next, 0));
  const held = [button.held];
  second.reply(refused);
  await new Promise((next) => setTimeout(next, 0));
  return [...held, button.held];
}"""
"""Script that refuses a press after it has ended, and then the press that is held; returns whether it is still held."""


def test_the_refusal_of_an_earlier_press_does_not_end_a_press(manual: Station, browser: Browser) -> None:
    with Screen(browser, manual.panel.url, "maintain", patient=True) as screen:
        ready_to_jog(screen, manual.live)
        assert screen.page.evaluate(REFUSE_LATE) == [True, False]


def test_a_held_button_tells_why_its_output_stays_off(manual: Station, browser: Browser) -> None:
    with Screen(browser, manual.panel.url, "maintain", patient=True) as screen:
        ready_to_jog(screen, manual.live)
        expect(screen.find("header [data-fact=state]")).to_have_text("❚❚ Ready to jog")
        jog = screen.find(".jog", has=screen.find("[data-jog='left.slide_inward']"))
        reason = jog.locator("[role=alert]")
        expect(reason).to_be_empty()
        jog.locator("button").hover()
        screen.page.mouse.down()
        expect(reason).to_have_text(RULES["inward ready"].en.capitalize())
        assert not manual.live.on("left.slide_inward")
        screen.page.mouse.up()
        expect(reason).to_be_empty()


@pytest.mark.nightly
@pytest.mark.parametrize("loss", first_of(["panel frozen", "page closed", "panel killed"]))
def test_lost_socket_releases_the_output_within_the_timeout(manual: Station, browser: Browser, loss: str) -> None:
    live = manual.live
    with ExitStack() as stack:
        panel = (
            stack.enter_context(PanelProcess(live, manual.folder, slow=True))
            if loss == "panel killed"
            else manual.panel
        )
        screen = stack.enter_context(Screen(browser, panel.url, "maintain", patient=True))
        stack.callback(panel.send, signal.SIGCONT)  # the page waits for a frozen panel when it closes
        button = ready_to_jog(screen, live)
        button.hover()
        screen.page.mouse.down()
        live.until(lambda: live.on(OUTPUT), f"{OUTPUT} on")
        until_renewed(live)
        if loss == "page closed":
            screen.page.close()
        else:
            panel.send(signal.SIGSTOP if loss == "panel frozen" else signal.SIGKILL)
        lost_ms = live.now_ms
        live.until(lambda: not live.on(OUTPUT), f"{OUTPUT} off")
        # the last request may still be in transit and take effect one scan later
        assert live.last_on_ms(OUTPUT) - lost_ms <= JOG_LEASE_MS + 2 * SCAN_MS
        screen.unexpected.clear()  # the browser reports the closed socket of a killed panel


END_WITHOUT_RELEASE: Final = """async () => {
  const { app } = await import("/static/app.js");
  const { jogButton } = await import("/static/controls/buttons.js");
  const line = document.querySelector("[data-part=notice]");
  const seen = [];
  for (const end of ["end", "drop", "end"]) {
    const sent = [];
    app.link.order = (message) => new Promise(() => sent.push(message.hold));
    const button = jogButton("jog", "left.lift_retract");
    button.why = null;
    button.start();
    while (sent.length === 0) await new Promise((next) => setTimeout(next, 10));
    if (end === "drop") app.link.dispatchEvent(new Event("drop"));
    button.end();
    seen.push([sent.at(-1), line.textContent]);
    app.pressed(button);
  }
  return seen;
}"""
"""Script that releases a jog, loses the connection in another one, and releases a third; returns their last orders and
the notices.
"""


def test_a_jog_that_the_page_ends_names_the_reason(manual: Station, browser: Browser) -> None:
    """A page without live data ends the jog; a release needs no reason."""
    with Screen(browser, manual.panel.url, "maintain", patient=True) as screen:
        ready_to_jog(screen, manual.live)
        expect(screen.find("[data-part=notice]")).to_be_empty()
        seen = screen.page.evaluate(END_WITHOUT_RELEASE)
        assert seen == [[False, ""], [False, f"✕ {texts.TEXTS['why.stale'].en}"], [False, ""]]


@pytest.mark.nightly
@pytest.mark.parametrize("screen", ["maintain"], indirect=True)
def test_refused_jog_ends_and_shows_the_reason(stopped: Station, screen: Screen) -> None:
    live = stopped.live
    screen.open("manual")
    button = screen.find(f"main [data-jog='{OUTPUT}']")
    press_unavailable(button)
    expect(screen.find("[data-part=notice]")).to_contain_text("Cannot")
    expect(button).to_have_attribute("aria-pressed", "false")
    assert not any(OUTPUT in outputs for _, outputs in live.levels)
