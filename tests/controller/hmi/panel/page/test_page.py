"""Page in a browser, with the panel, controller and plant running."""

from __future__ import annotations

import re
import signal
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest
from playwright.sync_api import Browser, WebSocketRoute, expect
from websockets.sync.client import connect
from websockets.typing import Origin

from controller.hmi.panel.view import texts
from controller.hmi.panel.web.sockets import QUOTA, TOO_MANY
from controller.io.pace import PAUSED
from controller.program.alarms.guide import likely_causes
from controller.program.operator.next_press import NextPress
from controller.program.states import Mode, State
from controller.program.tags import ROWS
from controller.program.texts.isolation import ISOLATION
from controller.program.texts.next_press import NEXT_PRESSES
from controller.program.texts.operator import CANNOT, MODES, STATES
from tests.controller.hmi.panel.page.panel_page_rig import LiveMachine, PanelProcess
from tests.controller.hmi.panel.page.screen import (
    AGAIN_MS,
    PAGES,
    TIMEOUT_MS,
    Screen,
    Station,
    clear,
    expect_state,
    press_unavailable,
)
from tests.controller.hmi.panel.test_chinese import CHINESE, latin_words, punctuation_errors
from tests.sampling import first_of

STALE_MS = 1_000
DRAW_MS = 500
"""Allowance for a browser on a busy computer to draw an update, ms."""


def test_emergency_stop_is_shown_on_every_page_and_acknowledged(stopped: Station, screen: Screen) -> None:
    live = stopped.live
    screen.press("[data-box=emergency_stop]")
    expect(screen.find(".notice")).to_have_text("✓ Emergency stop X25 pressed")
    live.until_state(State.ABORTED)
    following = screen.find("header [data-fact=next-press]")
    expect(following).to_have_text(
        f"→ {NEXT_PRESSES[NextPress.RELEASE_EMERGENCY_STOP].en.capitalize()}", ignore_case=True
    )
    banner = screen.find("[data-part=banner]")
    for page in PAGES:
        screen.open(page)
        expect(banner).to_have_attribute("data-alarm", "900")
        expect(banner).to_have_attribute("data-priority", "safety")
        expect(banner).to_contain_text("[First-out] Emergency stop pressed (unacknowledged)")
    screen.open("recovery")
    expect(screen.find("main [data-fact=reason]")).to_have_text("Emergency stop pressed")
    screen.open("alarms")
    expect(screen.find("[data-alarm='900'] [data-action=shelve]")).to_have_count(0)
    # the first rows that the page gets are those from before the history has received the change
    screen.page.route("**/api/history/alarms*", lambda route: route.fulfill(json=[]), times=1)
    screen.press("[data-banner=acknowledge]")
    expect(banner).to_contain_text("(acknowledged)")
    expect(screen.find("[data-banner=acknowledge]")).to_be_hidden()
    expect(screen.find("li[data-alarm='900']")).to_have_attribute("data-state", "acknowledged")
    expect(screen.find("[data-table=journal] tbody tr").first).to_contain_text(texts.TEXTS["level.operate"].en)
    screen.open("overview")
    expect(screen.find("[data-box=emergency_stop]")).to_have_attribute("aria-pressed", "true")
    screen.press("[data-box=emergency_stop]")
    expect(screen.find("[data-box=emergency_stop]")).to_have_attribute("aria-pressed", "false")
    expect(banner).to_contain_text("latched")
    clear(screen, live)


@pytest.mark.parametrize("pages", first_of([["manual", "history", "menu"], [*PAGES, "menu"]]), ids=len)
def test_every_page_opens_by_its_address(stopped: Station, browser: Browser, pages: Sequence[str]) -> None:
    """As after a reload: the page is built before the first view. Three pages by default."""
    with Screen(browser, stopped.panel.url, "operate") as screen:
        for page in pages:
            screen.page.goto("about:blank")  # the page before may still open another one after the login
            screen.page.goto(f"{stopped.panel.url}/#{page}")
            expect(screen.find("body")).to_have_attribute("data-link", "live")
            expect(screen.find(f"main[data-page={page}]")).to_be_visible()
        screen.unexpected[:] = [line for line in screen.unexpected if "WebSocket" not in line]


