"""Refusals on the page: reasons in time, notices that end with them, and orders that have nothing to do."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from random import Random
from typing import Any, Final, NamedTuple

import pytest
from playwright.sync_api import Browser, expect
from playwright.sync_api import TimeoutError as PlaywrightTimeoutError

from controller.core.devices import Memory
from controller.core.expr import Bit, Word, evaluate, leaves
from controller.core.scan import Plc
from controller.hmi.panel.orders.jog_reasons import _LAST, jog_obstacle
from controller.hmi.panel.orders.replies import REPLIES
from controller.hmi.panel.view import texts
from controller.hmi.panel.web.sockets import VIEW_MS
from controller.program.operator.commands import JOGGED
from controller.program.states import Mode, State
from controller.program.texts.operator import LANGUAGES, Text
from tests.controller.hmi.panel.page.panel_page_rig import LiveMachine
from tests.controller.hmi.panel.page.screen import (
    TIMEOUT_MS,
    Screen,
    Station,
    clear,
    press_unavailable,
    ready_to_jog,
    started,
)
from tests.controller.hmi.panel.test_jog_reasons import rules_of
from tests.controller.program.interlock_scene import MACHINE
from tests.sampling import first_of

pytestmark = pytest.mark.nightly

LIMIT_MS: Final = 300
"""Time from a press until its reason is shown, ms."""
ROUND_TRIPS: Final = 3
"""Number of bare round trips after which the reason is shown on a computer that is too busy for `LIMIT_MS`."""
TAGS: Final = MACHINE.tags
FIRST: Final = "left.slide_inward"
"""Output with the most rules of its own; the other outputs are jogged every night."""
AT_ITS_END: Final = "at its end"
NOT_IN_MANUAL_MODE: Final = {"no arm fault", "no feeder fault"}
"""Rules that block no jog."""


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Yield a machine with its panel, which is patient; each test must leave it without alarms."""
    with started(tmp_path_factory.mktemp("refusals"), slow=True) as station:
        yield station


@pytest.fixture(scope="module")
def maintain(station: Station, browser: Browser) -> Iterator[Screen]:
    """Yield the page of a maintainer; each test must leave it in English."""
    with Screen(browser, station.panel.url, "maintain", patient=True) as screen:
        yield screen


@pytest.fixture
def screen(station: Station, maintain: Screen) -> Screen:
    """Return the page of the machine in Stopped."""
    live = station.live
    if live.state != State.STOPPED:
        maintain.open("overview")
        maintain.press("[data-command=stop]")
        live.until_state(State.STOPPED)
    return maintain


class Blocked(NamedTuple):
    """Situation in which a jogged output stays off or moves nothing: values of devices, and the reason."""

    values: dict[Bit | Word, int]
    reason: Text


def situations(output: str) -> dict[str, Blocked]:
    """Return a situation in manual mode for each rule that can be the first one to block an output, and for its end.

    One device is changed after the other, and a change is kept unless an earlier rule blocks then.
    """
    side, _, name = output.rpartition(".")
    machine, random = TAGS.machine, Random(1)
    rules = rules_of(output)
    last = getattr(TAGS.arms[side], _LAST[name]) if name in _LAST and side in TAGS.arms else None
    read = {device for rule in rules for device in leaves(rule.allow)} | (set() if last is None else {*leaves(last)})
    devices = sorted((device for device in read if isinstance(device, Bit | Word)), key=str)
    found: dict[str, Blocked] = {}
    names = [*(rule.name for rule in rules), AT_ITS_END]
    fixed: dict[Bit | Word, int] = {machine.jogging: 1, machine.jog: 1 + JOGGED.index(output)}
    kept: dict[Bit | Word, int] = dict.fromkeys(devices, 0) | fixed
    reached = 0
    for _ in range(20_000):
        changed = random.choice(devices)
        values = kept | {changed: random.randrange(2 if isinstance(changed, Bit) else 4)} | fixed
        memory = Memory()
        write(memory, values)
        reason = jog_obstacle(MACHINE, memory, output)
        first = next((n for n, rule in enumerate(rules) if not evaluate(rule.allow, memory)), len(rules))
        if reason is not None and names[first] not in found:
            found[names[first]] = Blocked({each: values[each] for each in devices if each not in fixed}, reason)
        if first >= reached:
            kept, reached = values, first
    return found


