"""Names of the program: no text of an operator contains one, in the tables and on the pages."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

import pytest
from playwright.sync_api import Browser, expect

from controller.history.query import HistoryReader
from controller.hmi.panel.view.describe import describe
from controller.io.pace import PAUSED
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.states import State
from controller.program.tags import SIDES
from controller.program.texts.operator import LANGUAGES, STATES, Language, Text
from plant_sim.faults import parse_fault
from plant_sim.twin.commissioning import program_of
from tests.controller.hmi.panel.page.panel_page_rig import LiveMachine, PanelProcess
from tests.controller.hmi.panel.page.screen import PAGES, Screen, chromium
from tests.controller.hmi.panel.text_tables import declared_values

MACHINE = program_of(load_io_map(DEFAULT_IO_MAP))
COMPOUND: Final = r"[A-Za-z][A-Za-z0-9]*(?:[_.][A-Za-z0-9]+)*[_.][A-Za-z][A-Za-z0-9]*"
"""Names in snake case, and names with dots."""
DEVICE: Final = r"(?:[Cc]oils?|[Oo]utputs?|[Ss]witch(?:es)?|[Ss]ensors?|[Ss]et-points?|输出|线圈|开关|传感器|设定值) ?"
"""Words that precede the name of a device."""
ENGINEERS_CELLS: Final = {"io": ".tag"}
"""Elements of a page that show names of the program: the tags of the I/O page, with which engineers look up wires."""


@cache
def program_name() -> re.Pattern[str]:
    """Return the pattern of a name of the program; a single word is one only after the word for a device."""
    points = (*MACHINE.io_map.inputs, *MACHINE.io_map.outputs, *MACHINE.io_map.unwired)
    tags = {point.tag.rpartition(".")[2] for point in points}
    single = "|".join(sorted(re.escape(name) for name in tags | set(MACHINE.tags.sp.names())))
    return re.compile(rf"{DEVICE}(?:{single})\b|{COMPOUND}")


def names_in(text: str) -> list[str]:
    return program_name().findall(re.sub(r"\{[^}]*\}", "", text))


def texts_of(value: Any) -> Iterator[Text]:
    """Yield the texts in a value, down into tables and records."""
    if isinstance(value, Text):
        yield value
    elif isinstance(value, dict):
        for entry in value.values():
            yield from texts_of(entry)
    elif isinstance(value, tuple | list):
        for entry in value:
            yield from texts_of(entry)


def test_no_text_of_a_table_contains_a_name_of_the_program() -> None:
    found = {text: place for place, value in declared_values() for text in texts_of(value)}
    assert len(found) > 700
    assert [(place, text) for text, place in found.items() if names_in(text.en) or names_in(text.zh)] == []


def test_no_text_of_the_description_contains_a_name_of_the_program() -> None:
    """The texts that the program makes from its parts: conditions of the step charts, points, jogs, alarms."""

    def shown(value: Any) -> Iterator[str]:
        if isinstance(value, dict) and set(value) == set(LANGUAGES):
            yield from value.values()
        elif isinstance(value, dict | list):
            for entry in value.values() if isinstance(value, dict) else value:
                yield from shown(entry)

    texts = list(shown(describe(MACHINE, None)))
    assert len(texts) > 1_500
    assert [text for text in texts if names_in(text)] == []


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("Coil lift_retract on?", ["Coil lift_retract"]),
        ("left.slide at feed", ["left.slide"]),
        ("Output spread on?", ["Output spread"]),
        ("输出 converge 是否得电", ["输出 converge"]),
        ("Claws spread. Arm down at 0.5 mm, {for_ms} ms, X0", []),
    ],
)
def test_names_of_the_program_are_recognised(text: str, names: list[str]) -> None:
    assert names_in(text) == names


# --- pages ----------------------------------------------------------------------------------------

SHOWN: Final = """(left_out) => {
  const texts = [document.title];
  const walker = document.createTreeWalker(document.getElementById("panel"), NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    if (left_out === null || !walker.currentNode.parentElement.closest(left_out)) texts.push(walker.currentNode.data);
  }
  for (const node of document.querySelectorAll("#panel *")) {
    for (const name of ["aria-label", "title", "placeholder"]) texts.push(node.getAttribute(name) ?? "");
  }
  return texts.filter((text) => text.trim());
}"""
"""Script that returns all texts of the page, except those within the given elements."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as process:
        yield process


def run_and_pause(live: LiveMachine, screen: Screen, history: HistoryReader) -> None:
    """Start the machine and pause the time in Execute, with a cycle of each arm in the history."""
    live.fast()
    screen.press("[data-command=reset]")
    live.until_state(State.IDLE)
    screen.press("[data-command=start]")
    live.until_state(State.EXECUTE)
    live.until(lambda: all((history.last_cycle(side) or {}).get("edges") for side in SIDES), "a cycle of each arm")
    live.pace.set(PAUSED)
    assert live.state is State.EXECUTE


def jam_and_pause(live: LiveMachine, _: Screen, history: HistoryReader) -> None:
    """Jam the lift of the left arm, and pause the time in Held with the alarm in the history."""
    faults = live.plant.server.module.plant.faults
    live.plant.call(lambda: faults.add(parse_fault("jammed:left.lift")))
    live.fast()
    live.until_state(State.HELD)
    live.until(lambda: bool(history.alarms(1, None)), "the alarm in the history")
    live.pace.set(PAUSED)


def stop_and_pause(live: LiveMachine, screen: Screen, _: HistoryReader) -> None:
    """Press the emergency stop, and pause the time in Aborted."""
    screen.press("[data-box=emergency_stop]")
    live.fast()
    live.until_state(State.ABORTED)
    live.pace.set(PAUSED)


def look_at_all_pages(screen: Screen, state: State, language: Language) -> None:
    """Open every page in a language and compare its texts with the names of the program."""
    screen.find("[data-action=language]").select_option(language)
    expect(screen.find("header [data-fact=state]")).to_contain_text(getattr(STATES[state], language))
    for page in PAGES:
        screen.open(page)
        if page == "alarms" and state is not State.EXECUTE:
            expect(screen.find("[data-table=journal] tbody tr").first).to_be_visible()
        if page == "cycle":
            expect(screen.find("[data-timing=left] .row-label").first).to_be_visible()
        shown = screen.page.evaluate(SHOWN, ENGINEERS_CELLS.get(page))
        assert len(shown) > 30, page
        assert [text for text in shown if names_in(text)] == [], (state.name, language, page)
    screen.open("overview")


@pytest.mark.nightly
def test_no_page_shows_a_name_of_the_program(browser: Browser, tmp_path: Path) -> None:
    """Running, held with an alarm, and in emergency stop, in both languages, with the keys of a maintainer."""
    with (
        LiveMachine(tmp_path) as live,
        PanelProcess(live, tmp_path) as panel,
        Screen(browser, panel.url, "maintain") as screen,
    ):
        for begin in (run_and_pause, jam_and_pause, stop_and_pause):
            begin(live, screen, HistoryReader(tmp_path / "history.sqlite"))
            for language in LANGUAGES:
                look_at_all_pages(screen, live.state, language)
            screen.find("[data-action=language]").select_option("en")
        live.fast()