def test_the_rows_of_the_tray_are_named_with_their_arm(screen: Screen) -> None:
    screen.open("trays")
    names = screen.find("dt", has=screen.page.get_by_text("arm, Row"))
    assert names.all_text_contents() == [f"{side} arm, Row {row}" for side in ("Left", "Right") for row in ROWS]


@pytest.mark.nightly
def test_nothing_can_be_pressed_before_the_first_view(panel: PanelProcess, browser: Browser) -> None:
    """A page whose connection is not yet open shows no strip, and its buttons give the reason instead of an order."""
    context = browser.new_context()
    page = context.new_page()
    page.route_web_socket(re.compile(".*"), lambda socket: None)  # opens, and sends nothing
    page.goto(panel.url)
    expect(page.locator("[data-box=start]")).to_have_attribute("aria-disabled", "true")
    for button in page.locator("[data-box], [data-pace], [data-command]").all():
        expect(button).to_have_attribute("aria-disabled", "true")
    for part in ("paused", "field-lost", "forced"):
        expect(page.locator(f"[data-part={part}]")).to_be_hidden()
    press_unavailable(page.locator("[data-box=start]"))
    expect(page.locator("[data-part=notice]")).to_contain_text("✕")
    context.close()


@pytest.mark.nightly
def test_outdated_values_are_distinguished_from_a_pause(
    live: LiveMachine, panel: PanelProcess, browser: Browser
) -> None:
    with Screen(browser, panel.url, "operate") as screen:
        stale, paused = screen.find("[data-part=stale]"), screen.find("[data-part=paused]")
        screen.press("[data-pace='0']")
        expect(paused).to_be_visible()
        assert live.pace.percent == PAUSED
        screen.page.wait_for_timeout(STALE_MS + DRAW_MS)  # longer than the age limit of the values
        expect(stale).to_be_hidden(timeout=1)
        screen.press("[data-pace='100']")
        expect(paused).to_be_hidden()
        panel.send(signal.SIGSTOP)
        expect(stale).to_be_visible(timeout=STALE_MS + DRAW_MS)
        expect(screen.find("[data-command=stop]")).to_have_attribute("aria-disabled", "true")
        panel.send(signal.SIGCONT)
        expect(stale).to_be_hidden(timeout=TIMEOUT_MS)
        live.__exit__(None, None, None)
        expect(stale).to_be_visible(timeout=STALE_MS + DRAW_MS)
        expect(screen.find("[data-fact=link]")).to_contain_text("No data")


@pytest.mark.nightly
def test_first_run_asks_for_both_passwords_and_the_page_survives_a_restart(
    stopped: Station, browser: Browser, tmp_path: Path
) -> None:
    """The first page sets both passwords, logs in and out, and reconnects to a panel that has been restarted."""
    with PanelProcess(stopped.live, tmp_path, first_run=True) as panel:
        screen = Screen(browser, panel.url)  # not entered: the browser reports the lost connection
        screen.page.goto(panel.url)
        screen.set_first_passwords()
        screen.log_in("operate")
        screen.find("[data-action=logout]").click()
        expect(screen.find("[data-fact=level]")).to_have_text(texts.TEXTS["level.view"].en)
        expect(screen.find("[data-fact=link]")).to_contain_text(texts.TEXTS["link.live"].en)
        assert screen.unexpected == []
        with panel.restarted():
            expect(screen.find("[data-part=stale]")).to_be_visible()
        expect(screen.find("[data-part=stale]")).to_be_hidden(timeout=TIMEOUT_MS)
        expect(screen.find("[data-fact=link]")).to_contain_text(texts.TEXTS["link.live"].en)
        screen.page.context.close()