def write(memory: Memory, values: dict[Bit | Word, int]) -> None:
    for device, value in values.items():
        if isinstance(device, Bit):
            memory.bits(device.kind)[device.number] = bool(value)
        else:
            memory.set_word(device.kind, device.number, value)


@contextmanager
def shown_to_the_panel(live: LiveMachine, values: dict[Bit | Word, int]) -> Iterator[None]:
    """Give the devices these values in every snapshot that the Modbus server takes; the program does not see them."""
    kept: dict[Bit | Word, int] = {}

    def before(_: int, plc: Plc) -> None:
        kept.update({device: plc.read(device) for device in values})
        write(plc.memory, values)

    def after(_: int, plc: Plc) -> None:
        write(plc.memory, kept)

    observers = live.runtime.observers
    live.runtime.observers = [before, *observers, after]
    try:
        yield
    finally:
        live.runtime.observers = observers


TIME_A_PRESS: Final = """async (output) => {
  const { app } = await import("/static/app.js");
  const button = document.querySelector(`main [data-jog='${output}']`);
  const reason = button.closest(".jog").querySelector("[role=alert]");
  const notice = document.querySelector("[data-part=notice]");
  window.shown = null;
  button.addEventListener("pointerdown", () => {
    const from = performance.now();
    let last = from, gap = 0;
    const note = () => {
      gap = Math.max(gap, performance.now() - last);
      last = performance.now();
    };
    app.link.addEventListener("view", note);
    const observer = new MutationObserver(() => {
      const refused = notice.dataset.ok === "0" ? notice.textContent : "";
      if (reason.textContent === "" && refused === "") return;
      observer.disconnect();
      window.requestAnimationFrame(() => {
        note();
        app.link.removeEventListener("view", note);
        window.shown = { ms: performance.now() - from, text: reason.textContent, refused, gap };
      });
    });
    const texts = { childList: true, characterData: true, subtree: true };
    observer.observe(reason, texts);
    observer.observe(notice, { ...texts, attributes: true });
  }, { once: true, capture: true });
}"""
"""Script that measures from the next press of a jog until the frame in which its reason is drawn, and meanwhile the
longest time without values of the machine: if the computer stops a process, both are longer. A press that the page ends
shows a notice in place of the reason.
"""
SHOWN: Final = "() => window.shown"
"""Script that returns what the press has shown; null until then."""
START_READING: Final = """async (from_ms) => {
  const { app } = await import("/static/app.js");
  const times = new Set();
  window.read = false;
  app.link.addEventListener("view", function check() {
    if (app.link.view.machine.time_ms > from_ms) times.add(app.link.view.machine.time_ms);
    if (times.size < 2) return;
    app.link.removeEventListener("view", check);
    window.read = true;
  });
}"""
"""Script that records when the panel has read the whole controller after a time, which takes it two polls at most."""
READ: Final = "() => window.read"
"""Script that returns whether that is so."""
ON_THE_PAGE: Final = """(output) => ({
  link: document.body.dataset.link,
  page: document.querySelector("main")?.dataset.page,
  notice: document.querySelector("[data-part=notice]")?.textContent,
  strip: document.querySelector("[data-part=stale]")?.textContent,
  button: document.querySelector(`main [data-jog='${output}']`)?.outerHTML,
  under_the_pointer: document.querySelector("main :hover:not(:has(:hover))")?.outerHTML,
})"""
"""Script that returns what a person sees of a press."""
ROUND_TRIP: Final = """async () => {
  const { app } = await import("/static/app.js");
  const from = performance.now();
  await app.link.order({ type: "jog", output: "left.lift_retract", hold: false });
  return performance.now() - from;
}"""
"""Script that measures an order that is answered at once, ms."""


