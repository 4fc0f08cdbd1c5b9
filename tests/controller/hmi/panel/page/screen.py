"""Browser and page with which the panel is operated in tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final, NamedTuple, Self
from urllib.parse import urlsplit

from playwright.sync_api import Browser, Locator, Page, Route, ViewportSize, expect, sync_playwright

from controller.hmi.panel.view import texts
from controller.program.operator.commands import JOG_LEASE_MS
from controller.program.states import Mode, State
from controller.program.texts.operator import STATES
from tests.controller.hmi.panel.page.panel_page_rig import PASSWORDS, PATIENCE, SCAN_MS, LiveMachine, PanelProcess

FLAGS: Final = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
CHROMIUM: Final = "/usr/bin/chromium-headless-shell"
"""The browser without its own windows, which needs half the processor time."""
CHROMIUM_OF_THE_KIOSK: Final = "/usr/bin/chromium"
PAGES: Final = (
    "cab",
    "overview",
    "alarms",
    "recovery",
    "manual",
    "trays",
    "trends",
    "cycle",
    "history",
    "steps",
    "io",
    "parameters",
)
"""Pages with a tab, in their order."""
TIMEOUT_MS: Final = 60_000
AGAIN_MS: Final = 600
"""Time after which a tap is no longer the second one of a double tap, ms."""
OUTPUT: Final = "left.lift_retract"
"""Output that is jogged."""

expect.set_options(timeout=TIMEOUT_MS)


@contextmanager
def chromium(environment: dict[str, str | float | bool] | None = None) -> Iterator[Browser]:
    """Run the browser for the duration of a `with` block; None = with the environment of this process."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS, env=environment)
        yield browser
        browser.close()


def _lengthen(route: Route) -> None:
    """Answer with the script in which values are outdated later."""
    response = route.fetch()
    short = "const STALE_MS = 1000;"
    script = response.text()
    assert short in script
    route.fulfill(response=response, body=script.replace(short, f"const STALE_MS = {1_000 * PATIENCE};"))


class Screen:
    """Page in a browser; no unexpected event may occur during the test.

    Args:
        user: User who is logged in when the page opens; None for a page without a login.
        locale: Language of the browser.
        patient: Whether the page waits longer before it regards values as outdated.
        touch: Whether the page is on a touch screen of 800 by 480 pixels.

    Attributes:
        unexpected: Console errors, and requests to hosts other than the panel.
    """

    def __init__(
        self,
        browser: Browser,
        url: str,
        user: str | None = None,
        locale: str = "en-US",
        *,
        patient: bool = False,
        touch: bool = False,
    ) -> None:
        viewport: ViewportSize = {"width": 800, "height": 480} if touch else {"width": 1280, "height": 800}
        self._context = browser.new_context(viewport=viewport, has_touch=touch, locale=locale)
        if user is not None:
            data = {"user": user, "password": PASSWORDS[user]}
            answer = self._context.request.post(f"{url}/api/login", data=data, headers={"origin": url})
            assert answer.ok, answer.text()
        self.page: Page = self._context.new_page()
        self.page.set_default_timeout(TIMEOUT_MS)
        if patient:
            self.page.route("**/static/link.js", _lengthen)
        self.unexpected: list[str] = []
        self._url = url
        self.page.on("console", lambda line: self.unexpected.append(line.text) if line.type == "error" else None)
        self.page.on("pageerror", lambda error: self.unexpected.append(str(error)))
        self.page.on("request", lambda request: self._check(request.url))
        self.page.on("websocket", lambda socket: self._check(socket.url))

    def __enter__(self) -> Self:
        self.page.goto(self._url)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        with suppress(Exception):
            self._context.close()
        if kind is None:
            assert self.unexpected == []

    def log_in(self, user: str) -> None:
        """Log in once the page is complete; the first values move its header."""
        expect(self.find("body")).to_have_attribute("data-link", "live")
        self.find("[data-action=login]").click()
        self.find("dialog select").select_option(user)
        self.find("dialog input[type=password]").fill(PASSWORDS[user])
        self.find("dialog [data-action=submit]").click()
        expect(self.find("[data-fact=level]")).to_have_text(texts.TEXTS[f"level.{user}"].en)

    def set_first_passwords(self) -> None:
        """Fill in and submit the first-run dialog."""
        fields = self.find("dialog input[type=password]")
        expect(fields).to_have_count(len(PASSWORDS), timeout=TIMEOUT_MS)
        for index, password in enumerate(PASSWORDS.values()):
            fields.nth(index).fill(password)
        self.find("dialog [data-action=submit]").click()
        expect(self.find("dialog[open]")).to_have_count(0, timeout=TIMEOUT_MS)

    def find(self, selector: str, *, has: Locator | None = None) -> Locator:
        return self.page.locator(selector, has=has)

    def open(self, page: str) -> None:
        """Open a page by its tab, or by its key in the menu of the cab."""
        tab = self.find(f"[role=tab][data-page={page}]")
        self.find("main").wait_for(state="attached")
        if not tab.is_visible():
            self.find(".keys [data-page=menu]").click()
            tab = self.find(f".menu [data-page={page}]")
        tab.click()
        expect(self.find(f"main[data-page={page}]")).to_be_visible()

    def select_language(self, language: str) -> None:
        """Select a language in the header, or in the menu of the cab."""
        choice = self.find("[data-action=language]")
        self.find("main").wait_for(state="attached")
        if choice.is_visible():
            choice.select_option(language)
            return
        self.find(".keys [data-page=menu]").click()
        self.find(f".menu [data-language-key={language}]").click()

    def press(self, selector: str) -> None:
        """Press a button as soon as it is available."""
        button = self.find(selector)
        expect(button).not_to_have_attribute("aria-disabled", "true", timeout=TIMEOUT_MS)
        button.click()

    def _check(self, url: str) -> None:
        if urlsplit(url).netloc != urlsplit(self._url).netloc:
            self.unexpected.append(f"request to {url}")


class Maintained(NamedTuple):
    """Machine in Stopped, and the page of a maintainer."""

    live: LiveMachine
    screen: Screen


@contextmanager
def maintained(folder: Path) -> Iterator[Maintained]:
    """Run a machine in Stopped with the page of a maintainer for the duration of a `with` block."""
    with ExitStack() as stack:
        live = stack.enter_context(LiveMachine(folder))
        panel = stack.enter_context(PanelProcess(live, folder, patient=True))
        screen = stack.enter_context(Screen(stack.enter_context(chromium()), panel.url, "maintain"))
        live.until_state(State.STOPPED)
        yield Maintained(live, screen)


def clear(screen: Screen, live: LiveMachine) -> None:
    """Clear an emergency stop whose button has been released."""
    screen.press("[data-command=clear]")
    live.until_state(State.STOPPED)


class Station(NamedTuple):
    """Machine and panel shared by several tests, and their folder."""

    live: LiveMachine
    panel: PanelProcess
    folder: Path


@contextmanager
def started(folder: Path, *, slow: bool = False) -> Iterator[Station]:
    with LiveMachine(folder) as live, PanelProcess(live, folder, patient=True, slow=slow) as panel:
        yield Station(live, panel, folder)


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
