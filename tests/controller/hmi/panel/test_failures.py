"""Unexpected exceptions in the tasks of the panel: outputs are released, the work goes on, and counts have risen."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Never

import pytest
from prometheus_client.parser import text_string_to_metric_families
from websockets.exceptions import ConnectionClosedError

from controller.common.supervision.failures import drop, failures
from controller.history.query import HistoryReader
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.panel.modbus.mirror import Mirror
from controller.hmi.panel.modbus.telemetry import Telemetry, TelemetryTag
from controller.hmi.panel.orders.operator import OrderHandler
from controller.hmi.panel.view.state import ViewBuilder
from controller.hmi.panel.view.trends import Trends
from controller.hmi.panel.web import app, sockets
from controller.program.operator.commands import JOG_LEASE_MS
from controller.program.states import Mode, State
from tests.controller.common.supervision.failure_rig import DefectError, FailsOnce, drawn, fresh_counts, patch
from tests.controller.hmi.panel.panel_rig import Browser, PanelRig
from tests.controller.hmi.panel.test_jog import OUTPUT, coil, jog, manual_twin
from tests.plant_sim.twin.twin_rig import ChangeRecorder, switched_on

JOGS = 12


@pytest.fixture(autouse=True)
def _counts(monkeypatch: pytest.MonkeyPatch) -> None:
    fresh_counts(monkeypatch)
    monkeypatch.setattr("controller.hmi.panel.orders.jog.LEASE_MS", 10 * JOG_LEASE_MS)  # for a busy computer


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[PanelRig]:
    with PanelRig(tmp_path, manual_twin()) as rig:
        yield rig


def metrics(rig: PanelRig) -> dict[tuple[str, str], float]:
    """Return the metrics by name and label."""
    families = text_string_to_metric_families(rig.here.get("/metrics").text)
    return {
        (sample.name.removeprefix("transplanter_"), "".join(sample.labels.values())): sample.value
        for family in families
        for sample in family.samples
    }


def test_the_parts_of_the_panel_start_again_at_any_moment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each fails once, at a moment of its own; the machine, the view and the orders go on."""
    monkeypatch.setattr(app, "HISTORY_CHECK_S", 0.02)
    monkeypatch.setattr("controller.hmi.panel.view.trends.WRITE_MS", 20)
    monkeypatch.setattr("controller.hmi.panel.orders.operator.FORCE_RENEWAL_MS", 50)
    parts: dict[str, tuple[type, str]] = {
        "panel poll": (Mirror, "update"),
        "panel view": (ViewBuilder, "view"),
        "forced inputs": (OrderHandler, "_renew_forces"),
        "newest alarm": (HistoryReader, "newest_alarm"),
        "trend writer": (Trends, "write"),
        "telemetry poll": (Telemetry, "_poll"),
    }
    failing = []
    for name, (owner, method) in parts.items():
        (call,) = drawn(name, 10, 1)
        failing.append(patch(monkeypatch, owner, method, call + 1))  # the first view is built before the tasks start
    tags = [TelemetryTag(name="total", table="input", address=0)]
    rig = PanelRig(
        tmp_path,
        switched_on(mode=Mode.MANUAL),
        allow_forcing=True,
        telemetry=lambda clock: Telemetry(ModbusConnection("127.0.0.1", 1), tags, clock),
    )
    with rig, rig.browser("maintain") as browser:
        browser.until(lambda view: view["machine"]["state"] == State.STOPPED)
        assert browser.order(type="force", point="X22", level=1)["ok"] is True
        found = metrics(rig)
        while {part for name, part in found if name == "panel_failures_total"} != {*parts}:
            browser.read()
            found = metrics(rig)
        assert [found["panel_failures_total", part] for part in parts] == [1] * len(parts)
        browser.until(lambda view: not view["forced"])
        assert browser.order(type="force", point="X22", level=1)["ok"] is True
        polls, number = rig.panel.mirror.polls, browser.view_number
        browser.until(lambda view: view["forced"] == ["X22"] and browser.view_number >= number + 3)
        assert rig.panel.mirror.polls > polls
        calls = [each.calls for each in failing]
        browser.until(lambda _: all(each.calls > before for each, before in zip(failing, calls, strict=True)))
        browser.until(lambda _: metrics(rig)["failures_total", ""] == len(parts))  # of the same process in this rig