@pytest.mark.nightly
def test_a_page_without_a_place_tells_so(stopped: Station, browser: Browser) -> None:
    url = stopped.panel.url
    with Screen(browser, url) as screen, ExitStack() as stack:
        expect(screen.find("body")).to_have_attribute("data-link", "live")
        for _ in range(QUOTA.most - QUOTA.reserved):
            stack.enter_context(
                connect(f"{url.replace('http', 'ws')}/ws", origin=Origin(url), proxy=None, max_queue=None)
            )
        expect(screen.find("[data-part=stale]")).to_have_text(texts.TEXTS["link.full"].en)
        screen.log_in("operate")


def test_a_page_without_views_that_loses_its_place_tells_so(stopped: Station, browser: Browser) -> None:
    """A busy computer delivers no view for a second before the panel closes the connection for another browser."""
    open_sockets: list[WebSocketRoute] = []

    def send_first_view(socket: WebSocketRoute) -> None:
        open_sockets.append(socket)
        if len(open_sockets) == 1:
            server = socket.connect_to_server()
            server.on_message(lambda view: socket.send(view) if '"full"' in str(view) else None)

    context = browser.new_context()
    page = context.new_page()
    page.route_web_socket(re.compile(".*"), send_first_view)
    page.goto(stopped.panel.url)
    stale = page.locator("[data-part=stale]")
    expect(stale).to_have_text(texts.TEXTS["link.closed"].en)
    open_sockets[0].close(code=TOO_MANY)
    expect(stale).to_have_text(texts.TEXTS["link.full"].en)
    context.close()


def test_view_level_is_asked_to_log_in(stopped: Station, browser: Browser) -> None:
    with Screen(browser, stopped.panel.url) as screen:
        expect(screen.find("[data-fact=link]")).to_contain_text(texts.TEXTS["link.live"].en)
        press_unavailable(screen.find("[data-command=abort]"))
        expect(screen.find("[data-part=notice]")).to_contain_text("Operator login required")
        press_unavailable(screen.find("[data-command=hold]"))
        expect(screen.find("[data-part=notice]")).to_contain_text("Cannot hold")  # only because of the state
        screen.open("io")
        expect(screen.find("[data-force]").first).to_be_hidden()
        for part in ("no-forcing", "no-jogs"):
            expect(screen.find(f"[data-part={part}]")).to_have_text("Maintenance login required")


def test_parameter_is_checked_before_it_is_sent(stopped: Station, screen: Screen) -> None:
    live = stopped.live
    settle = live.machine.tags.sp.settle
    screen.open("parameters")
    row = screen.find("[data-set-point=settle]")
    for value, message in (("5", "50 to 2000"), ("205", "multiple of 10"), ("-1", "number"), ("", "number")):
        row.locator("input").fill(value)
        row.locator("button[type=submit]").click()
        expect(row.locator("[role=alert]")).to_contain_text(message)
    assert live.runtime.plc.read(settle) == 10
    expect(screen.find("[data-fact=lambda_lowest] + td")).to_have_text("0.10 – 3.00")
    expect(screen.find("[data-fact=planter_pitch]")).to_have_text("489 mm")
    row.locator("input").fill("300")
    row.locator("input").press("Enter")
    live.until(lambda: live.runtime.plc.read(settle) == 30, "settle")
    expect(screen.find("[data-fact=settle]")).to_have_text("300 ms")
    expect(screen.find(".notice")).to_have_text("✓ Done")
    row.locator("input").fill("5")
    row.locator("button[type=submit]").click()
    expect(screen.find(".notice")).to_have_text("✕ Enter 50 to 2000")
    expect(screen.find("[data-set-point=arms_may_meet] input")).to_have_count(0)


@pytest.mark.parametrize(("counts", "value"), [(30, "300 ms"), (15, "150 ms")])
def test_a_constant_that_differs_is_named_in_the_alarm_list_and_marked(
    stopped: Station, screen: Screen, counts: int, value: str
) -> None:
    """Also if a tool has changed its register; the warning ends with the difference."""
    live, word = stopped.live, stopped.live.machine.tags.sp.clamp
    row = screen.find("[data-set-point=clamp]")
    screen.open("parameters")
    expect(row).not_to_have_attribute("data-differs", "1")
    live.runtime.plc.write(word, counts)
    try:
        expect(row).to_have_attribute("data-differs", "1")
        screen.open("alarms")
        expect(screen.find("[data-alarm='999'] .alarm-constants")).to_contain_text(f"{value} (default 200 ms)")
    finally:
        live.runtime.plc.write(word, 20)
    screen.press("[data-command=acknowledge_all]")
    expect(screen.find("li[data-alarm='999']")).to_have_count(0)


