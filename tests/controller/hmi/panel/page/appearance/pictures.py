"""Pictures of the panel in the documentation, taken in a browser at a simulated machine in a trial.

Run `python -m tests.controller.hmi.panel.page.appearance.pictures --out docs/pictures` to take them again; it also
writes the checksum of the sources, texts and scenes that they show. Whether the pictures are up to date is told by the
checksum, because the points of a picture depend on the browser and the clock.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from playwright.sync_api import Browser, expect

from controller.hmi.panel.view.describe import describe
from controller.hmi.panel.web.app import STATIC
from controller.program.machine import build
from controller.program.states import State
from controller.program.texts.next_press import NEXT_PRESSES
from plant_sim.faults.fault import parse_fault
from tests.controller.common.modbus_rig import IO_MAP
from tests.controller.hmi.panel.page.panel_page_rig import LiveMachine, PanelProcess
from tests.controller.hmi.panel.page.screen import Screen, chromium
from tests.paths import ROOT

COMMAND: Final = ".venv/bin/python -m tests.controller.hmi.panel.page.appearance.pictures --out docs/pictures"
FOLDER: Final = ROOT / "docs" / "pictures"
CHECKSUM: Final = "panel.sha256"
FOREIGN: Final = STATIC / "foreign"
WORK_MS: Final = 42_000
"""Time of the trial at which the pictures are taken, after the start."""


class Scene(NamedTuple):
    """Picture of a page.

    Attributes:
        name: Name of the file, without its ending.
        situation: running, held, jam or emergency stop.
        page: Name of the page.
        section: Section of the page that a small screen shows; None = the first one.
        language: Language of the page.
        theme: Theme of the page.
        size: Width and height of the screen, px.
    """

    name: str
    situation: str
    page: str
    section: str | None = None
    language: str = "en"
    theme: str = "grey"
    size: tuple[int, int] = (800, 480)


SCENES: Final = (
    Scene("panel-cab", "running", "cab"),
    Scene("panel-overview", "running", "overview", size=(1366, 768)),
    Scene("panel-jam-night", "jam", "cab", theme="night"),
    Scene("panel-alarm", "jam", "alarms", language="zh"),
    Scene("panel-isolation", "jam", "recovery", section="isolate.steps"),
    Scene("panel-emergency-stop", "emergency stop", "cab", theme="day"),
)
"""Pictures of the documentation."""


def checksum() -> str:
    """Return the checksum of what the pictures show: sources of the page, texts and names of the machine, scenes."""
    total = hashlib.sha256(Path(__file__).read_bytes() + (ROOT / "scripts" / "foreign_files.py").read_bytes())
    for path in sorted(path for path in STATIC.rglob("*") if path.is_file() and FOREIGN not in path.parents):
        total.update(path.relative_to(STATIC).as_posix().encode() + path.read_bytes())
    machine = build(IO_MAP)
    total.update(json.dumps(describe(machine, None, None), sort_keys=True).encode())
    total.update(repr(sorted(NEXT_PRESSES.items())).encode())
    return total.hexdigest()


@contextmanager
def machine_in(situation: str, folder: Path, browser: Browser) -> Iterator[Screen]:
    """Yield the page of an operator at a machine in a situation."""
    with (
        LiveMachine(folder, trays=3) as live,
        PanelProcess(live, folder, patient=True) as panel,
        Screen(browser, panel.url, "operate") as screen,
    ):
        live.until_state(State.STOPPED)
        live.fast()
        screen.press("[data-command=reset]")
        live.until_state(State.IDLE)
        screen.press("[data-command=start]")
        live.until_state(State.EXECUTE)
        began_ms = live.now_ms
        live.until(lambda: live.now_ms >= began_ms + WORK_MS, "work")
        live.pace.set(100)
        match situation:
            case "held":
                screen.press("[data-command=hold]")
                live.until_state(State.HELD)
            case "jam":
                plant = live.plant.server.module.plant
                live.plant.call(lambda: plant.faults.add(parse_fault("jammed:left.lift")))
                live.until(lambda: live.state in (State.HELD, State.ABORTED), "stopped by the jam")
            case "emergency stop":
                screen.press("[data-box=emergency_stop]")
                live.until_state(State.ABORTED)
        yield screen
        screen.unexpected.clear()  # sockets of the pages that were reloaded


def take(screen: Screen, scene: Scene, path: Path) -> None:
    """Take the picture of a scene."""
    page = screen.page
    page.set_viewport_size({"width": scene.size[0], "height": scene.size[1]})
    page.evaluate(
        """([language, theme]) => {
          localStorage.setItem("panel-language", language);
          localStorage.setItem("panel-theme", theme);
        }""",
        [scene.language, scene.theme],
    )
    page.goto(f"{page.url.partition('#')[0]}#{scene.page}")
    page.reload()
    expect(screen.find(f"main[data-page={scene.page}]")).to_be_visible()
    expect(screen.find("body")).to_have_attribute("data-link", "live")
    if scene.section is not None:
        screen.find(f"[data-section='{scene.section}']").click()
    page.wait_for_function("() => document.fonts.status === 'loaded'")
    page.screenshot(path=path, animations="disabled", caret="hide")


def write(folder: Path, scenes: tuple[Scene, ...] = SCENES) -> None:
    """Take the pictures of scenes and write them to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    with chromium() as browser:
        for situation in dict.fromkeys(scene.situation for scene in scenes):
            with tempfile.TemporaryDirectory() as place, machine_in(situation, Path(place), browser) as screen:
                for scene in scenes:
                    if scene.situation == situation:
                        take(screen, scene, folder / f"{scene.name}.png")


def main() -> None:
    """Take the pictures of the documentation, or with --all every page of the cab in every situation."""
    parser = argparse.ArgumentParser(prog="pictures", description="Take the pictures of the panel.")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--all", action="store_true", help="every situation, size, language and theme instead")
    options = parser.parse_args()
    write(options.out, tuple(every_scene()) if options.all else SCENES)
    if not options.all:
        (options.out / CHECKSUM).write_text(f"{checksum()}\n", encoding="utf-8")


def every_scene() -> Iterator[Scene]:
    """Yield the cab page, and the page for the situation, in every situation, size, language and theme."""
    pages = {"running": "overview", "held": "recovery", "jam": "alarms", "emergency stop": "recovery"}
    for situation, other in pages.items():
        for page in ("cab", other):
            for size in ((800, 480), (1024, 768), (1366, 768)):
                for language in ("en", "zh"):
                    for theme in ("day", "night"):
                        name = f"{situation.replace(' ', '-')}-{page}-{size[0]}-{language}-{theme}"
                        yield Scene(name, situation, page, None, language, theme, size)


if __name__ == "__main__":
    main()
