"""Use errors on the page (docs/use-errors.md): for each, the barrier that prevents it or the text that tells it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import pytest
from playwright.sync_api import Browser, CDPSession, Locator, expect

from controller.hmi.panel.orders.replies import REPLIES
from controller.hmi.panel.view import texts
from controller.program.operator.commands import JOG_LEASE_MS, JOGGED
from controller.program.states import State
from controller.program.tags import FORGOTTEN, IN_DOUBT, IN_PLACE, SIDES
from controller.program.texts.operator import LANGUAGES
from controller.program.texts.operator import SIDES as SIDE_TEXTS
from tests.controller.hmi.panel.page.screen import (
    AGAIN_MS,
    OUTPUT,
    PAGES,
    Screen,
    Station,
    clear,
    expect_state,
    press_unavailable,
    ready_to_jog,
    started,
    until_renewed,
)
from tests.controller.hmi.panel.test_chinese import punctuation_errors

OPPOSITE = "left.lift_extend"
WRONG_ENTRIES = {"0.3": "50 to 2000", "300 ms": "number", "3,5": "comma", "3\uff0c5": "comma", "\uff13\uff10": "number"}
"""Entries for 300 ms in another unit, with a comma, and with full-width digits; and their refusals."""
TEXTS = texts.TEXTS
NOTICE_MS = 8_000
"""Time for which a refusal is shown, ms."""
KEEP_SENT = """
window.sent = [];
const send = WebSocket.prototype.send;
WebSocket.prototype.send = function (message) {
  window.sent.push(message);
  send.call(this, message);
};
"""
"""Script that keeps every message to the panel."""


class Page(Screen):
    """Page of a maintainer that keeps what the browser sends."""

    def __init__(self, browser: Browser, url: str) -> None:
        super().__init__(browser, url, "maintain", patient=True)
        self.page.add_init_script(KEEP_SENT)

    @property
    def notice(self) -> Locator:
        return self.find("[data-part=notice]")

    @property
    def sent(self) -> list[dict[str, object]]:
        """Orders in the sequence in which they were sent."""
        return [json.loads(order) for order in self.page.evaluate("window.sent")]

    def clear_notice(self) -> None:
        self.notice.evaluate("node => { node.textContent = ''; }")

    def forget_sent(self) -> None:
        self.page.evaluate("window.sent.length = 0")

    def commands(self) -> list[object]:
        return [order["command"] for order in self.sent if order["type"] == "command"]

    def hold(self, button: Locator) -> None:
        """Press a button with the mouse and keep it pressed."""
        button.hover()
        self.page.mouse.down()
        expect(button).to_have_attribute("aria-pressed", "true")


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Yield a machine with its panel; each test must leave it without alarms and with its outputs off."""
    with started(tmp_path_factory.mktemp("use-errors"), slow=True) as station:
        yield station


@pytest.fixture(scope="module")
def shared(station: Station, browser: Browser) -> Iterator[Page]:
    with Page(browser, station.panel.url) as page:
        yield page


@pytest.fixture
def at_rest(station: Station, shared: Page) -> Page:
    """Return the page of the machine in Stopped."""
    station.live.fast()
    shared.open("overview")
    if station.live.state != State.STOPPED:
        shared.press("[data-command=stop]")
        station.live.until_state(State.STOPPED)
    station.live.pace.set(100)
    expect_state(shared, State.STOPPED)
    shared.forget_sent()
    return shared


@pytest.fixture
def jogging(station: Station, shared: Page) -> Page:
    """Return the page of the machine in manual mode, ready to jog."""
    ready_to_jog(shared, station.live)
    station.live.slow()
    shared.forget_sent()
    return shared


def jog_of(page: Page, output: str) -> Locator:
    return page.find(f"main [data-jog='{output}']")


@pytest.mark.nightly
def test_the_wrong_arm_is_named_on_the_button_itself(station: Station, jogging: Page) -> None:
    """In both languages, and on the I/O page its output; and only the arm of the button moves."""
    live, page = station.live, jogging
    for language in LANGUAGES:
        page.select_language(language)
        for side in SIDES:
            names = page.find(f"main [data-jog^='{side}.']").all_text_contents()
            assert len(names) == 8
            assert all(name.startswith(getattr(TEXTS[side], language)) for name in names), names
    page.open("io")
    for language in LANGUAGES:
        page.select_language(language)
        names = page.find("main [data-jog]").all_text_contents()
        assert len({*names}) == len(names) == len(JOGGED)
        for side in SIDES:
            named = page.find(f"main [data-jog^='{side}.']").all_text_contents()
            assert all(getattr(SIDE_TEXTS[side], language) in name for name in named), named
    page.select_language("en")
    page.open("manual")
    scans = len(live.levels)
    page.hold(jog_of(page, "right.lift_retract"))
    live.until(lambda: live.on("right.lift_retract"), "right arm up")
    page.page.mouse.up()
    live.until(lambda: not live.on("right.lift_retract"), "released")
    assert not any(output.startswith("left.") for _, outputs in live.levels[scans:] for output in outputs)