@pytest.mark.parametrize("screen", ["maintain"], indirect=True)
def test_forced_input_is_shown_on_every_page(stopped: Station, screen: Screen) -> None:
    live = stopped.live
    screen.press("[data-command=mode_manual]")
    expect(screen.find("header [data-fact=mode]")).to_have_text(MODES[Mode.MANUAL].en.capitalize())
    screen.open("io")
    screen.press("[data-force='X22=1']")
    live.until(lambda: live.runtime.plc.memory.X[0o22], "X22 forced")
    expect(screen.find("[data-address=X22]")).to_have_attribute("data-forced", "1")
    for part in ("no-forcing", "no-jogs"):
        expect(screen.find(f"[data-part={part}]")).to_be_hidden()
    expect(screen.find("[data-part=forced]")).to_contain_text("X22")
    screen.open("trends")
    expect(screen.find("[data-part=forced]")).to_be_visible()
    screen.open("io")
    screen.press("[data-force='X22=2']")
    expect(screen.find("[data-part=forced]")).to_be_hidden()
    screen.open("overview")
    screen.press("[data-command=mode_continuous]")
    live.until(lambda: live.runtime.plc.read(live.machine.tags.machine.mode) == Mode.CONTINUOUS, "continuous")


def test_selected_language_is_stored(screen: Screen) -> None:
    expect_state(screen, State.STOPPED)
    screen.find("[data-action=language]").select_option("zh")
    for shown in ("selected", "reloaded"):
        expect(screen.find("header [data-fact=state]")).to_contain_text(STATES[State.STOPPED].zh)
        expect(screen.find("[data-command=start]")).to_have_text(texts.TEXTS["command.start"].zh)
        tabs = [texts.TEXTS[f"page.{page}"].zh for page in PAGES]
        expect(screen.find("[role=tab]")).to_have_text(tabs)
        if shown == "selected":
            screen.page.reload()
    screen.find("[data-action=language]").select_option("en")


VISIBLE_TEXTS = """() => {
  const texts = [document.title];
  const walker = document.createTreeWalker(document.getElementById("panel"), NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const parent = walker.currentNode.parentElement;
    if (!parent.closest(".tag, [data-action=language]")) texts.push(walker.currentNode.data);
  }
  for (const node of document.querySelectorAll("#panel *")) {
    for (const name of ["aria-label", "title", "placeholder"]) texts.push(node.getAttribute(name) ?? "");
  }
  return texts;
}"""
"""Script that returns all texts of the page except tag names and the names of the languages."""


@pytest.mark.nightly
def test_every_page_is_chinese(stopped: Station, screen: Screen) -> None:
    """After an emergency stop and a refused command, every text on every page and in the login dialog is Chinese."""
    live = stopped.live
    screen.press("[data-box=emergency_stop]")
    live.until_state(State.ABORTED)
    screen.press("[data-banner=acknowledge]")
    expect(screen.find("[data-banner=acknowledge]")).to_be_hidden()
    screen.find("[data-action=language]").select_option("zh")
    press_unavailable(screen.find("[data-command=start]"))
    expect(screen.find("[data-part=notice]")).to_contain_text(CANNOT.zh.partition("{")[0])
    for page in PAGES:
        screen.open(page)
        if page == "alarms":
            screen.find("[data-table=journal] [data-help]").first.click()
            expect(screen.find("svg .located").first).to_be_attached()
        shown = screen.page.evaluate(VISIBLE_TEXTS)
        assert len(shown) > 40
        assert [text for text in shown if latin_words(text)] == [], page
        assert [text for text in shown if CHINESE.search(text) and punctuation_errors(text)] == [], page
    screen.find("[data-action=login]").click()
    shown = screen.page.evaluate(VISIBLE_TEXTS)
    assert [text for text in shown if latin_words(text)] == [], "login dialog"
    screen.find("dialog [data-action=close]").click()
    screen.open("overview")
    screen.press("[data-box=emergency_stop]")
    clear(screen, live)
    screen.find("[data-action=language]").select_option("en")


