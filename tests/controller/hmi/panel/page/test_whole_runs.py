"""Whole runs operated in a browser: the page shows the counts of the plant."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from controller.io.pace import FLAT_OUT
from controller.program.states import State
from controller.program.texts.operator import STATES
from plant_sim.crop.seedling import Location
from tests.controller.hmi.panel.page.panel_page_rig import LiveMachine, PanelProcess
from tests.controller.hmi.panel.page.screen import TIMEOUT_MS, Screen, expect_state


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
