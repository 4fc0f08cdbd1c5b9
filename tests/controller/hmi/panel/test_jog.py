"""Jogging from a browser: the output turns off however the jog ends."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest

from controller.core.clock import MonotonicClock
from controller.hmi.panel.orders.replies import REPLIES
from controller.program.operator.commands import JOG_LEASE_MS
from controller.program.states import Mode, State
from plant_sim.twin.lock_step import SCAN_MS, Twin
from tests.controller.hmi.panel.panel_rig import TIMEOUT_S, Browser, PanelRig
from tests.plant_sim.twin.twin_rig import ChangeRecorder, switched_on

OUTPUT = "left.lift_retract"
OTHER = "right.lift_retract"
LEASE_SCANS = JOG_LEASE_MS // SCAN_MS
SLACK_SCANS = 8
"""Allowance for a browser message, a Modbus write and a scan on a busy computer."""
PATIENCE = 10
"""Factor by which the panel's lease is lengthened for a busy computer, in tests of anything else."""


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[PanelRig]:
    with PanelRig(tmp_path, manual_twin()) as rig:
        yield rig


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lengthen the panel's lease."""
    monkeypatch.setattr("controller.hmi.panel.orders.jog.LEASE_MS", PATIENCE * JOG_LEASE_MS)


def manual_twin() -> Twin:
    """Return a machine in manual mode with both arms down, so that both may move up."""
    twin = switched_on(mode=Mode.MANUAL)
    twin.home()
    twin.start()
    return twin


def jog(browser: Browser, output: str = OUTPUT) -> dict[str, Any]:
    return browser.order(type="jog", output=output, hold=True)


def audits(rig: PanelRig) -> list[tuple[str, ...]]:
    return [row[1:] for row in rig.hmi.audits if row[2].startswith("jog")]


def coil(rig: PanelRig, output: str = OUTPUT) -> bool:
    return rig.hmi.coil(output)