@pytest.mark.nightly
def test_hold_says_that_it_is_no_emergency_stop(at_rest: Page) -> None:
    """In both languages, at the button; it is neither named nor styled as one, and stands with the orders that halt."""
    for language in LANGUAGES:
        at_rest.select_language(language)
        button = at_rest.find(".halts [data-command=hold]")
        about = button.get_attribute("aria-describedby")
        expect(at_rest.find(f"#{about}")).to_have_text(getattr(TEXTS["hold.about"], language))
        expect(at_rest.find(f".halts #{about}")).to_be_visible()
        assert at_rest.find(".halts .emergency").count() == 0
        expect(button.locator("span")).not_to_contain_text(getattr(TEXTS["box.emergency_stop"], language).split()[0])
    at_rest.select_language("en")
    assert "not an emergency stop" in TEXTS["hold.about"].en
    assert "不是急停" in TEXTS["hold.about"].zh


@pytest.mark.nightly
def test_hold_tells_after_the_press_that_it_is_no_emergency_stop(station: Station, jogging: Page) -> None:
    jogging.open("overview")
    jogging.press("[data-command=hold]")
    expect(jogging.notice).to_have_text(f"✓ {TEXTS['hold.about'].en}")
    station.live.until_state(State.HELD)


def test_an_answer_by_habit_is_not_taken(station: Station, at_rest: Page) -> None:
    """A short press answers nothing, nor does one under which the question changes; a long press does."""
    live, page = station.live, at_rest
    plc, tray = live.runtime.plc, live.machine.tags.tray
    row = live.machine.tags.arms["left"].rows[1]
    before = plc.read(row)
    plc.write(tray.ask, 1)
    page.open("recovery")
    answer = page.find("[data-question=tray] [data-command=tray_none]")
    stored = page.find("[data-question=tray] [data-fact=stored-tray]")
    stored_before = stored.text_content() or ""
    expect(answer).not_to_have_attribute("aria-disabled", "true")
    answer.click()
    expect(page.notice).to_have_text(f"✕ {TEXTS['answer.short'].en}")
    page.hold(answer)
    plc.write(row, IN_DOUBT)
    expect(page.notice).to_have_text(f"✕ {TEXTS['answer.changed'].en}")
    expect(page.find("[data-question]")).to_have_count(2)
    page.page.mouse.up()
    plc.write(row, before)
    expect(page.find("[data-question]")).to_have_count(1)
    expect(stored).to_have_text(stored_before)  # the panel may read the row after the question; this would end a press
    page.clear_notice()
    page.hold(answer)
    plc.write(row, IN_PLACE if before != IN_PLACE else 0)  # of the stored rows that the answer is read against
    expect(page.notice).to_have_text(f"✕ {TEXTS['answer.changed'].en}")
    page.page.mouse.up()
    plc.write(row, before)
    expect(stored).to_have_text(stored_before)  # as above
    discard = page.find("main section:not(:has([data-question])) [data-command=left_discard]")
    discard.click()
    expect(page.notice).to_have_text(f"✕ {TEXTS['answer.short'].en}")
    assert page.commands() == []
    assert plc.read(tray.ask)
    page.hold(answer)
    live.until(lambda: not plc.read(tray.ask), "answered")
    page.page.mouse.up()
    assert page.commands() == ["tray_none"]
    expect(page.find("[data-question]")).to_have_count(0)