def test_a_tap_on_an_alarm_opens_its_help(stopped: Station, screen: Screen) -> None:
    """One tap shows meaning, causes, isolation and the parts in the picture, from the list and from the journal."""
    live = stopped.live
    alarm = live.machine.alarms.of(900)
    causes = likely_causes(alarm, live.machine.io_map)
    screen.press("[data-box=emergency_stop]")
    live.until_state(State.ABORTED)
    screen.open("alarms")
    expect(screen.find("[data-part=help]")).to_be_hidden()
    screen.find("li[data-alarm='900'] [data-help]").click()
    shown = screen.find("[data-part=help]")
    expect(shown.locator("[data-fact=meaning]")).to_have_text(alarm.text.meaning.en)
    expect(shown.locator(".causes > li > strong")).to_have_text([cause.cause.name.en for cause in causes])
    expect(shown.locator("[data-part=isolation] li")).to_have_text([step.en for step in ISOLATION])
    expect(shown.locator("svg .located")).to_have_count(1)
    expect(shown.locator("svg .located")).to_have_attribute("data-location", "cabinet")
    expect(shown.locator("svg .located-number")).to_have_text("1 2")
    assert [text for text in shown.locator("svg text").all_text_contents() if re.search("[a-z]{2}", text)] == []
    screen.find("[data-action=close_help]").click()
    expect(shown).to_be_hidden()
    screen.find("[data-table=journal] [data-help='900']").first.click()
    expect(shown).to_be_visible()
    screen.press("[data-banner=acknowledge]")
    expect(screen.find("[data-banner=acknowledge]")).to_be_hidden()
    screen.open("overview")
    screen.press("[data-box=emergency_stop]")
    clear(screen, live)


SHOW_ALARMS = """async ([rows]) => {
  const { app } = await import("/static/app.js");
  const { AlarmsPage } = await import("/static/pages/alarms.js");
  const page = new AlarmsPage();
  page.node.id = "shown-alarms";
  document.querySelector("main").append(page.node);
  const row = { state: 1, first_out: false, follows: null, chattering: false, standing: false, came_ms: 0 };
  const all = rows.map((each) => ({ ...row, shelved_until_ms: null, ...each }));
  page.update({
    link: { newest_alarm: null }, machine: { time_ms: 1000 }, alarms: { recent: 4, peak: 7, rows: all },
  });
}"""
"""Script that shows an alarm page with given rows below the open page."""


def test_consequences_are_folded_and_the_alarm_load_is_shown(stopped: Station, screen: Screen) -> None:
    """A consequence is folded under its first-out alarm, or listed alone if that alarm is not listed."""
    assert stopped.live
    screen.open("overview")
    rows = [
        {"number": 911, "first_out": True},
        {"number": 923, "follows": 911, "chattering": True},
        {"number": 961, "follows": 911},
        {"number": 990, "standing": True},
        {"number": 962, "follows": 905},
    ]
    screen.page.evaluate(SHOW_ALARMS, [rows])
    page = screen.find("#shown-alarms")
    numbers = "nodes => nodes.map((node) => Number(node.dataset.alarm))"
    assert page.locator(".part:first-child > .alarm-list > li").evaluate_all(numbers) == [911, 990, 962]
    assert page.locator("li[data-alarm='911'] details li").evaluate_all(numbers) == [923, 961]
    expect(page.locator("li[data-alarm='923']")).to_be_hidden()
    expect(page.locator("summary")).to_have_text("Consequences of this alarm: 2")
    page.locator("summary").click()
    expect(page.locator("li[data-alarm='923'] .alarm-load")).to_have_text("Chattering")
    expect(page.locator("li[data-alarm='990'] .alarm-load")).to_have_text("Standing for more than a day")
    expect(page.locator("[data-fact=alarm-load]")).to_have_text(
        "Alarms in the last 10 minutes: 4 (at most 10); most in 10 minutes: 7; chattering: 1; standing: 1"
    )