@pytest.mark.usefixtures("patient")
def test_output_is_on_while_renewed_and_off_after_release(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        recorder = ChangeRecorder.of_outputs(rig.twin)
        for _ in range(6):
            assert jog(browser)["ok"] is True
            rig.for_scans(10)
        assert coil(rig)
        browser.until(lambda view: view["jog"]["output"] == OUTPUT)
        assert browser.order(type="jog", output=OUTPUT, hold=False)["ok"] is True
        rig.until(lambda: not coil(rig))
        browser.until(lambda view: view["jog"]["output"] is None)
        changes = recorder.of(OUTPUT)
    assert [change.on for change in changes] == [True, False]
    assert changes[1].at_ms - changes[0].at_ms >= 450  # longer than the controller's lease, so the jog was renewed
    assert audits(rig) == [
        ("maintain", "jog_left_lift_retract", "1", "done"),
        ("maintain", "jog_left_lift_retract", "0", "done"),  # by the release; a lease of the controller has "ended"
    ]


def test_missing_renewal_releases_the_output(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        recorder = ChangeRecorder.of_outputs(rig.twin)
        clock = MonotonicClock()
        ordered_ms = clock.now_ms()
        assert jog(browser)["ok"] is True
        rig.until(lambda: coil(rig))
        rig.until(lambda: not coil(rig), scans=200)
        held_ms = clock.now_ms() - ordered_ms
        browser.until(lambda view: view["jog"]["output"] is None)
    on, off = recorder.of(OUTPUT)
    assert off.at_ms - on.at_ms <= (LEASE_SCANS + SLACK_SCANS) * SCAN_MS
    # the panel counts by the clock, the controller by scans, fewer on a busy computer; the earlier one ends it
    assert held_ms >= JOG_LEASE_MS or off.at_ms - on.at_ms >= JOG_LEASE_MS


def test_late_message_does_not_start_a_jog(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        jog(browser)
        rig.until(lambda: coil(rig))
        browser.until(lambda view: view["jog"]["output"] == OUTPUT)
        browser.until(lambda view: view["jog"]["output"] is None)
        assert jog(browser)["text"]["en"] == REPLIES["jog late"].en
        rig.for_scans(20)
        assert not coil(rig)
        browser.order(type="jog", output=OUTPUT, hold=False)
        assert jog(browser)["ok"] is True
        rig.until(lambda: coil(rig))


@pytest.mark.usefixtures("patient")
def test_closed_socket_releases_the_output_at_once(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        jog(browser)
        rig.until(lambda: coil(rig))
    rig.until(lambda: not coil(rig))
    rig.until(lambda: len(audits(rig)) == 2)  # a lease of the controller would be recorded as "ended"
    assert audits(rig)[-1] == ("maintain", "jog_left_lift_retract", "0", "done")


@pytest.mark.usefixtures("patient")
def test_thirty_silent_connections_do_not_take_jogging_from_the_operator(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser, ExitStack() as stack:
        for _ in range(30):
            stack.enter_context(socket.create_connection(("127.0.0.1", rig.port), TIMEOUT_S))
        for _ in range(5):
            assert jog(browser)["ok"] is True
            rig.until(lambda: coil(rig))
        rig.until(lambda: bool(audits(rig)))  # written after the answer to the write, which may follow the coil
        rig.for_scans(SLACK_SCANS)
        assert [row[2] for row in audits(rig)].count("1") == 1, "one jog"


class Relay:
    """Connection to the panel through a relay that can lose all data of one direction."""

    def __init__(self, rig: PanelRig, stack: ExitStack) -> None:
        host, _, port = rig.host.rpartition(":")
        self.client, inner = socket.socketpair()
        outer = socket.create_connection((host, int(port)), TIMEOUT_S)
        self.lost = ""
        for direction, source, sink in (("to the panel", inner, outer), ("from the panel", outer, inner)):
            thread = threading.Thread(target=self._pass, args=(direction, source, sink))
            thread.start()
            stack.callback(thread.join)
        for end in (inner, outer):
            stack.callback(end.close)
            stack.callback(end.shutdown, socket.SHUT_RDWR)

    def _pass(self, direction: str, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(4_096):
                if self.lost != direction:
                    sink.sendall(data)


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize(
    ("lost", "lease_scans"), [("to the panel", LEASE_SCANS), ("from the panel", PATIENCE * LEASE_SCANS)]
)
def test_a_jog_ends_if_one_direction_of_its_connection_is_lost(rig: PanelRig, lost: str, lease_scans: int) -> None:
    """The lease of the controller ends it if the panel receives nothing, that of the panel if the browser does not."""
    with ExitStack() as stack:
        rig.log_in("maintain")
        relay = Relay(rig, stack)
        browser = Browser(stack.enter_context(rig.socket(sock=relay.client)))
        browser.until(lambda view: bool(view["link"]["controller"]))
        for _ in range(10):
            assert browser.order(type="jog", output=OUTPUT, hold=True, seen=browser.view_number)["ok"]
            rig.until(lambda: coil(rig))
        relay.lost = lost
        lost_scan = seen_scan = rig.twin.plc.scans
        while coil(rig) and seen_scan - lost_scan <= lease_scans + SLACK_SCANS:
            browser.send(type="jog", output=OUTPUT, hold=True, seen=browser.view_number)
            rig.for_scans(5)
            seen_scan = rig.twin.plc.scans
        assert not coil(rig)
        rig.for_scans(20)
        assert not coil(rig)


def test_a_jog_that_the_controller_ends_tells_why(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        modbus = rig.hmi.server.modbus
        assert modbus is not None
        frontend = modbus._frontend
        frontend.is_closed = True
        refused = next(reply for _ in range(100) if not (reply := jog(browser))["ok"])
        assert refused["text"] == {"en": REPLIES["jog closed"].en, "zh": REPLIES["jog closed"].zh}
        frontend.is_closed = False
        browser.order(type="jog", output=OUTPUT, hold=False)
        assert jog(browser)["ok"] is True
        rig.until(lambda: coil(rig))


@pytest.mark.usefixtures("patient")
def test_one_jog_at_a_time_across_all_browsers(rig: PanelRig) -> None:
    with rig.browser("maintain") as first, rig.browser() as second:
        assert jog(first)["ok"] is True
        reply = jog(second, OTHER)
        assert (reply["ok"], reply["text"]["en"]) == (False, "another operator is jogging an output")
        second.order(type="jog", output=OTHER, hold=False)  # does not release the jog of the first browser
        assert jog(first)["ok"] is True
        rig.until(lambda: coil(rig))
        assert not coil(rig, OTHER)
        first.order(type="jog", output=OUTPUT, hold=False)
        for _ in range(3):  # the release and the next press may occur in the same scan
            assert jog(second, OTHER)["ok"] is True
            rig.for_scans(10)
        assert coil(rig, OTHER)


def test_another_output_requires_release_and_press(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        jog(browser)
        assert jog(browser, OTHER)["text"]["en"] == "release the button and press it again"
        rig.until(lambda: not coil(rig))
        assert not coil(rig, OTHER)


def test_unknown_output_is_refused(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        assert jog(browser, "left.nothing")["text"]["en"] == "output 'left.nothing' cannot be jogged"


@pytest.mark.usefixtures("patient")
def test_jog_ends_when_manual_operation_stops(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        jog(browser)
        rig.until(lambda: coil(rig))
        assert browser.order(type="command", command="stop")["ok"] is True
        rig.until(lambda: not coil(rig), scans=20)
        browser.until(lambda view: view["machine"]["state"] == State.STOPPED)
        assert jog(browser)["text"]["en"] == "cannot jog: manual mode is not started"
        rig.for_scans(10)
        assert not coil(rig)


@pytest.mark.usefixtures("patient")
def test_logout_ends_a_jog(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        jog(browser)
        rig.until(lambda: coil(rig))
        assert rig.here.post("/api/logout").status_code == 200
        assert jog(browser)["text"]["en"] == "Maintenance login required"
        assert rig.until(lambda: not coil(rig), scans=60) <= LEASE_SCANS + SLACK_SCANS


@pytest.mark.usefixtures("patient")
def test_lost_controller_ends_a_jog_permanently(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        jog(browser)
        rig.until(lambda: coil(rig))
        browser.until(lambda view: view["jog"]["output"] == OUTPUT)
        rig.stop_server()
        rig.until(lambda: not coil(rig), scans=60)
        browser.until(lambda view: view["jog"]["output"] is None)
        assert jog(browser)["ok"] is False
        rig.restart_server()
        browser.until(lambda view: bool(view["link"]["controller"]))
        assert jog(browser)["ok"] is False
        rig.for_scans(10)
        assert not coil(rig)