def test_a_wet_touch_moves_nothing(station: Station, jogging: Page) -> None:
    """Too short a touch starts nothing; one that slides off, or a second one anywhere, ends the motion."""
    live, page = station.live, jogging
    button = jog_of(page, OUTPUT)
    scans = len(live.levels)
    button.evaluate(
        "node => ['pointerdown', 'pointerup'].forEach((name) =>"
        " node.dispatchEvent(new PointerEvent(name, { bubbles: true, isPrimary: true, pointerType: 'touch' })))"
    )
    expect(page.notice).to_have_text(f"✕ {TEXTS['touch.short'].en}")
    assert page.sent == []
    assert not any(OUTPUT in outputs for _, outputs in live.levels[scans:])
    button.scroll_into_view_if_needed()
    box = button.bounding_box()
    assert box is not None
    finger = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2, "id": 1}
    away = {"x": box["x"] + box["width"] / 2, "y": 5, "id": 1}
    water: dict[str, float] = {"x": 1270, "y": 5, "id": 2}  # beside the keys of the strip
    touch = page.page.context.new_cdp_session(page.page)
    ends: dict[str, list[dict[str, float]]] = {"touchMove": [away], "touchStart": [finger, water]}
    for after, points in ends.items():
        touched(touch, "touchStart", [finger])
        live.until(lambda: live.on(OUTPUT), f"on, to end by {after}")
        touched(touch, after, points)
        live.until(lambda: not live.on(OUTPUT), f"off by {after}")
        expect(button).to_have_attribute("aria-pressed", "false")
        if after == "touchStart":
            expect(page.notice).to_have_text(f"✕ {TEXTS['touch.two'].en}")
        touched(touch, "touchEnd", [])
    touched(touch, "touchStart", [finger])
    expect(page.notice).to_be_empty(timeout=NOTICE_MS / 2)
    touched(touch, "touchEnd", [])
    live.until(lambda: not live.on(OUTPUT), "released")
    page.forget_sent()
    page.clear_notice()
    touched(touch, "touchStart", [water])
    touched(touch, "touchStart", [water, finger])
    expect(page.notice).to_have_text(f"✕ {TEXTS['touch.two'].en}")
    held_from_ms = live.now_ms
    live.until(lambda: live.now_ms > held_from_ms + JOG_LEASE_MS, "held")
    touched(touch, "touchEnd", [])
    assert page.sent == []
    touch.detach()


def touched(session: CDPSession, kind: str, points: Sequence[Mapping[str, float]]) -> None:
    session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [dict(point) for point in points]})


def test_the_question_about_the_tray_shows_what_is_stored(station: Station, at_rest: Page) -> None:
    """The stored rows stand above the answers, and "same tray" is refused while no tray is seen."""
    live, page = station.live, at_rest
    plc, tags = live.runtime.plc, live.machine.tags
    row, tray = tags.arms["right"].rows[3], tags.tray
    phase, before = plc.read(tray.phase), plc.read(row)
    plc.write(tray.phase, IN_PLACE)
    plc.write(tray.ask, 1)
    page.open("recovery")
    stored = page.find("[data-question=tray] [data-fact=stored-tray]")
    for state in (1, 0):
        plc.write(row, state)
        expect(stored).to_contain_text(f"3 {TEXTS[f'row.{state}'].en}.")
        expect(stored).to_contain_text("The same tray only if")
    page.select_language("zh")
    assert punctuation_errors(stored.text_content() or "") == []
    page.select_language("en")
    press_unavailable(page.find("[data-command=tray_same]"))
    expect(page.notice).to_contain_text("Cannot")
    assert page.commands() == []
    for device, value in ((row, before), (tray.ask, 0), (tray.phase, phase)):
        plc.write(device, value)
    expect(page.find("[data-question]")).to_have_count(0)


def test_a_machine_is_declared_new_only_while_its_memory_is_unknown_and_by_a_second_press(
    station: Station, at_rest: Page
) -> None:
    live, page = station.live, at_rest
    plc, tray = live.runtime.plc, live.machine.tags.tray
    rows = [row for arm in live.machine.tags.arms.values() for row in arm.rows.values()]
    before = {word: plc.read(word) for word in (tray.phase, *rows)}
    page.open("recovery")
    part, button = page.find("[data-part=new-machine]"), page.find("[data-command=new_machine]")
    expect(part).to_be_hidden()
    plc.write(tray.phase, FORGOTTEN)
    expect(part).to_be_visible()
    expect(part).to_contain_text(TEXTS["remark.new_machine"].en)
    expect(button).not_to_have_attribute("aria-disabled", "true")
    button.click()
    assert page.commands() == []
    page.page.wait_for_timeout(AGAIN_MS)  # longer than a double tap
    button.click()
    live.until(lambda: plc.read(tray.phase) != FORGOTTEN, "declared")
    assert page.commands() == ["new_machine"]
    expect(part).to_be_hidden()
    for word, value in before.items():
        plc.write(word, value)