ANSWER_LATE = """async ([presses, answers]) => {
  const { app, order, refuse } = await import("/static/app.js");
  const { link } = app;
  const waiting = new Map();
  const answer = ({ name }) => new Promise((resolve) => waiting.set(name, resolve));
  app.link = Object.create(link, { order: { value: answer } });
  presses.forEach((name) => (name === "refused" ? refuse("refused") : void order({ name })));
  app.link = link;
  for (const [name, ok] of answers) {
    waiting.get(name)({ ok, text: { en: name, zh: name } });
    await new Promise((resolve) => window.setTimeout(resolve));
  }
}"""
"""Script that gives presses, whose orders are then answered in another sequence."""


@pytest.mark.parametrize(
    ("presses", "answers", "shown"),
    [
        (["first", "refused"], [("first", True)], "✕ refused"),
        (["first", "second"], [("second", True), ("first", True)], "✓ second"),
        (["first", "second"], [("second", False), ("first", False)], "✕ second"),
        (["first", "second"], [("second", True), ("first", False)], "✕ first"),
        (["first", "second"], [("first", False), ("second", True)], "✓ second"),
    ],
)
def test_a_late_reply_does_not_hide_the_reply_to_a_newer_press(
    stopped: Station, screen: Screen, presses: list[str], answers: list[tuple[str, bool]], shown: str
) -> None:
    """A refusal stays until the next press is answered, and a late refusal is shown unless there is a newer one."""
    assert stopped.live
    screen.page.evaluate(ANSWER_LATE, [presses, answers])
    expect(screen.find("[data-part=notice]")).to_have_text(re.compile(re.escape(shown), re.IGNORECASE))


def test_commands_that_halt_stand_apart_and_are_not_asked_about(stopped: Station, screen: Screen) -> None:
    names = screen.page.evaluate(
        "() => [...document.querySelectorAll('.halts button')].map((one) => one.dataset.command)"
    )
    assert names == [None, "stop", "hold"]  # the first one opens the menu
    expect(screen.find(".apart button")).to_have_attribute("data-command", "abort")
    screen.press("[data-command=abort]")
    stopped.live.until_state(State.ABORTED)
    clear(screen, stopped.live)


def test_resetting_the_counters_is_asked_about(stopped: Station, screen: Screen) -> None:
    """The first press changes the label only, and leaving the button takes it back."""
    live, button = stopped.live, screen.find("[data-command=count_reset]")
    done = live.machine.tags.machine.trays_done
    live.runtime.plc.write(done, 3)
    button.click()
    expect(button).to_have_text("Reset counters? Press again")
    screen.find("[data-command=clear]").focus()
    expect(button).to_have_text("Reset counters")
    screen.page.wait_for_timeout(AGAIN_MS)
    button.click()
    assert live.runtime.plc.read(done) == 3
    screen.page.wait_for_timeout(AGAIN_MS)
    button.click()
    live.until(lambda: live.runtime.plc.read(done) == 0, "counters reset")
    expect(button).to_have_text("Reset counters")


def test_acknowledging_is_available_only_with_an_alarm_to_acknowledge(screen: Screen) -> None:
    screen.open("alarms")
    button = screen.find("[data-command=acknowledge_all]")
    expect(button).to_have_attribute("aria-disabled", "true")
    press_unavailable(button)
    expect(screen.find(".notice")).to_have_text("✕ No alarm to acknowledge")


@pytest.mark.nightly
def test_numbers_that_round_to_zero_have_no_sign(screen: Screen) -> None:
    numbers = [(-0.04, 1), (-0.05, 1), (0, 0), (-0.4, 0), (-7.84, 1), (1.25, 1)]
    script = (
        "async (all) => { const { fixed } = await import('/static/texts.js'); return all.map((one) => fixed(...one)); }"
    )
    assert screen.page.evaluate(script, numbers) == ["0.0", "-0.1", "0", "0", "-7.8", "1.3"]
