"""States of the page for an operator who does not tell red from green, in the pictures that the browser draws."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import combinations
from typing import Any, Final, NamedTuple

import pytest
from playwright.sync_api import Page, expect

from controller.program.states import State
from tests.controller.hmi.panel.page.appearance.still_page import differing_points, picture, show, stand_still
from tests.controller.hmi.panel.page.screen import PAGES, maintained

pytestmark = pytest.mark.nightly

LEAST_POINTS: Final = 12
"""Least number of points in which two states differ: a stroke of a sign, more than a blurred edge."""
LOOKS: Final = [("grey", "deuteranopia"), ("day", "protanopia"), ("grey", "protanopia"), ("day", "deuteranopia")]
"""Theme of the page and colour vision of the operator."""
CUPS: Final = (1, 2, 3, 5, 6, 7)
"""Codes of the latest cups of a row."""

Changes = dict[str, dict[str, Any]]
Variants = dict[str, Changes]


def alarms(*states: int, kinds: tuple[str, ...] = ("safety", "stops", "warning")) -> Variants:
    """Return views with one alarm of each kind in each state; each kind stands for the number of an alarm."""
    row = {"first_out": False, "follows": None, "chattering": False, "standing": False, "came_ms": 0}
    return {
        f"{kind} {state}": {"alarms": {"rows": [row | {"state": state, "number": kind, "shelved_until_ms": None}]}}
        for kind in kinds
        for state in states
    }


def each_of(section: str, path: str, *values: object) -> Variants:
    """Return views with each of the values at a path."""
    return {str(value): {section: {path: value}} for value in values}


CASES: Final[dict[str, dict[str, Variants]]] = {
    "overview": {
        ".machine": each_of("machine", "state", int(State.STOPPED), int(State.EXECUTE), int(State.ABORTED)),
        ".banner": alarms(1, 2) | each_of("alarms", "rows", []),
        ".mimic .arm[data-tag='left.slide']": each_of("arms", "left/loaded", False, True),
        ".mimic .tray-row[data-row='left.1']": each_of("arms", "left/rows/1", 0, 1, 2, 3),
        ".mimic": each_of("tray", "phase", 0, 1, 2, 3, 4),
        ".mimic .flow": each_of("tray", "running", False, True),
        ".mimic .cups[data-tag='left.cups']": each_of("arms", "left/cup_count", 0, 7, 8),
        "[data-command=reset]": each_of("commands", "reset/free", False, True),
        ".modes": each_of("machine", "mode", 1, 2, 3),
        "[data-pace='50']": each_of("link", "pace_percent", 50, 100),
        "[data-box=emergency_stop]": each_of("telemetry", "box.emergency_stop", 0, 1),
        "[data-cups=left]": each_of("telemetry", "left.cups_3", *(code * 0x11111111 for code in CUPS)),
    },
    "alarms": {".alarm-row": alarms(1, 2)},
    "steps": {"[data-step=S20]": each_of("steps", "S20", 0, 1)},
    "io": {
        "tr[data-address=X0]": each_of("io", "X0", 0, 1) | {"forced": {"io": {"X0": 1}, "forced": {"": ["X0"]}}},
        "tr[data-address=Y0]": each_of("io", "Y0", 0, 1),
    },
    "manual": {
        ".jog:has([data-jog='left.slide_inward'])": {
            "off": {"io": {}},
            "on": {"io": {"left.slide_inward": 1}},
        },
        "[data-jog='left.slide_inward']": each_of("commands", "jog_left_slide_inward/free", False, True),
    },
    "recovery": {"[data-command=reset]": each_of("commands", "reset/free", False, True)},
    "cab": {
        ".mimic .arm[data-tag='left.slide']": each_of("arms", "left/loaded", False, True)
        | alarms(1, kinds=("left slide",)),
        ".mimic .tray-row[data-row='left.1']": each_of("arms", "left/rows/1", 0, 1, 2, 3),
        ".mimic .flow": each_of("tray", "running", False, True),
        ".figure:has([data-fact=missed])": each_of("arms", "left/missed_cups", 0, 8),
        "[data-cab=alarms]": each_of("alarms", "rows", []) | alarms(1, kinds=("stops",)),
        ".next-command [data-command=reset]": {
            free: {"machine": {"next_command": "reset", "isolate": False}, "commands": {"reset/free": free == "free"}}
            for free in ("blocked", "free")
        },
    },
    "trays": {
        "[data-fact=left_row_1]": each_of("arms", "left/rows/1", 0, 1, 2, 3),
        "[data-command=left_row_1_empty]": each_of("commands", "left_row_1_empty/free", False, True),
    },
    "parameters": {"[data-set-point=clamp]": each_of("set_points", "clamp", 20, 21)},
}
"""Views by page and element; each picture of the element must be told from each other one."""


class Station(NamedTuple):
    """Page of a maintainer that stands still."""

    page: Page
    numbers: dict[str, int | str]


def in_numbers(changes: Changes, station: Station) -> Changes:
    """Return changes with the number of an alarm, and the address of an output, in place of its name."""
    named: Changes = {section: dict(values) for section, values in changes.items()}
    if "io" in named:
        named["io"] = {str(station.numbers.get(path, path)): value for path, value in named["io"].items()}
    if "alarms" in named:
        alarm_rows = named["alarms"]["rows"]
        named["alarms"] = {"rows": [row | {"number": station.numbers[row["number"]]} for row in alarm_rows]}
    return named


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    with maintained(tmp_path_factory.mktemp("vision")) as (_, screen):
        expect(screen.find("[data-cups=left]")).to_be_visible()
        stand_still(screen.page)
        yield Station(screen.page, screen.page.evaluate(NUMBERS))


NUMBERS: Final = """async () => {
  const { app } = await import("/static/app.js");
  const first = (test) => app.describe.alarms.find(test).number;
  return { safety: first((one) => one.safety), stops: first((one) => one.stops_work && !one.safety),
    warning: first((one) => !one.stops_work && !one.safety), "left slide": first((one) => one.device === "left.slide"),
    ...Object.fromEntries(app.describe.points.map((point) => [point.tag, point.address])) };
}"""
"""Script that returns the number of an alarm of each priority and of a device, and the address of each tag."""


@contextmanager
def seen_with(page: Page, theme: str, vision: str) -> Iterator[None]:
    """Draw the page in a theme as an operator with a colour vision sees it; the browser simulates it."""
    page.locator("[data-action=theme]").select_option(theme)
    session = page.context.new_cdp_session(page)
    session.send("Emulation.setEmulatedVisionDeficiency", {"type": vision})
    yield
    session.send("Emulation.setEmulatedVisionDeficiency", {"type": "none"})
    session.detach()


def alike(pictures: dict[str, Any], of: str) -> list[str]:
    """Return the pairs of pictures that are not told from each other."""
    return [
        f"{of}: {one} and {other}, {points} points"
        for one, other in combinations(pictures, 2)
        if (points := differing_points(pictures[one], pictures[other])) < LEAST_POINTS
    ]


@pytest.mark.parametrize(
    ("name", "theme", "vision"),
    [
        pytest.param(name, *look, marks=() if (n - m) % len(LOOKS) == 0 else pytest.mark.nightly)
        for n, name in enumerate(CASES)
        for m, look in enumerate(LOOKS)
    ],
)
def test_states_are_told_from_each_other_without_red_and_green(
    station: Station, name: str, theme: str, vision: str
) -> None:
    """By their text or form, or by lightness: in enough points, the pictures have a contrast of 3 : 1."""
    page = station.page
    page.locator(f"[role=tab][data-page={name}]").click()
    same = []
    with seen_with(page, theme, vision):
        for selector, variants in CASES[name].items():
            pictures = {}
            for variant, changes in variants.items():
                show(page, in_numbers(changes, station))
                pictures[variant] = picture(page, selector)
            same += alike(pictures, selector)
    assert same == []


@pytest.mark.parametrize(
    ("theme", "vision"),
    [pytest.param(*look, marks=() if n == 1 else pytest.mark.nightly) for n, look in enumerate(LOOKS)],
)
@pytest.mark.parametrize("name", PAGES)
def test_the_open_page_and_outdated_values_are_seen_without_red_and_green(
    station: Station, name: str, theme: str, vision: str
) -> None:
    """On every page: its tab differs from itself while another page is open, and its frame while the link is lost."""
    page = station.page
    with seen_with(page, theme, vision):
        tab, other = f"[role=tab][data-page={name}]", "overview" if name != "overview" else "recovery"
        page.locator(f"[role=tab][data-page={other}]").click()
        closed = picture(page, tab)
        page.locator(tab).click()
        tabs = {"closed": closed, "open": picture(page, tab)}
        shown: dict[str, dict[str, Any]] = {"main": {}, ".link-lamp": {}}
        for link in ("live", "stale"):
            show(page, {}, link)
            for selector, pictures in shown.items():
                pictures[link] = picture(page, selector)
        show(page, {})
    assert alike(tabs, tab) + [line for selector, each in shown.items() for line in alike(each, selector)] == []