def once(screen: Screen, script: str, output: str) -> dict[str, Any]:
    """Return the first value of a script that is true; if there is none, fail with what is on the page."""
    try:
        value: dict[str, Any] = screen.page.wait_for_function(script).json_value()
    except PlaywrightTimeoutError:
        pytest.fail(f"{script} has no value within {TIMEOUT_MS} ms: {screen.page.evaluate(ON_THE_PAGE, output)}")
    return value


def select_language(screen: Screen, language: str) -> None:
    screen.find("[data-action=language]").select_option(language)


@pytest.mark.parametrize("output", first_of([FIRST, *(output for output in JOGGED if output != FIRST)]))
def test_the_reason_of_a_blocked_jog_is_shown_in_time(station: Station, maintain: Screen, output: str) -> None:
    """Each rule that can block the output, and its end, in both languages."""
    found = situations(output)
    assert {rule.name for rule in rules_of(output)} - found.keys() <= NOT_IN_MANUAL_MODE
    ready_to_jog(maintain, station.live)
    station.live.pace.set(100)
    times: dict[tuple[str, str], tuple[float, float]] = {}
    bare: list[float] = []
    for language in LANGUAGES:
        select_language(maintain, language)
        button = maintain.find(f"main [data-jog='{output}']")
        reason = maintain.find(".jog", has=maintain.find(f"[data-jog='{output}']")).locator("[role=alert]")
        for name, situation in found.items():
            with shown_to_the_panel(station.live, situation.values):
                maintain.page.evaluate(START_READING, station.live.now_ms)
                once(maintain, READ, output)
                expect(reason).to_be_empty()
                bare.append(maintain.page.evaluate(ROUND_TRIP))
                maintain.page.evaluate(TIME_A_PRESS, output)
                button.hover()
                maintain.page.mouse.down()
                shown = once(maintain, SHOWN, output)
                maintain.page.mouse.up()
                expected = getattr(situation.reason, language)
                assert shown["text"].lower() == expected.lower(), (name, shown)
                times[language, name] = shown["ms"], max(0.0, shown["gap"] - VIEW_MS)
                expect(reason).to_be_empty()
    select_language(maintain, "en")
    limit_ms = max(LIMIT_MS, ROUND_TRIPS * max(bare))
    slow = {situation: round(ms) for situation, (ms, stopped_ms) in times.items() if ms > limit_ms + stopped_ms}
    assert slow == {}, f"limit {limit_ms:.0f} ms; longest bare round trip {max(bare):.0f} ms"


def test_silencing_and_acknowledging_are_live_only_with_something_to_do(station: Station, screen: Screen) -> None:
    """The horn sounds for the emergency stop until it is silenced."""
    screen.open("overview")
    silence = screen.find("[data-command=acknowledge]")
    press_unavailable(silence)
    expect(screen.find(".notice")).to_have_text(f"✕ {REPLIES['horn is off'].en}", ignore_case=True)
    expect(screen.find("[data-banner=acknowledge]")).to_be_hidden()
    screen.press("[data-box=emergency_stop]")
    station.live.until_state(State.ABORTED)
    expect(screen.find("[data-banner=acknowledge]")).to_be_visible()
    screen.press("[data-command=acknowledge]")
    expect(silence).to_have_attribute("aria-disabled", "true")
    screen.press("[data-banner=acknowledge]")
    expect(screen.find("[data-banner=acknowledge]")).to_be_hidden()
    screen.press("[data-box=emergency_stop]")
    clear(screen, station.live)