def test_a_double_tap_is_one_order_and_confirms_nothing(station: Station, at_rest: Page) -> None:
    live, page = station.live, at_rest
    done = live.machine.tags.machine.trays_done
    live.runtime.plc.write(done, 3)
    button = page.find("[data-command=count_reset]")
    button.dblclick()
    expect(button).to_have_attribute("data-asks", "1")
    assert page.commands() == []
    page.find("[data-command=clear]").focus()
    live.fast()
    page.find("[data-command=reset]").dblclick()
    live.until_state(State.IDLE)
    expect_state(page, State.IDLE)
    assert page.commands() == ["reset"]
    assert all(order["seen"] for order in page.sent), "the panel cannot tell how late they are"
    page.press("[data-command=stop]")
    live.until_state(State.STOPPED)
    live.runtime.plc.write(done, 0)


HAMMER: Final = """async (name) => {
  const { app } = await import("/static/app.js");
  const order = app.link.order;
  let orders = 0;
  app.link.order = () => { orders += 1; return Promise.resolve({ ok: true, text: { en: "", zh: "" } }); };
  const button = document.querySelector(`[data-command=${name}]`);
  for (const isPrimary of [true, true, false]) {
    button.dispatchEvent(new PointerEvent("pointerdown", { isPrimary, button: 0 }));
  }
  app.link.order = order;
  return orders;
}"""
"""Script that touches a button of the page three times in quick succession, once as a second finger, without lifting;
returns the number of orders.
"""


@pytest.mark.parametrize(("page", "command"), [("overview", "abort"), ("manual", "stop"), ("cab", "hold")])
def test_every_touch_on_a_button_that_halts_is_an_order(jogging: Page, page: str, command: str) -> None:
    """The browser makes no tap of a touch that lasts, slides or is one of several."""
    jogging.open(page)
    expect(jogging.find(f"[data-command={command}]")).not_to_have_attribute("aria-disabled", "true")
    assert jogging.page.evaluate(HAMMER, command) == 3


TAP: Final = """async ([halts, reasons]) => {
  const { app } = await import("/static/app.js");
  const { OrderButton } = await import("/static/controls/buttons.js");
  const order = app.link.order;
  let orders = 0;
  app.link.order = () => { orders += 1; return Promise.resolve({ ok: true, text: { en: "", zh: "" } }); };
  const button = new OrderButton("order", { type: "command", command: "abort" }, { halts });
  reasons.forEach((why) => {
    button.why = why;
    button.button.dispatchEvent(new PointerEvent("pointerdown", { button: 0 }));
    button.button.dispatchEvent(new MouseEvent("click", { detail: 1 }));
  });
  app.link.order = order;
  return orders;
}"""
"""Script that taps a button quickly, each time with a reason to refuse or none; returns the number of orders sent."""


@pytest.mark.parametrize(
    ("halts", "reasons", "orders"),
    [
        (True, [None, None, None], 3),
        (True, ["not in this state", "no data", None], 3),
        (False, [None, None, None], 1),
        (False, ["no data", None, None], 1),
    ],
)
def test_hammering_a_button_halts_with_every_tap_and_orders_anything_else_once(
    shared: Page, halts: bool, reasons: list[str | None], orders: int
) -> None:
    """A halt is sent whatever the page believes; a tap that was refused does not use up the ones after it."""
    assert shared.page.evaluate(TAP, [halts, reasons]) == orders


@pytest.mark.nightly
def test_a_key_that_is_held_is_one_press(at_rest: Page) -> None:
    """The browser repeats the key; neither an order is repeated nor a question confirmed."""
    keyboard = at_rest.page.keyboard
    for command in ("count_reset", "mode_step"):
        at_rest.find(f"[data-command={command}]").focus()
        keyboard.down("Enter")
        at_rest.page.wait_for_timeout(AGAIN_MS)  # longer than a double tap
        for _ in range(4):
            keyboard.down("Enter")
        keyboard.up("Enter")
    expect(at_rest.find("[data-command=mode_step]")).to_have_attribute("aria-pressed", "true")
    assert at_rest.commands() == ["mode_step"]
    at_rest.press("[data-command=mode_continuous]")
    expect(at_rest.find("[data-command=mode_continuous]")).to_have_attribute("aria-pressed", "true")


