"""Page in a browser, with the panel, controller and plant running."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest
from playwright.sync_api import Browser, Locator, expect

from controller.hmi.panel.view import texts
from controller.hmi.panel.web import app
from controller.io.pace import FLAT_OUT, PAUSED
from controller.program.alarms.guide import likely_causes
from controller.program.operator.commands import JOG_LEASE_MS
from controller.program.operator.next_press import NextPress
from controller.program.states import Mode, State
from controller.program.texts.interlocks import RULES
from controller.program.texts.isolation import ISOLATION
from controller.program.texts.next_press import NEXT_PRESSES
from controller.program.texts.operator import CANNOT, MODES, STATES
from plant_sim.crop.seedling import Location
from tests.controller.hmi.panel.panel_page_rig import PASSWORDS, SCAN_MS, LiveMachine, PanelProcess
from tests.controller.hmi.panel.screen import PAGES, TIMEOUT_MS, Screen, chromium, clear
from tests.controller.hmi.panel.test_chinese import CHINESE, latin_words, punctuation_errors
from tests.sampling import first_of

STALE_MS = 1_000
DRAW_MS = 500
"""Allowance for a browser on a busy computer to draw an update, ms."""
OUTPUT = "left.lift_retract"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as process:
        yield process


@pytest.fixture
def live(tmp_path: Path) -> Iterator[LiveMachine]:
    with LiveMachine(tmp_path) as machine:
        yield machine


@pytest.fixture
def panel(live: LiveMachine, tmp_path: Path) -> Iterator[PanelProcess]:
    with PanelProcess(live, tmp_path) as process:
        yield process


class Station(NamedTuple):
    """Machine and panel shared by several tests, and their folder."""

    live: LiveMachine
    panel: PanelProcess
    folder: Path


@contextmanager
def started(folder: Path, *, slow: bool = False) -> Iterator[Station]:
    with LiveMachine(folder) as live, PanelProcess(live, folder, slow=slow) as panel:
        yield Station(live, panel, folder)


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Yield a machine in the Stopped state; each test must leave it Stopped, in continuous mode and without alarms."""
    with started(tmp_path_factory.mktemp("stopped")) as station:
        yield station


