"""History page in a browser: selection, pages, and what happened around an alarm."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, count
from pathlib import Path
from typing import Final

import pytest
from playwright.sync_api import Browser, expect

from controller.core.clock import utc_ms
from controller.events.alarm_list import AlarmChange
from controller.events.alarm_states import AlarmState
from controller.events.kinds import CycleEvent, RefusalEvent, StateEvent, TrayEvent
from controller.history.writer import HistoryWriter
from controller.program.states import State
from controller.program.texts.operator import Text
from tests.controller.hmi.panel.page.panel_page_rig import LiveMachine, PanelProcess
from tests.controller.hmi.panel.page.screen import Screen
from tests.sampling import first_of

MINUTE_MS: Final = 60_000
TRAYS: Final = 50
"""Trays, one a minute, of which the last is 30 min before the alarm."""


def record(path: Path) -> None:
    """Write trays, and half an hour later a state, a cycle, an alarm and a refusal within two minutes."""
    alarm_ms = utc_ms() - 200 * MINUTE_MS
    first_ms = alarm_ms - (30 + TRAYS) * MINUTE_MS
    times = chain(
        range(first_ms, first_ms + (TRAYS + 1) * MINUTE_MS, MINUTE_MS), count(alarm_ms - MINUTE_MS, MINUTE_MS // 2)
    )
    history = HistoryWriter(path, wall_ms=lambda: next(times), program="transplanter", version="0")
    for n in range(TRAYS):
        history.write(TrayEvent(0, n + 1))
    history.write(StateEvent(0, State.EXECUTE, Text.plain("Execute")))
    history.write(CycleEvent(0, "left", 3, 5_200, 300, 0))
    history.write(
        AlarmChange(0, 900, "estop", AlarmState.NORMAL, AlarmState.UNACKNOWLEDGED, None, Text.plain("recorded text"))
    )
    history.write(RefusalEvent(0, "hold", 3, Text.plain("cannot hold")))
    history.close()


@pytest.fixture(scope="module")
def panel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelProcess]:
    folder = tmp_path_factory.mktemp("history")
    own = folder / "panel"
    own.mkdir()
    record(own / "history.sqlite")
    with LiveMachine(folder) as live, PanelProcess(live, own) as process:
        yield process


@pytest.fixture(params=first_of([False, True]), ids=["desk", "cab"])
def screen(request: pytest.FixtureRequest, panel: PanelProcess, browser: Browser) -> Iterator[Screen]:
    with Screen(browser, panel.url, touch=request.param) as opened:
        opened.open("history")
        yield opened


def test_records_are_chosen_and_turned_page_by_page(screen: Screen) -> None:
    rows = screen.find("[data-table=history] tbody tr")
    older, newer = screen.find("[data-action=older]"), screen.find("[data-action=newer]")
    expect(rows).to_have_count(20)
    expect(newer).to_be_disabled()
    expect(rows.nth(0)).to_contain_text("Hold (")
    expect(rows.nth(1)).to_contain_text(
        "S900 Emergency stop pressed (normal → unacknowledged, machine)", ignore_case=True
    )
    expect(rows.nth(2)).to_contain_text("left, row 3: 5.2 s, waiting for cups 0.3 s")
    expect(rows.nth(3)).to_contain_text("Execute")
    older.click()
    expect(rows.nth(0)).to_contain_text(f"{TRAYS - 16}")
    expect(rows).to_have_count(20)
    older.click()
    expect(rows).to_have_count(14)
    expect(older).to_be_disabled()
    newer.click()
    expect(rows).to_have_count(20)
    screen.find("[data-filter='history.kind']").select_option("cycle")
    expect(rows).to_have_count(1)
    expect(newer).to_be_disabled()
    screen.find("[data-filter='history.kind']").select_option("")
    screen.find("[data-filter=number]").fill("S900")
    screen.find("[data-filter=number]").blur()
    expect(rows).to_have_count(1)
    screen.find("[data-filter=number]").fill("")
    screen.find("[data-filter=text]").fill("no such text")
    screen.find("[data-filter=text]").blur()
    expect(rows).to_have_count(0)
    expect(screen.find("main [role=status]")).to_have_text("No records")
    screen.find("[data-filter=text]").fill("")
    screen.find("[data-filter=text]").blur()
    screen.find("[data-filter='trends.span']").select_option("60")
    expect(rows).to_have_count(0)
    screen.find("[data-filter='trends.span']").select_option("720")
    expect(rows).to_have_count(20)


def test_an_alarm_leads_to_what_happened_around_it(screen: Screen) -> None:
    screen.open("alarms")
    journal = screen.find("[data-section='alarms.journal']")
    if journal.is_visible():
        journal.click()
    screen.find("[data-table=journal] [data-action=around]").first.click()
    expect(screen.find("main[data-page=history]")).to_be_visible()
    rows = screen.find("[data-table=history] tbody tr")
    expect(rows).to_have_count(4)
    expect(rows.nth(1)).to_have_attribute("data-alarm", "900")
    expect(screen.find("[data-action=older]")).to_be_disabled()
    screen.find("[data-filter='trends.span']").select_option("")
    expect(rows).to_have_count(20)