def test_forcing_is_live_only_for_an_input_that_may_be_forced(station: Station, screen: Screen) -> None:
    """Only in Stopped, in manual mode; the end of forcing only for a forced input."""
    live, mode = station.live, station.live.machine.tags.machine.mode
    screen.open("overview")
    screen.press("[data-command=mode_continuous]")
    live.until(lambda: live.runtime.plc.read(mode) == Mode.CONTINUOUS, "continuous")
    screen.open("io")
    force, let_go = screen.find("[data-force='X22=1']"), screen.find("[data-force='X22=2']")
    press_unavailable(force)
    expect(screen.find(".notice")).to_have_text(f"✕ {REPLIES['force only at rest'].en}", ignore_case=True)
    press_unavailable(let_go)
    expect(screen.find(".notice")).to_have_text(f"✕ {texts.TEXTS['io.not_forced'].en}")
    live.runtime.order("mode_manual")
    expect(force).not_to_have_attribute("aria-disabled", "true")
    expect(let_go).to_have_attribute("aria-disabled", "true")
    force.click()
    expect(let_go).not_to_have_attribute("aria-disabled", "true")
    let_go.click()
    expect(let_go).to_have_attribute("aria-disabled", "true")


def test_a_notice_ends_with_its_reason_or_the_next_press_of_its_control(station: Station, screen: Screen) -> None:
    """Refusals by the page and by the server; a press of another control does not end them."""
    live, mode = station.live, station.live.machine.tags.machine.mode
    notice = screen.find("[data-part=notice]")
    screen.page.evaluate(KEEP_NOTICES)
    screen.open("overview")
    live.runtime.order("mode_continuous")
    live.until(lambda: live.runtime.plc.read(mode) == Mode.CONTINUOUS, "continuous")
    screen.open("io")
    press_unavailable(screen.find("[data-force='X22=1']"))
    expect(notice).to_contain_text(REPLIES["force only at rest"].en[1:])
    live.runtime.order("mode_manual")
    expect(notice).to_be_empty()
    screen.open("overview")
    press_unavailable(screen.find("[data-command=start]"))
    expect(notice).to_contain_text("Cannot")
    screen.open("parameters")
    expect(notice).to_be_empty()
    entry = screen.find("[data-set-point=settle] input")
    entry.fill("5")
    entry.press("Enter")
    expect(notice).to_have_text("✕ Enter 50 to 2000")
    entry.fill("50")
    expect(notice).to_be_empty()
    ended = screen.page.evaluate(PRESS_AGAIN)
    assert ended == ["✕ refused", "✕ refused", "", "✕ refused", "✓ done"]


def test_a_refused_shelving_ends_when_its_entry_changes(station: Station, screen: Screen) -> None:
    live, clamp, notice = station.live, station.live.machine.tags.sp.clamp, screen.find("[data-part=notice]")
    screen.page.evaluate(KEEP_NOTICES)
    before = live.runtime.plc.read(clamp)
    live.runtime.plc.write(clamp, before + 10)  # a machine constant that differs is a warning
    screen.open("alarms")
    minutes = screen.find("li[data-alarm='999'] input")
    minutes.fill("0")
    screen.find("li[data-alarm='999'] [data-action=shelve]").click()
    expect(notice).to_have_text("✕ Enter 1 to 480")
    minutes.fill("5")
    expect(notice).to_be_empty()
    live.runtime.plc.write(clamp, before)
    screen.press("[data-command=acknowledge_all]")
    expect(screen.find("li[data-alarm='999']")).to_have_count(0)


KEEP_NOTICES: Final = "() => { window.setTimeout = ((set) => (f, ms) => set(f, ms === 8000 ? 1e9 : ms))(setTimeout); }"
"""Script after which a refusal does not end by itself."""
PRESS_AGAIN: Final = """async () => {
  const { app, newPress, refuse } = await import("/static/app.js");
  const line = document.querySelector("[data-part=notice]");
  const [one, other] = [{}, {}];
  refuse("refused", one);
  const seen = [line.textContent];
  newPress(other);
  seen.push(line.textContent);
  newPress(one);
  seen.push(line.textContent);
  const executed = newPress(other);
  refuse("refused", other, () => false);
  await new Promise((next) => app.link.addEventListener("view", next, { once: true }));
  seen.push(line.textContent);
  app.notice("done", true, executed);
  return [...seen, line.textContent];
}"""
"""Script that refuses a press of a control, and then presses another control and the same one; refuses a press for a
reason that ends at once; and shows that the control has executed the press before.
"""