@pytest.fixture(scope="module")
def manual(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Yield a machine for jogging; each test must leave it in manual mode with its outputs off."""
    with started(tmp_path_factory.mktemp("manual"), slow=True) as station:
        yield station


@pytest.fixture(scope="module")
def screens(stopped: Station, browser: Browser) -> Iterator[dict[str, Screen]]:
    """Yield a page of the stopped machine for each user, shared by the tests; each test must leave it without a dialog
    and in English.
    """
    with ExitStack() as stack:
        yield {user: stack.enter_context(Screen(browser, stopped.panel.url, user)) for user in PASSWORDS}


@pytest.fixture(params=["operate"])
def screen(request: pytest.FixtureRequest, screens: dict[str, Screen]) -> Iterator[Screen]:
    """Yield the page of a user, by default the operator, on its first tab."""
    shared = screens[request.param]
    shared.open(PAGES[0])
    yield shared
    unexpected, shared.unexpected[:] = [*shared.unexpected], []
    assert unexpected == []


def expect_state(screen: Screen, state: State) -> None:
    expect(screen.find("header [data-fact=state]")).to_contain_text(STATES[state].en, timeout=TIMEOUT_MS)


def press_unavailable(button: Locator) -> None:
    """Press an unavailable button with the mouse, once it rests and nothing covers it.

    A click of the browser driver waits until the button is available, and a forced one does not look whether the page
    moves meanwhile.
    """
    expect(button).to_have_attribute("aria-disabled", "true")
    button.hover()
    button.page.mouse.down()
    button.page.mouse.up()


def ready_to_jog(screen: Screen, live: LiveMachine) -> Locator:
    """Start manual mode if necessary, and return the jog button of an output."""
    screen.open("manual")
    if live.state != State.EXECUTE:
        live.fast()
        screen.press("[data-command=mode_manual]")
        live.until(lambda: live.runtime.plc.read(live.machine.tags.machine.mode) == Mode.MANUAL, "manual")
        screen.press("[data-command=reset]")
        live.until_state(State.IDLE)
        screen.press("[data-command=start]")
        live.until_state(State.EXECUTE)
        live.slow()
    button = screen.find(f"main [data-jog='{OUTPUT}']")
    expect(button).not_to_have_attribute("aria-disabled", "true", timeout=TIMEOUT_MS)
    return button


def until_renewed(live: LiveMachine) -> None:
    """Wait until the output has been on for longer than a lease that is not renewed."""
    held_from_ms = live.now_ms
    live.until(lambda: live.now_ms > held_from_ms + JOG_LEASE_MS + 2 * SCAN_MS, "held")
    assert live.on(OUTPUT), "not renewed"


def recent_cups(live: LiveMachine) -> dict[str, str]:
    """Return the signs of the latest cups of each row, when the cups have stopped."""
    plant = live.plant.server.module.plant

    def read() -> dict[str, str]:
        losses = {None: "○", Location.LOST_PICK: "P", Location.LOST_CARRY: "D", Location.LOST_THROW: "T"}
        return {
            side: "".join("↑" if cup.seedlings else losses[cup.cause] for cup in arm.row.recent)
            for side, arm in plant.arms.items()
        }

    live.until(lambda: all(arm.cups.speed_m_s == 0.0 for arm in plant.arms.values()), "cups stand")
    return live.plant.call(read)


@pytest.mark.nightly
def test_trial_started_by_the_box_shows_the_counts_of_the_plant(
    live: LiveMachine, panel: PanelProcess, browser: Browser
) -> None:
    with Screen(browser, panel.url) as screen:
        screen.log_in("operate")
        live.fast()
        screen.press("[data-box=start]")
        live.until_state(State.IDLE)
        expect_state(screen, State.IDLE)
        live.stop_cups_in(State.COMPLETE)
        screen.press("[data-box=start]")
        live.until_state(State.COMPLETE)
        expect_state(screen, State.COMPLETE)
        counts = live.counts()
        assert counts.in_cups > 50
        expect(screen.find("[data-fact=in_cups]")).to_have_text(f"{counts.in_cups} / {counts.total}")
        expect(screen.find("[data-fact=lost]")).to_have_text(f"{counts.P} / {counts.D} / {counts.T}")
        for side, cups in recent_cups(live).items():
            expect(screen.find(f"[data-cups={side}]")).to_have_text(cups)
            assert cups.count("↑") >= 10
        expect(screen.find("[data-fact=trays]")).to_have_text("1")
        thrown = sum(live.runtime.plc.read(arm.cycles) for arm in live.machine.tags.arms.values())
        expect(screen.find("[data-fact=cycles]")).to_have_text(str(thrown))
        screen.open("cycle")
        expect(screen.find("[data-timing=left] [data-device=Y5]")).to_have_count(1)
        expect(screen.find("[data-timing=right] [data-device=X23]").first).to_be_attached()
        screen.open("trends")
        expect(screen.find("[data-chart='Pressures']")).to_be_visible()


@pytest.mark.nightly
def test_live_run_is_operated_manually_in_the_browser(tmp_path: Path, browser: Browser) -> None:
    """A manually operated run, as in the README, completes, and the page shows the seedling counts of its report.

    The times of the button presses determine how long the seedlings are held and how many break. The expected counts
    are therefore taken from the report, which counts each of the 72 seedlings once.
    """
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = str(reserved.getsockname()[1])
    command = [
        *(sys.executable, "-m", "plant_sim", "run", "--by-hand", "--keep", "--trays", "1", "--pace", str(FLAT_OUT)),
        *("--port", port, "--hmi-port", "0", "--panel-port", "0"),
    ]
    run = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert run.stdout is not None
        assert run.stderr is not None
        url = next(line for line in run.stderr if line.startswith("panel at ")).removeprefix("panel at ").strip()
        with Screen(browser, url) as screen:
            screen.set_first_passwords()
            screen.log_in("operate")
            screen.press("[data-box=start]")
            expect_state(screen, State.IDLE)
            screen.press("[data-box=start]")
            complete = re.compile(STATES[State.COMPLETE].en)
            expect(screen.find("header [data-fact=state]")).to_contain_text(complete, timeout=180_000)
            counted = next(line for line in run.stdout if line.startswith("seedlings "))
            total, in_cups, *lost = map(int, re.findall(r"\d+", counted))
            expect(screen.find("[data-fact=in_cups]")).to_have_text(f"{in_cups} / 72")
            expect(screen.find("[data-fact=lost]")).to_have_text(" / ".join(map(str, lost)))
        run.send_signal(signal.SIGINT)
        _, errors = run.communicate(timeout=TIMEOUT_MS / 1_000)
    finally:
        run.send_signal(signal.SIGINT)  # on SIGINT the run stops its own processes
        run.communicate()
    assert run.returncode == 0, errors
    assert in_cups + sum(lost) == total == 72
    assert in_cups > 60
    assert "Traceback" not in errors


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
    screen.open("alarms")
    expect(screen.find("[data-alarm='900'] [data-action=shelve]")).to_have_count(0)
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


def test_output_follows_pointer_and_key(manual: Station, browser: Browser) -> None:
    live = manual.live
    with Screen(browser, manual.panel.url) as screen:
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


def test_a_held_button_tells_why_its_output_stays_off(manual: Station, browser: Browser) -> None:
    with Screen(browser, manual.panel.url, "maintain") as screen:
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


@pytest.mark.parametrize("loss", first_of(["panel frozen", "page closed", "panel killed"]))
def test_lost_socket_releases_the_output_within_the_timeout(manual: Station, browser: Browser, loss: str) -> None:
    live = manual.live
    with ExitStack() as stack:
        panel = (
            stack.enter_context(PanelProcess(live, manual.folder, slow=True))
            if loss == "panel killed"
            else manual.panel
        )
        screen = stack.enter_context(Screen(browser, panel.url, "maintain"))
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
        panel.send(signal.SIGCONT)  # the page waits for a frozen panel when it closes
        screen.unexpected.clear()  # the browser reports the closed socket of a killed panel


@pytest.mark.parametrize("screen", ["maintain"], indirect=True)
def test_refused_jog_ends_and_shows_the_reason(stopped: Station, screen: Screen) -> None:
    live = stopped.live
    screen.open("manual")
    button = screen.find(f"main [data-jog='{OUTPUT}']")
    press_unavailable(button)
    expect(screen.find("[data-part=notice]")).to_contain_text("Cannot")
    expect(button).to_have_attribute("aria-pressed", "false")
    assert not any(OUTPUT in outputs for _, outputs in live.levels)


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


def test_view_level_is_asked_to_log_in(stopped: Station, browser: Browser) -> None:
    with Screen(browser, stopped.panel.url) as screen:
        expect(screen.find("[data-fact=link]")).to_contain_text(texts.TEXTS["link.live"].en)
        button = screen.find("[data-command=stop]")
        press_unavailable(button)
        expect(screen.find("[data-part=notice]")).to_contain_text(texts.TEXTS["why.operate"].en)
        screen.open("io")
        expect(screen.find("[data-force]").first).to_be_hidden()


def test_parameter_is_checked_before_it_is_sent(stopped: Station, screen: Screen) -> None:
    live = stopped.live
    settle = live.machine.tags.sp.settle
    screen.open("parameters")
    row = screen.find("[data-set-point=settle]")
    for value, message in (("5", "50 to 2000"), ("205", "multiple of 10"), ("-1", "number"), ("", "number")):
        row.locator("input").fill(value)
        row.locator("button").click()
        expect(row.locator("[role=alert]")).to_contain_text(message)
    assert live.runtime.plc.read(settle) == 10
    row.locator("input").fill("300")
    row.locator("input").press("Enter")
    live.until(lambda: live.runtime.plc.read(settle) == 30, "settle")
    expect(screen.find("[data-fact=settle]")).to_have_text("300 ms")
    expect(screen.find(".notice")).to_have_text("✓ Done")
    row.locator("input").fill("5")
    row.locator("button").click()
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
  const { AlarmsPage } = await import("/static/alarms.js");
  const page = new AlarmsPage();
  page.node.id = "shown-alarms";
  document.querySelector("main").append(page.node);
  const row = { state: 1, first_out: false, follows: null, chattering: false, standing: false, came_ms: 0 };
  const all = rows.map((each) => ({ ...row, shelved_until_ms: null, ...each }));
  page.update({ machine: { time_ms: 1000 }, alarms: { recent: 4, peak: 7, rows: all } });
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


SMALL_CONTROLS = """() => [...document.querySelectorAll("button, input, select")]
  .filter((one) => one.checkVisibility({ visibilityProperty: true }))
  .map((one) => ({ text: one.outerHTML, box: one.getBoundingClientRect() }))
  .filter(({ box }) => box.width > 0 && box.height > 0 && !(box.width >= 44 && box.height >= 44))
  .map(({ text, box }) => `${text} is ${box.width} px wide and ${box.height} px high`)"""
"""Script that returns the visible controls that are less than 44 px wide or high."""


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


def test_commands_that_halt_stand_apart_and_are_not_asked_about(stopped: Station, screen: Screen) -> None:
    names = screen.page.evaluate(
        "() => [...document.querySelectorAll('.halts button')].map((one) => one.dataset.command)"
    )
    assert names == ["stop", "hold", "abort"]
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
    button.click()
    assert live.runtime.plc.read(done) == 3
    button.click()
    live.until(lambda: live.runtime.plc.read(done) == 0, "counters reset")
    expect(button).to_have_text("Reset counters")


def test_acknowledging_is_available_only_with_an_alarm_to_acknowledge(screen: Screen) -> None:
    screen.open("alarms")
    button = screen.find("[data-command=acknowledge_all]")
    expect(button).to_have_attribute("aria-disabled", "true")
    press_unavailable(button)
    expect(screen.find(".notice")).to_have_text("✕ No alarm to acknowledge")


def test_numbers_that_round_to_zero_have_no_sign(screen: Screen) -> None:
    numbers = [(-0.04, 1), (-0.05, 1), (0, 0), (-0.4, 0), (-7.84, 1), (1.25, 1)]
    script = (
        "async (all) => { const { fixed } = await import('/static/texts.js'); return all.map((one) => fixed(...one)); }"
    )
    assert screen.page.evaluate(script, numbers) == ["0.0", "-0.1", "0", "0", "-7.8", "1.3"]


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
    for page in (*PAGES[1:], PAGES[0]):
        screen.page.keyboard.press("ArrowRight")
        expect(screen.find("[role=tab]:focus")).to_have_attribute("data-page", page)
        expect(screen.find("main")).to_have_attribute("data-page", page)


STATIC = app.STATIC
SCRIPTS = {path.name: path.read_text(encoding="utf-8") for path in STATIC.glob("*.js")}


def test_every_text_key_of_the_scripts_exists() -> None:
    used = {
        key
        for script in SCRIPTS.values()
        for key in re.findall(r"\b(?:t|label|section|group|button|note|labelled)\(\"([a-z_.0-9]+)\"", script)
    }
    assert len(used) > 100
    assert sorted(used - texts.TEXTS.keys()) == []


def test_every_part_of_the_program_has_a_name(part_keys: list[str]) -> None:
    assert sorted(set(part_keys) - texts.TEXTS.keys()) == []


@pytest.fixture
def part_keys() -> list[str]:
    from controller.program.machine import build
    from controller.program.tags import SIDES
    from tests.controller.common.modbus_rig import IO_MAP

    machine = build(IO_MAP)
    tags = machine.tags
    bare = [
        point.tag.partition(".")[2] if point.tag.partition(".")[0] in SIDES else point.tag
        for point in (*IO_MAP.inputs, *IO_MAP.outputs, *IO_MAP.unwired)
    ]
    steps = [step for sequence in machine.program.sequences() for _, step in sequence]
    return [
        *(f"command.{command.name}" for command in tags.commands if command.group != "jog"),
        *(f"set.{name}" for name in tags.sp.names()),
        *(f"point.{name}" for name in bare),
        *(f"sequence.{sequence.name}" for sequence in machine.program.sequences()),
        *(f"step.{step.title}" for step in steps),
        *(f"waits.{step.waits_for}" for step in steps if step.waits_for),
        *(f"jog.{output.rpartition('.')[2]}" for output in tags.commands.jog),
    ]


def test_every_text_has_both_languages_and_the_same_placeholders() -> None:
    def placeholders(text: str) -> list[str]:
        return sorted(re.findall(r"\{\w+\}", text))

    assert [key for key, text in texts.TEXTS.items() if not text.en or not text.zh] == []
    assert [key for key, text in texts.TEXTS.items() if placeholders(text.en) != placeholders(text.zh)] == []


def test_page_loads_nothing_from_other_hosts() -> None:
    for path in (path for path in STATIC.iterdir() if path.is_file()):
        text = path.read_text(encoding="utf-8")
        external = [url for url in re.findall(r"(?:https?:)?//[\w.]+\.\w+[^\s\"']*", text) if "www.w3.org" not in url]
        assert external == [], path.name
        assert not re.search(r"\bstyle=|\bon\w+=\"|<script>|innerHTML|\beval\(", text), path.name