def test_a_jog_ends_with_its_page(station: Station, jogging: Page) -> None:
    """When another page is opened, and when the tab is hidden."""
    live, page = station.live, jogging
    hide = """(hidden) => {
      Object.defineProperty(document, "hidden", { configurable: true, get: () => hidden });
      document.dispatchEvent(new Event("visibilitychange"));
    }"""
    for way in ("hidden", "left"):
        page.open("manual")
        page.hold(jog_of(page, OUTPUT))
        live.until(lambda: live.on(OUTPUT), f"on, to end when {way}")
        until_renewed(live)
        if way == "hidden":
            page.page.evaluate(hide, arg=True)
        else:
            page.page.evaluate("() => { window.location.hash = '#overview'; }")
        live.until(lambda: not live.on(OUTPUT), f"off when {way}")
        page.page.evaluate(hide, arg=False)
        page.page.mouse.up()


def test_the_opposite_order_of_a_second_operator_is_refused(station: Station, jogging: Page, browser: Browser) -> None:
    live = station.live
    with Page(browser, station.panel.url) as other:
        other.open("manual")
        expect(jog_of(other, OPPOSITE)).not_to_have_attribute("aria-disabled", "true")
        jogging.hold(jog_of(jogging, OUTPUT))
        live.until(lambda: live.on(OUTPUT), "on")
        scans = len(live.levels)
        jog_of(other, OPPOSITE).hover()
        other.page.mouse.down()
        expect(other.notice).to_have_text(f"✕ {REPLIES['jog taken'].en}", ignore_case=True)
        other.page.mouse.up()
        until_renewed(live)
        jogging.page.mouse.up()
        live.until(lambda: not live.on(OUTPUT), "off")
        assert not any(OPPOSITE in outputs for _, outputs in live.levels[scans:])


@pytest.mark.nightly
def test_a_value_in_another_unit_or_with_a_comma_is_not_sent(station: Station, at_rest: Page) -> None:
    """Each entry is refused with its reason, which ends when the entry changes."""
    page, settle = at_rest, station.live.machine.tags.sp.settle
    before = station.live.runtime.plc.read(settle)
    page.open("parameters")
    row = page.find("[data-set-point=settle]")
    for value, message in WRONG_ENTRIES.items():
        row.locator("input").fill(value)
        row.locator("button[type=submit]").click()
        expect(row.locator("[role=alert]")).to_contain_text(message)
        expect(page.notice).to_contain_text(message)
    row.locator("input").fill("")
    expect(page.notice).to_be_empty()
    expect(row.locator("th + td")).to_contain_text("ms")
    assert page.sent == []
    assert station.live.runtime.plc.read(settle) == before


@pytest.mark.nightly
def test_the_language_of_the_previous_shift_is_changed_from_every_page(at_rest: Page) -> None:
    """The languages are named in themselves, and one choice changes a page that was left in Chinese."""
    page = at_rest
    choice = page.find("[data-action=language]")
    for name in PAGES:
        page.select_language("zh")
        page.open(name)
        expect(page.find(f"[role=tab][data-page={name}]")).to_have_text(TEXTS[f"page.{name}"].zh)
        expect(choice).to_be_visible()
        assert choice.locator("option").all_text_contents() == ["English", "中文"]
        choice.select_option(label="English")
        expect(page.find(f"[role=tab][data-page={name}]")).to_have_text(TEXTS[f"page.{name}"].en)


def test_releasing_and_acknowledging_an_emergency_stop_restart_nothing(station: Station, at_rest: Page) -> None:
    """The acknowledged alarm stays in view, and stays named after the button is released, until it is cleared."""
    live, page = station.live, at_rest
    banner = page.find("[data-part=banner]")
    page.press("[data-box=emergency_stop]")
    live.until_state(State.ABORTED)
    page.press("[data-banner=acknowledge]")
    expect(banner).to_contain_text("Emergency stop pressed (acknowledged)")
    expect(banner).to_have_attribute("data-alarm", "900")
    for command in ("start", "reset"):
        expect(page.find(f"[data-command={command}]")).to_have_attribute("aria-disabled", "true")
    press_unavailable(page.find("[data-command=clear]"))
    expect(page.notice).to_contain_text("Cannot")
    scans = len(live.levels)
    page.press("[data-box=emergency_stop]")
    expect(banner).to_contain_text("latched")
    expect(banner).to_have_attribute("data-alarm", "900")
    for command in ("start", "reset"):
        press_unavailable(page.find(f"[data-command={command}]"))
        expect(page.notice).to_contain_text("Cannot")
    assert live.state == State.ABORTED
    moving = {point.tag for point in live.machine.io_map.outputs} - {"horn", "lamp_red", "lamp_amber", "lamp_green"}
    assert not any(moving & outputs for _, outputs in live.levels[scans:])
    clear(page, live)
