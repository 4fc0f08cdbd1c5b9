"""Holding an output by hand from a browser: it is let go whatever ends the hand."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from panel_rig import Browser, PanelRig
from twin_rig import Recorder, switched_on

from controller.program.states import Mode, State
from plant_sim.bench.twin import Twin

OUTPUT = "left.lift_retract"
OTHER = "right.lift_retract"
LEASE_SCANS = 30
SLACK_SCANS = 8
"""A browser's message, a Modbus write and a scan; the computer may be busy."""


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[PanelRig]:
    with PanelRig(tmp_path, by_hand()) as rig:
        yield rig


def by_hand() -> Twin:
    """A machine that is moved by hand, its arms down: both may go up."""
    twin = switched_on(mode=Mode.MANUAL)
    twin.home()
    twin.start()
    return twin


def hold(browser: Browser, output: str = OUTPUT) -> dict[str, Any]:
    return browser.order(type="jog", output=output, hold=True)


def audits(rig: PanelRig) -> list[tuple[str, ...]]:
    return [row[1:] for row in rig.hmi.audits if row[2].startswith("jog")]


def coil(rig: PanelRig, output: str = OUTPUT) -> bool:
    return rig.hmi.coil(output)


def test_an_output_is_on_while_it_is_renewed_and_off_with_the_release(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        recorder = Recorder.of_outputs(rig.twin)
        for _ in range(6):
            assert hold(browser)["ok"] is True
            rig.for_scans(10)
        assert coil(rig)
        browser.until(lambda view: view["jog"]["output"] == OUTPUT)
        assert browser.order(type="jog", output=OUTPUT, hold=False)["ok"] is True
        assert rig.until(lambda: not coil(rig), scans=60) <= SLACK_SCANS
        browser.until(lambda view: view["jog"]["output"] is None)
        changes = recorder.of(OUTPUT)
    assert [change.on for change in changes] == [True, False]
    assert changes[1].at_ms - changes[0].at_ms >= 450  # longer than one lease: it was renewed
    assert audits(rig) == [
        ("maintain", "jog_left_lift_retract", "1", "done"), ("maintain", "jog_left_lift_retract", "0", "done"),
    ]  # fmt: skip


def test_silence_lets_go(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        assert hold(browser)["ok"] is True
        rig.until(lambda: coil(rig))
        scans = rig.until(lambda: not coil(rig), scans=200)
        assert LEASE_SCANS // 2 <= scans <= LEASE_SCANS + SLACK_SCANS
        browser.until(lambda view: view["jog"]["output"] is None)


def test_a_late_telegram_starts_nothing(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        hold(browser)
        rig.until(lambda: coil(rig))
        browser.until(lambda view: view["jog"]["output"] == OUTPUT)
        browser.until(lambda view: view["jog"]["output"] is None)
        assert hold(browser)["text"]["en"] == "let go of the button and press again"
        rig.for_scans(20)
        assert not coil(rig)
        browser.order(type="jog", output=OUTPUT, hold=False)
        assert hold(browser)["ok"] is True
        rig.until(lambda: coil(rig))


def test_the_loss_of_the_socket_lets_go_at_once(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        hold(browser)
        rig.until(lambda: coil(rig))
    assert rig.until(lambda: not coil(rig), scans=60) <= SLACK_SCANS
    rig.until(lambda: len(audits(rig)) == 2)
    assert audits(rig)[-1] == ("maintain", "jog_left_lift_retract", "0", "done")


def test_one_jog_at_a_time_over_all_browsers(rig: PanelRig) -> None:
    with rig.browser("maintain") as first, rig.browser() as second:
        assert hold(first)["ok"] is True
        reply = hold(second, OTHER)
        assert (reply["ok"], reply["text"]["en"]) == (False, "somebody else holds an output by hand")
        second.order(type="jog", output=OTHER, hold=False)  # lets go nothing of the other
        assert hold(first)["ok"] is True
        rig.until(lambda: coil(rig))
        assert not coil(rig, OTHER)
        first.order(type="jog", output=OUTPUT, hold=False)
        for _ in range(3):  # the release of the one and the press of the other may meet in one scan
            assert hold(second, OTHER)["ok"] is True
            rig.for_scans(10)
        assert coil(rig, OTHER)


def test_another_output_needs_another_press(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        hold(browser)
        assert hold(browser, OTHER)["text"]["en"] == "let go of the button and press again"
        rig.until(lambda: not coil(rig))
        assert not coil(rig, OTHER)


def test_no_such_output(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        assert hold(browser, "left.nothing")["text"]["en"] == "no output 'left.nothing' is held by hand"


def test_a_jog_ends_with_manual_work(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        hold(browser)
        rig.until(lambda: coil(rig))
        assert browser.order(type="command", command="stop")["ok"] is True
        rig.until(lambda: not coil(rig), scans=20)
        browser.until(lambda view: view["machine"]["state"] == State.STOPPED)
        assert hold(browser)["text"]["en"] == "cannot move by hand: manual mode has not been started"
        rig.for_scans(10)
        assert not coil(rig)


def test_logging_out_ends_a_jog(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        hold(browser)
        rig.until(lambda: coil(rig))
        assert rig.here.post("/api/logout").status_code == 200
        assert hold(browser)["text"]["en"] == "log in as maintain for this"
        assert rig.until(lambda: not coil(rig), scans=60) <= LEASE_SCANS + SLACK_SCANS


def test_the_loss_of_the_controller_ends_a_jog_for_good(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        hold(browser)
        rig.until(lambda: coil(rig))
        browser.until(lambda view: view["jog"]["output"] == OUTPUT)
        rig.silence()
        rig.until(lambda: not coil(rig), scans=60)
        browser.until(lambda view: view["jog"]["output"] is None)
        assert hold(browser)["ok"] is False
        rig.answer_again()
        browser.until(lambda view: bool(view["link"]["controller"]))
        assert hold(browser)["ok"] is False
        rig.for_scans(10)
        assert not coil(rig)
