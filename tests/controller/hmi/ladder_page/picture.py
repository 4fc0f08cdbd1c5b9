"""Picture of the ladder page for the documentation; writes docs/pictures/ladder-page.png.

Run: python -m tests.controller.hmi.ladder_page.picture
"""

from __future__ import annotations

from controller.cli.ladder.page_server import program_of_machine
from controller.core.clock import MonotonicClock
from controller.hmi.ladder_page.live_source import LiveSource
from controller.hmi.modbus.connection import ModbusConnection
from plant_sim.twin.lock_step import Twin
from tests.controller.common.modbus_rig import PATIENT_S
from tests.controller.hmi.hmi_rig import HmiRig
from tests.controller.hmi.ladder_page.page_rig import WebRig
from tests.controller.hmi.panel.page.screen import chromium
from tests.paths import DOCS

DEVICE = "Y2"
WORK_MS = 9_000


def main() -> None:
    twin = Twin(seed=1, trays=1)
    with HmiRig(twin) as rig:
        rig.scans_for_writes = False
        twin.home()
        twin.start()
        twin.run_for(WORK_MS)
        program, work = program_of_machine(twin.machine)
        connection = ModbusConnection("127.0.0.1", rig.server.port, timeout_s=PATIENT_S)
        with WebRig(LiveSource(program, connection, MonotonicClock(), work)) as web, chromium() as browser:
            page = browser.new_page(viewport={"width": 1366, "height": 768})
            page.goto(web.origin)
            page.locator("body[data-link=live]").wait_for()
            page.locator("#freeze").click()
            page.locator("body[data-link=frozen]").wait_for()
            page.locator("[data-view=executed]").click()
            page.locator("[data-tab=outputs]").click()
            page.locator(f"li[data-device={DEVICE}] button").click()
            page.locator("section[data-here] g.symbol").first.wait_for()
            page.locator("[data-uses]").first.wait_for()
            page.locator("body[data-shown^=executed]").wait_for()
            page.screenshot(path=DOCS / "pictures" / "ladder-page.png")


if __name__ == "__main__":
    main()