@pytest.mark.parametrize("failing", drawn("jog", JOGS))
def test_a_defect_while_jogging_releases_the_output_until_the_button_is_pressed_again(
    failing: int, rig: PanelRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = ChangeRecorder.of_outputs(rig.twin)
    patch(monkeypatch, ModbusConnection, "write_bit", failing)
    with rig.browser("maintain") as browser:
        for _ in range(3 * JOGS):
            reply = jog(browser)
            rig.for_scans(3)
            if not reply["ok"]:
                break
        assert "press" in reply["text"]["en"]
        rig.until(lambda: failures() == {"jog": 1})  # the jog ends with the answer to its release
        assert jog(browser)["ok"] is False
        rig.until(lambda: not coil(rig))
        assert [change.on for change in recorder.of(OUTPUT)] == [True, False][: 2 * min(failing, 1)]
        assert browser.order(type="jog", output=OUTPUT, hold=False)["ok"] is True
        assert jog(browser)["ok"] is True
        rig.until(lambda: coil(rig))


@pytest.mark.parametrize(
    ("task", "function", "failing", "error"),
    [
        ("browser views", "delta", *drawn("browser views", JOGS, 1), DefectError),
        ("browser views", "delta", *drawn("closed socket", JOGS, 1), RuntimeError),  # as from a closed socket
        ("browser orders", "read_order", *drawn("browser orders", JOGS, 1), DefectError),
    ],
)
def test_a_defect_in_a_socket_closes_it_and_releases_what_its_browser_jogs(
    task: str, function: str, failing: int, error: type[Exception], rig: PanelRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    with rig.browser("maintain") as browser:
        monkeypatch.setattr(sockets, function, FailsOnce(getattr(sockets, function), failing, error))
        with pytest.raises(ConnectionClosedError) as closed:
            _jog_for_ever(rig, browser)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == sockets.FAILURE
    rig.until(lambda: not coil(rig))
    assert failures() == {task: 1}
    with rig.browser("maintain") as browser:
        assert jog(browser)["ok"] is True


def _jog_for_ever(rig: PanelRig, browser: Browser) -> Never:
    while True:
        jog(browser)
        rig.for_scans(3)


@pytest.mark.parametrize("failing", drawn("order", JOGS, 1))
def test_an_order_with_a_defect_has_no_reply_and_the_others_have(
    failing: int, rig: PanelRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch(monkeypatch, OrderHandler, "_dispatch", failing)
    with rig.browser("operate") as browser:
        sent = [browser.send(type="acknowledge", alarm=7) for _ in range(JOGS)]
        others = [id_ for number, id_ in enumerate(sent) if number != failing]
        assert {browser.reply(id_)["ok"] for id_ in others} == {False}
        assert not browser.is_answered(sent[failing])
    assert failures() == {"order": 1}


@pytest.mark.parametrize("failing", drawn("panel request", JOGS, 1))
def test_a_request_with_a_defect_is_answered_and_counted(
    failing: int, rig: PanelRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch(monkeypatch, Trends, "answer", failing)
    query = {"span": "60000", "points": "10"}
    codes = [rig.here.get("/api/trends", params=query).status_code for _ in range(JOGS)]
    assert codes == [200] * failing + [500] + [200] * (JOGS - 1 - failing)
    assert failures() == {"panel request": 1}


def test_what_is_lost_is_in_the_metrics(rig: PanelRig) -> None:
    lost = {"events": 3, "history": 70_000, "capture": 5, "log": 6, "trends": 7}
    for item, count in lost.items():
        drop(item, count)
    with rig.browser() as browser:
        browser.until(lambda _: metrics(rig)["dropped_total", "events"] == lost["events"])
    found = metrics(rig)
    assert {item: found["dropped_total", item] for item in lost if item != "trends"} == {
        item: count for item, count in lost.items() if item != "trends"
    }
    assert {label: value for (name, label), value in found.items() if name == "panel_dropped_total"} == {
        "trends": 7,
        "log": 6,
    }
