"""Browser, machines and pages of the tests in this folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import cache
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.controller.hmi.panel.page.panel_page_rig import LiveMachine, PanelProcess
from tests.controller.hmi.panel.page.screen import Screen, Station, chromium, started


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


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Yield a machine in the Stopped state; each test must leave it Stopped, in continuous mode and without alarms."""
    with started(tmp_path_factory.mktemp("stopped")) as station:
        yield station


@pytest.fixture(scope="module")
def screen_of(stopped: Station, browser: Browser) -> Iterator[Callable[[str], Screen]]:
    """Yield a function that returns the page of a user at the stopped machine, opened at the first call.

    The tests share the pages; each test must leave them without a dialog and in English.
    """
    with ExitStack() as stack:
        yield cache(lambda user: stack.enter_context(Screen(browser, stopped.panel.url, user)))


@pytest.fixture(params=["operate"])
def screen(request: pytest.FixtureRequest, screen_of: Callable[[str], Screen]) -> Iterator[Screen]:
    """Yield the page of a user, by default the operator, at the overview."""
    shared = screen_of(request.param)
    shared.open("overview")
    yield shared
    unexpected, shared.unexpected[:] = [*shared.unexpected], []
    assert unexpected == []
